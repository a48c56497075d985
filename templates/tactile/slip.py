"""Slip of an object that the array felt touch: incipient, gross, and where to.

A force that an object puts on the skin at a constant speed grows by Mindlin's law,
Q = μP (1 − (1 − t/T)^(3/2)), and all of the contact slips at T; c/a = √(1 − t/T) of it sticks until
then. So the program asks how much of that law the force has gone through, whatever the friction,
the speed, the cover and the size of the contact are. Where a few frames cannot tell slip from a
pull that has stopped, the contact tells: it moves on (`moves`).
"""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, exp, maximum, minimum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.contact_mechanics.contact_shift import Rest, moves_on
from cnnum.templates.tactile.contact_mechanics.contact_wrench import (
    RADIUS,
    Place,
    Side,
    force_on,
    moved_since,
    place_of,
)
from cnnum.templates.tactile.contact_mechanics.cover_response import Skin
from cnnum.templates.tactile.contact_mechanics.growth_laws import pull_law
from cnnum.templates.tactile.contact_mechanics.traction_lag import AtRest, lag_of
from cnnum.templates.tactile.cover_model.deconvolution import DEPTH
from cnnum.templates.tactile.shared.friction import friction_needed
from cnnum.templates.tactile.shared.latch import latched
from cnnum.templates.tactile.shared.loads import PUSH, loads_of, patch_of, square
from cnnum.templates.tactile.shared.pressure import Carries
from cnnum.templates.tactile.twist import BUMP, Cover

STOPS = 2.0
"""How much likelier a slip must be than a stop at the same time, by how the force bends and by how
the contact moves on: a pull that is over has mostly stopped. Of 62 stopped pulls at 500 and 1000
frames a second (tuning seeds 34000 to 35999) none is taken for slip."""

SUDDEN, MORE = 1.4, 16.0
"""A force of which so little came after its first frame has no bend; a stop is so much likelier
still. What a held object weighs comes like that, and what comes then may be rolling. With `STOPS`
it is 32 times: with 24 a version before took one of 570 held objects to slip (tuning seeds), with
48 three of twelve pulls that slide within a frame are missed (`tests/tactile/test_moves.py`)."""

SELDOM, FALLS, LEAST = 0.25, 0.02, 4.0
"""Friction below which slip is less likely: rubber has seldom less than 0.3. By every 0.02 below a
stop is likelier by e, for friction is known to 20 % (nine of ten slips on 8×8, tuning seeds), up to
e⁴: no more, since a cover may be another one than the program is told."""

HALF = 0.875
"""Share of what friction holds that pulls as half the contact radius sticks: 1 − (c/a)³."""

GROSS = 0.5
"""Belief, against a pull that goes on growing, at which gross slip is reported."""

INCIPIENT = 0.28
"""Belief that less than half the contact radius sticks by the next frame, and not all slips yet, at
which incipient slip is reported; stops count as much as slips here, since it warns."""

ENGAGED = 0.2
"""Share of the normal load that the force has at least. Rubber's friction is seldom below 0.3, and
taxels under a cover read 0.65 to 7 times as much of a shear load as of a normal one."""

STEADY = 0.3
"""Largest change of the normal load, as a share of the force, under which a force counts: beyond,
the grip changes."""

ROLLS = 1.0
"""Force, in normal loads, over the pitches that the contact has moved since it began to grow:
below, the object rolls, and taxels that sample its contact coarsely read the change as shear."""

TINY = 1e-30


