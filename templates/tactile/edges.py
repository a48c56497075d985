"""Edges of what presses on the skin: taxels just inside a sharp rim."""

from collections.abc import Mapping

from cnnum.library import get_template
from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, sqrt
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templates.tactile.contact import LEVEL
from cnnum.templates.tactile.loads import LIFT, PUSH, Loads, loads_of

FINE, COARSE = 0.125, 0.5
"""Cells². Times of the two diffusion waves: their difference sees what bends within a cell."""

CONTRAST = 0.1
"""Least difference, as a share of the peak load. Straight rims of a uniform load have 0.12 in the
stress under half a cell of cover, 0.07 under a whole one (0.23 and 0.15 in normal strain, which is
a band-pass itself); spheres of 4 cells and more have up to 0.08 and 0.07 (0.20 and 0.11)."""


@program
def edges(
    frame: FrameFields, *, push: float = PUSH, contrast: float = CONTRAST
) -> Mapping[str, Field]:
    """Edges, by a difference of diffusion waves and a threshold.

    A diffusion wave takes off what bends: the more, the longer it runs. Two of them differ inside
    a rim by about 3/8 of a cell squared times the load's curvature, and much less in a contact
    that is many cells wide and smooth, such as a sphere's. A contact few cells wide bends
    everywhere, and is all rim.

    Parameters
    ----------
    frame : FrameFields
        Only `normal` is read.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    contrast : float
        Least difference of the waves, as a share of the peak load.

    Returns
    -------
    mapping
        `edges` (logic map), `edge_count` (taxels), `edge_row`, `edge_column` (their centroid,
        cells).
    """
    return edges_of(loads_of(frame, push), contrast=contrast)


def edges_of(loads: Loads, *, contrast: float = CONTRAST) -> Mapping[str, Field]:
    """Return the outputs of `edges` from what other programs share with it."""
    frame, diffusion = loads.frame, get_template("tactile_diffusion")
    fine = apply(diffusion, input=loads.normal, duration=FINE)
    coarse = apply(diffusion, input=loads.normal, duration=COARSE)
    level = maximum(contrast * loads.normal.max(), LIFT * sqrt(loads.normal_noise))
    scaled = minimum(maximum(LEVEL * (fine - coarse) / level, -1.0), 1.0)
    found = apply(get_template("contact_threshold"), input=scaled).black() & loads.contact
    number = found.count()
    return {
        "edges": found,
        "edge_count": number,
        "edge_row": (frame.row * found).sum() / number,
        "edge_column": (frame.column * found).sum() / number,
    }
