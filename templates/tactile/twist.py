"""Twist of an object on the skin: that it turns, which way, how fast, and about where.

A torque at a constant rate grows by Lubkin's law; the program asks how much of it the torque has
gone through, as `slip` does with the force.
"""

from collections.abc import Mapping
from typing import Literal, get_args

from cnnum.errors import name_error
from cnnum.programs import program
from cnnum.programs.fields import Field, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.tactile.bumps_felt import bumps_felt
from cnnum.templates.tactile.contact_mechanics.contact_wrench import (
    RADIUS,
    Place,
    Side,
    moved_since,
    place_of,
    torque_on,
    widened_since,
)
from cnnum.templates.tactile.contact_mechanics.growth_rate import Pace
from cnnum.templates.tactile.contact_mechanics.load_growth import FOLLOW
from cnnum.templates.tactile.contact_mechanics.torque_law import turning_of
from cnnum.templates.tactile.shared.latch import latched
from cnnum.templates.tactile.shared.loads import PUSH, loads_of, patch_of

TURNS = 0.5
"""Belief that half the contact radius slips, at which a twist is reported."""

STOPS = 3.0
"""How much likelier a twist must be than a turn that has stopped, as for a pull in `slip`: seen
through noise a torque stops bending like a law that is nearly over."""

ENGAGED = 0.13
"""Share of the normal load, at the contact's radius of gyration, that the torque has at least: with
a friction of 0.3 on few bumps it has 0.14 as half the contact radius slips."""

POSSIBLE = 6.0
"""The same that it has at most: taxels read a friction of 1 as up to 3.5 (tuning seeds). More is no
torque, but a contact that appears beside a bridge that is stuck."""

STEADY = 0.3
"""Largest change of the normal load, at that radius, as a share of the torque."""

MOVES, WIDENS = 0.15, 0.1
"""Pitches that the contact may have moved since the torque began, and share by which it may be
wider or narrower: a moment about a centre that moves is no torque. In 81 twists it is 0.003 and
0.02 at most (tuning seeds), 0.3 and more where an object comes down beside a stuck bridge."""

LONE = 0.52
"""Least radius of gyration, cells: one taxel alone, which has `SMALLEST`, has no torque. The
narrowest of 81 contacts has 0.6 (tuning seeds)."""

DEPTH = 0.5
"""Pitches from the surface to the taxels, unless told otherwise."""

LEARNED = 0.85
"""Strength from which a torque hardly grows any more: how fast the object turns is what it was."""

KNOWN = 0.04
"""Standard error of a rate, as a share of it, below which it is told. A rate is to be within 10 %
in 0.995, which is 2.8 standard errors of 3.6 %; radii and centres put it off by 1.5 % more. At the
level that makes 0.981, but few are there: with the errors that 115 twists have (tuning seeds 7000
to 7299, a replica in NumPy) it makes 0.999 of the 108 that are told. At a level of 3 % it would be
103, and 106 at 3.5 %."""

REST = 0.1
"""Seconds over which the torque at rest is taken, `FOLLOW` frames at least: within a few frames of
a thousand a second a slow twist is lost in the noise. Over 0.25 s one is noticed early, by chance,
and its rate is read 10 to 60 % too high."""

Cover = Literal["flat", "bumpy", "bumps-fem"]

BUMP = 0.4
"""Radius of a bump, pitches, unless told otherwise."""

RATE = 200.0
"""Frames a second that `twist_rate` is for, unless told otherwise."""


