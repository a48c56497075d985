"""Holes of objects: filled by a white wave that does not reach them, and found by logic."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templating.library import get_template


@program
def holes(frame: FrameFields) -> Mapping[str, Field]:
    """Fill the holes of the black objects of a picture.

    Returns
    -------
    filled : logic map of the objects with their holes.
    holes : logic map of the holes alone.
    area : number of its cells.
    """
    picture = frame.channel("picture")
    filled = apply(get_template("HOLE"), input=picture).black()
    enclosed = filled & ~picture.black()
    return {"filled": filled, "holes": enclosed, "area": enclosed.count()}
