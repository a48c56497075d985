"""The influence of the cover that a scene asks for."""

from cnnum.arrays import Floats
from cnnum.drivers.simulated.bumps import bumpy_influence
from cnnum.drivers.simulated.cover import Layout, flat_influence
from cnnum.drivers.simulated.layer import layer_influence
from cnnum.drivers.simulated.settings import Settings
from cnnum.safety.memory import refuse_on_host
from cnnum.tactile.grid import sharpened

CELLS = (2, 3)
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
        return sharpened(layer_influence(*cover, options.taxel_height), CELLS)
    return sharpened(flat_influence(*cover), CELLS)
