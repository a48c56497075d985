"""Direction of motion by correlation: each taxel now against its neighbour a moment ago.

    R_x = late(u) · u(one to the right) − u · late(u(one to the right)),    R_y the same downwards

`late` is a low-pass (`slow_receptor`), which delays: a pattern that comes from the left is met late
on the left and now on the right. Of a grating A cos(k x − ω t) it is A² sin k · ωτ / (1 + ω²τ²) in
every place and at every time: no other cell, and no mean, is needed.

References
----------
Hassenstein & Reichardt, Z. Naturforsch. 11b (1956) 513; Reichardt (1961). Barlow & Levick, J.
Physiol. 178 (1965) 477, in the retina.
"""

from collections.abc import Mapping
from math import exp, pi

from cnnum.programs import program
from cnnum.programs.fields import Field, length, maximum, sqrt, square, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.reports import report
from cnnum.programs.transients import apply, shift
from cnnum.templates.tactile.shared.loads import PUSH
from cnnum.templates.tactile.shared.rest import TINY, Clock, with_corners
from cnnum.templating.library import get_template

NEAR = 4.0
"""Diffusion time (cells²) of the mean that is subtracted to obtain the pattern."""


@program
def motion_direction(
    frame: FrameFields,
    *,
    push: float = PUSH,
    rest: float = 0.4,
    delay: float = 0.1,
    look: float = 0.2,
    level: float = 10.0,
    sure: float = 0.05,
    hold_time: float = 0.1,
    contrast: bool = True,
) -> Mapping[str, Field]:
    """Determine the direction in which the pattern of a load moves.

    Parameters
    ----------
    frame : FrameFields
        Only `normal` is read, in any unit.
    push : float
        −1 for strain and stress, which count tension as positive; +1 if readings rise under a push.
    rest : float, s
        Time without contact at the start, from which rest and noise are learned.
    delay, look : float, s
        Time constants of the low-pass, and of the means from which the direction is computed. A
        detector responds most to a pattern with a period of 2π delays.
    level : float
        Smallest power of a pattern, relative to that of the noise at rest.
    sure : float
        Smallest correlation, as a share of the pattern's power, that is reported as motion.
    hold_time : float, s
        A motion ends once the correlation has been below half of `sure` for this time.
    contrast : bool
        Whether to subtract the mean of the surroundings first, so that a load that only grows is
        not a pattern.

    Returns
    -------
    mapping
        `motion_map_x`, `motion_map_y` (R of each taxel and the one to its right or below, in the
        square of the unit of `normal`; 0 in the last column or row), `motion_x`,
        `motion_y` (their sums divided by the power of the pattern, averaged over `look`: −1 to 1),
        `motion_strength` (magnitude of the two), `drifts` (flag).

    Raises
    ------
    ProgramError
        If a parameter is out of range.
    """
    refuse_outside(
        delay=(delay, 1e-6, 1e6), look=(look, 1e-6, 1e6), level=(level, 1.0, 1e6),
        sure=(sure, 1e-6, 1.0), hold_time=(hold_time, 0.0, 1e6),
    )  # fmt: skip
    clock, share = Clock(frame, rest), 1.0 - exp(-1.0 / (frame.rate * look))
    signal = clock.above_rest("normal", push)
    if contrast:
        signal = signal - apply(get_template("tactile_diffusion"), input=signal, duration=NEAR)
    late = clock.behind(with_corners("slow_receptor", (0.5 / pi / delay,)), signal)
    maps = [_correlated(signal, late, *way) for way in ((0, 1), (1, 0))]
    power = frame.memory("power", scalar=True).mean(square(signal).sum(), share)
    there = ~clock.resting & (sqrt(power) > level * clock.noise(square(signal).sum(), ("normal",)))
    sums = [
        frame.memory(name, scalar=True).mean(values.sum(), share)
        for name, values in zip(("motion x", "motion y"), maps, strict=True)
    ]
    x, y = (where(there, total / maximum(power, TINY), 0.0) for total in sums)
    strength = length([x, y])
    return {
        "motion_map_x": maps[0],
        "motion_map_y": maps[1],
        "motion_x": x,
        "motion_y": y,
        "motion_strength": strength,
        "drifts": report(frame, strength, sure, hold_time * frame.rate),
    }


def _correlated(now: Field, late: Field, down: int, right: int) -> Field:
    """Return how much each taxel is ahead of its next one; 0 where there is none."""
    other, other_late = (
        shift(values, -down, -right, boundary="zero-flux") for values in (now, late)
    )
    return late * other - now * other_late
