"""Incipient slip of a sphere by Cattaneo and Mindlin's law, where friction and cover are known.

The disc that sticks has the share c/a = (1 − Q/μP)^⅓ of the contact's radius. The law holds for a
sphere on a deep elastic cover, under a normal load that stays. Signs that it does not hold:
a pressure that is not Hertz's, a pull beyond friction's limit, and a slide at another pull.
"""

from collections.abc import Mapping
from math import pi

from cnnum.programs import program
from cnnum.programs.fields import Field, length, maximum, square, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS, Carries
from cnnum.templates.tactile.shared.loads import PUSH, Loads, loads_of
from cnnum.templates.tactile.shared.pressure import Pressed, pressed_of
from cnnum.templates.tactile.slip import slip

LOOSE, STAYS = 0.5, 0.55
"""c/a below which slip is called incipient, and up to which it stays so: noise at the one does not
reach the other."""

WIDE = 1.82
"""Least contact radius, cells: on fewer taxels a flat punch looks like a sphere."""

FLATNESS, PEAK = (1.395, 1.53), (0.55, 0.65)
"""Of a pressure: fourth moment over the second's square, and peak · π · second moment over load.
Hertz's has 10/7 and 0.6. Spheres that are wide enough have 1.39 to 1.5 and 0.57 to 0.63; rigid flat
punches have less than 1.4, thin layers below 1.35 or above 2 (`docs/calibration.md`)."""

STEADY = 0.15
"""s for which a pressure must be Hertz's before the law is trusted."""

OFF = 0.15
"""Share by which a slide may be off the pull that friction holds."""

SHARE = 0.1
"""Share of the peak pressure from which a taxel counts as touched."""


@program
def mindlin_slip(
    frame: FrameFields,
    *,
    friction: float = 0.5,
    push: float = PUSH,
    depth: float = DEPTH,
    reads: Carries = READS,
    rest: float = 0.4,
    false_reports: float = 2.0,
) -> Mapping[str, Field]:
    """Incipient and gross slip of a sphere, and how much of its contact sticks.

    The stream must begin without contact: its first frames define rest.

    Parameters
    ----------
    frame : FrameFields
        Strain or stress.
    friction : float
        Coefficient of friction μ.
    push, depth, reads
        As in `contact`.
    rest, false_reports
        As in `slip`, which gives the gross phase.

    Returns
    -------
    mapping
        `mindlin_holds` (flag: something touches and nothing contradicts the law),
        `incipient_slip` (flag: it holds, less than half the radius sticks, and nothing slides),
        `stick_share` (c/a; 1 where the law does not hold), `slip_strength` (1 − c/a),
        `gross_slip`, `slip_x`, `slip_y` (as in `slip`).

    Raises
    ------
    ProgramError
        If the friction is not positive.
    """
    refuse_outside(friction=(friction, 1e-6, 1e6))
    loads = frame.once(loads_of, push=push)
    pressed = pressed_of(loads, SHARE, depth, reads, 1.0)
    slides = slip.bind(push=push, rest=rest, false_reports=false_reports)(frame)
    gross = slides["gross_slip"]
    pull = length(pressed.pulls)
    loaded = loads.contact & (pressed.normal > 0.0)  # without a load, there is no friction to use
    used = where(loaded, pull / (friction * pressed.normal), 0.0)
    fitted = frame.memory("frames that fit", scalar=True)
    whole = frame.within_range(loads.contact)  # a clipped load has too much pull
    steady = fitted.count(whole & _hertz(loads, pressed)) > STEADY * frame.rate
    holds = steady & ~_contradicted(frame, used, gross, steady)
    stick_radius = where(holds, maximum(1.0 - used, 0.0) ** (1 / 3), 1.0)
    may, begun = holds & ~gross, frame.memory("incipient", scalar=True, logic=True)
    return {
        "mindlin_holds": holds,
        "incipient_slip": begun.latch(may & (stick_radius < LOOSE), may & (stick_radius < STAYS)),
        "stick_share": stick_radius,
        "slip_strength": 1.0 - stick_radius,
        **{name: slides[name] for name in ("gross_slip", "slip_x", "slip_y")},
    }


def _hertz(loads: Loads, pressed: Pressed) -> Field:
    """Return a flag: the pressure's moments are those of a sphere, on enough taxels."""
    frame, weight = loads.frame, pressed.weight
    load = maximum(weight.sum(), 1e-30)
    row, column = frame.centroid(weight)
    away = square(frame.row - row) + square(frame.column - column)
    second = maximum((weight * away).sum() / load, 1e-6)
    flatness = (weight * square(away)).sum() / (load * square(second))
    peak = pi * weight.max() * second / load
    wide = 2.5 * second > WIDE**2  # Hertz: a² = 2.5 ⟨r²⟩
    fits = (flatness > FLATNESS[0]) & (flatness < FLATNESS[1])
    return wide & fits & (peak > PEAK[0]) & (peak < PEAK[1])


def _contradicted(frame: FrameFields, used: Field, gross: Field, steady: Field) -> Field:
    """Return a flag: the last conclusive pull was not at friction's limit.

    A pull beyond that limit is one such, and so is a slide below it. A touch that begins is
    not conclusive: its load is next to nothing.
    """
    memory = frame.memory("contradicted", scalar=True, logic=True)
    peak = frame.memory("largest pull of the slide", scalar=True)
    peak.store(where(gross, maximum(peak.value, used), 0.0))
    over = frame.previous(gross) & ~gross
    known = where(over, abs(peak.value - 1.0), where(steady & (used > 1.0 + OFF), used, 0.0))
    return memory.latch(known > OFF, ~(over & (known < OFF)))
