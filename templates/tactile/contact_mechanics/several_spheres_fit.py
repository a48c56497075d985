"""Several spheres side by side, each fitted to what the others leave of all that taxels read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations

from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.loops import branch
from cnnum.templates.tactile.contact_mechanics.elliptic_contact_fit import Whole
from cnnum.templates.tactile.contact_mechanics.sphere_fit import (
    LOAD_STEPS,
    SPHERE_STEPS,
    Round,
    Seen,
    about,
    judged,
    moved,
    numbers,
    risen,
    seen_of,
    surface,
)
from cnnum.templates.tactile.shared.least_squares import TINY, Felt, repeat
from cnnum.templates.tactile.shared.loads import square

TRIED, HOPELESS = 2, 0.15
"""Steps of each after which spheres are given up, and share of the signal that they leave."""

SPLITS = 3
"""Times that the load is shared out between their centres anew."""

NUMBERS = 3
"""Of a round contact."""


@dataclass(frozen=True, slots=True)
class Several:
    """Spheres.

    Attributes
    ----------
    each : sequence of Whole
        What each is, beside the others.
    left : Field
        Share of the signal that all leave.
    apart : Field
        Least distance of two centres, in sums of their radii: below 1 they would overlap.
    """

    each: Sequence[Whole]
    left: Field
    apart: Field


def several_on(felt: Felt, load: Field, number: int) -> Several:
    """Return the spheres that explain a frame best, each fitted to what the others leave.

    Parameters
    ----------
    felt : Felt
    load : Field
        On the surface, for the first guess.
    number : int
        Of spheres, 2 or more.
    """
    end = NUMBERS * number
    carried = end + number - 1

    def judging(*values: Field) -> tuple[Field, ...]:
        now, seen, made, left = _beside(felt, number, values[:carried])
        told = (*values[carried + NUMBERS :], *judged(felt, seen, left))
        return (*_turned(number, values[:carried], now, made), *told)

    def hopeless(count: Field, *values: Field) -> Field:
        return (count > number * TRIED - 0.5) & (values[-1] > HOPELESS)

    def all_judged(*values: Field) -> tuple[Field, ...]:
        return repeat(number, judging, *values)

    near = _in_turn(surface(felt, load), _parts(felt, load, number), LOAD_STEPS)
    *last, left = _in_turn(felt, _rounds(near[:end]), SPHERE_STEPS, hopeless)
    # what is given up leaves all
    blank = (0.0 * left, 0.0 * left, 0.0 * left + 1.0) * number
    found = branch(left < HOPELESS, all_judged, *last, *blank)
    rounds, left = _rounds(found[:end]), found[-1]
    flatness, unsure = found[carried::NUMBERS], found[carried + 1 :: NUMBERS]
    each = [
        Whole(left, flat, error, at.radius)
        for flat, error, at in zip(flatness, unsure, rounds, strict=True)
    ]
    away = [
        sqrt(square(one.column - two.column) + square(one.row - two.row))
        / (one.radius + two.radius)
        for one, two in combinations(rounds, 2)
    ]
    return Several(each, left, reduce(minimum, away))


def _in_turn(
    felt: Felt,
    start: Sequence[Round],
    steps: int,
    stop: Callable[..., Field] | None = None,
) -> tuple[Field, ...]:
    """Return the numbers of spheres after steps of each, what all but the first make, what is left.

    To begin with each makes what is felt nearest to it.
    """
    number = len(start)
    away = [at.away(felt.frame) for at in start]
    nearest = reduce(minimum, away)
    made_by = [where(far <= nearest, felt.normal, 0.0) for far in away[1:]]

    def stepped(*values: Field) -> tuple[Field, ...]:
        now, _, made, left = _beside(felt, number, values[:-1])
        return (*_turned(number, values[:-1], now, made), felt.share(left))

    values = [value for at in start for value in numbers(at)]
    return repeat(number * steps, stepped, *values, *made_by, 0.0 * start[0].radius, stop=stop)


def _beside(felt: Felt, number: int, values: Sequence[Field]) -> tuple[Round, Seen, Field, Field]:
    """Return the first contact after a step, what is felt of it, what it makes, and what is left.

    Values are the numbers of all, and what all but the first make.
    """
    normal = felt.normal
    for made in values[NUMBERS * number :]:
        normal = normal - made
    seen = seen_of(felt, normal, Round(*values[:NUMBERS]))
    now, left = moved(felt, seen)
    return now, seen, normal - left, left


def _turned(number: int, values: Sequence[Field], now: Round, made: Field) -> tuple[Field, ...]:
    """Return the numbers of all and what they make, what was the first being the last now."""
    end = NUMBERS * number
    return (*values[NUMBERS:end], *numbers(now), *values[end + 1 :], made)


def _rounds(values: Sequence[Field]) -> list[Round]:
    return [Round(*values[at : at + NUMBERS]) for at in range(0, len(values), NUMBERS)]


def _parts(felt: Felt, load: Field, number: int) -> list[Round]:
    """Return contacts to start from, between which the load is shared out.

    It is cut across its length; each further one begins where most of the load lies farthest away.
    """
    parts = _shared_out(felt, load, _ends(felt, load))
    while len(parts) < number:
        far = risen(felt, load) * reduce(minimum, [at.away(felt.frame) for at in parts])
        there = where(far >= far.max(), 1.0, 0.0)
        count = maximum(there.sum(), 1.0)
        row = (there * felt.frame.row).sum() / count
        column = (there * felt.frame.column).sum() / count
        parts = _shared_out(felt, load, [*parts, Round(parts[0].radius, column, row)])
    return parts


def _shared_out(felt: Felt, load: Field, start: Sequence[Round]) -> list[Round]:
    """Return contacts after the load was shared out between their centres, some times anew."""

    def shared(*values: Field) -> tuple[Field, ...]:
        away = [at.away(felt.frame) for at in _rounds(values)]
        nearest = reduce(minimum, away)
        parts = [about(felt, where(far <= nearest, load, 0.0)) for far in away]
        return tuple(value for at in parts for value in numbers(at))

    return _rounds(repeat(SPLITS, shared, *(value for at in start for value in numbers(at))))


def _ends(felt: Felt, load: Field) -> list[Round]:
    """Return two contacts on either side of a load's middle, along its length."""
    frame = felt.frame
    weight = risen(felt, load)
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
    return [Round(out, column - right, row - down), Round(out, column + right, row + down)]
