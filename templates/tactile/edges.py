"""Edges of what presses on the skin: where its outline passes, between the taxels."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply, shift
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.contact_mechanics.edge_crossings import WAYS, Links, links_of
from cnnum.templates.tactile.contact_mechanics.elliptic_contact_fit import Whole, whole_of
from cnnum.templates.tactile.contact_mechanics.indenter_classes import (
    are_spheres,
    is_edged,
    is_round,
    is_smooth,
    punch_of,
)
from cnnum.templates.tactile.contact_mechanics.rim_circle_fit import circle_through, on_circle
from cnnum.templates.tactile.cover_model.deconvolution import (
    DEPTH,
    READS,
    filter_template,
    noise_gain,
    surface_load,
)
from cnnum.templates.tactile.shared.least_squares import Felt, felt_of
from cnnum.templates.tactile.shared.loads import LIFT, PUSH, Loads, loads_of

SHARE = 0.3
"""Least load along an edge, as a share of the largest."""

RISE = {0.3: 0.70, 0.5: 0.735, 0.75: 0.785}
"""Cells in which the load of an edge rises from half to 0.88 of its height, at most, by pitches of
cover; the thicker it is, the more the filter rounds. A uniform load takes 0.4 to 0.9, with the
place of the outline between the taxels; on average 0.71 at most under 0.3 pitches, and 0.84 (small
rectangles) under one. Hertz's pressure takes 0.70 to 0.81 at a radius of 2 cells, 0.79 to 0.89 at
2.5 and 0.96 at 3."""

EDGED_RISE = 0.86
"""Cells in which the load of one edged body rises at most."""

VOTERS = 3
"""Cells to each side whose links are averaged before an edge is called sharp."""

HOLLOW_VOTERS = 3
"""The same for whether a load is a punch's, along one side of it."""

NEARER = 0.501
"""Cells up to which the outline counts as nearest to the inner taxel of a link. A load that falls
from all to nothing on one link is half midway, where rounding would choose."""

HOLLOW = (0.2, 0.26)
"""Mean of what the inside lacks from which the load may be a punch's, and from which it is."""


@program
def edges(
    frame: FrameFields,
    *,
    push: float = PUSH,
    depth: float = DEPTH,
    reads: Reads = READS,
    rise: float | None = None,
) -> Mapping[str, Field]:
    """Edges, from the surface load that the cover has blurred.

    The cover's blur is taken off by a 7×7 template. The outline passes where the load falls below
    half of what it is inside. It is an edge where the load rises to its height within a cell; a
    smooth contact such as a sphere's takes longer. Where one such contact explains the whole frame,
    there is no edge in it.

    Parameters
    ----------
    frame : FrameFields
        Only `normal` is read.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    depth : float
        Cover above the taxels, in pitches; up to 1 for what `docs/programs/edges.md` measures.
    reads : "strain" or "stress"
        What the taxels read.
    rise : float, optional
        Cells in which the load of an edge rises from half to 0.88 of its height, on average, at
        most; by the depth unless given.

    Returns
    -------
    mapping
        `edges` (logic map: the taxels nearest to the outline), `edge_count` (taxels), `edge_row`,
        `edge_column` (their centroid, cells), `edge_to_right`, `edge_to_below` (maps: how far from
        the taxel towards its right and lower neighbour the outline passes, 0 to 1 cell; −1 where
        it does not), `edge_load` (map: the load on the surface), `surround_inhibition` (how far
        the normal reading falls below rest beside the contact, as a share of its peak).
    """
    return edges_of(loads_of(frame, push), depth=depth, reads=reads, rise=rise)


def edges_of(
    loads: Loads, *, depth: float = DEPTH, reads: Reads = READS, rise: float | None = None
) -> Mapping[str, Field]:
    """Return the outputs of `edges` from what other programs share with it."""
    frame = loads.frame
    load = surface_load(loads.normal, depth, reads)
    noise = sqrt(loads.normal_noise)
    least = maximum(SHARE * load.max(), LIFT * noise_gain(depth, reads) * noise)
    links = links_of(frame, load, least)
    votes = _Votes(links)
    felt = felt_of(loads, float(depth), reads)
    whole = whole_of(felt, load, loads.contact)
    most: Field | float = rise_of(depth) if rise is None else rise
    if rise is None:
        most = where(is_edged(felt, whole), EDGED_RISE, most)
    sharp = votes.sharp(most) & loads.contact & ~is_smooth(whole)
    links = votes.placed(links)
    ends = [link.crosses & sharp for link in links]
    links, ends = _on_rounds(felt, load, whole, links, ends)
    found = _nearest(links, ends)
    number = found.count()
    return {
        "edges": found,
        "edge_count": number,
        "edge_row": (frame.row * found).sum() / number,
        "edge_column": (frame.column * found).sum() / number,
        "edge_to_right": _between(links, ends, 0),
        "edge_to_below": _between(links, ends, 2),
        "edge_load": load,
        "surround_inhibition": _surround(loads, noise),
    }


