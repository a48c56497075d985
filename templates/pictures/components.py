"""Connected components, counted one by one: a wave fills each from its first cell."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, where
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templating.library import get_template


@program
def components(frame: FrameFields) -> Mapping[str, Field]:
    """Count the eight-connected black objects of a picture.

    Returns
    -------
    count : number of objects.
    largest : number of cells of the largest one.
    """
    recall = get_template("RECALL")
    rows, cols = frame.shape
    number = frame.row * cols + frame.column

    def take_one(left: Field, count: Field, largest: Field) -> tuple[Field, Field, Field]:
        first = left & number.equals(where(left, number, rows * cols).min())
        filled = apply(recall, input=left.picture(), state=first.picture())
        result = left & filled.black()
        size = result.count()
        return left & ~result, count + where(size > 0.0, 1.0, 0.0), maximum(size, largest)

    def none_left(left: Field, *_: Field) -> Field:
        return ~left.any()

    objects, none = frame.channel("picture").black(), frame.constant(0.0)
    # at most every second cell of every second row is an object of its own
    limit = ((rows + 1) // 2) * ((cols + 1) // 2) + 1
    counted = loop(take_one, objects, none, none, limit=limit, until=none_left)
    return {"count": counted.values[1], "largest": counted.values[2]}
