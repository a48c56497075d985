"""Round outlines: the circle through what was found of one, and where a circle crosses links."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import shift
from cnnum.templates.tactile.contact_mechanics.edge_crossings import WAYS, Links
from cnnum.templates.tactile.contact_mechanics.sphere_fit import Round
from cnnum.templates.tactile.shared.least_squares import TINY, Felt
from cnnum.templates.tactile.shared.loads import square


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle, and the root of the mean square distance of places from it, cells."""

    at: Round
    off: Field


def circle_through(felt: Felt, links: Sequence[Links], ends: Sequence[Field]) -> Circle:
    """Return the circle through the places of links where an outline ends.

    It is the one of least squares in ρ² (Kåsa 1976): no steps are needed.
    """
    frame = felt.frame
    weights = [where(end, 1.0, 0.0) for end in ends]
    number = maximum(_sum(weights), 1.0)
    columns = [
        frame.column + cols * link.place for link, (_, cols) in zip(links, WAYS, strict=True)
    ]
    rows = [frame.row + rows * link.place for link, (rows, _) in zip(links, WAYS, strict=True)]
    column = _sum(_times(weights, columns)) / number
    row = _sum(_times(weights, rows)) / number
    right, down = [each - column for each in columns], [each - row for each in rows]
    aside, along = _times(weights, right), _times(weights, down)
    away = [square(u) + square(v) for u, v in zip(right, down, strict=True)]
    wide, high, slant = (
        _sum(_times(aside, right)),
        _sum(_times(along, down)),
        _sum(_times(aside, down)),
    )
    pull, sink = 0.5 * _sum(_times(aside, away)), 0.5 * _sum(_times(along, away))
    apart = maximum(wide * high - square(slant), TINY)
    x, y = (high * pull - slant * sink) / apart, (wide * sink - slant * pull) / apart
    # least squares hold the mean of ρ² at the radius's own
    mean = (wide + high) / number
    radius = felt.within(sqrt(square(x) + square(y) + mean))
    off = [
        square(q - 2.0 * (x * u + y * v) - mean) for q, u, v in zip(away, right, down, strict=True)
    ]
    far = sqrt(_sum(_times(weights, off)) / number) / (2.0 * radius)
    return Circle(Round(radius, column + x, row + y), far)


def on_circle(frame: FrameFields, link: Links, way: tuple[int, int], at: Round) -> Links:
    """Return a link in one direction as a circle crosses it.

    Along a link the square distance from the centre is a parabola of height 1.
    """
    beyond = at.away(frame) - square(at.radius)
    next_one = shift(beyond, -way[0], -way[1], boundary=-1.0)
    slope = next_one - beyond - 1.0
    place = 0.5 * (sqrt(square(slope) - 4.0 * beyond) - slope)
    return replace(link, crosses=(beyond <= 0.0) & (next_one > 0.0), place=place)


def _times(ones: Sequence[Field], others: Sequence[Field]) -> list[Field]:
    return [one * other for one, other in zip(ones, others, strict=True)]


def _sum(maps: Sequence[Field]) -> Field:
    return sum(maps[1:], start=maps[0]).sum()
