"""The centre points of objects: eight peeling templates in turn until nothing changes."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.templates.pictures.peeling import eight, peeled


@program
def center(frame: FrameFields) -> Mapping[str, Field]:
    """Shrink the black objects of a picture to points, one for each object without holes.

    Returns
    -------
    picture : logic map of the points.
    rounds : number of iterations, each of which peels all eight sides clockwise from the west.
    """
    return peeled(frame, eight("CENTER"))
