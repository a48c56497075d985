"""Round contacts, fitted to what all taxels read: a flat punch, or a sphere."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.contact_mechanics.elliptic_contact_fit import NARROW, Whole
from cnnum.templates.tactile.contact_mechanics.sphere_response import (
    Pushed,
    pulled_by,
    punched_by,
    pushed_by,
)
from cnnum.templates.tactile.shared.least_squares import (
    FAR,
    TINY,
    Felt,
    apart,
    at_most,
    part_of,
    repeat,
    without,
)
from cnnum.templates.tactile.shared.loads import square

PUNCH_STEPS = 6
"""Gauss–Newton steps of a punch from the circle through its outline, which is up to a third of a
cell off."""

MET = 0.03
"""Share of the signal that a punch leaves at most when it is met: 0.01, and a ring 0.08 or more."""

TRIES, THIN = 3, 0.5
"""Starts under covers thinner than so many pitches: from the circle, and from narrower and wider
ones by half the depth. What taxels read of a rim is about as wide as the cover is thick, and steps
from farther away may end beside it: under 0.3 pitches, in 13 of 240 from the circle alone, in none
from three."""

SPHERE_STEPS = 6
"""The same of a sphere, and of each of several, in turn."""

LOAD_STEPS = 2
"""The same before them, to the load on the surface. What it is blurred by is a cell, whatever the
cover, so that steps meet it from farther away than they meet what taxels under a thin cover read:
in strain under 0.3 pitches 17 of 240 pairs were not met without them, 3 with them."""

CELL = 12.0**-0.5
"""Cover under which stress is as blurred as by the mean over a cell, to the second order in the
wave number: 1 − (kz)²/2 for the one, 1 − k²/24 for the other."""

START, SPREAD = 0.2, 2.77
"""Share of the largest load above which loads give centre and radius, and square of the radius over
the mean square way of what a Hertzian pressure has above it. Radii come out 0.05 to 0.1 cells too
small. From 0.3 cells too small, one pair in five in strain under 0.3 pitches was given up."""

STUCK = (1.0, 0.75, 0.5)
"""Radii of what a pull shears, over that of the contact: all of it, and less what sticks."""

NARROWER = 0.65
"""Radius of each further start of a sphere, over that of the one before. In strain, which a pull
changes as much as the push does, its load looks wider: of 60 spheres of 0.8 to 1.2 cells under 0.3
pitches that slip, 12 are not met from one start, 4 from three."""

ENOUGH = 36
"""Taxels of an array that tells a pull, too: on 16 its numbers, beside the four of a push, explain
uniform discs."""

TOLD, EXPLAINED = 25.0, 0.1
"""What a pull must explain: so many times the noise of one reading, as a power (by chance the six
numbers of a pull take 6 ± 3.5), and all but a tenth of what the push leaves, or all but as much.
Where half was enough, a square of 2.5 cells was taken for a pulled sphere."""

Shape = Callable[[Field, Field, float, Reads], Pushed]


@dataclass(frozen=True, slots=True)
class Round:
    """A round contact: its radius and centre, cells."""

    radius: Field
    column: Field
    row: Field

    def away(self, frame: FrameFields) -> Field:
        """Return the square distance of each taxel from the centre."""
        return square(frame.column - self.column) + square(frame.row - self.row)


@dataclass(frozen=True, slots=True)
class Punch:
    """A flat punch, and the share of the signal that it leaves."""

    at: Round
    left: Field


@dataclass(frozen=True, slots=True)
class Sphere:
    """A sphere: what it is as a whole, and the radius of the load that its fit began with."""

    found: Whole
    begun: Field


@dataclass(frozen=True, slots=True)
class Seen:
    """What taxels feel of a contact, how much of it, and how that changes: maps.

    Attributes
    ----------
    at : Round
    normal : Field
        What the contact is fitted to.
    away : Field
        Square distance from the centre.
    size : Field
        Largest pressure.
    signal : Field
        What a pressure of 1 makes.
    ways : tuple of Field
        How that changes with radius, column and row, beside itself and what a pull adds.
    pulls : tuple of Field
        What a pull adds along columns and rows, of power 1 and apart; none where it is not asked.
    """

    at: Round
    normal: Field
    away: Field
    size: Field
    signal: Field
    ways: tuple[Field, ...]
    pulls: tuple[Field, ...]


def punch_on(felt: Felt, guess: Round) -> Punch:
    """Return the flat punch that explains a frame best, starting near it."""

    def stepped(*values: Field) -> tuple[Field, ...]:
        seen = seen_of(felt, felt.normal, Round(*values[:3]), punched_by)
        now, left = moved(felt, seen)
        return (*numbers(now), felt.share(left))

    def tried(*values: Field) -> tuple[Field, ...]:
        wider = values[0]
        start = (felt.within(guess.radius + wider), guess.column, guess.row, values[4])
        found = repeat(PUNCH_STEPS, stepped, *start)
        other = where(wider < 0.0, -1.0 * wider, -0.5 * felt.depth)
        return other, *found

    def met(_: Field, *values: Field) -> Field:
        return values[4] < MET

    none = 0.0 * guess.radius
    tries = TRIES if felt.depth < THIN else 1
    _, *at, left = repeat(tries, tried, none, *numbers(guess), none, stop=met)
    return Punch(Round(*at), left)


def sphere_on(felt: Felt, load: Field) -> Sphere:
    """Return the sphere, pressed and pulled, that explains a frame best.

    Parameters
    ----------
    felt : Felt
    load : Field
        On the surface, for the first guess.
    """
    begun, above = about(felt, load), surface(felt, load)
    many = felt.frame.shape[0] * felt.frame.shape[1] >= ENOUGH

    def nearer(*values: Field) -> tuple[Field, ...]:
        return numbers(moved(above, seen_of(above, above.normal, Round(*values)))[0])

    def stepped(*values: Field) -> tuple[Field, ...]:
        # in stress a pull is like a shift
        seen = seen_of(felt, felt.normal, Round(*values), pulled=many and felt.reads == "strain")
        return numbers(moved(felt, seen)[0])

    def tried(*values: Field) -> tuple[Field, ...]:
        start, *best = values
        at = Round(*repeat(SPHERE_STEPS, stepped, start, *near[1:]))
        seen = seen_of(felt, felt.normal, at)
        now = (at.radius, *(_pushed_or_pulled if many else judged)(felt, seen))
        better = now[-1] < best[-1]
        kept = (where(better, new, old) for new, old in zip(now, best, strict=True))
        return (NARROWER * start, *kept)

    def met(_: Field, *values: Field) -> Field:
        return values[-1] < MET

    near = repeat(LOAD_STEPS, nearer, *numbers(begun))
    tries = TRIES if felt.depth < THIN and felt.reads == "strain" else 1
    none = 0.0 * begun.radius
    _, radius, flatness, unsure, left = repeat(
        tries, tried, near[0], none, none, none, none + 1.0, stop=met
    )
    return Sphere(Whole(left, flatness, unsure, radius), begun.radius)


def _pushed_or_pulled(felt: Felt, seen: Seen) -> tuple[Field, ...]:
    """Return flatness, its standard deviation, and what is left, with a pull if that is told."""
    pushed, pulled = judged(felt, seen), judged(felt, _with_pulls(felt, seen))
    power = square(felt.normal).sum()
    before, after, least = power * square(pushed[-1]), power * square(pulled[-1]), TOLD * felt.noise
    told = (before - after > least) & ((after < EXPLAINED * before) | (after < least))
    return tuple(where(told, *both) for both in zip(pulled, pushed, strict=True))


def _with_pulls(felt: Felt, seen: Seen) -> Seen:
    """Return what is felt of a contact, and what pulls add to it, whatever part of it sticks."""
    columns, rows = felt.frame.column - seen.at.column, felt.frame.row - seen.at.row
    pulls = list[Field]()
    for share in STUCK:
        size = share * seen.at.radius
        pull = felt.inside * pulled_by(seen.away, size, felt.depth, felt.reads)
        pulls += [pull * columns, pull * rows]
    return replace(seen, pulls=tuple(pulls))


def surface(felt: Felt, load: Field) -> Felt:
    """Return the load on the surface as if it were felt."""
    return replace(felt, normal=felt.inside * load, depth=CELL, reads="stress")


def numbers(at: Round) -> tuple[Field, Field, Field]:
    """Return what a round contact is made of, in the order of its parts."""
    return at.radius, at.column, at.row


def seen_of(
    felt: Felt, normal: Field, at: Round, shape: Shape = pushed_by, pulled: bool = False
) -> Seen:
    """Return what taxels feel of a contact.

    Parameters
    ----------
    felt : Felt
    normal : Field
        What the contact is fitted to.
    at : Round
    shape : callable
        What its load makes: a sphere's unless given.
    pulled : bool
        It may be pulled, too.
    """
    columns, rows = felt.frame.column - at.column, felt.frame.row - at.row
    away = square(columns) + square(rows)
    seen = shape(away, at.radius, felt.depth, felt.reads)
    signal = felt.inside * seen.signal
    slope = -2.0 * felt.inside * seen.by_away
    raw = (felt.inside * seen.by_radius, slope * columns, slope * rows)
    ways = [way - part_of(way, signal) * signal for way in raw]
    pulls: list[Field] = []
    if pulled:
        pull = felt.inside * pulled_by(away, at.radius, felt.depth, felt.reads)
        pulls = apart((pull * columns, pull * rows))
        ways = [without(way, pulls) for way in ways]
    size = maximum(part_of(normal, signal), TINY)
    return Seen(at, normal, away, size, signal, tuple(ways), tuple(pulls))


def moved(felt: Felt, seen: Seen) -> tuple[Round, Field]:
    """Return the contact after a step, and what it leaves then.

    Each number is fitted to what those before it leave: on few taxels radius and centre are not
    independent.
    """
    left = without(seen.normal - seen.size * seen.signal, seen.pulls)
    far, now = FAR * seen.at.radius, list[Field]()
    for was, way in zip(numbers(seen.at), seen.ways, strict=True):
        much = part_of(left, way)
        left = left - much * way
        now.append(was + at_most(much / seen.size, far))
    return Round(felt.within(now[0]), now[1], now[2]), left


def judged(felt: Felt, seen: Seen, left: Field | None = None) -> tuple[Field, Field, Field]:
    """Return flatness, its standard deviation, and the share of the signal that is left.

    Parameters
    ----------
    felt : Felt
    seen : Seen
    left : Field, optional
        What the contact leaves; if not given, all that its numbers and pulls cannot tell.
    """
    ways = apart((seen.signal, *seen.ways, *seen.pulls))
    narrow = pushed_by(seen.away, NARROW * seen.at.radius, felt.depth, felt.reads).signal
    narrow = without(felt.inside * narrow, ways)
    left = without(seen.normal, ways) if left is None else left
    much, unit = part_of(left, narrow), NARROW * seen.size
    unsure = sqrt(felt.noise / maximum(square(narrow).sum(), TINY)) / unit
    return -much / unit, unsure, felt.share(left - much * narrow)


def risen(felt: Felt, load: Field) -> Field:
    """Return by how much loads exceed a share of the largest."""
    return felt.inside * maximum(load - START * load.max(), 0.0)


def about(felt: Felt, load: Field) -> Round:
    """Return a contact with the centre and the spread of a load."""
    frame, weight = felt.frame, risen(felt, load)
    whole = maximum(weight.sum(), TINY)
    row, column = (weight * frame.row).sum() / whole, (weight * frame.column).sum() / whole
    at = Round(row, column, row)
    away = (weight * at.away(frame)).sum() / whole
    return Round(felt.within(sqrt(SPREAD * away)), column, row)
