"""Round contacts, fitted to what all taxels read: a flat punch, a sphere, or two spheres."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.loops import branch
from cnnum.programs.machine import FrameFields
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.least_squares import (
    FAR,
    TINY,
    Felt,
    apart,
    at_most,
    part_of,
    repeat,
    without,
)
from cnnum.templates.tactile.loads import square
from cnnum.templates.tactile.sphere import Pushed, punched_by, pushed_by
from cnnum.templates.tactile.whole import NARROW, Whole

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
"""The same of a sphere, and of each of two, in turn."""

LOAD_STEPS = 2
"""The same before them, to the load on the surface. What it is blurred by is a cell, whatever the
cover, so that steps meet it from farther away than they meet what taxels under a thin cover read:
in strain under 0.3 pitches 17 of 240 pairs were not met without them, 3 with them."""

CELL = 12.0**-0.5
"""Cover under which stress is as blurred as by the mean over a cell, to the second order in the
wave number: 1 − (kz)²/2 for the one, 1 − k²/24 for the other."""

TRIED, HOPELESS = 2, 0.15
"""Steps of each after which two spheres are given up, and share of the signal that they leave."""

SPLITS = 3
"""Times that the load is shared out between two centres anew."""

START, SPREAD = 0.2, 2.77
"""Share of each half's largest load above which loads give its centre and radius, and square of the
radius over the mean square way of what a Hertzian pressure has above it. Radii come out 0.05 to 0.1
cells too small. From 0.3 cells too small, one pair in five in strain under 0.3 pitches was given
up."""

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
class Pair:
    """Two spheres.

    Attributes
    ----------
    first, second : Whole
        What each is, beside the other.
    apart : Field
        Distance of their centres, in sums of their radii: below 1 they would overlap.
    """

    first: Whole
    second: Whole
    apart: Field


def punch_on(felt: Felt, guess: Round) -> Punch:
    """Return the flat punch that explains a frame best, starting near it."""

    def stepped(*values: Field) -> tuple[Field, ...]:
        seen = _seen(felt, felt.normal, Round(*values[:3]), punched_by)
        now, left = _moved(felt, seen)
        return (*_numbers(now), felt.share(left))

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
    _, *at, left = repeat(tries, tried, none, *_numbers(guess), none, stop=met)
    return Punch(Round(*at), left)


def sphere_on(felt: Felt, load: Field) -> Sphere:
    """Return the sphere that explains a frame best.

    Parameters
    ----------
    felt : Felt
    load : Field
        On the surface, for the first guess.
    """

    def steps_on(what: Felt, count: int, start: Round) -> Round:
        def stepped(*values: Field) -> tuple[Field, ...]:
            return _numbers(_moved(what, _seen(what, what.normal, Round(*values), pushed_by))[0])

        return Round(*repeat(count, stepped, *_numbers(start)))

    begun = _about(felt, load)
    near = steps_on(_surface(felt, load), LOAD_STEPS, begun)
    found = steps_on(felt, SPHERE_STEPS, near)
    seen = _seen(felt, felt.normal, found, pushed_by)
    flatness, unsure, left = _judged(felt, seen, felt.normal - seen.size * seen.signal)
    return Sphere(Whole(left, flatness, unsure, found.radius), begun.radius)


def pair_on(felt: Felt, load: Field) -> Pair:
    """Return the two spheres that explain a frame best, each fitted to what the other leaves.

    Parameters
    ----------
    felt : Felt
    load : Field
        On the surface, for the first guess.
    """
    near = _in_turn(_surface(felt, load), *_halves(felt, load), LOAD_STEPS)

    def judged(*values: Field) -> tuple[Field, ...]:
        now, seen, normal, left = _beside(felt, values)
        found = _judged(felt, seen, left)
        return (*values[3:6], *_numbers(now), normal - left, *values[10:13], *found)

    def hopeless(count: Field, *values: Field) -> Field:
        return (count > 2 * TRIED - 0.5) & (values[-1] > HOPELESS)

    def both_judged(*values: Field) -> tuple[Field, ...]:
        return repeat(2, judged, *values)

    *last, left = _in_turn(felt, Round(*near[:3]), Round(*near[3:6]), SPHERE_STEPS, hopeless)
    # what is given up leaves all
    blank = (0.0 * left, 0.0 * left, 0.0 * left + 1.0)
    found = branch(left < HOPELESS, both_judged, *last, *blank, *blank)
    one, two = Round(*found[:3]), Round(*found[3:6])
    away = sqrt(square(one.column - two.column) + square(one.row - two.row))
    return Pair(
        Whole(found[12], found[7], found[8], one.radius),
        Whole(found[12], found[10], found[11], two.radius),
        away / (one.radius + two.radius),
    )


def _surface(felt: Felt, load: Field) -> Felt:
    """Return the load on the surface as if it were felt."""
    return replace(felt, normal=felt.inside * load, depth=CELL, reads="stress")


def _in_turn(
    felt: Felt,
    first: Round,
    second: Round,
    steps: int,
    stop: Callable[..., Field] | None = None,
) -> tuple[Field, ...]:
    """Return the numbers of two spheres after steps of each, what the second makes, what is left.

    To begin with each makes what is felt nearer to it.
    """
    nearer = second.away(felt.frame) < first.away(felt.frame)

    def stepped(*values: Field) -> tuple[Field, ...]:
        now, _, normal, left = _beside(felt, values)
        # the other comes next: they change places
        return (*values[3:6], *_numbers(now), normal - left, felt.share(left))

    start = (*_numbers(first), *_numbers(second), where(nearer, felt.normal, 0.0))
    return repeat(2 * steps, stepped, *start, 0.0 * first.radius, stop=stop)


@dataclass(frozen=True, slots=True)
class _Seen:
    """What taxels feel of a contact, how much of it, and how that changes: maps."""

    at: Round
    normal: Field
    away: Field
    size: Field
    signal: Field
    ways: tuple[Field, ...]


def _beside(felt: Felt, values: tuple[Field, ...]) -> tuple[Round, _Seen, Field, Field]:
    """Return the first of two contacts after a step, what is felt of it, all, and what it leaves.

    Values are the numbers of both, and what the second makes.
    """
    normal = felt.normal - values[6]
    seen = _seen(felt, normal, Round(*values[:3]), pushed_by)
    now, left = _moved(felt, seen)
    return now, seen, normal, left


def _numbers(at: Round) -> tuple[Field, Field, Field]:
    return at.radius, at.column, at.row


def _seen(felt: Felt, normal: Field, at: Round, shape: Shape) -> _Seen:
    columns, rows = felt.frame.column - at.column, felt.frame.row - at.row
    away = square(columns) + square(rows)
    seen = shape(away, at.radius, felt.depth, felt.reads)
    signal = felt.inside * seen.signal
    slope = -2.0 * felt.inside * seen.by_away
    raw = (felt.inside * seen.by_radius, slope * columns, slope * rows)
    ways = tuple(way - part_of(way, signal) * signal for way in raw)
    return _Seen(at, normal, away, maximum(part_of(normal, signal), TINY), signal, ways)


def _moved(felt: Felt, seen: _Seen) -> tuple[Round, Field]:
    """Return the contact after a step, and what it leaves then.

    Each number is fitted to what those before it leave: on few taxels radius and centre are not
    independent.
    """
    left = seen.normal - seen.size * seen.signal
    far, moved = FAR * seen.at.radius, list[Field]()
    for was, way in zip(_numbers(seen.at), seen.ways, strict=True):
        much = part_of(left, way)
        left = left - much * way
        moved.append(was + at_most(much / seen.size, far))
    return Round(felt.within(moved[0]), moved[1], moved[2]), left


def _judged(felt: Felt, seen: _Seen, left: Field) -> tuple[Field, Field, Field]:
    """Return flatness, its standard deviation, and the share of the signal that is left."""
    narrow = pushed_by(seen.away, NARROW * seen.at.radius, felt.depth, felt.reads).signal
    narrow = without(felt.inside * narrow, apart((seen.signal, *seen.ways)))
    much, unit = part_of(left, narrow), NARROW * seen.size
    unsure = sqrt(felt.noise / maximum(square(narrow).sum(), TINY)) / unit
    return -much / unit, unsure, felt.share(left - much * narrow)


def _halves(felt: Felt, load: Field) -> tuple[Round, Round]:
    """Return two contacts to start from: the load is cut across its length, and shared out."""
    frame = felt.frame
    weight = _above(felt, load)
    whole = maximum(weight.sum(), TINY)
    row, column = (weight * frame.row).sum() / whole, (weight * frame.column).sum() / whole
    rows, columns = frame.row - row, frame.column - column
    wide = (weight * (square(columns) - square(rows))).sum() / (2.0 * whole)
    slant = (weight * columns * rows).sum() / whole
    spread = (weight * (square(columns) + square(rows))).sum() / (2.0 * whole)
    turn = maximum(sqrt(square(wide) + square(slant)), TINY)
    out = sqrt(spread + turn)
    right = out * sqrt(0.5 + 0.5 * wide / turn)
    down = out * sqrt(0.5 - 0.5 * wide / turn) * where(slant > 0.0, 1.0, -1.0)

    def shared(*values: Field) -> tuple[Field, ...]:
        nearer = Round(*values[:3]).away(frame) < Round(*values[3:]).away(frame)
        mine, others = where(nearer, load, 0.0), where(nearer, 0.0, load)
        return (*_numbers(_about(felt, mine)), *_numbers(_about(felt, others)))

    start = (out, column - right, row - down, out, column + right, row + down)
    last = repeat(SPLITS, shared, *start)
    return Round(*last[:3]), Round(*last[3:])


def _above(felt: Felt, load: Field) -> Field:
    """Return by how much loads exceed a share of the largest."""
    return felt.inside * maximum(load - START * load.max(), 0.0)


def _about(felt: Felt, load: Field) -> Round:
    """Return a contact with the centre and the spread of a load."""
    frame, weight = felt.frame, _above(felt, load)
    whole = maximum(weight.sum(), TINY)
    row, column = (weight * frame.row).sum() / whole, (weight * frame.column).sum() / whole
    at = Round(row, column, row)
    away = (weight * at.away(frame)).sum() / whole
    return Round(felt.within(sqrt(SPREAD * away)), column, row)
