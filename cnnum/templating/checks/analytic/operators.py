"""Spatial operators by name, from differences and means of shifted pictures."""

from collections.abc import Callable, Mapping

import numpy as np

from cnnum.arrays import Floats
from cnnum.templating.boundary import Boundary

Operator = Callable[[Floats, Boundary], Floats]


def neighbours(
    picture: Floats, boundary: Boundary, radius: int = 1
) -> Callable[[int, int], Floats]:
    """Return a function of (row step, column step) that gives each cell that neighbour's value."""
    rows, cols = picture.shape[-2:]
    rim = [(0, 0)] * (picture.ndim - 2) + [(radius, radius)] * 2
    if boundary.constant is None:
        padded = np.pad(picture, rim, mode=boundary.pad_mode)
    else:
        padded = np.pad(picture, rim, constant_values=boundary.constant)

    def at(down: int, east: int) -> Floats:
        top, left = radius + down, radius + east
        return padded[..., top : top + rows, left : left + cols]

    return at


def _same(picture: Floats, boundary: Boundary) -> Floats:
    """Return the picture itself."""
    return picture


def _east(picture: Floats, boundary: Boundary) -> Floats:
    """Return the central difference along a row, towards rising columns."""
    at = neighbours(picture, boundary)
    return (at(0, 1) - at(0, -1)) / 2.0


def _south(picture: Floats, boundary: Boundary) -> Floats:
    """Return the central difference along a column, towards rising rows."""
    at = neighbours(picture, boundary)
    return (at(1, 0) - at(-1, 0)) / 2.0


def _slope_east(picture: Floats, boundary: Boundary) -> Floats:
    """Return a smoothed difference along a row, its rows weighed 0.11, 0.28 and 0.11."""
    at = neighbours(picture, boundary)
    rows = [at(down, 1) - at(down, -1) for down in (-1, 0, 1)]
    return 0.28 * rows[1] + 0.11 * (rows[0] + rows[2])


def _fall_east(picture: Floats, boundary: Boundary) -> Floats:
    """Return how far each cell lies above its neighbour to the east."""
    return picture - neighbours(picture, boundary)(0, 1)


def _between(picture: Floats, boundary: Boundary) -> Floats:
    """Return half the sum of the four sides less a quarter of that of the four corners."""
    at = neighbours(picture, boundary)
    sides = at(0, 1) + at(0, -1) + at(1, 0) + at(-1, 0)
    corners = at(1, 1) + at(1, -1) + at(-1, 1) + at(-1, -1)
    return sides / 2.0 - corners / 4.0


def _laplacian(picture: Floats, boundary: Boundary) -> Floats:
    at = neighbours(picture, boundary)
    return at(0, 1) + at(0, -1) + at(1, 0) + at(-1, 0) - 4.0 * picture


def _binomial(picture: Floats, boundary: Boundary) -> Floats:
    at = neighbours(picture, boundary)
    rows = [(at(-1, e) + 2.0 * at(0, e) + at(1, e)) / 4.0 for e in (-1, 0, 1)]
    return (rows[0] + 2.0 * rows[1] + rows[2]) / 4.0


def _divergence(field: Floats, boundary: Boundary) -> Floats:
    """Return ∂q_x/∂x + ∂q_y/∂y of (..., 2, rows, cols)."""
    return _east(field[..., 0, :, :], boundary) + _south(field[..., 1, :, :], boundary)


def _curl(field: Floats, boundary: Boundary) -> Floats:
    """Return ∂q_y/∂x − ∂q_x/∂y of (..., 2, rows, cols)."""
    return _east(field[..., 1, :, :], boundary) - _south(field[..., 0, :, :], boundary)


SCALAR: Mapping[str, Operator] = {
    "identity": _same,
    "gradient-x": _east,
    "slope-x": _slope_east,
    "gradient-y": _south,
    "fall-x": _fall_east,
    "between": _between,
    "laplacian": _laplacian,
    "binomial": _binomial,
}
"""Operators on one picture."""

VECTOR: Mapping[str, Operator] = {"divergence": _divergence, "curl": _curl}
"""Operators on a field of two components."""
