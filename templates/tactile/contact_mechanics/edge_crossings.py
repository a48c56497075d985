"""Where a surface load ends, link by link between neighbouring taxels, and how sharply."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.programs.fields import Field, maximum, minimum, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import shift

WAYS = ((0, 1), (0, -1), (1, 0), (-1, 0))
"""Steps outwards, rows and columns: right, left, down, up."""

HALF, NEAR_TOP = 0.5, 0.88
"""Shares of the load inside. At one half, a cell that the outline cuts into halves lies on it."""

EMPTY = 0.12
"""Share of the load inside that is left at most within two cells outside."""

ALONG = 0.6
"""Least slope along a link, in slopes across it: steeper outlines are met by the other links."""

LONGEST = 1.3
"""Cells that a rise counts at most, so that one odd link does not outvote the others."""

DEEP, RIM = 0.4, 0.3
"""A flat punch carries most at its rim, so that a cell cut by it reads more than its share: where
the second and third cell inside fall behind the rim, yet carry 0.4 of it, the level rises with
0.3 of what they lack. Both were set on punches of 1.5 to 2.8 cells."""


LEVEL = 0.7
"""Least load of the third cell inside over the second's if it is a punch's: at s cells from a
straight rim, where loads go as 1/√s, it is √(s/(s + 1)), 0.82 at two cells, and more farther away.
The hole of a ring and the far side of a narrow body leave less."""

NEAREST = 1e-3
"""Share of the load of a cell and the next that is taken as the rest of nothing, so that the model
of a punch's rim divides by none."""


@dataclass(frozen=True, slots=True)
class Links:
    """The links of every taxel to its neighbour in one direction.

    Attributes
    ----------
    crosses : Field
        Logic map: the load ends on the way.
    rise : Field
        Cells from half of the load to 0.88 of it, where it ends.
    place : Field
        Cells from the taxel outwards to where it ends; below 0 where that is inside.
    hollow : Field
        Share of the load at the rim that the second and third cell inside lack, where there are
        such cells.
    rim : Field
        The place if the load is that of a flat punch.
    """

    crosses: Field
    rise: Field
    place: Field
    hollow: Field
    rim: Field


def links_of(frame: FrameFields, load: Field, least: Field) -> tuple[Links, ...]:
    """Return where a load that is at least so large ends, in the directions of `WAYS`."""
    slopes = [abs(_from(load, row, col) - _from(load, -row, -col)) for row, col in ((0, 1), (1, 0))]
    return tuple(_links(frame, load, least, way, slopes) for way in WAYS)


def _links(
    frame: FrameFields, load: Field, least: Field, way: tuple[int, int], slopes: Sequence[Field]
) -> Links:
    rows, cols = way
    inside = [load, *(_from(load, -k * rows, -k * cols) for k in (1, 2, 3))]
    outside = [_from(load, k * rows, k * cols) for k in (1, 2)]
    top = maximum(inside[0], maximum(inside[1], inside[2]))
    floor = minimum(outside[0], outside[1])
    level = floor + HALF * (top - floor)
    along, across = slopes if cols else (slopes[1], slopes[0])
    crosses = (
        (top > least)
        & (load >= level)
        & (outside[0] < level)
        & (floor < EMPTY * top)
        & (along > ALONG * across)
        & (frame.constant(_has_neighbour(frame.shape, way)) > 0.0)
    )
    half = _share(load - level, load - outside[0])
    high = floor + NEAR_TOP * (top - floor)
    rise = minimum(half + _climb(inside, outside[0], high), LONGEST)
    hollow = _hollow(inside, top)
    place = _place(inside, outside[0], HALF + RIM * hollow, top, floor)
    return Links(crosses, rise, place, hollow, _rim(inside, outside[0], floor))


def _climb(inside: Sequence[Field], outer: Field, high: Field) -> Field:
    """Return the cells inwards from the taxel to where the load first reaches a height."""
    first, second, third = inside[:3]
    early = where(first >= high, _share(first - high, first - outer), 0.0)
    one = where(first < high, _share(high - first, second - first), 0.0)
    two = where((first < high) & (second < high), _share(high - second, third - second), 0.0)
    return one + two - early


def _hollow(inside: Sequence[Field], top: Field) -> Field:
    """Return what the second and third cell inside lack, where the load falls inwards."""
    deep = minimum(inside[2], inside[3])
    falls = inside[2] < maximum(inside[0], inside[1])
    punched = (deep > DEEP * top) & (inside[3] > LEVEL * inside[2]) & falls
    return where(punched, minimum(1.0 - deep / top, HALF), 0.0)


def _place(inside: Sequence[Field], outer: Field, share: Field, top: Field, floor: Field) -> Field:
    """Return the cells outwards to where the load falls below a share."""
    first, second = inside[:2]
    level = floor + share * (top - floor)
    inner = _share(level - first, second - first)
    return where(first >= level, _share(first - level, first - outer), -inner)


def _rim(inside: Sequence[Field], outer: Field, floor: Field) -> Field:
    """Return the cells outwards to a punch's rim.

    Its load from the rim to s inside goes as √s. Of s up to the taxel's inner side and s + 1 up to
    the next one's the loads are known.
    """
    ground = minimum(floor, 0.0)
    near = outer + inside[0] - 2.0 * ground
    both = near + inside[1] - ground
    part = minimum(maximum(_share(near, both), NEAREST), 1.0 - NEAREST)
    square = part * part
    return minimum(maximum(square / (1.0 - square) - 0.5, -1.0), 1.0)


def _share(part: Field, whole: Field) -> Field:
    """Return a share, from 0 to 1, also where there is nothing to share."""
    safe = where(abs(whole) > 0.0, whole, 1.0)
    return minimum(maximum(part / safe, 0.0), 1.0)


def _from(load: Field, rows: int, cols: int) -> Field:
    """Return for every taxel the value so many rows below and columns to the right of it."""
    return shift(load, -rows, -cols)


def _has_neighbour(shape: tuple[int, int], way: tuple[int, int]) -> np.ndarray:
    row, col = np.indices(shape)
    row, col = row + way[0], col + way[1]
    return ((row >= 0) & (row < shape[0]) & (col >= 0) & (col < shape[1])).astype(np.float64)
