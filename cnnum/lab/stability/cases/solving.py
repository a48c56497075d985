"""Solutions that share nothing with the engines: implicit steps of SciPy, and matrix functions."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from cnnum.arrays import Floats


def coupled(weights: Floats, outputs: Floats, outside: str) -> Floats:
    """Return the sum over the neighbourhood of one layer, by shifted copies.

    Parameters
    ----------
    weights : (k, k) float
        Correlation weights.
    outputs : (rows, cols) float
    outside : str
        As `numpy.pad` names it: "edge", "wrap" or "constant" (0).
    """
    radius, (rows, cols) = len(weights) // 2, outputs.shape
    pad: Any = np.pad
    around: Floats = pad(outputs, radius, mode=outside)
    total: Floats = np.zeros_like(outputs)
    for r, row in enumerate(weights):
        for c, weight in enumerate(row):
            total = total + weight * around[r : r + rows, c : c + cols]
    return total


def standard(state: Floats) -> Floats:
    """Return the piecewise linear output, as Chua & Yang (1988) write it."""
    return 0.5 * (np.abs(state + 1.0) - np.abs(state - 1.0))


def integrated(
    weights: ArrayLike,
    drive: ArrayLike,
    start: Floats,
    time: float,
    *,
    outside: str = "constant",
    taus: Sequence[float] = (1.0,),
    rtol: float = 1e-10,
) -> Floats:
    """Return the state of a saturating array, by Radau IIA of order 5.

    Parameters
    ----------
    weights : (layers, layers, k, k) float
    drive : float, or (layers, rows, cols) float
        B∗u + z.
    start : (layers, rows, cols) float
    time : float
    outside : str
        See `coupled`.
    taus : sequence of float
        Time constant of each layer.
    rtol : float
        Steps that jump over a corner of f may be off by a thousand times as much.
    """
    A, layers = np.asarray(weights, dtype=np.float64), len(start)
    constant = np.asarray(drive, dtype=np.float64)
    rates = (1.0 / np.asarray(taus)).reshape(-1, 1, 1)

    def slope(_: float, flat: Floats) -> Floats:
        x = flat.reshape(start.shape)
        y = standard(x)
        sums = [
            [coupled(A[to, of], y[of], outside) for of in range(layers)] for to in range(layers)
        ]
        rate = (np.sum(np.array(sums), axis=1) - x + constant) * rates
        return np.asarray(rate, dtype=np.float64).ravel()

    solution = solve_ivp(slope, (0.0, time), start.ravel(), "Radau", rtol=rtol, atol=rtol)
    return np.asarray(solution.y[:, -1], dtype=np.float64).reshape(start.shape)


def linear(matrix: Floats, drive: Floats, start: Floats, time: float) -> Floats:
    """Return the solution of x' = M x + w at a time, by the exponential of a matrix."""
    n = len(start)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = matrix, drive
    return np.asarray((expm(whole * time) @ np.append(start, 1.0))[:n], dtype=np.float64)
