"""How far states at rest are from the equilibrium that their array truly comes to.

A run is off by at most its error E. So the true state lies in the box of that half-width around its
end. Let d bound f' in the box, and

    C = diag(1 − max(a_ii, 0) d_i) − (|a_ij| d_j),  i ≠ j.

If C u = 1 has a positive solution, C is an M-matrix: the array contracts there in the norm max
|v_i| / u_i. The source is Berman & Plemmons, Nonnegative Matrices in the Mathematical Sciences
(1979), ch. 6. Both states then come to one equilibrium. It is at most max C⁻¹ |dx/dt| τ away,
whatever the error of the way was.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.runs.equilibrium import ROUNDINGS, RatedArray
from cnnum.templating.template import Template

OUTPUTS = ("standard", "linear", "tanh", "full-range")
"""Output functions whose slopes in a box are known."""

MOST_CELLS = 300
"""States up to which the matrix of a frame is solved, in some milliseconds."""

EPSILON = float(np.finfo(np.float64).eps)

SPARE = 1e-6
"""Part of a bound that covers the roundings of its solution."""


def may_contract(template: Template) -> bool:
    """Return whether arrays of a template are looked at: couplings are linear, slopes known."""
    return template.plain and template.output.name in OUTPUTS


def distances(
    template: Template, given: Mapping[str, Floats], state: Floats, error: Floats
) -> Floats:
    """Return a bound on the distance from states to the equilibrium they truly come to, (batch,).

    Parameters
    ----------
    template : Template
        See `may_contract`.
    given : mapping of str to (batch or 1, maps, rows, cols) float
        Input, bias and mask, as far as the run is given them.
    state : (batch, layers, rows, cols) float
    error : (batch,) float
        Of the states, as those of a run.

    Returns
    -------
    (batch,) float
        Infinite where no contraction is shown.
    """
    array, batch = RatedArray(template, given, state), len(state)
    reach = error.reshape(-1, 1, 1, 1)
    held = ~array.moving | _pushed(array, reach)
    sizes = np.abs(array.rates) * (1.0 + SPARE) + ROUNDINGS * EPSILON * array.sizes
    rates = np.where(held, 0.0, sizes).reshape(batch, -1)
    slopes = np.where(held, 0.0, _slopes(template, state, reach)).reshape(batch, -1)
    found = np.where(slopes.any(axis=1), np.inf, rates.max(axis=1, initial=0.0))
    rest = np.flatnonzero(slopes.any(axis=1))
    if len(rest) and state[0].size <= MOST_CELLS:
        weights = array.weights().toarray()
        for frame in rest:
            found[frame] = _distance(weights, slopes[frame], rates[frame], held[frame].ravel())
    # the slopes hold in the box alone
    return np.where(found <= np.maximum(error, 0.0), found, np.inf)


def _pushed(array: RatedArray, reach: Floats) -> NDArray[np.bool_]:
    """Return the cells of a limited state that its rates keep at a limit all over the box."""
    if not array.template.output.limited:
        return np.zeros(array.x.shape, dtype=np.bool_)
    seen = np.abs(array.template.A).sum(axis=(1, 2, 3)).reshape(-1, 1, 1)
    outwards = array.rates * np.sign(array.x)
    with np.errstate(invalid="ignore"):  # an error may be infinite, and A be 0
        pushed = (np.abs(array.x) >= 1.0) & (outwards > seen * reach)
    return np.asarray(pushed, dtype=np.bool_)


def _slopes(template: Template, state: Floats, reach: Floats) -> Floats:
    """Return bounds on f' in the box around states."""
    name = template.output.name
    if name == "standard":
        return np.asarray(np.abs(state) <= 1.0 + reach, dtype=np.float64)
    if name == "tanh":
        with np.errstate(over="ignore"):
            least = np.maximum(np.abs(state) - reach, 0.0)
            return np.asarray(np.cosh(np.minimum(least, 300.0)) ** -2.0, dtype=np.float64)
    return np.ones_like(state)


def _distance(weights: Floats, slopes: Floats, rates: Floats, held: NDArray[np.bool_]) -> float:
    """Return the largest of C⁻¹ · rates; infinite where C is no M-matrix."""
    own = np.diag(weights)
    matrix = -np.abs(weights) * slopes
    matrix[held] = 0.0
    np.fill_diagonal(matrix, 1.0 - np.where(held, 0.0, np.maximum(own, 0.0) * slopes))
    sides = np.stack([np.ones_like(rates), rates], axis=1)
    try:
        solved = np.linalg.solve(matrix, sides)
    except np.linalg.LinAlgError:
        return np.inf
    return float(solved[:, 1].max()) if bool((solved[:, 0] > 0.0).all()) else np.inf
