"""The point load seen by many taxels: strain, its derivatives, and the best force for a place.

Lengths here are in units of the depth, so that z = 1.
"""

import numpy as np

from cnnum.tactile.checks import Array


def directions(offset: Array) -> Array:
    """Return (..., n, 3) the strain rows for Qx + Ry + F = 1, without 3/(4πEz²), (4.16)."""
    x, y = offset[..., 0], offset[..., 1]
    squared = x**2 + y**2
    rows = np.stack([-3.0 * x, -3.0 * y, squared - 2.0], axis=-1)
    return np.asarray(rows / ((squared + 1.0) ** 2.5)[..., np.newaxis], dtype=np.float64)


def lever(offset: Array) -> Array:
    """Return (..., n, 3) the rows (x, y, 1) of Qx + Ry + F."""
    return np.concatenate([offset, np.ones((*offset.shape[:-1], 1))], axis=-1)


def linear_part(offset: Array, weights: Array) -> Array:
    """Return (..., 3n, 3): weighted strain for each component of the force."""
    rows = (weights * directions(offset))[..., :, np.newaxis] * lever(offset)[..., np.newaxis, :]
    return rows.reshape(*rows.shape[:-3], -1, 3)


def place_part(offset: Array, force: Array, weights: Array) -> Array:
    """Return (..., 3n, 2): weighted change of strain as the load moves along x and y."""
    squared = np.sum(offset**2, axis=-1)[..., np.newaxis]
    rows = directions(offset)
    seen = np.sum(lever(offset) * force[..., np.newaxis, :], axis=-1)[..., np.newaxis]
    columns: list[Array] = []
    for axis in (0, 1):
        along = offset[..., axis, np.newaxis]
        slope = np.zeros_like(rows)
        slope[..., axis] = -3.0
        slope[..., 2] = 2.0 * offset[..., axis]
        slope = slope / (squared + 1.0) ** 2.5 - 5.0 * along / (squared + 1.0) * rows
        change = slope * seen + rows * force[..., np.newaxis, axis, np.newaxis]
        columns.append(-weights * change)  # the offset is taxel − load
    whole = np.stack(columns, axis=-1)
    return whole.reshape(*whole.shape[:-3], -1, 2)


def best_force(design: Array, target: Array) -> tuple[Array, Array]:
    """Return the least-squares force and the sum of squares it leaves.

    Parameters
    ----------
    design : (..., m, 3) float
    target : (..., m) float
    """
    inverse = np.linalg.pinv(design, rcond=1e-11)
    force = np.asarray((inverse @ target[..., np.newaxis])[..., 0], dtype=np.float64)
    return force, squares_left(design, force, target)


def squares_left(design: Array, force: Array, target: Array) -> Array:
    """Return the sum of squares of target − design · force."""
    left = target - (design @ force[..., np.newaxis])[..., 0]
    return np.asarray(np.sum(left**2, axis=-1), dtype=np.float64)
