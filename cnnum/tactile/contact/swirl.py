"""Cell averages of a circumferential traction, from line integrals along the cells' edges.

A traction τ(ρ) around the centre is the curl of Φ(ρ), the integral of τ from ρ to the rim: q =
(∂Φ/∂y, -∂Φ/∂x). So a cell's average needs Φ on its edges alone, and each edge serves two cells. The
sum over all cells, a net force, is zero to rounding.
"""

from collections.abc import Callable

import numpy as np
from numpy.polynomial.legendre import leggauss

from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.grid import Grid

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
        Where Φ is not smooth: the rim, and the stick radius.

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
