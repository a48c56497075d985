"""Thinning by families of templates, in turn until nothing changes."""

from collections.abc import Mapping

from cnnum.errors import name_error
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.templates.pictures.peeling import eight, peeled

FAMILIES = {
    "SKELE": eight("MATCNN_SKELE"),
    "SKLHV": eight("MATCNN_SKLHV"),
    "SKL": eight("MATCNN_SKL"),
    "HORSKEL": ("HORSKELL", "HORSKELR"),
    "VERSKEL": ("VERSKELT", "VERSKELB"),
}
"""Templates of each family in order: MatCNN's sets of eight, and pairs of the CNN library."""


@program
def thinning(frame: FrameFields, *, family: str = "SKELE") -> Mapping[str, Field]:
    """Thin the black objects of a picture with a family of templates.

    `SKELE`, `SKLHV` and `SKL` are MatCNN's families of eight elements. `HORSKEL` peels west and
    east sides, `VERSKEL` north and south sides.

    Returns
    -------
    picture : logic map of the skeleton.
    rounds : number of iterations, each of which applies all templates of the family.
    """
    if family not in FAMILIES:
        raise name_error("family of templates", family, FAMILIES)
    return peeled(frame, FAMILIES[family])
