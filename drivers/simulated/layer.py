"""The flat cover as a layer on a rigid base, for the same taxels and cells as `cover`.

A layer is the half-space and the effect of its base. The half-space's part is known in closed form
for a whole cell. The base's is as smooth as if its load were a thickness farther away. So a table
over the distance and a few points a cell give it.
"""

from itertools import product
from math import ceil, hypot
from typing import TYPE_CHECKING

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.cover import Layout, flat_influence, gathered, offsets
from cnnum.tactile.cover import FlatCover, LayerCover
from cnnum.tactile.cover.axial import Profiles, to_components

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

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
