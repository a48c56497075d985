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
        Young's modulus of an incompressible cover.

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
