"""Twist of an object on the skin: that it turns, which way, how fast, and about where.

A torque at a constant rate grows by Lubkin's law; the program asks how much of it the torque has
gone through, as `slip` does with the force.
"""

from collections.abc import Mapping
from typing import Literal, get_args

from cnnum.errors import name_error
from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.tactile.bumps_felt import BumpsFelt, bumps_felt
from cnnum.templates.tactile.bump_loads import turned_on_bumps
from cnnum.templates.tactile.contact_radius import TINY, round_under
from cnnum.templates.tactile.latch import latched
from cnnum.templates.tactile.laws import CURVE
from cnnum.templates.tactile.loads import PUSH, loads_of, patch_of, square
from cnnum.templates.tactile.pull import Place, Side, place_of, torque_on
from cnnum.templates.tactile.sphere import turned_by

TURNS = 0.5
"""Belief that half the contact radius slips, at which a twist is reported."""

ENGAGED = 0.2
"""Share of the normal load, at the contact's radius of gyration, that the torque has at least."""

STEADY = 0.3
"""Largest change of the normal load, at that radius, as a share of the torque."""

DEPTH = 0.5
"""Pitches from the surface to the taxels, unless told otherwise."""

LEAST = 0.05
"""Moment, a radian, that the taxels near a contact feel at least."""

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
        (1 − c/a: 0 sticks, 1 turns freely), `twist_rate` (rad/s, while a torque grows or is held;
        of strain, of a round contact), `twist_row`,
        `twist_column` (centre, cells).
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
    torque = torque_on(contact)
    growth, found = torque.growth, torque.growth.found
    believed = found.growing + found.stopped + found.ended
    change = growth.steady < STEADY * growth.size + 5.0 * contact.spread * sqrt(torque.normal_noise)
    engaged = (growth.size > ENGAGED * torque.normal * contact.spread) & torque.outweighs & change
    turned = latched(contact.loads.frame, growth.grows, engaged & (found.passed > turns * believed))
    torque.close(turned)
    twisted = growth.grows & torque.outweighs
    sense = where(growth.acts[0] > 0.0, 1.0, -1.0)
    pace = sqrt(found.pace / found.growing)
    speed = CURVE[0] * pace / _felt(contact, torque, depth, bumps)
    return {
        "twist": turned,
        "twist_sense": where(twisted, sense, 0.0),
        "twist_strength": where(twisted, 1.0 - found.sticks / (found.growing + found.stopped), 0.0),
        "twist_rate": where(twisted, sense * rate * speed, 0.0),
        "twist_row": contact.row,
        "twist_column": contact.column,
    }


def _felt(contact: Place, torque: Side, depth: float, bumps: BumpsFelt | None) -> Field:
    """Return the moment that the taxels which are summed feel, for a turn of 1 rad."""
    place = round_under(contact, torque.sideways, depth, bumps)
    rows, columns = contact.loads.frame.row - place.row, contact.loads.frame.column - place.column
    # the moment is taken about the centroid, and the strain goes round the centre
    if bumps is None:
        away = maximum(square(rows) + square(columns), TINY)
        lever = (contact.from_row * rows + contact.from_column * columns) / away
        felt = lever * turned_by(away, place.radius, depth)
    else:
        turned = turned_on_bumps(rows, columns, place.radius, bumps)
        felt = contact.from_column * turned.y - contact.from_row * turned.x
    return maximum(where(torque.memory.value & contact.loads.alive, felt, 0.0).sum(), LEAST)
