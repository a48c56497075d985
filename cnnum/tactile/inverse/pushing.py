"""Regularised least squares under the condition that pressure pushes and never pulls."""

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

from cnnum.tactile.checks import Array


def pushing_only(square: Array, pull: Array, positive: NDArray[np.bool_]) -> Array:
    """Return u with the least ½ uᵀ H u − gᵀ u and u ≥ 0 where it is asked for.

    The free unknowns are eliminated (Schur complement). So the rest is a non-negative least squares
    problem for its Cholesky factor.

    Parameters
    ----------
    square : (n, n) float
        H, symmetric positive definite.
    pull : (n,) float
        g.
    positive : (n,) bool
        At least one.

    References
    ----------
    Lawson and Hanson, Solving Least Squares Problems (1974), ch. 23.
    """
    free = ~positive
    coupling = square[np.ix_(free, positive)]
    carried = _solved(square[np.ix_(free, free)], np.column_stack([coupling, pull[free]]))
    rest = square[np.ix_(positive, positive)] - coupling.T @ carried[:, :-1]
    root = np.linalg.cholesky(rest)
    aim = linalg.solve_triangular(root, pull[positive] - coupling.T @ carried[:, -1], lower=True)
    result = np.empty_like(pull)
    result[positive] = cast(Any, optimize.nnls(root.T, aim))[0]
    result[free] = carried[:, -1] - carried[:, :-1] @ result[positive]
    return result


def _solved(square: Array, right: Array) -> Array:
    """Return square⁻¹ right; nothing for nothing."""
    if not len(square):
        return right
    return np.asarray(
        cast(Any, linalg.cho_solve(linalg.cho_factor(square), right)), dtype=np.float64
    )
