"""The cover: from tractions on its surface to the strain at the taxels under it.

The influence of every cell on every taxel is worked out once; a scan is then one product.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.tactile.grid import Grid, make_grid
from cnnum.tactile.halfspace import rectangle_strain

CELLS = 5
"""Cells a pitch: an odd number, so that a taxel lies below the middle of a cell."""

MARGIN = 1
"""Pitches of surface beyond the outermost taxels' own."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Taxels on a square lattice, and the cells of the surface above them.

    Attributes
    ----------
    shape : (rows, cols) int
    pitch : float, m
    """

    shape: Shape
    pitch: float

    @property
    def surface(self) -> Grid:
        """The cells of the surface."""
        sides = [(n + 2 * MARGIN) * CELLS for n in self.shape]
        return make_grid(sides, self.pitch / CELLS)

    @property
    def taxels(self) -> Grid:
        """The taxels' places."""
        return make_grid(self.shape, self.pitch)

    def nearest(self) -> NDArray[np.intp]:
        """Return (rows, cols) of the surface: number of the pitch square that a cell lies in."""
        rows, cols = (np.arange(n) // CELLS for n in self.surface.shape)
        return np.asarray(rows[:, None] * (self.shape[1] + 2 * MARGIN) + cols)


def flat_influence(layout: Layout, thickness: float, youngs_modulus: float) -> Floats:
    """Return the strain at each taxel under a unit traction on each cell of a flat cover.

    Parameters
    ----------
    layout : Layout
    thickness : float, m
        Depth at which the taxels lie in the half-space.
    youngs_modulus : float, Pa
        Of an incompressible cover.

    Returns
    -------
    (rows, cols, surface rows, surface cols, load, component) float, 1/Pa
        Loads q_x, q_y, p; components ε_xz, ε_yz, ε_zz.
    """
    return gathered(layout, _kernel(layout.surface, thickness, youngs_modulus))


def gathered(layout: Layout, kernel: Floats) -> Floats:
    """Return the response of each taxel to each cell, from that of one cell at all offsets.

    Parameters
    ----------
    layout : Layout
    kernel : (2 surface rows - 1, 2 surface cols - 1, ...) float

    Returns
    -------
    (rows, cols, surface rows, surface cols, ...) float
    """
    surface, taxels = layout.surface, layout.taxels
    rows = _offsets(taxels.y, surface.y, surface.dy) + surface.rows - 1
    cols = _offsets(taxels.x, surface.x, surface.dx) + surface.cols - 1
    return np.asarray(kernel[rows[:, None, :, None], cols[None, :, None, :]])


def offsets(count: int, size: float) -> Floats:
    """Return the distances between cells of a row of `count`, (2 count - 1,) m, signed."""
    return np.asarray(np.arange(1 - count, count) * size, dtype=np.float64)


def bumpy_influence(
    layout: Layout, thickness: float, youngs_modulus: float, bump_radius: float
) -> Floats:
    """Return the same for a cover with a hemispherical bump above every taxel.

    The model: only bumps are touched. Each takes the whole load of its pitch square. It hands it on
    to the layer below as a uniform traction on the bump's round foot.

    Parameters
    ----------
    layout, thickness, youngs_modulus
        As in `flat_influence`; the thickness is that of the layer under the bumps.
    bump_radius : float, m
    """
    flat = flat_influence(layout, thickness, youngs_modulus)
    square = layout.nearest().reshape(-1)
    cells = flat.reshape(*layout.shape, square.size, 3, 3)
    share = _shares(square, _feet(layout, bump_radius).reshape(-1))
    bumps = np.einsum("bs,rcslk->rcblk", share, cells)
    return np.asarray(bumps[:, :, square].reshape(flat.shape))


def _shares(square: NDArray[np.intp], feet: NDArray[np.bool_]) -> Floats:
    """Return how each bump's load is spread over the cells of its foot, (bumps, cells)."""
    share = np.zeros((int(square.max()) + 1, square.size))
    share[square[feet], np.flatnonzero(feet)] = 1.0
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _feet(layout: Layout, radius: float) -> NDArray[np.bool_]:
    """Return which cells of the surface lie on the foot of a bump."""
    away = [
        (np.arange(n) % CELLS - CELLS // 2) * layout.pitch / CELLS for n in layout.surface.shape
    ]
    return np.asarray(np.hypot(away[0][:, None], away[1][None, :]) <= radius * (1 + 1e-9))


def _kernel(surface: Grid, depth: float, youngs_modulus: float) -> Floats:
    """Return the strain of one cell at every offset, (2 rows - 1, 2 cols - 1, load, component)."""
    x, y = offsets(surface.cols, surface.dx), offsets(surface.rows, surface.dy)
    strain = rectangle_strain(
        x[None, :, None],
        y[:, None, None],
        depth,
        np.eye(3),
        size=(surface.dx, surface.dy),
        youngs_modulus=youngs_modulus,
    )
    return np.asarray(strain[..., 2])


def _offsets(taxels: Floats, cells: Floats, size: float) -> NDArray[np.intp]:
    """Return how many cells a taxel lies beyond a cell, (taxels, cells)."""
    return np.rint((taxels[:, None] - cells[None, :]) / size).astype(np.intp)
