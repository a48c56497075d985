"""Exact averages over the cells of a grid of the tractions that contacts are made of.

Each profile has a closed antiderivative over the rectangle from the contact's centre to a cell
corner. The contact's rim cuts the rectangle, and four corners make a cell. Neighbours share
corners, so the sum over a grid that holds the whole contact is the load itself, to rounding.
"""

import math

import numpy as np
from numpy.typing import NDArray

from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.grid import Grid


def root_average(grid: Grid, centre: tuple[float, float], radius: float) -> Array:
    """Return the averages of √(a² - ρ²), m: the Hertz profile.

    Parameters
    ----------
    grid : Grid
        The cells.
    centre : (x, y) float, m
        Centre of the contact.
    radius : float, m
        Its radius a.

    Returns
    -------
    (rows, cols) float, m
        Averages over the cells, 0 outside the contact.
    """
    x, y = _corners(grid, centre)
    total = _difference(np.sign(x) * np.sign(y) * _root(abs(x), abs(y), radius))
    return np.maximum(total, 0.0) * _touched(x, y, radius) / grid.cell_area


def inverse_average(grid: Grid, centre: tuple[float, float], radius: float) -> Array:
    """Return the averages of 1/√(a² - ρ²), 1/m: the flat punch's and the stuck shear profile.

    Parameters and shape are those of `root_average`.
    """
    x, y = _corners(grid, centre)
    total = _difference(np.sign(x) * np.sign(y) * _inverse(abs(x), abs(y), radius))
    return np.maximum(total, 0.0) * _touched(x, y, radius) / grid.cell_area


def twist_average(grid: Grid, centre: tuple[float, float], radius: float) -> Array:
    """Return the averages of (-y, x)/√(a² - ρ²), no unit: the twisted stuck disc's profile.

    Parameters are those of `root_average`; the result is (rows, cols, 2).
    """
    x, y = _corners(grid, centre)
    along_x = -_difference(_moment(y, x, radius))
    along_y = _difference(_moment(x, y, radius))
    touched = _touched(x, y, radius)[..., None]
    return np.stack([along_x, along_y], axis=-1) * touched / grid.cell_area


def _corners(grid: Grid, centre: tuple[float, float]) -> tuple[Array, Array]:
    checks.record("grid", grid, Grid)
    x, y = np.broadcast_arrays(grid.x_edges - centre[0], grid.y_edges[:, None] - centre[1])
    return x, y


def _touched(x: Array, y: Array, a: float) -> NDArray[np.bool_]:
    """Return which cells reach into the contact: only rounding is left in the others."""
    left, right, top, bottom = x[1:, :-1], x[1:, 1:], y[:-1, 1:], y[1:, 1:]
    near = np.hypot(np.clip(0.0, left, right), np.clip(0.0, top, bottom))
    return np.asarray(near < a)


def _difference(corners: Array) -> Array:
    return np.diff(np.diff(corners, axis=0), axis=1)


def _root(x: Array, y: Array, a: float) -> Array:
    """Return the integral of √(a² - ρ²) over [0, x] by [0, y], for x, y >= 0."""
    x, y, bend = _clipped(x, y, a)
    h = _height(bend, y, a)
    inner = (
        bend * y * h
        + (1.5 * a * a * bend - bend**3 / 2) * np.arctan2(y, h)
        + (1.5 * a * a * y - y**3 / 2) * np.arctan2(bend, h)
        - a**3 * np.arctan2(bend * y, a * h)
    ) / 3
    tail = math.pi / 4 * (a * a * (x - bend) - (x**3 - bend**3) / 3)
    return np.asarray(inner + tail)


def _inverse(x: Array, y: Array, a: float) -> Array:
    """Return the integral of 1/√(a² - ρ²) over [0, x] by [0, y], for x, y >= 0."""
    x, y, bend = _clipped(x, y, a)
    h = _height(bend, y, a)
    inner = bend * np.arctan2(y, h) + y * np.arctan2(bend, h) - a * np.arctan2(bend * y, a * h)
    return np.asarray(inner + math.pi / 2 * (x - bend))


def _moment(x: Array, y: Array, a: float) -> Array:
    """Return a function whose ∂²/∂x∂y is x/√(a² - ρ²): minus the integral of √ over [0, y]."""
    half = np.sqrt(np.maximum(a * a - x * x, 0.0))
    y = np.clip(y, -half, half)
    h = _height(x, y, a)
    return np.asarray(-(y * h + half * half * np.arctan2(y, h)) / 2)


def _clipped(x: Array, y: Array, a: float) -> tuple[Array, Array, Array]:
    """Return x and y cut to the disc, and where on [0, x] the line y leaves it."""
    x, y = np.minimum(x, a), np.minimum(y, a)
    return x, y, np.minimum(x, np.sqrt((a - y) * (a + y)))


def _height(x: Array, y: Array, a: float) -> Array:
    return np.sqrt(np.maximum(a * a - x * x - y * y, 0.0))
