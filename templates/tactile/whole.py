"""A frame as a whole: whether one contact explains it, and whether that is smooth.

A Hertzian pressure is fitted to what all taxels read by least squares, its contact an ellipse: the
map of a sphere, stretched. How flat the pressure is inside is told by the map of a narrower sphere
beside it: a uniform load lacks it, and a sphere's needs none.
"""

from dataclasses import dataclass, fields

from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.programs.loops import branch, loop
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.loads import Loads, square
from cnnum.templates.tactile.sphere import pushed_by

START = 0.3
"""Share of the largest load above which loads give the first guess."""

SPREAD = 2.2
"""Square of a contact radius over the mean square way from its centre: 2.5 for Hertz's pressure, 2
for a uniform one."""

STEPS = 4
"""Gauss–Newton steps. Spheres of 2 cells and more are met to the noise then, but in strain under a
third of a pitch of cover, where half of them are."""

FAR, LONG = 0.4, 0.3
"""What radius and centre move by in a step at most, in radii, and what the ellipse is stretched
by."""

LONGEST = 0.85
"""Largest stretch: an ellipse 2.2 times as long as it is wide."""

SMALLEST, LARGEST = 0.5, 0.75
"""Contact radii that are looked for: cells, and sides of the array."""

NARROW = 0.7
"""Radius of the narrower sphere, over that of the contact. Its map, less what the fit takes, is
like that of a uniform disc: their correlation is 0.91 to 0.99 from 0.5 pitches of cover on."""

TINY = 1e-12


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


def whole_of(loads: Loads, load: Field, depth: float, reads: Reads) -> Whole:
    """Return what a frame is as a whole; anything while nothing touches.

    Parameters
    ----------
    loads : Loads
    load : Field
        On the surface, for the first guess.
    depth : float
    reads : "strain" or "stress"
    """
    one = loads.frame.constant(1.0)
    fit = _Fit(loads, load, depth, reads)
    return Whole(*branch(loads.contact, lambda *_: fit.judged(), one, one, one, one))


class _Fit:
    """The least squares of one contact."""

    def __init__(self, loads: Loads, load: Field, depth: float, reads: Reads) -> None:
        self._frame = loads.frame
        self._inside = where(loads.sound & loads.alive, 1.0, 0.0)
        self._normal = self._inside * loads.normal
        self._noise = loads.normal_noise
        self._load = load
        self._depth = depth
        self._reads: Reads = reads

    def judged(self) -> tuple[Field, ...]:
        """Return share left, flatness, its error, and radius."""
        guess = self._guess()
        count = self._frame.constant(0.0)
        last = loop(
            self._stepped,
            *(getattr(guess, field.name) for field in fields(guess)),
            count,
            limit=STEPS,
            until=lambda *values: values[-1] > STEPS - 0.5,
        )
        found = _Contact(*last.values[:-1])
        seen = self._seen(found)
        ways = _apart((seen.signal, *seen.changes))
        narrow = pushed_by(seen.away, NARROW * found.radius, self._depth, self._reads).signal
        narrow = _without(self._inside * narrow, ways)
        size = (seen.signal * self._normal).sum() / maximum(square(seen.signal).sum(), TINY)
        left = _without(self._normal, ways)
        power = maximum(square(narrow).sum(), TINY)
        much = (left * narrow).sum() / power
        unit = maximum(NARROW * size, TINY)
        rest = square(left - much * narrow).sum() - self._inside.sum() * self._noise
        share = sqrt(maximum(rest, 0.0) / maximum(square(self._normal).sum(), TINY))
        return share, -much / unit, sqrt(self._noise / power) / unit, found.radius

    def _guess(self) -> _Contact:
        frame = self._frame
        weight = self._inside * maximum(self._load - START * self._load.max(), 0.0)
        whole = maximum(weight.sum(), TINY)
        row, column = (weight * frame.row).sum() / whole, (weight * frame.column).sum() / whole
        away = square(frame.row - row) + square(frame.column - column)
        radius = sqrt(SPREAD * (weight * away).sum() / whole)
        none = 0.0 * row
        return _Contact(self._within(radius), column, row, none, none)

    def _within(self, radius: Field) -> Field:
        return minimum(maximum(radius, SMALLEST), LARGEST * max(self._frame.shape))

    def _seen(self, at: _Contact) -> _Seen:
        rows, columns = self._frame.row - at.row, self._frame.column - at.column
        wide, slant = square(columns) - square(rows), 2.0 * columns * rows
        even = sqrt(1.0 + square(at.along) + square(at.aslant))
        away = even * (square(columns) + square(rows)) + at.along * wide + at.aslant * slant
        felt = pushed_by(away, at.radius, self._depth, self._reads)
        by_away = self._inside * felt.by_away
        changes = (
            self._inside * felt.by_radius,
            -2.0 * by_away * (even * columns + at.along * columns + at.aslant * rows),
            -2.0 * by_away * (even * rows - at.along * rows + at.aslant * columns),
            by_away * wide,
            by_away * slant,
        )
        return _Seen(away, self._inside * felt.signal, changes)

    def _stepped(self, *values: Field) -> tuple[Field, ...]:
        """Return the contact after a step, and the number of steps."""
        at = _Contact(*values[:-1])
        seen = self._seen(at)
        power = maximum(square(seen.signal).sum(), TINY)
        size = maximum((seen.signal * self._normal).sum() / power, TINY)
        left = self._normal - size * seen.signal
        wider, *others = seen.changes
        wider = wider - (wider * seen.signal).sum() / power * seen.signal
        far = FAR * at.radius
        most: tuple[Field | float, ...] = (far, far, far, LONG, LONG)
        steps = [
            _at_most((left * way).sum() / (size * maximum(square(way).sum(), TINY)), limit)
            for way, limit in zip((wider, *others), most, strict=True)
        ]
        return (
            self._within(at.radius + steps[0]),
            at.column + steps[1],
            at.row + steps[2],
            _at_most(at.along + steps[3], LONGEST),
            _at_most(at.aslant + steps[4], LONGEST),
            values[-1] + 1.0,
        )


def _at_most(value: Field, size: Field | float) -> Field:
    return minimum(maximum(value, -1.0 * size), size)


def _apart(maps: tuple[Field, ...]) -> list[Field]:
    """Return the maps, each without its share of those before it, of power 1."""
    found: list[Field] = []
    for each in maps:
        rest = _without(each, found)
        found.append(rest / sqrt(maximum(square(rest).sum(), TINY)))
    return found


def _without(rest: Field, ways: list[Field]) -> Field:
    """Return what is left of a map without its shares of maps that are of power 1 and apart."""
    for way in ways:
        rest = rest - (rest * way).sum() * way
    return rest
