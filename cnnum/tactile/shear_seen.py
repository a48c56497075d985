"""Effect of a pull on one cell on an array: on the sum of shear and the normal readings.

Cerruti's and Boussinesq's solutions, integrated over the cell.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from cnnum.tactile.checks import Array, positive
from cnnum.tactile.halfspace import rectangle_strain, rectangle_stress
from cnnum.tactile.indenters import Reads

NEAR = 7
"""Cells to each side in which pulls are laid out cell by cell: all of an array of 8×8."""

BLOCK = 3
"""Cells to a side of the blocks beyond; 2 NEAR + 1 is a multiple of it."""


@dataclass(frozen=True, slots=True, eq=False)
class ShearSeen:
    """Sums of shear over an array, for a unit load on each of its cells.

    On an endless array a pull's own shear adds up to the pull, and a push's to nothing.

    Attributes
    ----------
    own_x, own_y : (rows, cols) float
        Sum of the shear along x or y under a pull along it.
    pushed_x, pushed_y : (rows, cols) float
        The same under a push.
    """

    own_x: Array
    own_y: Array
    pushed_x: Array
    pushed_y: Array


@cache
def shear_seen(shape: tuple[int, int], depth: float) -> ShearSeen:
    """Return the sum over an array.

    Parameters
    ----------
    shape : (rows, cols) int
    depth : float
        Cover above the taxels, in pitches.

    Raises
    ------
    PhysicsError
        If the depth is not positive.
    """
    positive("depth", depth)
    rows, cols = shape
    x, y = np.meshgrid(np.arange(1.0 - cols, cols), np.arange(1.0 - rows, rows))

    def summed(axis: int, load: list[float]) -> Array:
        # E = 1.5 makes shear strain the stress itself; a pull along x shears by less than 0
        strain = rectangle_strain(x, y, depth, load, size=(1.0, 1.0), youngs_modulus=1.5)
        table = -strain[..., axis, 2]
        return np.array(
            [
                [
                    table[rows - 1 - r : 2 * rows - 1 - r, cols - 1 - c : 2 * cols - 1 - c].sum()
                    for c in range(cols)
                ]
                for r in range(rows)
            ]
        )

    push = [0.0, 0.0, 1.0]
    return ShearSeen(
        summed(0, [1.0, 0.0, 0.0]), summed(1, [0.0, 1.0, 0.0]), summed(0, push), summed(1, push)
    )


@cache
def pulled_normal(depth: float, reads: Reads, reach: int) -> Array:
    """Return the normal readings of a pull on a cell, as weights of a correlation.

    Ahead of a pull the skin is squeezed along it and swells. Behind, it is stretched and sinks in.
    Strain falls off with no more than the square of the distance.

    Parameters
    ----------
    depth, reads
        As in `cnnum.tactile.deconvolution.unblur_kernel`.
    reach : int
        Cells to each side, up to `NEAR`.

    Returns
    -------
    (2, 2 reach + 1, 2 reach + 1) float
        For a unit pull along x and along y, in the sign of a push.

    Raises
    ------
    PhysicsError
        If the depth is not positive.
    """
    return _pulled(depth, reads, np.arange(reach, -reach - 1.0, -1.0), 1.0)


@cache
def pulled_far(depth: float, reads: Reads, reach: int) -> Array:
    """Return the same for pulls on blocks of 3×3 cells that lie beyond `NEAR`.

    Parameters and errors are those of `pulled_normal`.

    Returns
    -------
    (2, 2 n + 1, 2 n + 1) float
        n is the next multiple of 3 from `reach`. The numbers are 0 but in every third row and
        column, for the sum of a pull on the block around.
    """
    most = -(-reach // BLOCK) * BLOCK
    away = np.arange(most, -most - 1.0, -BLOCK)
    blocks = _pulled(depth, reads, away, float(BLOCK))
    near = np.abs(away) <= NEAR
    sparse = np.zeros((2, 2 * most + 1, 2 * most + 1))
    sparse[:, ::BLOCK, ::BLOCK] = np.where(near[:, None] & near, 0.0, blocks)
    sparse.setflags(write=False)
    return sparse


def _pulled(depth: float, reads: Reads, away: Array, side: float) -> Array:
    """Return readings at (x, y) from a pull on a square; a correlation asks for them mirrored."""
    positive("depth", depth)
    x, y = np.meshgrid(away, away)
    kernels: list[Array] = []
    for pull in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        load, size = np.array(pull) / side**2, (side, side)
        if reads == "stress":
            seen = rectangle_stress(x, y, depth, load, size=size)
        else:
            seen = rectangle_strain(x, y, depth, load, size=size, youngs_modulus=1.5)
        kernels.append(-seen[..., 2, 2])
    pulled = np.stack(kernels)
    pulled.setflags(write=False)
    return pulled
