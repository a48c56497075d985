"""Equal blocks of an array, as of pads or fingers side by side, and sums over each."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ProgramError
from cnnum.programs.fields import Field, sqrt, square, total
from cnnum.programs.machine import FrameFields

Sums = Callable[[Field], Field]
"""A sum of a map over some of its cells."""


class Block(NamedTuple):
    """A block of the array.

    Attributes
    ----------
    cells : int
    share : (rows, cols) float
        1 in its cells, 0 elsewhere.
    total, inner : callable
        `total` sums a map over its cells. `inner` does so over those that touch no other block, for
        the results of templates, which would mix both.
    """

    cells: int
    share: Floats
    total: Sums
    inner: Sums


def blocks(frame: FrameFields, rows: int, cols: int) -> list[Block]:
    """Return the equal blocks of an array, row by row.

    Raises
    ------
    ProgramError
        If the array does not divide into as many rows and columns of blocks.
    """
    if rows < 1 or cols < 1 or any(np.mod(frame.shape, (rows, cols))):
        raise ProgramError(
            f"An array of {frame.shape[0]}×{frame.shape[1]} cells does not divide into "
            f"{rows}×{cols} equal blocks."
        )
    row, column = (np.arange(n) * k // n for n, k in zip(frame.shape, (rows, cols), strict=True))
    number = row[:, np.newaxis] * cols + column
    around = np.pad(number, 1, mode="edge")
    alone = (around[2:, 1:-1] == around[:-2, 1:-1]) & (around[1:-1, 2:] == around[1:-1, :-2])
    shares = [1.0 * (number == n) for n in range(rows * cols)]
    cells = number.size // len(shares)
    return [Block(cells, one, _over(frame, one), _over(frame, one * alone)) for one in shares]


def root_sum(sums: Sums, maps: Iterable[Field]) -> Field:
    """Return the root of a sum of the squares of some maps."""
    return sqrt(sums(total(map(square, maps))))


def _over(frame: FrameFields, share: Floats) -> Sums:
    return Field.sum if share.all() else lambda values: (values * frame.constant(share)).sum()
