"""The covers of the simulated array: from tractions on the surface to strain at the taxels.

The influence of every cell on every taxel is worked out once; a scan is then one product.

The flat cover as a layer on a rigid base, for the same taxels and cells as `cover`.

A layer is the half-space and the effect of its base. The half-space's part is known in closed form
for a whole cell. The base's is as smooth as if its load were a thickness farther away. So a table
over the distance and a few points per cell give it.
"""

from dataclasses import dataclass
from itertools import product
from math import ceil, hypot
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.simulated.settings import Settings
from cnnum.safety.values import refuse_on_host
from cnnum.tactile.cover import (
    BumpCover,
    Creep,
    FlatCover,
    LayerCover,
    StandardLinearSolid,
    at_rest,
    creep_step,
)
from cnnum.tactile.cover.protocol import Profiles, to_components
from cnnum.tactile.grid import Grid, make_grid, sharpened
from cnnum.tactile.halfspace import rectangle_strain

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


CELLS = 5
"""Cells a pitch: an odd number, so that a taxel lies below the middle of a cell."""

MARGIN, FARTHEST = 1, 6
"""Pitches of surface beyond the outermost taxels' own, to begin with and under a body that goes
over the rim: what is farther away, taxels no longer feel."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Taxels on a square lattice, and the cells of the surface above them.

    Attributes
    ----------
    shape : (rows, cols) int
    pitch : float, m
    margin : int
        Pitches of surface beyond the outermost taxels' own.
    """

    shape: Shape
    pitch: float
    margin: int = MARGIN

    @property
    def surface(self) -> Grid:
        """The cells of the surface."""
        sides = [(n + 2 * self.margin) * CELLS for n in self.shape]
        return make_grid(sides, self.pitch / CELLS)

    @property
    def taxels(self) -> Grid:
        """The taxels' places."""
        return make_grid(self.shape, self.pitch)

    def nearest(self) -> NDArray[np.intp]:
        """Return (rows, cols) of the surface: number of the pitch square that a cell lies in."""
        rows, cols = (np.arange(n) // CELLS for n in self.surface.shape)
        return np.asarray(rows[:, None] * (self.shape[1] + 2 * self.margin) + cols)


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


def bumpy_influence(
    layout: Layout, thickness: float, youngs_modulus: float, bump_radius: float
) -> Floats:
    """Return the strain at each taxel under a unit traction on each cell of a bumpy cover.

    Only bumps are touched, and each takes the whole load of its pitch square on its top. A drag
    acts above the bump's foot, so it also tips the bump: its front edge presses down and its rear
    edge lifts. On the axis below, that moment shears the layer against the drag, and from 0.63 bump
    radii on it outweighs the drag's own shear, which fades as the fourth power of the depth. The
    sign of ε_xz under a bump is therefore the opposite of the sign under a flat cover.

    Parameters
    ----------
    layout : Layout
    thickness : float, m
        Depth of the taxels below the foot of the bumps: 0.5 to 5 bump radii.
    youngs_modulus : float, Pa
        Young's modulus of an incompressible cover.
    bump_radius : float, m

    The shape is that of `flat_influence`.

    Raises
    ------
    PhysicsError
        If the thickness is none that the coefficients hold.
    """
    cover = BumpCover(thickness, youngs_modulus, bump_radius)
    taxels, surface = layout.taxels, layout.surface
    bumps = make_grid([n + 2 * layout.margin for n in layout.shape], layout.pitch)
    at_taxels = np.stack(np.meshgrid(taxels.x, taxels.y), axis=-1)
    at_bumps = np.stack(np.meshgrid(bumps.x, bumps.y), axis=-1).reshape(-1, 2)
    away = at_taxels[:, :, None, None] - at_bumps[:, None]
    force = np.eye(3) * surface.cell_area
    strain = cover.strain([0.0, 0.0], away, force)
    cells = strain[:, :, layout.nearest().reshape(-1)]
    return np.asarray(cells.reshape(*layout.shape, *surface.shape, 3, 3))


STEPS = 24
"""Distances to a thickness in the table: a spline of h/24 is off by some 1e-6 of the peak."""

POINTS = 4
"""Gauss points a side of a cell that is at most as wide as the layer is thick. Wider ones take
more. The influence is off by 2e-5 of its largest value on layers of 0.5 mm under cells of 0.3 mm.
On thinner ones it is off by 4e-4."""


def layer_influence(
    layout: Layout, thickness: float, youngs_modulus: float, height: float
) -> Floats:
    """Return the strain at each taxel under a unit traction on each cell of a bonded layer.

    Parameters
    ----------
    layout : Layout
    thickness : float, m
        Thickness of the layer.
    youngs_modulus : float, Pa
        Young's modulus of an incompressible layer.
    height : float, m
        At which the taxels lie above the rigid base: below the thickness. On the base itself
        there is no normal strain.

    Returns
    -------
    float, 1/Pa
        As `flat_influence`.

    Raises
    ------
    PhysicsError
        If the height is not below the thickness.
    """
    depth = thickness - height
    layer = LayerCover(thickness, youngs_modulus, taxel_depth=depth)
    base = gathered(layout, _base_kernel(layout, layer))
    return flat_influence(layout, depth, youngs_modulus) + base


def _base_kernel(layout: Layout, layer: LayerCover) -> Floats:
    """Return the base's share in the strain of one cell at every offset."""
    surface = layout.surface
    x, y = offsets(surface.cols, surface.dx), offsets(surface.rows, surface.dy)
    table = _base_profiles(layer, hypot(x[-1] + surface.dx, y[-1] + surface.dy))
    nodes, weights = _gauss(surface.dx, layer.thickness)
    kernel = np.zeros((y.size, x.size, 3, 3))
    for (u, first), (v, second) in product(zip(nodes, weights, strict=True), repeat=2):
        kernel += first * second * _at(table, x + u, y + v)
    return kernel * surface.cell_area


def _at(table: "CubicSpline", x: Floats, y: Floats) -> Floats:
    """Return the strain of unit forces along x, y and down, (y, x, load, component)."""
    away = np.stack(np.meshgrid(x, y), axis=-1)
    rows = np.moveaxis(table(np.hypot(away[..., 0], away[..., 1])), -1, 0)
    profiles = Profiles(*rows[..., None])
    return to_components(profiles, away[..., None, :], np.eye(3))


def _base_profiles(layer: LayerCover, farthest: float) -> "CubicSpline":
    """Return the five profiles of `Profiles` over the distance: layer less half-space."""
    from scipy.interpolate import CubicSpline

    count = ceil(STEPS * farthest / layer.thickness) + 1
    distance = np.linspace(0.0, farthest, count)
    flat = FlatCover(layer.depth, layer.youngs_modulus, layer.poisson)
    taxels = np.stack([distance, np.zeros(count)], axis=-1)[:, None]
    there = ([0.0, 0.0], taxels, np.eye(3))
    strain = layer.strain(*there) - flat.strain(*there)
    # on the x axis: along is x, across is y, and a drag across turns backwards
    parts = (strain[:, 2, 2], strain[:, 2, 0], strain[:, 0, 2], strain[:, 0, 0], -strain[:, 1, 1])
    return CubicSpline(distance, np.stack(parts, axis=-1))


def _gauss(side: float, thickness: float) -> tuple[Floats, Floats]:
    """Return places in a cell, m, and their shares: more where the cell is wide for the layer."""
    x, w = np.polynomial.legendre.leggauss(ceil(POINTS * max(1.0, side / thickness)))
    return x * side / 2, w / 2


CELL_AXES = (2, 3)
"""Axes of the surface's cells. Bumps need none of it: each takes the whole load of its square."""

BYTES, COPIES = 9 * 8, 2
"""Bytes of the strain under one cell at one taxel, and how often it is in memory on its way:
1.9 to 3.5 times, by the cover."""


def influence_of(options: Settings, layout: Layout) -> Floats:
    """Return the strain at each taxel under a unit mean traction over each cell.

    Returns
    -------
    (rows, cols, surface rows, surface cols, load, component) float, 1/Pa

    Raises
    ------
    PhysicsError
        If the cover is none that can be worked out.
    SizeError
        If there is no room for the strain.
    """
    rows, cols = layout.surface.shape
    refuse_on_host("The simulated array", layout.shape, COPIES * rows * cols * BYTES)
    cover = (layout, options.thickness, options.youngs_modulus)
    if options.cover == "bumpy":
        return bumpy_influence(*cover, options.bump_radius)
    if options.cover == "layer":
        return sharpened(layer_influence(*cover, options.taxel_height), CELL_AXES)
    return sharpened(flat_influence(*cover), CELL_AXES)


class Creeping:
    """A cover that creeps, as a stream of strain in and out.

    Tractions are taken as they come: the contact is the one on a cover with the instant modulus.

    Parameters
    ----------
    options : Settings
    """

    def __init__(self, options: Settings) -> None:
        instant = options.youngs_modulus
        relaxed = instant * (1 - options.creep)
        self._solid = StandardLinearSolid(instant, relaxed, options.creep_time)
        self._elastic = options.creep == 0
        self._shape = (*options.taxels, 3)
        self._step = 1 / options.rate

    def rest(self) -> Creep:
        """Return the memory of the cover before the first scan."""
        return at_rest(self._shape)

    def __call__(self, before: Creep, elastic: Floats) -> tuple[Floats, Creep]:
        """Return the strain that scans see, and the memory after them.

        Parameters
        ----------
        before : Creep
        elastic : (scans, rows, cols, 3) float
            Strain of a cover with the instant modulus, under the same tractions.
        """
        if self._elastic:
            return elastic, before
        strain = np.empty_like(elastic)
        memory = before
        for n, now in enumerate(elastic):
            memory = creep_step(self._solid, memory, now, self._step)
            strain[n] = memory.strain
        return strain, memory
