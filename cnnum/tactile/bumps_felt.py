"""What taxels read of tractions on a bumpy cover, one bump over each: kernels over the lattice.

Lengths are in pitches, tractions are means over a bump's square, in units of the shear modulus G.
"""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from cnnum.errors import PhysicsError
from cnnum.tactile.checks import Array, positive
from cnnum.tactile.cover.bump import BumpCover
from cnnum.tactile.halfspace import rectangle_strain

Bumps = Literal["bumpy", "bumps-fem"]

REACH = 4
"""Bumps to each side whose loads a taxel is told of."""

CELLS = 8
"""Cells to a side of a foot, and to each side of a square around it, that stand for it."""

STIFF = 3.0
"""Young's modulus of an incompressible cover whose shear modulus is 1."""


@dataclass(frozen=True, slots=True, eq=False)
class BumpsFelt:
    """Readings around a loaded bump, positive as a push or a pull reads.

    Attributes
    ----------
    normal : (9, 9) float
        −ε_zz under a pressure.
    shear : (2, 2, 9, 9) float
        [load, component]: −ε_xz and −ε_yz under a traction along x and along y.
    """

    normal: Array
    shear: Array


@cache
def bumps_felt(cover: Bumps, depth: float, radius: float) -> BumpsFelt:
    """Return the kernels of a bumpy cover.

    Parameters
    ----------
    cover : "bumpy" or "bumps-fem"
        A load even on the bump's foot, or as finite elements have it.
    depth : float
        Of the taxels below the feet.
    radius : float
        Of the bumps, at most half a pitch.

    Raises
    ------
    PhysicsError
        If depth or radius are out of range.
    """
    positive("depth", depth)
    if not 0.0 < radius <= 0.5:
        raise PhysicsError(
            f"A bump's radius is {radius:g} pitches, expected above 0 and at most 0.5; give it in "
            "pitches of the array."
        )
    axis = np.arange(-float(REACH), REACH + 1.0)
    away = np.stack(np.meshgrid(axis, axis), axis=-1)
    strain = _even(away, depth, radius) if cover == "bumpy" else _bent(away, depth, radius)
    felt = -np.moveaxis(strain, (2, 3), (0, 1))
    return BumpsFelt(normal=felt[2, 2], shear=felt[:2, :2])


def _even(away: Array, depth: float, radius: float) -> Array:
    """Return ε_xz, ε_yz, ε_zz under unit forces on a round foot, (row, column, load, 3)."""
    side = radius / CELLS
    steps = (np.arange(-CELLS, CELLS) + 0.5) * side
    cells = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    cells = cells[np.hypot(cells[:, 0], cells[:, 1]) <= radius]
    x, y = (away[:, :, None, None, n] - cells[:, None, n] for n in range(2))
    strain = rectangle_strain(x, y, depth, np.eye(3), size=(side, side), youngs_modulus=STIFF)
    return np.asarray(strain[..., 2].mean(axis=2) / side**2)


def _bent(away: Array, depth: float, radius: float) -> Array:
    cover = BumpCover(depth, STIFF, radius)
    return cover.strain([0.0, 0.0], away[:, :, None], np.eye(3))
