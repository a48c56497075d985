"""Edges of the object on the skin: where its outline passes between the taxels.

    deconvolution      unblur (7×7, made for the cover)          the load on the surface
    surround           tactile_diffusion of that load            the load around a taxel
    inhibition         load − half of the surround > 0           inside; its rim crosses links
    edge template      edge_step, turned to four sides           the fall to each neighbour
    vote               tactile_diffusion of the sharp falls      the answer of the links around
    decision           edge_latch, bistable cells                an edge, or a smooth contact

Under a flat body the load ends within a cell; a sphere's pressure fades out over its radius. So the
question is which share of the fall, from within the rim to outside, a single cell takes. A uniform
load that ends between two cells takes ¾ of it on average over places. A rigid flat punch, whose
load rises towards its rim, takes more. Feedback is in the diffusion and in the bistable cells.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, sqrt, total, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply, shift
from cnnum.templates.tactile.cover_model.fields import (
    DEPTH,
    READS,
    Carries,
    noise_gain,
    surface_load,
)
from cnnum.templates.tactile.shared.loads import LIFT, PUSH, Loads, loads_of, whole_normal
from cnnum.templating.library import get_template

WAYS = ((0, 1), (-1, 0), (0, -1), (1, 0))
"""Steps outwards, rows and columns: right, up, left, down, each a quarter turn from the last."""

SPREAD, INHIBITS = 1.0, 0.5
"""Diffusion time of the surround, cells², and the share of it that a load must exceed."""

FAINT, LEAST, FALLS = 0.04, 0.15, 0.3
"""Shares of the peak load: by which a load exceeds that, which it has at least, and by which it
falls where it ends. Strain passes no mean, so that loads sink within a wide contact, too."""

SLANT = 0.6
"""Smallest slope along a link, relative to that across it; other links cross the rest."""

SHARP = 0.75
"""Share of its fall that the load at an edge takes within one cell, as for a uniform load."""

VOTE, FIRM = 8.0, 0.006
"""Diffusion time of the votes, cells², and their excess that turns a cell, in peak loads."""

SURE = 0.3
"""The same in the noise of a load. Without it a faint touch turns cells by chance, the more often
the more frames a press has, and they stay turned."""

WIDE = 7.0
"""Smallest number of cells inside. A contact narrower than three cells looks the same with and
without an edge."""

PLACE = (-0.87, 0.14, 1.07, -0.44)
"""Cells from the taxel outwards to the outline: a constant, and three weights of loads: next to it
within, its own, and outside, as shares of the larger of the first two."""


@program
def edges(
    frame: FrameFields,
    *,
    push: float = PUSH,
    depth: float = DEPTH,
    reads: Carries = READS,
    sharp: float = SHARP,
) -> Mapping[str, Field]:
    """Find the edges of objects, from the surface load that the cover has blurred.

    Parameters
    ----------
    frame : FrameFields
        Only `normal` is read. Nothing is known about the cells beyond the rim of the array, so
        arrays with only one or two rows or columns have no edges.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    depth : float
        Cover above the taxels, in pitches; up to 1 in the measurements of `docs/programs/edges.md`.
    reads : "strain", "stress" or "force"
        The measured quantity; "force" for taxels that each carry their own share of the load.
    sharp : float
        Smallest share of the fall of a load that must occur within one cell for an edge. A larger
        value finds fewer edges, but also mistakes fewer smooth contacts for edges.

    Returns
    -------
    mapping
        `edges` (logic map: the taxels nearest to the outline), `edge_count` (taxels), `edge_row`,
        `edge_column` (their centroid, cells), `edge_to_right`, `edge_to_below` (maps: how far from
        the taxel towards its right and lower neighbour the outline passes, 0 to 1 cell; −1 where
        it does not), `edge_load` (map: the load on the surface), `surround_inhibition` (how far
        the normal reading falls below rest next to the contact, as a share of its peak).

    Raises
    ------
    PhysicsError
        If the depth is out of range.
    UnknownNameError
        If `reads` is unknown.
    """
    loads = frame.once(loads_of, push=push)
    noise = sqrt(loads.normal_noise)
    load = surface_load(whole_normal(loads), depth, reads)
    peak = load.max()
    surround = apply(get_template("tactile_diffusion"), input=load, duration=SPREAD)
    unblurred = noise_gain(depth, reads) * noise
    least = maximum(LEAST * peak, LIFT * unblurred)
    inside = (load - INHIBITS * surround > FAINT * peak) & (load > least) & loads.contact
    links = _links(load, inside, FALLS * peak, sharp)
    edged = _decided(loads, links, peak, unblurred) & (inside.count() > WIDE - 0.5)
    links = [link._replace(crosses=link.crosses & edged) for link in links]
    result = _nearest(links)
    row, column = frame.centroid(result)
    return {
        "edges": result,
        "edge_count": result.count(),
        "edge_row": row,
        "edge_column": column,
        "edge_to_right": _between(links[0], links[2], WAYS[2]),
        "edge_to_below": _between(links[3], links[1], WAYS[1]),
        "edge_load": load,
        "surround_inhibition": _surround(loads, noise),
    }


class _Link(NamedTuple):
    """The links of every taxel to its neighbour on one side: three maps."""

    crosses: Field  # logic: the load ends on the way
    excess: Field  # of its fall within one cell over that of an edge, where it does
    place: Field  # cells outwards to where it ends; below 0 where that is inside


def _links(load: Field, inside: Field, least: Field, sharp: float) -> list[_Link]:
    """Return the links to the right, up, left and down."""
    step = get_template("edge_step")
    turned = [replace(step, name=f"edge_step {k}", B=np.rot90(step.B[0, 0], k)) for k in range(4)]
    falls = [apply(template, input=load) for template in turned]
    slopes = [abs(falls[way] - falls[way + 2]) for way in (0, 1)]
    links: list[_Link] = []
    for way, (rows, cols) in enumerate(WAYS):
        outer, inner = load - falls[way], load - falls[way - 2]
        top = maximum(load, inner)
        ends = inside & ~shift(inside, -rows, -cols, boundary="zero-flux")
        ends = ends & (slopes[way % 2] > SLANT * slopes[1 - way % 2]) & (top - outer > least)
        excess = maximum(falls[way], inner - load) - sharp * (top - outer)
        base, within, own, outside = PLACE
        place = base + (within * inner + own * load + outside * outer) / top
        place = minimum(maximum(place, -1.0), 1.0)
        links.append(_Link(ends, where(ends, excess, 0.0), where(ends, place, 0.0)))
    return links


def _decided(loads: Loads, links: list[_Link], peak: Field, noise: Field) -> Field:
    """Return where the links around say that there is an edge; links on the verge stay so."""
    memory = loads.frame.memory("edge", logic=True)
    excess = total(link.excess for link in links)
    # at the rim of the array no cell beyond is seen
    inner = np.zeros(loads.frame.shape)
    inner[1:-1, 1:-1] = 1.0
    excess = excess * loads.frame.constant(inner)
    votes = apply(get_template("tactile_diffusion"), input=excess, duration=VOTE)
    least = maximum(FIRM * peak, SURE * noise)
    votes = minimum(maximum(0.5 * votes / least, -1.0), 1.0)
    before = memory.value.picture()
    edged = apply(get_template("edge_latch"), input=votes, state=before).black() & loads.contact
    memory.store(edged)
    return edged


def _nearest(links: list[_Link]) -> Field:
    """Return the taxels that the outline passes nearest to."""
    field: Field | None = None
    for link, (rows, cols) in zip(links, WAYS, strict=True):
        within = link.crosses & (link.place < -0.5)
        own = link.crosses & (link.place >= -0.5) & (link.place <= 0.5)
        beyond = link.crosses & (link.place > 0.5)
        here = own | shift(beyond, rows, cols) | shift(within, -rows, -cols)
        field = here if field is None else field | here
    assert field is not None
    return field


def _between(out: _Link, back: _Link, way: tuple[int, int]) -> Field:
    """Return where outlines pass between a taxel and its neighbour to the right, or below.

    `out` ends towards that neighbour and `back` away from it. A place may lie inside of the taxel
    whose load ends, or that taxel may be the neighbour. Then the link before holds it.
    """
    ahead, behind = out.crosses & (out.place >= 0.0), back.crosses & (back.place < 0.0)
    own = maximum(where(ahead, out.place, -1.0), where(behind, -1.0 * back.place, -1.0))
    before, beyond = out.crosses & (out.place < 0.0), back.crosses & (back.place >= 0.0)
    held = maximum(where(before, 1.0 + out.place, -1.0), where(beyond, 1.0 - back.place, -1.0))
    return maximum(own, shift(held, *way, boundary=-1.0))


def _surround(loads: Loads, noise: Field) -> Field:
    low, high = -loads.normal.min(), loads.normal.max()
    return where(loads.contact & (low > LIFT * noise), low / high, 0.0)
