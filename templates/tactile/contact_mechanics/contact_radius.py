"""The radius of a round contact, from the normal strain that taxels under a cover read.

Hertz's map is fitted by least squares, one Gauss–Newton step a frame, as long as no load acts
sideways: shear under the surface makes normal strain, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from cnnum.programs.fields import Field, maximum, minimum, sqrt, where
from cnnum.tactile.bumps_felt import REACH, BumpsFelt
from cnnum.templates.tactile.contact_mechanics.bump_loads import pressed_on_bumps
from cnnum.templates.tactile.contact_mechanics.contact_wrench import Place
from cnnum.templates.tactile.contact_mechanics.load_growth import length
from cnnum.templates.tactile.contact_mechanics.sphere_response import pushed_by
from cnnum.templates.tactile.shared.loads import square

SMALLEST, LARGEST = 0.5, 4.0
"""Pitches: contact radii that are looked for."""

STEP = 0.3
"""Pitches by which radius and centre move in a frame at most: Hertz's map is no straight line."""

NEAR, QUICK = 0.05, 6.0
"""Pitches, and frames that a radius has been so near to the least squares before it is averaged."""

HALF = 0.5
"""Share of a step until then: radius and place are not independent on few taxels."""

STEADY = 0.05
"""Change of the pressure, as a share, after which the radius is another."""

ANOTHER = 0.25
"""The same while something acts sideways, which makes normal strain itself."""

CLEAN = 0.1
"""Change of what acts sideways, in normal loads, up to which Hertz's map is as it is without."""

WIDER = 0.05
"""Pitches by which a contact is made wider to see what its radius does to bumps: the flat cover's
slope leads there so slowly that on 4×4 taxels it was left 0.9 % too large (tuning seed 7108)."""

START = 1.5
"""First guess of a radius: from below, the steps may end in a smaller contact between taxels."""

CENTRE = 0.3
"""Share of a step of the centre that is taken at least: contacts move on."""

TINY = 1e-12


@dataclass(frozen=True, slots=True)
class Round:
    """A round contact.

    Attributes
    ----------
    radius : Field
        As it was last known, pitches.
    row, column : Field
        Its centre, cells.
    sheared : Field
        Flag: before this frame something has acted sideways on it.
    """

    radius: Field
    row: Field
    column: Field
    sheared: Field


def round_under(
    contact: Place, sideways: Sequence[Field], depth: float, bumps: BumpsFelt | None = None
) -> Round:
    """Return the contact's radius and centre.

    Parameters
    ----------
    contact : Place
    sideways : sequence of Field
        What acts sideways, components over the normal load.
    depth : float
        Of the taxels, pitches.
    bumps : BumpsFelt, optional
        Of a cover with bumps; a flat one unless given.
    """
    frame = contact.loads.frame
    radius, row, column, size, count = (frame.memory(scalar=True) for _ in range(5))
    before = [frame.memory(scalar=True) for _ in sideways]
    spoiled = frame.memory(scalar=True, logic=True)
    known = contact.there & (count.value > 0.0)
    guess = where(known, radius.value, START)
    centre = (where(known, row.value, contact.row), where(known, column.value, contact.column))
    found, steps = _steps(contact, guess, centre, depth, bumps)
    settled = known & (count.value >= QUICK)
    apart = length([now - was.value for now, was in zip(sideways, before, strict=True)])
    sheared = settled & (apart > CLEAN)
    change = abs(found - size.value)
    other = settled & (change > where(sheared, ANOTHER, STEADY) * size.value)
    spoils = (spoiled.value | sheared) & ~other
    spoiled.store(spoils & contact.there)
    seen = where(known & ~other, count.value, 0.0)
    learns = contact.there & ~spoils
    fresh = seen < QUICK
    gain = where(learns, where(fresh, HALF, 1.0 / (seen - (QUICK - 2.0))), 0.0)
    follows = maximum(gain, CENTRE)
    starts = (where(other, START, guess), *centre)
    gains = (gain, follows, follows)
    moved = [was + much * step for was, much, step in zip(starts, gains, steps, strict=True)]
    moved[0] = minimum(maximum(moved[0], SMALLEST), LARGEST)
    for memory, value in zip((radius, row, column), moved, strict=True):
        memory.store(value)
    for memory, now in zip((size, *before), (found, *sideways), strict=True):
        memory.store(where(fresh, now, memory.value + gain * (now - memory.value)))
    near = ~fresh | (abs(steps[0]) < NEAR)
    longer = where(learns, where(near, seen + 1.0, 1.0), seen)
    count.store(where(contact.there, longer, 0.0))
    return Round(moved[0], moved[1], moved[2], sheared=spoiled.value)


def _steps(
    contact: Place,
    radius: Field,
    centre: tuple[Field, Field],
    depth: float,
    bumps: BumpsFelt | None,
) -> tuple[Field, tuple[Field, Field, Field]]:
    """Return the largest pressure, and how far radius, row and column are from least squares."""
    loads, frame = contact.loads, contact.loads.frame
    inside = where(loads.sound & loads.alive, 1.0, 0.0)
    rows, columns = frame.row - centre[0], frame.column - centre[1]
    flat = pushed_by(square(rows) + square(columns), radius, depth)
    shape, wider, scale = inside * flat.signal, inside * flat.by_radius, frame.constant(1.0)
    power = maximum(square(shape).sum(), TINY)
    if bumps is not None:
        # farther taxels read bumps that the kernels do not hold
        inside = where(maximum(abs(rows), abs(columns)) < REACH - 0.5, inside, 0.0)
        shape = inside * pressed_on_bumps(rows, columns, radius, bumps)
        wider = inside * pressed_on_bumps(rows, columns, radius + WIDER, bumps)
        wider = (1.0 / WIDER) * (wider - shape)
        # the flat cover's slopes along rows and columns are near enough to lead to the centre
        plain, power = power, maximum(square(shape).sum(), TINY)
        scale = sqrt(power / plain)
    size = maximum((shape * loads.normal).sum() / power, TINY)
    left = inside * loads.normal - size * shape
    inside = inside * scale
    wider = wider - (wider * shape).sum() / power * shape
    slope = -2.0 * inside * flat.by_away
    along = (wider, slope * rows, slope * columns)
    steps = [(left * way).sum() / (size * maximum(square(way).sum(), TINY)) for way in along]
    first, second, third = (minimum(maximum(step, -STEP), STEP) for step in steps)
    return size, (first, second, third)
