"""A frame as a whole: whether one contact explains it, and whether that is smooth.

A Hertzian pressure is fitted to what all taxels read by least squares, its contact an ellipse: the
map of a sphere, stretched. What a pull adds to it is Hertz's traction of the whole contact less one
of the part that sticks. How flat the pressure is inside is told by the map of a narrower sphere
beside it: a uniform load lacks it, and a sphere's needs none.
"""

from dataclasses import dataclass, fields, replace

from cnnum.programs.fields import Field, maximum, sqrt
from cnnum.programs.loops import branch
from cnnum.templates.tactile.contact_mechanics.sphere_response import pulled_by, pushed_by
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

START = 0.3
"""Share of the largest load above which loads give the first guess."""

SPREAD = 2.2
"""Square of a contact radius over the mean square way from its centre: 2.5 for Hertz's pressure, 2
for a uniform one."""

STEPS = 4
"""Gauss–Newton steps. Spheres of 2 cells and more are met to the noise then, but in strain under a
third of a pitch of cover, where half of them are."""

LONG = 0.3
"""What the ellipse is stretched by in a step at most."""

LONGEST = 0.85
"""Largest stretch: an ellipse 2.2 times as long as it is wide."""

NARROW = 0.7
"""Radius of the narrower sphere, over that of the contact. Its map, less what the fit takes, is
like that of a uniform disc: their correlation is 0.91 to 0.99 from 0.5 pitches of cover on."""


@dataclass(frozen=True, slots=True)
class Whole:
    """What a frame is as a whole.

    Attributes
    ----------
    left : Field
        Share of the signal that one contact leaves, the noise taken off.
    flatness : Field
        Of its pressure: 0 is Hertz's, 0.6 to 0.9 a uniform one, 1.8 to 2.8 a flat punch's.
    unsure : Field
        Standard deviation of the flatness.
    radius : Field
        Of the contact, cells.
    """

    left: Field
    flatness: Field
    unsure: Field
    radius: Field


@dataclass(frozen=True, slots=True)
class _Contact:
    """An elliptic contact: radius and centre, cells; stretch along the columns, and aslant."""

    radius: Field
    column: Field
    row: Field
    along: Field
    aslant: Field


@dataclass(frozen=True, slots=True)
class _Seen:
    """What taxels feel of a contact, and how that changes with each of its numbers: maps."""

    away: Field
    signal: Field
    changes: tuple[Field, ...]


def whole_of(felt: Felt, load: Field, contact: Field) -> Whole:
    """Return what a frame is as a whole; anything while nothing touches.

    Parameters
    ----------
    felt : Felt
    load : Field
        On the surface, for the first guess.
    contact : Field
        Flag.
    """
    one = felt.frame.constant(1.0)

    def judged(*values: Field) -> tuple[Field, ...]:
        normal, start = values[-2:]
        return (*_judged(replace(felt, normal=normal), start), normal, start)

    # what does not hang on a carried value would be worked out before the branch, in every frame
    return Whole(*branch(contact, judged, one, one, one, one, felt.normal, load)[:4])


def _judged(felt: Felt, load: Field) -> tuple[Field, ...]:
    """Return share left, flatness, its error, and radius."""
    guess = _guess(felt, load)

    def stepped(*values: Field) -> tuple[Field, ...]:
        return _stepped(felt, _Contact(*values))

    found = _Contact(
        *repeat(STEPS, stepped, *(getattr(guess, field.name) for field in fields(guess)))
    )
    seen = _seen(felt, found)
    inner = 0.5 * found.radius
    pulls = [pull for size in (found.radius, inner) for pull in _pulls(felt, found, seen, size)]
    ways = apart((seen.signal, *seen.changes, *pulls))
    narrow = felt.inside * pushed_by(seen.away, inner, felt.depth, felt.reads).signal
    narrow = without(narrow, ways)
    left = without(felt.normal, ways)
    much = part_of(left, narrow)
    unit = maximum(NARROW * part_of(felt.normal, seen.signal), TINY)
    unsure = sqrt(felt.noise / maximum(square(narrow).sum(), TINY)) / unit
    return felt.share(left - much * narrow), -much / unit, unsure, found.radius


def _guess(felt: Felt, load: Field) -> _Contact:
    frame = felt.frame
    weight = felt.inside * maximum(load - START * load.max(), 0.0)
    whole = maximum(weight.sum(), TINY)
    row, column = (weight * frame.row).sum() / whole, (weight * frame.column).sum() / whole
    away = square(frame.row - row) + square(frame.column - column)
    radius = sqrt(SPREAD * (weight * away).sum() / whole)
    none = 0.0 * row
    return _Contact(felt.within(radius), column, row, none, none)


def _seen(felt: Felt, at: _Contact) -> _Seen:
    rows, columns = felt.frame.row - at.row, felt.frame.column - at.column
    wide, slant = square(columns) - square(rows), 2.0 * columns * rows
    even = sqrt(1.0 + square(at.along) + square(at.aslant))
    away = even * (square(columns) + square(rows)) + at.along * wide + at.aslant * slant
    seen = pushed_by(away, at.radius, felt.depth, felt.reads)
    by_away = felt.inside * seen.by_away
    changes = (
        felt.inside * seen.by_radius,
        -2.0 * by_away * (even * columns + at.along * columns + at.aslant * rows),
        -2.0 * by_away * (even * rows - at.along * rows + at.aslant * columns),
        by_away * wide,
        by_away * slant,
    )
    return _Seen(away, felt.inside * seen.signal, changes)


def _pulls(felt: Felt, at: _Contact, seen: _Seen, radius: Field) -> tuple[Field, Field]:
    """Return what a traction along the columns and along the rows adds, Hertz's in its shape.

    Cattaneo's and Mindlin's is one of the whole contact, less one of the part that sticks.
    """
    pull = felt.inside * pulled_by(seen.away, radius, felt.depth, felt.reads)
    return pull * (felt.frame.column - at.column), pull * (felt.frame.row - at.row)


def _stepped(felt: Felt, at: _Contact) -> tuple[Field, ...]:
    """Return the contact after a step."""
    seen = _seen(felt, at)
    size = maximum(part_of(felt.normal, seen.signal), TINY)
    left = felt.normal - size * seen.signal
    wider, across, down, *others = seen.changes
    wider = wider - part_of(wider, seen.signal) * seen.signal
    if felt.reads == "strain":
        # a pull strains the skin as much as the push does; in stress it is like a shift
        pulls = _pulls(felt, at, seen, at.radius)
        left = left - part_of(left, pulls[0]) * pulls[0] - part_of(left, pulls[1]) * pulls[1]
        across, down = (
            way - part_of(way, pull) * pull for way, pull in zip((across, down), pulls, strict=True)
        )
    far = FAR * at.radius
    most: tuple[Field | float, ...] = (far, far, far, LONG, LONG)
    steps = [
        at_most(part_of(left, way) / size, limit)
        for way, limit in zip((wider, across, down, *others), most, strict=True)
    ]
    return (
        felt.within(at.radius + steps[0]),
        at.column + steps[1],
        at.row + steps[2],
        at_most(at.along + steps[3], LONGEST),
        at_most(at.aslant + steps[4], LONGEST),
    )
