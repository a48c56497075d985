"""Connected patches of a logic map: how many, which is whose, and their centroids."""

from dataclasses import dataclass

from cnnum.programs.fields import Field, where
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import shift

NEIGHBOURS = tuple((r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c)


@dataclass(frozen=True, slots=True)
class Patches:
    """Eight-connected patches.

    Attributes
    ----------
    count : Field
        How many.
    label : Field
        Map: 0 outside, else the number of the patch, one more than its last cell in reading order.
    row, column : Field
        Maps: in each cell of a patch its weighted centroid, cells; 0 outside.
    """

    count: Field
    label: Field
    row: Field
    column: Field


def patches_of(frame: FrameFields, inside: Field, weight: Field) -> Patches:
    """Return the patches of a logic map, and their centroids by a weight above 0 inside."""
    rows, cols = frame.shape
    number = frame.row * cols + frame.column + 1.0
    label = _labels(inside, number, rows * cols)
    centre_row, centre_column = _centroids(frame, label, weight)
    return Patches(
        count=(inside & label.equals(number)).count(),
        label=label,
        row=centre_row,
        column=centre_column,
    )


def _labels(inside: Field, number: Field, cells: int) -> Field:
    """Let the largest number of each patch spread over it, a cell a turn.

    Numbers are whole; the results of transients are near enough to separate them.
    """

    def spread(label: Field) -> Field:
        most = label
        for row, col in NEIGHBOURS:
            other = shift(label, row, col)
            most = where(other > most + 0.5, other, most)
        return where(inside, most, 0.0)

    return loop(spread, where(inside, number, 0.0), limit=cells).value


def _centroids(frame: FrameFields, label: Field, weight: Field) -> tuple[Field, Field]:
    """Return each patch's centroid in its cells, patch by patch."""
    rows, cols = frame.shape

    def next_one(left: Field, row: Field, column: Field) -> tuple[Field, Field, Field]:
        mine = (left > left.max() - 0.5) & (left > 0.0)
        own = where(mine, weight, 0.0)
        own_row, own_column = frame.centroid(own)
        return where(mine, 0.0, left), where(mine, own_row, row), where(mine, own_column, column)

    def none_left(left: Field, *_: Field) -> Field:
        return ~(left > 0.0).any()

    limit = ((rows + 1) // 2) * ((cols + 1) // 2) + 1
    nothing = 0.0 * label
    done = loop(next_one, label, nothing, nothing, limit=limit, until=none_left)
    return done.values[1], done.values[2]
