"""Slip of an object that the array felt touch: incipient, gross, and where to.

A force that an object puts on the skin at a constant speed grows by Mindlin's law,
Q = μP (1 − (1 − t/T)^(3/2)), and all of the contact slips at T; c/a = √(1 − t/T) of it sticks until
then. So the program asks how much of that law the force has gone through, whatever the friction,
the speed, the cover and the size of the contact are. Where a few frames can not tell slip from a
pull that has stopped, the contact tells: it moves on.
"""

import math
from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.latch import latched
from cnnum.templates.tactile.loads import PUSH, loads_of, patch_of, square
from cnnum.templates.tactile.pull import RADIUS, Place, Side, force_on, place_of

STOPS = 5.0
"""How much more often a pull that is over has stopped than slipped, before it is looked at: only a
force that bends as Mindlin's does is called slip, or one whose object moves on."""

GROSS = 0.2
"""Belief in gross slip at which it is reported."""

INCIPIENT = 0.4
"""Belief that less than half the contact radius sticks by the next frame, at which incipient slip
is reported; stops count as much as slips here, since it warns."""

ENGAGED = 0.2
"""Share of the normal load that the force has at least. Rubber's friction is seldom below 0.3, and
taxels under a cover read 0.75 to 5 times as much of a shear load as of a normal one."""

STEADY = 0.3
"""Largest change of the normal load, as a share of the force, under which a force counts: beyond,
the grip changes."""

MOVES = 4.0
"""Standard deviations by which the contact must have moved on along the pull."""

ASIDE = 2.0
"""The same by which it may have moved more sideways than along."""


@program
def slip(
    frame: FrameFields, *, push: float = PUSH, incipient: float = INCIPIENT, gross: float = GROSS
) -> Mapping[str, Field]:
    """Slip between the skin and what touches it, from how the shear force grows.

    The stream must begin without contact: its first frames say what rest is.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    incipient, gross : float
        Beliefs, 0 to 1, from which either is reported.

    Returns
    -------
    mapping
        `incipient_slip`, `gross_slip` (flags, never both; until the pull is over), `slip_x`,
        `slip_y` (unit vector, along columns and rows, of the object's motion or the tendency to
        it; 0 without a pull), `slip_strength` (1 − c/a: 0 sticks, 1 slides), `stick_map` (logic:
        the loaded taxels within the stick radius c of the contact's centre).
    """
    loads = loads_of(frame, push)
    contact = place_of(loads, patch_of(loads))
    return slip_of(contact, incipient=incipient, gross=gross)


def slip_of(
    contact: Place, *, incipient: float = INCIPIENT, gross: float = GROSS
) -> Mapping[str, Field]:
    """Return the outputs of `slip` from what other programs share with it."""
    loads, force = contact.loads, force_on(contact)
    frame, grows, found = loads.frame, force.growth.grows, force.growth.found
    believed = found.growing + STOPS * found.stopped
    change = force.growth.steady < STEADY * force.growth.size + 5.0 * sqrt(force.normal_noise)
    engaged = force.outweighs & (force.growth.size > ENGAGED * force.normal) & change
    bends = found.passed > gross * believed
    gone = latched(frame, grows, engaged & (bends | _moves_on(contact, force)))
    warns = found.soon > incipient * (found.growing + found.stopped)
    begun = latched(frame, grows, engaged & warns)
    force.close(gone)
    sticks = where(grows, found.sticks / (found.growing + found.stopped), 1.0)
    sticks = where(gone, 0.0, sticks)
    x, y = force.growth.acts
    size = sqrt(square(x) + square(y))
    pulled = grows & (size > 0.0)
    return {
        "incipient_slip": begun & ~gone,
        "gross_slip": gone,
        "slip_x": where(pulled, x / size, 0.0),
        "slip_y": where(pulled, y / size, 0.0),
        "slip_strength": where(contact.there & force.outweighs, 1.0 - sticks, 0.0),
        "stick_map": _sticks(contact, sticks),
    }


def _moves_on(contact: Place, force: Side) -> Field:
    """Return whether the contact has moved on along a force that does not grow any more."""
    frame, growth = contact.loads.frame, force.growth
    start = [frame.memory(scalar=True) for _ in range(2)]
    way = list[Field]()
    for memory, now in zip(start, (contact.column, contact.row), strict=True):
        begun = where(growth.stops, now, memory.value)
        memory.store(begun)
        way.append(now - begun)
    (x, y), (to_x, to_y) = way, growth.load
    along = (x * to_x + y * to_y) / growth.size
    across = abs(x * to_y - y * to_x) / growth.size
    noise = sqrt(force.place_noise)
    moved = (along > MOVES * math.sqrt(2.0) * noise) & (across < along + ASIDE * noise)
    return growth.still & ~growth.stops & moved


def _sticks(contact: Place, sticks: Field) -> Field:
    """Return the loaded taxels within the stick radius; the contact's is √2.5 gyration radii."""
    loads, radius = contact.loads, sticks * RADIUS * contact.spread
    loaded = loads.contact & (loads.normal > 0.1 * loads.normal.max()) & (sticks > 0.0)
    away = square(contact.from_row) + square(contact.from_column)
    return loaded & (away < radius * radius)
