"""The weak fading of short waves on a lattice, made up for in its loads.

A wave of number k fades with depth as exp(−kz). On a lattice of cells of 1 it fades as exp(−κz),

    (2/s) sinh(κs/2) = √(4 sin²(k_x/2) + 4 sin²(k_y/2)),

which is less: κ < k. A template of 3×3 gives loads the difference, exp(−(k − κ)z). It does so as
near as nine weights come on the waves that reach the taxels.
"""

import numpy as np

from cnnum.arrays import Floats
from cnnum.templating.template import Template

WAVES = 48
"""Wave numbers to each axis at which the weights are fitted."""


def fading_error(k_x: Floats, k_y: Floats, depth: float, slab: float) -> Floats:
    """Return the ratio by which waves fade more in depth than on the lattice.

    Parameters
    ----------
    k_x, k_y : (...) float
        Per cell.
    depth, slab : float
        Depth of the plane and of a slab, cells.

    Returns
    -------
    (...) float
        From 0 to 1.
    """
    seen = np.sqrt(4.0 * np.sin(k_x / 2) ** 2 + 4.0 * np.sin(k_y / 2) ** 2)
    slower = 2.0 * np.arcsinh(seen * slab / 2) / slab
    return np.asarray(np.exp((slower - np.hypot(k_x, k_y)) * depth), dtype=np.float64)


def matched(depth: float, slab: float) -> Template:
    """Return the template for loads whose effect is read at a depth, in cells."""
    turn = np.asarray(2.0 * np.pi * np.fft.fftfreq(WAVES), dtype=np.float64)
    k_x, k_y = np.meshgrid(turn, turn)
    wanted = fading_error(k_x, k_y, depth, slab).ravel()
    # half of the waves that reach the depth: errors of short waves count less, but do
    weight = np.exp(-0.5 * depth * np.hypot(k_x, k_y)).ravel()
    cosines = np.cos(k_x), np.cos(k_y)
    shapes = np.stack(
        [np.ones(weight.size), (cosines[0] + cosines[1]).ravel(), (cosines[0] * cosines[1]).ravel()]
    )
    middle, edge, across = np.linalg.lstsq((weight * shapes).T, weight * wanted, rcond=None)[0]
    side, corner = edge / 2.0, across / 4.0
    weights = [[corner, side, corner], [side, middle, side], [corner, side, corner]]
    return Template(
        f"matched to {depth:g} cells", [[0.0]], weights, boundary="periodic", output="linear"
    )
