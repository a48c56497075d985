"""Twist of an object on the skin: that it turns, which way, how fast, and about where.

A torque at a constant rate grows by Lubkin's law; the program asks how much of it the torque has
gone through, as `slip` does with the force.
"""

import math
from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.templates.tactile.latch import latched
from cnnum.templates.tactile.laws import CURVE
from cnnum.templates.tactile.loads import PUSH, loads_of, patch_of
from cnnum.templates.tactile.pull import Place, place_of, torque_on

TURNS = 0.5
"""Belief that half the contact radius slips, at which a twist is reported."""

ENGAGED = 0.2
"""Share of the normal load, at the contact's radius of gyration, that the torque has at least."""

STEADY = 0.3
"""Largest change of the normal load, at that radius, as a share of the torque."""

DEPTH = 0.5
"""Pitches from the surface to the taxels, unless told otherwise."""

WIDER, LESS, ROUND = 3.0, 0.8, 0.2
"""a² = 3 ρ² − 0.8 z² + 0.2 in pitches: contact radius from the radius of gyration ρ of the normal
strain above its rim, at the depth z. 3 instead of Hertz's 2.5, for the rim takes the foot off.
Fitted to simulated contacts (tuning seeds, flat and bumpy covers, z from 0.47 to 1.33), within
2–6 %."""

FELT, FADES = 0.93, 0.6
"""Share 0.93 exp(−0.6 z) of a torque that the taxels near the contact feel; the rest passes around
them. Fitted likewise: 10 % for flat covers, 15 % less is felt under thin ones with bumps."""

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

    Returns
    -------
    mapping
        `twist` (flag, until the torque is let go), `twist_sense` (+1 from x to y, that is from
        columns to rows, clockwise as seen from above; −1; 0 without a torque), `twist_strength`
        (1 − c/a: 0 sticks, 1 turns freely), `twist_rate` (rad/s, while a torque grows or is held;
        of strain or calibrated shear, see `rate_of`), `twist_row`, `twist_column` (centre, cells).
    """
    loads = loads_of(frame, push)
    contact = place_of(loads, patch_of(loads))
    return twist_of(contact, turns=turns, rate=rate, depth=depth)


def twist_of(
    contact: Place, *, turns: float = TURNS, rate: float = RATE, depth: float = DEPTH
) -> Mapping[str, Field]:
    """Return the outputs of `twist` from what other programs share with it."""
    torque = torque_on(contact)
    growth, found = torque.growth, torque.growth.found
    believed = found.growing + found.stopped
    change = growth.steady < STEADY * growth.size + 5.0 * contact.spread * sqrt(torque.normal_noise)
    engaged = (growth.size > ENGAGED * torque.normal * contact.spread) & torque.outweighs & change
    turned = latched(contact.loads.frame, growth.grows, engaged & (found.passed > turns * believed))
    torque.close(turned)
    twisted = growth.grows & torque.outweighs
    sense = where(growth.acts[0] > 0.0, 1.0, -1.0)
    pace = sqrt(found.pace / found.growing)
    return {
        "twist": turned,
        "twist_sense": where(twisted, sense, 0.0),
        "twist_strength": where(twisted, 1.0 - found.sticks / believed, 0.0),
        "twist_rate": where(twisted, sense * rate * rate_of(pace, contact.spread, depth), 0.0),
        "twist_row": contact.row,
        "twist_column": contact.column,
    }


def rate_of(pace: Field, spread: Field, depth: float) -> Field:
    """Return the rate of a twist, rad a frame, from the law that its torque follows.

    A contact that sticks takes the torque 16 G a³ θ / 3 (Reissner and Sagoci), and the moment of
    the shear strain over the taxels' plane is that torque over 2 G and the pitch cubed.

    Parameters
    ----------
    pace : Field
        The law's last moment over its time, cells a frame.
    spread : Field
        Radius of gyration of the contact, cells.
    depth : float
        Of the taxels, pitches.
    """
    radius = sqrt(maximum(WIDER * spread * spread + (ROUND - LESS * depth * depth), 0.25))
    felt = FELT * math.exp(-FADES * depth)
    return 0.375 / felt * CURVE[0] * pace / (radius * radius * radius)
