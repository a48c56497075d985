"""Average any traction inside a circular contact over the cells of a grid, to high order."""

from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.polynomial.legendre import leggauss

from cnnum.errors import ArrayError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.grid import Grid


def cell_average(
    profile: Callable[[Array, Array], Array],
    grid: Grid,
    *,
    radius: float,
    centre: tuple[float, float] = (0.0, 0.0),
    nodes: int = 12,
) -> Array:
    """Return the averages over the cells of a field that lives inside a circle.

    The circle cuts each cell, whose sides are set to x = a sin φ, y = √(a² - x²) sin θ. This takes
    a root (or its inverse) at the rim out of the integrand. The rest is summed by Gauss points
    between the places where the circle crosses the cell. A field that is smooth inside comes back
    to about 1e-8 of its peak, and so does the total load. A kink inside leaves some 1e-3 in the
    cells that it crosses.

    Parameters
    ----------
    profile : callable
        Takes x and y, m, relative to the centre, and gives the field there. They are arrays of one
        shape, inside the circle.
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
