"""The skeleton of objects: eight peeling templates in turn until nothing changes."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.templates.pictures.peeling import eight, peeled


@program
def skeleton(frame: FrameFields) -> Mapping[str, Field]:
    """Thin the black objects of a picture to lines.

    Returns
    -------
    picture : logic map of the skeleton.
    rounds : number of iterations, each of which peels all corners and sides clockwise from the
        north-west.
    """
    return peeled(frame, eight("SKELBW"))