@program
def slip(
    frame: FrameFields,
    *,
    push: float = PUSH,
    incipient: float = INCIPIENT,
    gross: float = GROSS,
    reads: Carries = "force",
    depth: float = DEPTH,
    cover: Cover = "flat",
    bump: float = BUMP,
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
    reads : "strain", "stress" or "force"
        What the taxels read, for the friction that a force would need, and for how what is read
        of it lags; "force" where each carries its own share of the load, or where nobody knows.
    depth : float
        Of the taxels under the surface, pitches, if not "force".
    cover : "flat", "bumpy" or "bumps-fem"
        As the driver `simulated` has them.
    bump : float
        Radius of a bump, pitches.

    Returns
    -------
    mapping
        `incipient_slip`, `gross_slip` (flags, never both; until the pull is over), `slip_x`,
        `slip_y` (unit vector, along columns and rows, of the object's motion or the tendency to
        it; 0 without a pull), `slip_strength` (1 − c/a: 0 sticks, 1 slides), `stick_map` (logic:
        the loaded taxels within the stick radius c of the contact's centre).

    Raises
    ------
    PhysicsError
        If depth or bumps are out of range.
    UnknownNameError
        If the cover or the reading is unknown.
    """
    loads = loads_of(frame, push)
    contact = place_of(loads, patch_of(loads))
    skin = Skin(float(depth), reads, cover, float(bump))
    return slip_of(contact, skin, incipient=incipient, gross=gross)


def slip_of(
    contact: Place, skin: Skin, *, incipient: float = INCIPIENT, gross: float = GROSS
) -> Mapping[str, Field]:
    """Return the outputs of `slip` from what other programs share with it."""
    loads, stood = contact.loads, AtRest(contact)
    force = force_on(contact, lambda load: pull_law(lag_of(contact, stood, skin, load)))
    frame, grows, found = loads.frame, force.growth.grows, force.growth.found
    rest = Rest(loads)
    change = force.growth.steady < STEADY * force.growth.size + 5.0 * sqrt(force.normal_noise)
    stays = force.growth.size > ROLLS * force.normal * moved_since(contact, force)
    engaged = force.outweighs & (force.growth.size > ENGAGED * force.normal) & change & stays
    needed = friction_needed(contact, force, skin)
    gone = latched(frame, grows, engaged & _slides(contact, force, rest, needed, gross))
    begun = latched(frame, grows, engaged & _soon(force, needed, incipient))
    learned = force.close(gone)
    rest.learn(learned)
    stood.learn(learned)
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


def _soon(force: Side, needed: Field, incipient: float) -> Field:
    """Return a flag: it is believed that soon less than half the contact radius sticks."""
    found = force.growth.found
    soon = found.soon - found.passed
    others = found.growing + found.stopped - soon
    return (1.0 - incipient) * soon > incipient * others * _seldom(needed / HALF)


def _seldom(friction: Field) -> Field:
    """Return how much likelier a stop is, for rubber has seldom so little friction."""
    return exp(minimum(maximum(SELDOM - friction, 0.0) / FALLS, LEAST))


def _slides(contact: Place, force: Side, rest: Rest, needed: Field, gross: float) -> Field:
    """Return a flag: the force has stopped growing, and what it pulls at goes on."""
    loads, growth, found = contact.loads, force.growth, force.growth.found
    ratio = growth.size / maximum(force.normal, TINY)
    way = rest.way(growth, force.normal, loads.normal_noise)
    moves = moves_on(loads, growth, way, ratio)
    stops = where(growth.size < SUDDEN * growth.first, MORE * STOPS, STOPS) * found.ended
    stops = stops * _seldom(needed)
    # those whose time is not over yet count as they are, be it that of slip or of a stop
    on = found.growing - found.passed + found.stopped - found.ended
    grows = gross * (on + moves.against_growth)
    slips, strays = moves.against_stops, moves.against_growth
    return stops * strays + grows * slips < slips * strays


def _sticks(contact: Place, sticks: Field) -> Field:
    """Return the loaded taxels within the stick radius; the contact's is √2.5 gyration radii."""
    loads, radius = contact.loads, sticks * RADIUS * contact.spread
    loaded = loads.contact & (loads.normal > 0.1 * loads.normal.max()) & (sticks > 0.0)
    away = square(contact.from_row) + square(contact.from_column)
    return loaded & (away < radius * radius)
