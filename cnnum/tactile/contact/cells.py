"""Exact averages over the cells of a grid of the tractions that contacts are made of.

Each profile has a closed antiderivative over the rectangle from the contact's centre to a cell
corner. The contact's rim cuts the rectangle, and four corners make a cell. Neighbours share
corners, so the sum over a grid that holds the whole contact is the load itself, to rounding.

Cell averages of a circumferential traction, from line integrals along the cells' edges.

A traction τ(ρ) around the centre is the curl of Φ(ρ), the integral of τ from ρ to the rim: q =
(∂Φ/∂y, -∂Φ/∂x). So a cell's average needs Φ on its edges alone, and each edge serves two cells. The
sum over all cells, a net force, is zero to rounding.
"""

import math
from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from cnnum.errors import ArrayError
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
        Radius a of the contact.

    Returns
    -------
    (rows, cols) float, m
        Averages over the cells, 0 outside the contact.
    """
    x, y = _corners(grid, centre)
    total = _difference(np.sign(x) * np.sign(y) * _root(abs(x), abs(y), radius))
    return np.maximum(total, 0.0) * _touched(x, y, radius) / grid.cell_area


def inverse_average(grid: Grid, centre: tuple[float, float], radius: float) -> Array:
    """Return the averages of 1/√(a² - ρ²), 1/m: the profile of a flat punch or of stuck shear.

    Parameters and the shape of the result are those of `root_average`.
    """
    x, y = _corners(grid, centre)
    total = _difference(np.sign(x) * np.sign(y) * _inverse(abs(x), abs(y), radius))
    return np.maximum(total, 0.0) * _touched(x, y, radius) / grid.cell_area


def twist_average(grid: Grid, centre: tuple[float, float], radius: float) -> Array:
    """Return the averages of (-y, x)/√(a² - ρ²) (dimensionless), as for a twisted stuck disc.

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


def cell_average(
    profile: Callable[[Array, Array], Array],
    grid: Grid,
    *,
    radius: float,
    centre: tuple[float, float] = (0.0, 0.0),
    nodes: int = 12,
) -> Array:
    """Return the averages over the cells of a field that is 0 outside a circle.

    The circle cuts each cell, whose sides are set to x = a sin φ, y = √(a² - x²) sin θ. This
    removes a root (or its inverse) at the rim from the integrand. The rest is summed over Gauss
    points between the places where the circle crosses the cell. For a field that is smooth inside,
    the averages and the total load are accurate to about 1e-8 of its peak. A kink inside causes
    errors of about 1e-3 in the cells that it crosses.

    Parameters
    ----------
    profile : callable
        Returns the field at x and y, m, relative to the centre: arrays of one shape with points
        inside the circle.
    grid : Grid
        The cells.
    radius : float, m
        Radius a of the circle; outside, the field is 0.
    centre : (x, y) float, m
        Centre of the circle.
    nodes : int
        Gauss points per piece and direction.

    Returns
    -------
    (rows, cols) float
        Averages, in the unit of the field.

    Raises
    ------
    PhysicsError
        If the radius is not positive.
    ArrayError
        If there is no node.
    """
    checks.record("grid", grid, Grid)
    if not isinstance(cast(object, nodes), int) or nodes < 1:
        raise ArrayError(f"'nodes': expected 1 or more, got {nodes}.")
    a = checks.scalar("radius", checks.positive("radius", radius))
    x = np.clip((grid.x_edges - centre[0]) / a, -1.0, 1.0)
    y = np.clip((grid.y_edges - centre[1]) / a, -1.0, 1.0)
    phi, weight = _pieces(x, y, nodes)
    half = np.cos(phi)
    low, high = (_angle(edge[:, None, None], half) for edge in (y[:-1], y[1:]))
    gauss, gauss_weight = _unit_gauss(nodes)
    theta = low[..., None] + (high - low)[..., None] * gauss
    along_y = half[..., None] * np.sin(theta)
    along_x = np.broadcast_to(np.sin(phi)[..., None], theta.shape)
    # x = a sin φ gives a cos φ, y gives a cos φ cos θ
    area = (half**2 * weight)[..., None] * np.cos(theta) * (high - low)[..., None] * gauss_weight
    live = (area != 0) & (along_x**2 + along_y**2 < 1)
    area[live] *= profile(a * along_x[live], a * along_y[live])
    return np.asarray(a * a * area.sum(axis=(-2, -1), where=live) / grid.cell_area)


