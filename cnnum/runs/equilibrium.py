"""Whether a state at which an array seems to rest is an equilibrium that it keeps.

Small rates are no proof: a state may pass a bottleneck, or leave a saddle, as slowly as one likes.
So an equilibrium is looked for near the state, by Newton's steps, and around it a region in which
the array contracts (`cnnum.runs.contraction`). Where there is none the eigenvalues of the Jacobian
say whether the array leaves.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
# (the types of SciPy's sparse matrices are known in part)

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph, linalg

from cnnum.arrays import Floats
from cnnum.runs.cells import EPSILON, Frame
from cnnum.runs.contraction import MOST_DENSE, MOST_SPARSE, region, signs

Stability = Literal["stable", "unstable", "unknown"]

NEWTON_STEPS = 12

NEAR = 0.01
"""Cells so near to saturation count as linear. An unstable equilibrium is named if the state is so
near to it, in units of the state."""

GROWS = 1e-9
"""Rate of growth above which an eigenvalue is no rounding, 1/τ."""


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """The findings on one state.

    Attributes
    ----------
    stability : "stable", "unstable" or "unknown"
        Of the equilibrium at the state; "unknown" also where there is none.
    state : (n,) float
        The equilibrium itself, where it is further away than the tolerance.
    error : float
        How far the equilibrium is from that state that the array comes to from all states within
        the reach that was asked for; infinite where that is not shown.
    decided : bool
        Whether an array that is not shown to rest is shown not to: it may run on.
    """

    stability: Stability
    state: Floats
    error: float
    decided: bool = True


def verdict(frame: Frame, x: Floats, reach: float, tolerance: Floats) -> Verdict:
    """Return what is known of a state at which rates are small.

    Parameters
    ----------
    frame : Frame
    x : (n,) float
    reach : float
        How far off the true state is at most.
    tolerance : (n,) float
    """
    if frame.cells.template.output.limited:
        x = np.where(frame.moving, np.clip(x, -1.0, 1.0), x)
    from_here = np.where(frame.moving, reach, 0.0)
    found = region(frame, x, from_here, close=False)
    if found is not None and bool((found.off <= tolerance).all()):
        return Verdict("stable", x, float(found.off.max(initial=0.0)))
    rest = newton(frame, x)
    if rest is not None:
        away = np.abs(rest - x)
        for spread in (reach, 0.0) if reach else (0.0,):
            around = region(frame, rest, np.where(frame.moving, spread, 0.0) + away)
            if around is not None:
                near = bool((away <= tolerance).all())
                off = around.off + away if near else around.off
                error = float(off.max(initial=0.0)) if spread == reach else np.inf
                return Verdict("stable", x if near else rest, error)
    scale = NEAR * np.maximum(1.0, np.abs(x))
    at = rest if rest is not None and bool((np.abs(rest - x) <= scale).all()) else x
    grows = unstable(frame, at)
    if grows is None:
        return Verdict("unknown", x, np.inf, decided=False)
    return Verdict("unstable" if grows else "unknown", x, np.inf)


def newton(frame: Frame, x: Floats) -> Floats | None:
    """Return an equilibrium that Newton's steps come to from a state; None where there is none."""
    if frame.cells.count > MOST_SPARSE:
        return None
    limited = frame.cells.template.output.limited
    for _ in range(NEWTON_STEPS):
        rate, rounded = frame.rates(x)
        free = frame.moving.copy()
        if limited:
            free &= ~((np.abs(x) >= 1.0) & (rate * x > 0.0))
        at = np.flatnonzero(free)
        if bool((np.abs(rate[at]) <= rounded[at]).all()):
            return x
        step = _step(frame, x, rate, at)
        if step is None or not bool(np.isfinite(step).all()):
            return None
        x = x.copy()
        x[at] += step
        if limited:
            x = np.clip(x, -1.0, 1.0)
        if bool((np.abs(step) <= 4.0 * EPSILON * np.maximum(np.abs(x[at]), 1e-3)).all()):
            return x
    return None


def _step(frame: Frame, x: Floats, rate: Floats, at: Any) -> Floats | None:
    jacobian = frame.jacobian(x)[at][:, at]
    with np.errstate(all="ignore"):
        if len(at) <= MOST_DENSE:
            try:
                return np.asarray(np.linalg.solve(jacobian.toarray(), -rate[at]))
            except np.linalg.LinAlgError:
                return None
        try:
            return np.asarray(linalg.splu(jacobian.tocsc()).solve(-rate[at]))
        except RuntimeError:
            return None


def unstable(frame: Frame, x: Floats) -> bool | None:
    """Return whether the array leaves a state, by the eigenvalues there; None if it is not known.

    With a delay only real eigenvalues are looked at: if an odd number is above 0, one is with any
    delay.
    """
    cells = frame.cells
    rate, _ = frame.rates(x)
    free = frame.moving.copy()
    if cells.template.output.limited:
        free &= ~((np.abs(x) >= 1.0) & (rate * x > 0.0))
    at = np.flatnonzero(free)
    if not len(at):
        return False
    jacobian = frame.jacobian(x)[at][:, at]
    if not bool(np.isfinite(jacobian.data).all()):
        return None
    rates = (sparse.diags(1.0 / cells.tau[at]) @ jacobian).tocsr()
    growth = GROWS / float(cells.tau[at].max())
    if cells.delays:
        if len(at) > MOST_DENSE:
            return None
        sign, _ = np.linalg.slogdet(-rates.toarray())
        return True if sign < 0.0 else None
    if len(at) <= MOST_DENSE:
        return bool(np.linalg.eigvals(rates.toarray()).real.max() > growth)
    return _grows(rates, jacobian, growth)


def _grows(rates: Any, jacobian: Any, growth: float) -> bool | None:
    """Return whether a large matrix has an eigenvalue above a growth; None if it is not known.

    Its eigenvalues are those of its parts in which all cells act on each other, however these act
    on further ones.
    """
    count, part = csgraph.connected_components(jacobian, connection="strong")
    sizes = np.bincount(part, minlength=count)
    alone = sizes[part] == 1
    if bool((rates.diagonal()[alone] > growth).any()):
        return True
    known = True
    for number in np.flatnonzero(sizes > 1):
        at = np.flatnonzero(part == number)
        inner = rates[at][:, at]
        if len(at) <= MOST_DENSE:
            if float(np.linalg.eigvals(inner.toarray()).real.max()) > growth:
                return True
            continue
        own = jacobian[at][:, at]
        if (abs(own - own.T) > 0.0).nnz == 0 and len(at) <= MOST_SPARSE:
            below = signs(-own - GROWS * sparse.identity(len(at)))
            if below:
                return True
            known &= below is not None
            continue
        try:
            most = linalg.eigs(inner, k=1, which="LR", maxiter=300, return_eigenvectors=False)
        except (linalg.ArpackError, RuntimeError):
            known = False
            continue
        if float(most.real.max()) > growth:
            return True
        known = False  # another eigenvalue may lie further out than the one that it came to
    return False if known else None
