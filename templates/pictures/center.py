"""The centre points of objects: eight peeling templates in turn until nothing changes."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.templates.pictures.peeling import eight, peeled


@program
def center(frame: FrameFields) -> Mapping[str, Field]:
    """Shrink the black objects of a picture to points: one an object without holes.

    Returns
    -------
    picture : logic map of the points.
    rounds : how often all eight sides were peeled, from the west on, clockwise.
    """
    return peeled(frame, eight("CENTER"))
