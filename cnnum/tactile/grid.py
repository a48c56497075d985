"""Where the cells of a map lie: columns run along x (to the right), rows along y (downwards).

The origin is the middle of the map. With z into the material the axes are right-handed, so a
positive torque about z turns x towards y: clockwise for who looks down on the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import as_shape
from cnnum.errors import ArrayError
from cnnum.safety.values import refuse_on_host
from cnnum.tactile.checks import Array, positive


@dataclass(frozen=True, slots=True)
class Grid:
    """A map of equal rectangular cells around the origin.

    Parameters
    ----------
    rows, cols : int
        Number of cells along y and along x.
    dy, dx : float, m
        Size of a cell along y and along x.

    Raises
    ------
    ArrayError
        If there is no cell.
    PhysicsError
        If a cell has no size.
    """

    rows: int
    cols: int
    dy: float
    dx: float

    def __post_init__(self) -> None:
        if self.rows < 1 or self.cols < 1:
            raise ArrayError(
                f"A grid needs at least one row and one column, got {self.rows} by {self.cols}."
            )
        positive("spacing", [self.dy, self.dx])

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.cols

    @property
    def x(self) -> Array:
        """(cols,) float, m. Centres of the columns."""
        return (np.arange(self.cols, dtype=np.float64) - (self.cols - 1) / 2) * self.dx

    @property
    def y(self) -> Array:
        """(rows,) float, m. Centres of the rows."""
        return (np.arange(self.rows, dtype=np.float64) - (self.rows - 1) / 2) * self.dy

    @property
    def x_edges(self) -> Array:
        """(cols + 1,) float, m. Edges of the columns."""
        return (np.arange(self.cols + 1, dtype=np.float64) - self.cols / 2) * self.dx

    @property
    def y_edges(self) -> Array:
        """(rows + 1,) float, m. Edges of the rows."""
        return (np.arange(self.rows + 1, dtype=np.float64) - self.rows / 2) * self.dy

    @property
    def cell_area(self) -> float:
        """Area of one cell, m²."""
        return self.dx * self.dy


def make_grid(shape: Sequence[int], spacing: float | tuple[float, float]) -> Grid:
    """Return the grid of `shape` cells.

    Parameters
    ----------
    shape : (rows, cols) int
        Number of cells.
    spacing : float or (dy, dx) float, m
        Size of a cell, one number for squares; in the order of the axes of a map.

    Raises
    ------
    ArrayError
        If `shape` is not two whole numbers from 1 up, or `spacing` not one number or two.
    SizeError
        If the machine has no room for a map of that shape.
    PhysicsError
        If a spacing is zero, negative or not finite.
    """
    rows, cols = as_shape(shape)
    refuse_on_host("A map", (rows, cols), 8)
    sizes = positive("spacing", spacing)
    if sizes.shape not in {(), (2,)}:
        raise ArrayError(f"'spacing': expected one number or (dy, dx), got shape {sizes.shape}.")
    dy, dx = np.broadcast_to(sizes, (2,))
    return Grid(rows, cols, float(dy), float(dx))


def sharpened(cells: Array, axes: tuple[int, int]) -> Array:
    """Return maps of cells that stand for a smooth traction, not for an even one on each cell.

    Spread evenly over its cells a traction is wider than it was. The variance grows by h²/6 along
    each side h of a cell: a contact of four cells' radius reads 2 % too wide. Weights of −1/12,
    7/6, −1/12 along each side take just that away, and leave an error of the order h⁴. The means of
    a traction may be weighed so, or the effect of each cell on another quantity.

    Parameters
    ----------
    cells : (...) float
    axes : (int, int)
        Along the sides of the cells.
    """
    for axis in axes:
        wide = np.pad(cells, [(int(axis == n),) * 2 for n in range(cells.ndim)], "edge")
        count = cells.shape[axis]
        other = (slice(None),) * axis
        before, after = (wide[(*other, slice(n, n + count))] for n in (0, 2))
        cells = np.asarray((14.0 * cells - before - after) / 12.0)
    return cells
