"""Thinning by MatCNN's three families of eight elements, in turn until nothing changes."""

from collections.abc import Mapping

from cnnum.errors import name_error
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.templates.pictures.peeling import eight, peeled

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
    return peeled(frame, eight(f"MATCNN_{family}"))
