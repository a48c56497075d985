"""Edge enhancement: emphasise the outlines in a frame, and locate them between the taxels.

    lateral inhibition   tactile_edge, 5×5 feedback, to rest     the enhanced frame
    edge templates       edge_step and its turn                  the fall to the right, and below
    slopes across        gradient_x, gradient_y                  outlines that run along a link
    passages             shift, local logic                      links across 0, where steepest

The wave of `tactile_edge` inhibits every taxel by its surround, as a retina does, and an elastic
cover to strain: an even pressure fades, and an outline becomes a steep passage from above 0 to
below. The program needs neither a model of the cover nor a depth. It reports an outline where the
frame shows it, which under a thick cover is farther out than on the skin
(docs/programs/edge-enhancement.md). Smooth contacts have a steepest place as well; `edges` decides
which ones have a sharp edge.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply, shift
from cnnum.templates.tactile.shared.loads import LIFT, PUSH, TINY, loads_of, whole_normal
from cnnum.templating.library import get_template

WAYS = ((0, 1), (1, 0))
"""Steps to the right and downwards, as (rows, columns)."""

STEEP = 0.4
"""Share of the steepest fall above which a zero crossing is an outline. The rim of a wide rigid
punch bears more than its middle and is also enhanced on its inner side, to a third of that."""

ALONG = 0.6
"""Smallest fall along a link, relative to the slope across it; other links cross the rest."""

SEEN = (-1, 1, 2)
"""Offsets of taxels along a link that are searched for a zero crossing."""

NOISE_GAIN = 1.162
"""Standard deviation of a fall of the enhanced frame over that of a reading: the root of the mean
over wave numbers of (g |1 − e^{ik}|)², with g the gain of `tactile_edge`."""


class _Links(NamedTuple):
    """The links of every taxel to its neighbour on one side: two maps."""

    crossed: Field  # logic: an outline passes
    place: Field  # cells from the taxel to where, 0 to 1


@program
def edge_enhancement(frame: FrameFields, *, push: float = PUSH) -> Mapping[str, Field]:
    """Enhance the outlines of objects that press on the skin, and locate them.

    Parameters
    ----------
    frame : FrameFields
        Only `normal` is read, in any unit, from an array with or without a cover.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.

    Returns
    -------
    mapping
        `edge_enhanced` (map: the frame after lateral inhibition, in its own unit), `edges` (logic
        map: the taxels nearest to an outline), `edge_count` (taxels), `edge_row`, `edge_column`
        (their centroid, cells), `edge_to_right`, `edge_to_below` (maps: how far from the taxel
        towards its right and lower neighbour the outline passes, 0 to 1 cell; −1 where it does
        not).
    """
    loads = frame.once(loads_of, push=push)
    enhanced = apply(get_template("tactile_edge"), input=whole_normal(loads))
    step = get_template("edge_step")
    below = replace(step, name="edge_step below", B=np.rot90(step.B[0, 0], 3))
    falls = apply(step, input=enhanced), apply(below, input=enhanced)
    across = (abs(apply(get_template(f"gradient_{axis}"), input=enhanced)) for axis in "yx")
    steepest = maximum(abs(falls[0]).max(), abs(falls[1]).max())
    least = maximum(STEEP * steepest, LIFT * NOISE_GAIN * sqrt(loads.normal_noise))
    right, down = (
        _links(where(loads.contact, fall, 0.0), other, enhanced > 0.0, least, way)
        for fall, other, way in zip(falls, across, WAYS, strict=True)
    )
    result = _nearest(right, WAYS[0]) | _nearest(down, WAYS[1])
    row, column = frame.centroid(result)
    return {
        "edge_enhanced": enhanced,
        "edges": result,
        "edge_count": result.count(),
        "edge_row": row,
        "edge_column": column,
        "edge_to_right": where(right.crossed, right.place, -1.0),
        "edge_to_below": where(down.crossed, down.place, -1.0),
    }


def _links(fall: Field, across: Field, on: Field, least: Field, way: tuple[int, int]) -> _Links:
    """Return the links where the frame passes 0, or next to it, and is steepest."""
    rows, cols = way
    steep = abs(fall)
    before, behind = shift(steep, rows, cols), shift(steep, -rows, -cols)
    most = rows * on.graph.shape[0] + cols * on.graph.shape[1]
    steps = [(-k * rows, -k * cols) for k in SEEN if abs(k) <= most]
    taxels = [shift(on, *step, boundary="zero-flux") for step in steps]
    somewhere, everywhere = on, on
    for taxel in taxels:
        somewhere, everywhere = somewhere | taxel, everywhere & taxel
    passes = somewhere & ~everywhere
    slope = 0.5 * (across + shift(across, -rows, -cols))
    ridge = (steep >= before) & (steep > behind) & (steep > ALONG * slope) & (steep > least)
    # the top of the parabola through three falls, which is never beyond half a link
    bend = maximum(2.0 * steep - before - behind, TINY)
    off = minimum(maximum(0.5 * (behind - before) / bend, -0.5), 0.5)
    return _Links(passes & ridge, 0.5 + off)


def _nearest(links: _Links, way: tuple[int, int]) -> Field:
    """Return the taxels at the nearer end of the links that an outline crosses."""
    near, far = links.place <= 0.5, links.place > 0.5
    return (links.crossed & near) | shift(links.crossed & far, *way)