@program
def twist(
    frame: FrameFields,
    *,
    push: float = PUSH,
    turns: float = TURNS,
    rate: float = RATE,
    depth: float = DEPTH,
    cover: Cover = "flat",
    bump: float = BUMP,
) -> Mapping[str, Field]:
    """Twist of what touches the skin, from how the torque about the contact's centre grows.

    The stream must begin without contact: its first frames say what rest is.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    turns : float
        Belief, 0 to 1, that half the contact radius slips, from which a twist is reported.
    rate : float, Hz
        Of the frames.
    depth : float
        Of the taxels under the surface, pitches; for `twist_rate`.
    cover : "flat", "bumpy" or "bumps-fem"
        As the driver `simulated` has them; for `twist_rate`.
    bump : float
        Radius of a bump, pitches.

    Returns
    -------
    mapping
        `twist` (flag, until the torque is let go), `twist_sense` (+1 from x to y, that is from
        columns to rows, clockwise as seen from above; −1; 0 without a torque), `twist_strength`
        (1 − c/a: 0 sticks, 1 turns freely), `twist_rate` (rad/s, while a torque grows or is held,
        0 while it is not known within a standard error of 4 %; of strain, of a round contact),
        `twist_row`, `twist_column` (centre, cells).
    """
    loads = loads_of(frame, push)
    contact = place_of(loads, patch_of(loads))
    return twist_of(contact, turns=turns, rate=rate, depth=depth, cover=cover, bump=bump)


def twist_of(
    contact: Place,
    *,
    turns: float = TURNS,
    rate: float = RATE,
    depth: float = DEPTH,
    cover: Cover = "flat",
    bump: float = BUMP,
) -> Mapping[str, Field]:
    """Return the outputs of `twist` from what other programs share with it."""
    if cover not in get_args(Cover):
        raise name_error("cover", cover, get_args(Cover))
    bumps = None if cover == "flat" else bumps_felt(cover, float(depth), float(bump))
    near = contact.loads.frame.memory(logic=True)
    turning = turning_of(contact, near.value, float(depth), bumps)
    torque = torque_on(turning.contact, turning.law, near, turning.weight, max(FOLLOW, REST * rate))
    growth, found = torque.growth, torque.growth.found
    believed = found.growing + STOPS * (found.stopped + found.ended)
    change = growth.steady < STEADY * growth.size + 5.0 * contact.spread * sqrt(torque.normal_noise)
    holds = torque.normal * contact.spread
    engaged = (growth.size > ENGAGED * holds) & (growth.size < POSSIBLE * holds)
    engaged = engaged & torque.outweighs & change & _alone(turning.contact, torque)
    turned = latched(contact.loads.frame, growth.grows, engaged & (found.passed > turns * believed))
    torque.close(turned)
    turning.kept.close(growth.grows)
    twisted = growth.grows & torque.outweighs
    sense = where(growth.acts[0] > 0.0, 1.0, -1.0)
    strength = 1.0 - found.sticks / (found.growing + found.stopped)
    late = latched(contact.loads.frame, growth.grows, turned & (strength > LEARNED))
    speed = _speed(contact.loads.frame, growth.grows, late, growth.pace(turning.law), turning.felt)
    return {
        "twist": turned,
        "twist_sense": where(twisted, sense, 0.0),
        "twist_strength": where(twisted, strength, 0.0),
        "twist_rate": where(twisted, sense * rate * speed, 0.0),
        "twist_row": contact.row,
        "twist_column": contact.column,
    }


def _alone(contact: Place, torque: Side) -> Field:
    """Return a flag: the torque is no by-product of a force, or of a contact that comes or goes."""
    place = (moved_since(contact, torque) < MOVES) & (widened_since(contact, torque) < WIDENS)
    lever = RADIUS * contact.spread
    outgrows = torque.growth.size > lever * torque.growth.grown_beside
    return place & (contact.spread > LONE) & outgrows


def _speed(frame: FrameFields, grows: Field, late: Field, pace: Pace, felt: Field) -> Field:
    """Return how fast it turns, rad a frame; 0 until that is known, and once late what it was."""
    memory = frame.memory(scalar=True)
    known = latched(frame, grows, pace.error < KNOWN)
    now = where(known, pace.slope / felt, 0.0)
    speed = where(late & (memory.value > 0.0), memory.value, now)
    memory.store(where(grows, speed, 0.0))
    return speed
