"""The centre points of objects: eight peeling templates in turn until nothing changes."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templating.library import get_template

SIDES = tuple(get_template(f"CENTER{number}") for number in range(1, 9))
"""Peel the west side first, then on, clockwise."""


@program
def center(frame: FrameFields) -> Mapping[str, Field]:
    """Shrink the black objects of a picture to points: one an object without holes.

    Returns
    -------
    picture : logic map of the points.
    rounds : how often all eight sides were peeled.
    """

    def peel(objects: Field) -> Field:
        for side in SIDES:
            objects = apply(side, input=objects.picture()).black()
        return objects

    # each round but the last takes a cell away
    limit = frame.shape[0] * frame.shape[1] + 1
    shrunk = loop(peel, frame.channel("picture").black(), limit=limit)
    return {"picture": shrunk.value, "rounds": shrunk.iterations}
