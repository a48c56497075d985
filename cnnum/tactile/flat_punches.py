"""Rigid flat punches of any outline on a half-space, and readings of the taxels under the cover.

No part of it is the program's: the pressure comes from Boussinesq's equation, solved on cells of a
part of the pitch. The readings come from Love's solution for these cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.sparse.linalg import LinearOperator, cg

from cnnum.arrays import Floats
from cnnum.errors import PhysicsError
from cnnum.tactile.halfspace import SurfaceToDepth, rectangle_displacement
from cnnum.tactile.indenters import Reads

FINER = 15
"""Cells of the surface to a pitch: an odd number, so that taxels lie below middles."""

SOLVED = 1e-4
"""Residue of the equation, relative: the readings are right to a tenth of that."""


class Outline(Protocol):
    """The outline of a body."""

    def distance(self, x: Floats, y: Floats) -> Floats:
        """Return the distance from it, negative inside."""
        ...


@dataclass(frozen=True, slots=True)
class Polygon:
    """An outline with straight sides, for its distance alone.

    Attributes
    ----------
    corners : ((x, y), ...) float
        In order, pitches.
    """

    corners: tuple[tuple[float, float], ...]

    def distance(self, x: Floats, y: Floats) -> Floats:
        """Return the distance from the outline, negative inside."""
        inside, nearest = np.zeros(np.shape(x), dtype=bool), np.full(np.shape(x), np.inf)
        for (x0, y0), (x1, y1) in zip(self.corners, np.roll(self.corners, 1, axis=0), strict=True):
            along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / (
                (x1 - x0) ** 2 + (y1 - y0) ** 2
            )
            share = np.clip(along, 0.0, 1.0)
            away = np.hypot(x - x0 - share * (x1 - x0), y - y0 - share * (y1 - y0))
            nearest = np.minimum(nearest, away)
            crossed = (y0 > y) != (y1 > y)
            beyond = (x1 - x0) * (y - y0) / np.where(crossed, y1 - y0, 1.0) + x0
            inside ^= crossed & (x < beyond)
        return np.where(inside, -nearest, nearest)


def triangle(side: float, angle: float, centre: tuple[float, float]) -> Polygon:
    """Return an equilateral triangle; `angle` is that of its first corner."""
    turns = angle + 2.0 * np.pi * np.arange(3) / 3.0
    radius = side / np.sqrt(3.0)
    x, y = centre[0] + radius * np.cos(turns), centre[1] + radius * np.sin(turns)
    return Polygon(tuple(zip(x.tolist(), y.tolist(), strict=True)))


@dataclass(frozen=True, slots=True)
class Joined:
    """Outlines that do not overlap, on one rigid body."""

    parts: tuple[Outline, ...]

    def distance(self, x: Floats, y: Floats) -> Floats:
        """Return the distance from the nearest outline, negative inside."""
        return np.asarray(np.min([part.distance(x, y) for part in self.parts], axis=0))


def punch_pressure(outline: Outline, cells: int, finer: int = FINER) -> Floats:
    """Return the pressure that sinks all of an outline evenly, of mean 1 within it.

    Parameters
    ----------
    outline : Outline
        Lengths in pitches, from the middle of the array.
    cells : int
        Number of cells along a side of the array.
    finer : int
        Cells of the surface to a pitch, an odd number.

    Returns
    -------
    (cells · finer, cells · finer) float

    Raises
    ------
    PhysicsError
        If no cell lies within the outline.
    """
    side = cells * finer
    axis = (np.arange(side) + 0.5) / finer - cells / 2
    # cells whose middle lies on the outline are outside on all sides, in spite of roundings
    within = np.nonzero((outline.distance(*np.meshgrid(axis, axis)) < -1e-9).ravel())[0]
    if not within.size:
        raise PhysicsError(
            "Expected an outline that contains cells of the array, got one without any."
        )
    waves = _sinking(side, finer)

    def sinks(pressure: Floats) -> Floats:
        whole = np.zeros(side * side)
        whole[within] = np.ravel(pressure)
        spread = fft.irfft2(fft.rfft2(whole.reshape(side, side), s=(2 * side,) * 2) * waves)
        return np.asarray(spread[:side, :side].ravel()[within])

    operator = LinearOperator((within.size,) * 2, matvec=sinks, dtype=np.float64)
    solution, failed = cg(operator, np.ones(within.size), rtol=SOLVED)
    assert not failed
    pressure = np.zeros(side * side)
    pressure[within] = solution / solution.mean()
    return pressure.reshape(side, side)


def read_below(
    pressures: Sequence[Floats], cells: int, depth: float, reads: Reads, finer: int = FINER
) -> Floats:
    """Return the readings of a square array's taxels, (pressures, cells, cells), push positive."""
    loads = np.zeros((len(pressures), cells * finer, cells * finer, 3))
    loads[..., 2] = pressures
    seen = _cover(cells, depth, reads, finer)(loads)[..., 2]
    return -seen[:, finer // 2 :: finer, finer // 2 :: finer]


@cache
def _cover(cells: int, depth: float, reads: Reads, finer: int) -> SurfaceToDepth:
    # at E = 1.5 strain is in units of 2E/3: as large as the stress that it comes from
    modulus = 1.5 if reads == "strain" else None
    return SurfaceToDepth(
        (cells * finer, cells * finer), 1.0 / finer, depth, youngs_modulus=modulus
    )


@cache
def _sinking(side: int, finer: int) -> NDArray[np.complex128]:
    """Return the waves of how far a load on one cell sinks the others, on twice the side."""
    away = np.minimum(np.arange(2 * side), 2 * side - np.arange(2 * side)) / finer
    x, y = np.meshgrid(away, away)
    size = (1.0 / finer, 1.0 / finer)
    sunk = rectangle_displacement(x, y, 0.0, [0.0, 0.0, 1.0], size=size, youngs_modulus=1.0)
    return np.asarray(fft.rfft2(sunk[..., 2]), dtype=np.complex128)
