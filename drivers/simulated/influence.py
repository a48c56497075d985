"""The influence of the cover that a scene asks for."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.bumps import bumps_fem_influence
from cnnum.drivers.simulated.cover import Layout, bumpy_influence, flat_influence
from cnnum.drivers.simulated.layer import layer_influence
from cnnum.drivers.simulated.settings import Settings


def influence_of(options: Settings, layout: Layout) -> Floats:
    """Return the strain at each taxel under a unit mean traction over each cell.

    Returns
    -------
    (rows, cols, surface rows, surface cols, load, component) float, 1/Pa

    Raises
    ------
    PhysicsError
        If the cover is none that can be worked out.
    """
    cover = (layout, options.thickness, options.youngs_modulus)
    if options.cover == "bumpy":
        return bumpy_influence(*cover, options.bump_radius)
    if options.cover == "bumps-fem":
        return bumps_fem_influence(*cover, options.bump_radius)
    if options.cover == "layer":
        return sharpened(layer_influence(*cover, options.taxel_height))
    return sharpened(flat_influence(*cover))


def sharpened(influence: Floats) -> Floats:
    """Return what the mean of a smooth traction over each cell does to the taxels.

    Spread evenly over its cells a traction is wider than it was, by a variance of h²/6 along each
    side h of a cell: contacts read up to 2 % too wide. Weights of −1/12, 7/6, −1/12 along each
    side take just that away, and leave an error of the order h⁴. Bumps need none of it: each
    takes the whole load of its square.

    Parameters
    ----------
    influence : (rows, cols, surface rows, surface cols, load, component) float, 1/Pa
        Of even tractions on each cell.
    """
    for axis in (2, 3):
        wide = np.pad(influence, [(int(axis == n),) * 2 for n in range(influence.ndim)], "edge")
        count = influence.shape[axis]
        before, after = (wide.take(range(n, n + count), axis) for n in (0, 2))
        influence = np.asarray(influence - (before - 2.0 * influence + after) / 12.0)
    return influence