def _on_rounds(
    felt: Felt, load: Field, whole: Whole, links: tuple[Links, ...], ends: list[Field]
) -> tuple[tuple[Links, ...], list[Field]]:
    """Return links and where outlines end, if the whole frame is a flat punch or spheres."""
    found = (ends[0] | ends[1] | ends[2] | ends[3]).any()
    ball = is_round(felt, load, whole, found)
    punched, rim = punch_of(felt, whole, circle_through(felt, links, ends), found & ~ball)
    smooth = ball | are_spheres(felt, load, whole, found & ~punched & ~ball)
    rims = [on_circle(felt.frame, link, way, rim) for link, way in zip(links, WAYS, strict=True)]
    return (
        tuple(
            replace(link, place=where(punched, now.place, link.place))
            for now, link in zip(rims, links, strict=True)
        ),
        [where(punched, now.crosses, end & ~smooth) for now, end in zip(rims, ends, strict=True)],
    )


def rise_of(depth: float) -> float:
    """Return in how many cells an edge rises at most, under so many pitches of cover."""
    return float(np.interp(depth, list(RISE), list(RISE.values())))


class _Votes:
    """What the links around a taxel say together."""

    def __init__(self, links: tuple[Links, ...]) -> None:
        self._number = _around(VOTERS, links, [1.0] * len(links))
        self._rise = _around(VOTERS, links, [link.rise for link in links])
        self._near = _around(HOLLOW_VOTERS, links, [1.0] * len(links))
        self._hollow = _around(HOLLOW_VOTERS, links, [link.hollow for link in links])

    def sharp(self, rise: Field | float) -> Field:
        """Return where the load ends within a cell."""
        return self._rise < rise * self._number

    def placed(self, links: tuple[Links, ...]) -> tuple[Links, ...]:
        """Return the links, placed as on a punch where the load is hollow."""
        low, high = HOLLOW
        hollow = self._hollow / maximum(self._near, 1.0)
        share = minimum(maximum((hollow - low) / (high - low), 0.0), 1.0)
        return tuple(
            replace(link, place=link.place + share * (link.rim - link.place)) for link in links
        )


def _around(cells: int, links: tuple[Links, ...], values: Sequence[object]) -> Field:
    """Return the sum of values of links where an outline crosses, within so many cells."""
    size = 2 * cells + 1
    vote = filter_template(f"vote {cells}", np.ones((size, size)), "Sums what is around a cell.")
    parts = [where(link.crosses, value, 0.0) for link, value in zip(links, values, strict=True)]
    return apply(vote, input=sum(parts[1:], start=parts[0]))


def _nearest(links: tuple[Links, ...], ends: list[Field]) -> Field:
    """Return the taxels that the outline passes nearest to."""
    found: Field | None = None
    for link, end, (rows, cols) in zip(links, ends, WAYS, strict=True):
        inner = end & (link.place <= NEARER)
        here = inner | shift(end & (link.place > NEARER), rows, cols)
        found = here if found is None else found | here
    assert found is not None
    return found


def _between(links: tuple[Links, ...], ends: list[Field], way: int) -> Field:
    """Return where outlines pass between a taxel and its neighbour to the right, or below.

    A load that ends towards the left is held by the neighbour. Inside places are cut to the taxel.
    """
    out, back = links[way], links[way + 1]
    rows, cols = WAYS[way]
    place = where(ends[way], maximum(out.place, 0.0), -1.0)
    held = where(ends[way + 1], 1.0 - maximum(back.place, 0.0), -1.0)
    return maximum(place, shift(held, -rows, -cols, boundary=-1.0))


def _surround(loads: Loads, noise: Field) -> Field:
    low, high = -loads.normal.min(), loads.normal.max()
    return where(loads.contact & (low > LIFT * noise), low / high, 0.0)
