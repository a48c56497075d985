"""Thinning by MatCNN's three families of eight elements, in turn until nothing changes."""

from collections.abc import Mapping

from cnnum.errors import name_error
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templating.library import get_template

FAMILIES = ("SKELE", "SKLHV", "SKL")


@program
def thinning(frame: FrameFields, *, family: str = "SKELE") -> Mapping[str, Field]:
    """Thin the black objects of a picture with the templates MATCNN_<family>1 to 8.

    Returns
    -------
    picture : logic map of the skeleton.
    rounds : how often all eight elements were tried.
    """
    if family not in FAMILIES:
        raise name_error("family of templates", family, FAMILIES)
    elements = [get_template(f"MATCNN_{family}{number}") for number in range(1, 9)]

    def thin(objects: Field) -> Field:
        for element in elements:
            objects = apply(element, input=objects.picture()).black()
        return objects

    # each round but the last takes a cell away
    limit = frame.shape[0] * frame.shape[1] + 1
    thinned = loop(thin, frame.channel("picture").black(), limit=limit)
    return {"picture": thinned.value, "rounds": thinned.iterations}
