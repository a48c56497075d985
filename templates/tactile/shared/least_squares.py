"""What fits of contacts to the readings of a whole array share."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.shared.loads import Loads, square

FAR = 0.4
"""What radius and centre of a contact move by in a step at most, in radii."""

SMALLEST, LARGEST = 0.5, 0.75
"""Contact radii that are looked for: cells, and sides of the array."""

TINY = 1e-12


@dataclass(frozen=True, slots=True)
class Felt:
    """The normal readings that contacts are fitted to.

    Attributes
    ----------
    frame : FrameFields
    inside : Field
        Map: 1 for taxels that tell what they feel, else 0.
    normal : Field
        Map: readings, 0 where they tell nothing.
    noise : Field
        Variance of one.
    depth : float
        Of the taxels, pitches.
    reads : "strain" or "stress"
    """

    frame: FrameFields
    inside: Field
    normal: Field
    noise: Field
    depth: float
    reads: Reads

    def share(self, left: Field) -> Field:
        """Return the share of the signal that is left, the noise taken off."""
        rest = square(left).sum() - self.inside.sum() * self.noise
        return sqrt(maximum(rest, 0.0) / maximum(square(self.normal).sum(), TINY))

    def within(self, radius: Field) -> Field:
        """Return a contact radius that is looked for."""
        return minimum(maximum(radius, SMALLEST), LARGEST * max(self.frame.shape))


def felt_of(loads: Loads, depth: float, reads: Reads) -> Felt:
    """Return what sound taxels feel."""
    inside = where(loads.sound & loads.alive, 1.0, 0.0)
    return Felt(loads.frame, inside, inside * loads.normal, loads.normal_noise, depth, reads)


def repeat(
    times: int,
    body: Callable[..., tuple[Field, ...]],
    *values: Field,
    stop: Callable[..., Field] | None = None,
) -> tuple[Field, ...]:
    """Return what a body makes of numbers and maps when it is run so many times.

    Parameters
    ----------
    times : int
    body : callable
        Takes the values and returns what they become.
    values : Field
    stop : callable, optional
        Takes the number of runs and the new values and returns a flag that ends it before.
    """

    def counted(*carried: Field) -> tuple[Field, ...]:
        return (*body(*carried[:-1]), carried[-1] + 1.0)

    def until(*carried: Field) -> Field:
        over = carried[-1] > times - 0.5
        return over if stop is None else over | stop(carried[-1], *carried[:-1])

    count = 0.0 * (values[0] if values[0].scalar else values[0].sum())
    return loop(counted, *values, count, limit=times, until=until).values[:-1]


def at_most(value: Field, size: Field | float) -> Field:
    """Return a value cut to a size, of either sign."""
    return minimum(maximum(value, -1.0 * size), size)


def part_of(left: Field, way: Field) -> Field:
    """Return how much of a map is in another, by least squares."""
    return (left * way).sum() / maximum(square(way).sum(), TINY)


def apart(maps: Iterable[Field]) -> list[Field]:
    """Return the maps, each without its share of those before it, of power 1."""
    found: list[Field] = []
    for each in maps:
        rest = without(each, found)
        found.append(rest / sqrt(maximum(square(rest).sum(), TINY)))
    return found


def without(rest: Field, ways: Iterable[Field]) -> Field:
    """Return what is left of a map without its shares of maps that are of power 1 and apart."""
    for way in ways:
        rest = rest - (rest * way).sum() * way
    return rest