def _pieces(x: Array, y: Array, nodes: int) -> tuple[Array, Array]:
    """Return angles and weights (rows, cols, points) along x, split where the circle crosses."""
    ends = np.arcsin(x)
    cross = np.arccos(np.abs(y))
    breaks = np.stack([-cross[:-1], -cross[1:], cross[:-1], cross[1:]], axis=-1)
    inside = np.clip(breaks[:, None], ends[:-1, None], ends[1:, None])
    sides = np.broadcast_to(np.stack([ends[:-1], ends[1:]], axis=-1), (*inside.shape[:2], 2))
    points = np.sort(np.concatenate([sides, inside], axis=-1), axis=-1)
    gauss, weight = _unit_gauss(nodes)
    # close to each end the points crowd as squares: θ's own root at a crossing becomes smooth
    share = np.sin(gauss * np.pi / 2) ** 2
    weight = weight * np.pi / 2 * np.sin(gauss * np.pi)
    span = np.diff(points, axis=-1)[..., None]
    phi = points[..., :-1, None] + span * share
    flat = (*phi.shape[:2], -1)
    return phi.reshape(flat), (span * weight).reshape(flat)


def _angle(edge: Array, half: Array) -> Array:
    """Return asin(edge / half) with the edge cut to the circle."""
    cut = np.clip(edge, -half, half)
    return np.asarray(np.arctan2(cut, np.sqrt((half - cut) * (half + cut))))


def _unit_gauss(nodes: int) -> tuple[Array, Array]:
    points, weights = leggauss(nodes)
    return (points + 1) / 2, weights / 2


_NODES, _WEIGHTS = leggauss(10)
# points crowd as squares at both ends of a piece: Φ has a 3/2 power there, or a kink
_SHARE = np.sin((_NODES + 1) * np.pi / 4) ** 2
_SHARE_WEIGHTS = np.sin((_NODES + 1) * np.pi / 2) * _WEIGHTS * np.pi / 4


def swirl_average(
    potential: Callable[[Array], Array],
    grid: Grid,
    centre: tuple[float, float],
    radii: tuple[float, ...],
) -> Array:
    """Return the cell averages of a circumferential traction.

    Parameters
    ----------
    potential : callable
        Φ(ρ), N/m: the integral of the traction from ρ, m, to the rim.
    grid : Grid
        The cells.
    centre : (x, y) float, m
        Centre of the contact.
    radii : tuple of float, m
        Radii at which Φ is not smooth: that of the rim, and the stick radius.

    Returns
    -------
    (rows, cols, 2) float, Pa
        Averages of (q_x, q_y); positive traction turns x towards y.
    """
    checks.record("grid", grid, Grid)
    x, y = grid.x_edges - centre[0], grid.y_edges - centre[1]
    cols, rows = _window(x, max(radii)), _window(y, max(radii))
    x, y = x[cols.start : cols.stop + 1], y[rows.start : rows.stop + 1]
    along_x = _line_integrals(potential, y, x, radii)
    along_y = _line_integrals(potential, x, y, radii)
    result = np.zeros((*grid.shape, 2))
    result[rows, cols, 0] = np.diff(along_x, axis=0)
    result[rows, cols, 1] = -np.diff(along_y, axis=0).T
    return result / grid.cell_area


def _window(edges: Array, radius: float) -> slice:
    """Return which cells of a row may reach into the contact."""
    start = int(np.searchsorted(edges, -radius, side="right")) - 1
    stop = int(np.searchsorted(edges, radius, side="left"))
    start, stop = max(start, 0), min(stop, len(edges) - 1)
    return slice(start, max(start, stop))


def _line_integrals(
    potential: Callable[[Array], Array], lines: Array, edges: Array, radii: tuple[float, ...]
) -> Array:
    """Return Φ integrated from edge to edge on every line, (lines, edges - 1)."""
    crossings = [np.sqrt(np.maximum(a * a - lines * lines, 0.0)) for a in radii]
    breaks = np.stack([sign * cross for cross in crossings for sign in (-1, 1)], axis=-1)
    inner = np.clip(breaks[:, None], edges[:-1, None], edges[1:, None])
    outer = np.broadcast_to(np.stack([edges[:-1], edges[1:]], axis=-1), (*inner.shape[:2], 2))
    ends = np.sort(np.concatenate([outer, inner], axis=-1), axis=-1)
    span = np.diff(ends, axis=-1)[..., None]
    place = ends[..., :-1, None] + span * _SHARE
    rho = np.hypot(place, lines[:, None, None, None])
    live = (rho < max(radii)) & (span > 0)
    area = np.broadcast_to(span * _SHARE_WEIGHTS, rho.shape) * live
    area[live] *= potential(rho[live])
    return np.asarray(area.sum(axis=(-2, -1)))
