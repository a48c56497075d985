"""Proof of an equilibrium near a state at which an array seems to rest, and its distance.

A true state lies within `reach` of a state x. Let d bound the slopes of the couplings in a box
around x, and

    C = 1 − diag(the largest own slopes) − (sizes of the others).

If C u > 0 for some u > 0, C is an M-matrix: differences of two states fall in the norm
max |v_i| / u_i while both are in the box (Berman & Plemmons, Nonnegative Matrices in the
Mathematical Sciences, 1979, ch. 6). If C r ≥ |τ dx/dt| at x, the rates point into the box of
half-width r on all its faces, so that an equilibrium lies there (Brouwer). All states within
`reach` come to it, if the box holds the ball around it that holds them: half-width r + k u, where
k = max (reach + r)_i / u_i. Both hold with delays, too, in the largest norm over the past, and
where a state is limited.

Where weights of both signs balance, C is no M-matrix, though the array is stable. Then a quadratic
form V = vᵀ P v falls: P is Lyapunov's solution of Jᵀ P + P J = −1, or τ where A is symmetric. How
much J differs in the box from that at x is allowed for.

Small rates are no proof: a state may pass a bottleneck, or leave a saddle, as slowly as one likes.
So an equilibrium is looked for near the state, by Newton's steps, and around it a region in which
the array contracts. Where there is none the eigenvalues of the Jacobian say whether it leaves.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
# (the types of SciPy's sparse matrices are known in part)
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError, solve_continuous_lyapunov
from scipy.sparse import csgraph, linalg

from cnnum.arrays import Floats
from cnnum.runs.cells import EPSILON, Flags, Frame, output_slopes, own_output

MOST_DENSE = 300
"""States up to which matrices are dense; a solution takes some milliseconds."""

MOST_SPARSE = 20_000
"""States up to which a sparse factorisation takes less than a second."""

SWEEPS = 200
"""Iterations for a solution where states are more: each is one look at all neighbours."""

WIDENED = 8
"""Times that a box is made wider until it holds its ball."""

SPARE = 1e-6
"""Part of a bound that covers the roundings of its solution."""

GAPS = (0.3, 0.03, 3e-3, 3e-4, 3e-5)
"""Least eigenvalues of 1 − A that are tried for, the largest first."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A box around a state from which an array comes to one equilibrium.

    Attributes
    ----------
    off : (n,) float
        How far the equilibrium is from the state at most, cell by cell.
    width : (n,) float
        Half-width of the box, which no true state leaves.
    """

    off: Floats
    width: Floats


def region(frame: Frame, x: Floats, reach: Floats, *, close: bool = True) -> Region | None:
    """Return the region that holds all states within reach of a state, or None if none is shown.

    Parameters
    ----------
    frame : Frame
    x : (n,) float
    reach : (n,) float
        May be infinite: the array then comes to one equilibrium from anywhere.
    close : bool
        Whether quadratic forms are tried, too; they take longer.
    """
    with np.errstate(all="ignore"):
        result = _by_rows(frame, x, reach)
        if result is None and close and bool(np.isfinite(reach).all()):
            result = _by_energy(frame, x, reach) or _by_form(frame, x, reach)
    return result


def _by_rows(frame: Frame, x: Floats, reach: Floats) -> Region | None:
    """Return a region by the rows of an M-matrix."""
    rate, rounded = frame.rates(x)
    sizes = np.abs(rate) * (1.0 + 8.0 * EPSILON) + rounded
    width = reach.copy()
    for _ in range(WIDENED):
        held = ~frame.moving | frame.pushed(x, width)
        slopes = frame.slopes(x - width, x + width)
        own = np.where(held, 0.0, slopes.own)
        others = sparse.diags(np.where(held, 0.0, 1.0)) @ slopes.others
        if not (bool((own < 1.0).all()) and bool(np.isfinite(others.data).all())):
            return None
        force = np.where(held, 0.0, sizes)
        solved = _solved(own, others, force)
        if solved is None:
            return None
        u, off = solved
        wide = off + u * float(((reach + off) / u).max(initial=0.0))
        wide = np.where(frame.moving, wide, 0.0)
        if bool((wide <= width).all()):
            return Region(off, width)
        width = np.maximum(width, wide * (1.0 + SPARE))
    return None


def _solved(own: Floats, others: Any, force: Floats) -> tuple[Floats, Floats] | None:
    """Return u > 0 with C u > 0, and r with C r ≥ force, or None if there is no such u."""

    def through(v: Floats) -> Floats:
        return np.asarray((1.0 - own) * v - others @ v, dtype=np.float64)

    u = r = None
    if len(own) <= MOST_DENSE:
        matrix = np.diag(1.0 - own) - others.toarray()
        try:
            both = np.linalg.solve(matrix, np.stack([np.ones_like(force), force], axis=1))
        except np.linalg.LinAlgError:
            return None
        u, r = both[:, 0], both[:, 1]
    else:
        u, r = np.zeros_like(force), np.zeros_like(force)
        for _ in range(SWEEPS):
            u, r = (1.0 + others @ u) / (1.0 - own), (force + others @ r) / (1.0 - own)
        if not bool((through(u) > 0.1).all()) and len(own) <= MOST_SPARSE:
            matrix = (sparse.diags(1.0 - own) - others).tocsc()
            try:
                factors = linalg.splu(matrix)
            except RuntimeError:
                return None
            u, r = factors.solve(np.ones_like(force)), factors.solve(force)
    left = through(u)
    spare = len(own) * 8.0 * EPSILON * u.max(initial=0.0)
    if not (bool((u > 0.0).all()) and bool((left > SPARE * (1.0 - own) * u + spare).all())):
        return None
    r = np.maximum(r, 0.0) * (1.0 + SPARE)
    short = bool((through(r) * (1.0 + EPSILON) < force).any())
    least = u * float((force / left).max(initial=0.0)) * (1.0 + SPARE)
    return u, least if short else np.minimum(r, least)


def _kept_in(frame: Frame, x: Floats, width: Floats, held: Flags) -> bool:
    """Return whether quadratic forms say something: no limited state meets its limit."""
    if not frame.cells.template.output.limited:
        return True
    return bool((np.abs(x) + width < 1.0)[~held].all()) and not bool((held & (width > 0.0)).any())


def _by_form(frame: Frame, x: Floats, reach: Floats) -> Region | None:
    """Return a region by a Lyapunov function, for arrays with linear couplings and few cells."""
    cells = frame.cells
    if cells.pairs or cells.delays or own_output(cells.template) or cells.count > MOST_DENSE:
        return None
    at = np.flatnonzero(frame.moving)
    if not len(at):
        return None
    tau = cells.tau[at]
    matrix = cells.matrix.toarray()[np.ix_(at, at)] / tau[:, np.newaxis]
    least, most = output_slopes(cells.template, x, x)
    slope = 0.5 * (least + most)[at]
    jacobian = matrix * slope - np.diag(1.0 / tau)
    if not float(np.linalg.eigvals(jacobian).real.max()) < -GAPS[-1] / float(tau.max()):
        return None
    try:
        form = solve_continuous_lyapunov(jacobian.T, -np.eye(len(at)))
        form = 0.5 * (form + form.T)
        sizes = np.linalg.eigvalsh(form)
        inverse = np.diag(np.linalg.inv(form)).copy()
    except (LinAlgError, np.linalg.LinAlgError, ValueError):
        return None
    rounded = len(at) * 8.0 * EPSILON
    if not sizes[0] > rounded * sizes[-1] or not bool((inverse > 0.0).all()):
        return None
    falls = -(jacobian.T @ form + form @ jacobian)
    margin = float(np.linalg.eigvalsh(falls)[0]) - rounded * sizes[-1] * np.abs(jacobian).max()
    rate, rounding = frame.rates(x)
    force = (np.abs(rate) + rounding)[at] / tau
    pull = float(np.linalg.norm(np.abs(form) @ force))
    width = reach[at].copy()
    for _ in range(WIDENED):
        wide = np.zeros(cells.count)
        wide[at] = width
        if not _kept_in(frame, x, wide, ~frame.moving):
            return None
        low, high = output_slopes(cells.template, x - wide, x + wide)
        away = np.maximum(np.abs(low[at] - slope), np.abs(high[at] - slope))
        change = np.abs(form) @ (np.abs(matrix) * away)
        steep = margin - float((change + change.T).sum(axis=1).max())
        if not steep > 0.0:
            return None
        off = np.sqrt(sizes[-1] * inverse) * (2.0 * pull / steep) * (1.0 + SPARE)
        start = reach[at] + off
        around = np.sqrt(float(start @ np.abs(form) @ start) * inverse) * (1.0 + SPARE)
        if bool((off + around <= width).all()):
            whole = np.zeros(cells.count)
            whole[at] = off
            return Region(whole, wide)
        width = np.maximum(width, (off + around) * (1.0 + SPARE))
    return None


def _by_energy(frame: Frame, x: Floats, reach: Floats) -> Region | None:
    """Return a region where A is symmetric among the cells of a linear range, by its inertia."""
    cells, template = frame.cells, frame.cells.template
    if cells.pairs or cells.delays or template.output.name not in ("standard", "linear"):
        return None
    if own_output(template) or cells.count > MOST_SPARSE or (
        cells.count <= MOST_DENSE and not template.output.linear):  # fmt: skip
        return None
    low, high = output_slopes(template, x - reach, x + reach)
    if bool((low != high)[frame.moving].any()):
        return None
    at = np.flatnonzero(frame.moving & (high > 0.0))
    rest = np.flatnonzero(frame.moving & (high == 0.0))
    inner = cells.matrix[at][:, at].tocsc()
    if len(at) and abs(inner - inner.T).max() > 0.0:
        return None
    gap = _gap(sparse.identity(len(at), format="csc") - inner) if len(at) else 1.0
    if gap is None:
        return None
    rate, rounded = frame.rates(x)
    force, tau = np.abs(rate) + rounded, cells.tau[at]
    off, width = np.zeros(cells.count), np.zeros(cells.count)
    # vᵀ τ v falls while |v| is above |force| / gap
    pull = float(np.linalg.norm(force[at])) / gap
    off[at] = pull * np.sqrt(tau.max(initial=1.0) / tau) * (1.0 + SPARE)
    start = np.sqrt(float((tau * (reach[at] + off[at]) ** 2).sum()))
    width[at] = off[at] + start / np.sqrt(tau) * (1.0 + SPARE)
    seen = cells.sizes[rest][:, at]
    off[rest] = (force[rest] + seen @ off[at]) * (1.0 + SPARE)
    width[rest] = np.maximum(off[rest] + reach[rest], off[rest] + seen @ width[at]) * (1.0 + SPARE)
    low, high = output_slopes(template, x - width, x + width)
    same = bool((high[at] == low[at]).all()) and not bool(high[rest].any())
    return Region(off, width) if same else None


def _gap(matrix: Any) -> float | None:
    """Return a bound below the eigenvalues of a symmetric matrix that is above 0, if one is shown.

    Without exchanges of rows the signs of U are those of the eigenvalues (Sylvester).
    """
    identity = sparse.identity(matrix.shape[0], format="csc")
    for gap in GAPS:
        if signs(matrix - gap * identity) == 0:
            return gap
    return None


def signs(matrix: Any) -> int | None:
    """Return how many eigenvalues of a symmetric matrix are below 0; None on the edge of it."""
    options = {"SymmetricMode": True}
    factorise: Any = linalg.splu
    try:
        factors = factorise(
            matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
        )
    except RuntimeError:
        return None
    diagonal = factors.U.diagonal()
    if not bool((factors.perm_r == factors.perm_c).all()) or not bool(np.isfinite(diagonal).all()):
        return None
    return int((diagonal < 0.0).sum())


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
        Stability of the equilibrium at the state; "unknown" also if there is none.
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
        Largest distance of the true state.
    tolerance : (n,) float
    """
    if frame.cells.template.output.limited:
        x = np.where(frame.moving, np.clip(x, -1.0, 1.0), x)
    from_here = np.where(frame.moving, reach, 0.0)
    result = region(frame, x, from_here, close=False)
    if result is not None and bool((result.off <= tolerance).all()):
        return Verdict("stable", x, float(result.off.max(initial=0.0)))
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
    growing = unstable(frame, at)
    if growing is None:
        return Verdict("unknown", x, np.inf, decided=False)
    return Verdict("unstable" if growing else "unknown", x, np.inf)


def newton(frame: Frame, x: Floats) -> Floats | None:
    """Return the equilibrium that Newton's method finds from a state, or None if it finds none."""
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
    """Return whether a large matrix has an eigenvalue above a growth, or None if it is not known.

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
