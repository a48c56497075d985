"""Reports of an event: the level of a strength by its false reports, and the flag that it sets."""

from collections.abc import Sequence
from math import log

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.programs.fields import Field, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside

HOLD = 0.5
"""Share of its level below which a report may end."""


LOWEST = 0.1
"""Share of the lowest measured level that a level has at least."""


def level_of(
    false_reports: float, levels: Sequence[tuple[float, float]], level: float = 0.0
) -> float:
    """Return the level of a strength that leads to a rate of false reports.

    Parameters
    ----------
    false_reports : float, 1/10 min
    levels : sequence of (float, float)
        Measured rates in ascending order, each with its level. Levels are interpolated linearly in
        the logarithm of the rate, and extrapolated through the first or the last two.
    level : float
        If it is above 0, the level itself, which replaces the rate.

    Raises
    ------
    ProgramError
        If the rate is not positive, or the level below 0.
    """
    refuse_outside(false_reports=(false_reports, 1e-6, 1e6), level=(level, 0.0, 1e6))
    if level > 0.0:
        return float(level)
    rates, known = np.log([rate for rate, _ in levels]), [own for _, own in levels]
    at = log(false_reports)
    ends = slice(0, 2) if at < rates[0] else slice(-2, None)
    if rates[0] <= at <= rates[-1] or len(levels) < 2:
        return float(np.interp(at, rates, known))
    slope, start = np.polyfit(rates[ends], known[ends], 1)
    return max(float(start + slope * at), LOWEST * min(known))


def report(frame: FrameFields, strength: Field, level: float, frames: float) -> Field:
    """Return the flag of an event, which a strength switches on and which is held for some frames.

    Parameters
    ----------
    frame : FrameFields
    strength : Field
        One number per frame.
    level : float
        Strength above which the flag is on.
    frames : float
        Number of consecutive frames below half of the level after which the flag is off.
    """
    on = frame.memory("flag", scalar=True, logic=True)
    low = frame.memory("frames below its level", scalar=True)
    high = strength > HOLD * level
    low.store(where(high, 0.0, low.value + 1.0))
    return on.latch(strength > level, high | (low.value < frames - 0.5))


def latched(values: Floats, on: float, off: float, frames: int) -> NDArray[np.bool_]:
    """Return the flags of a bistable latch: on above a level, off when low for some frames.

    Parameters
    ----------
    values : (frames,) float
    on, off : float
        A value that is not above `off` is low.
    frames : int
        Low frames before the one in which the flag goes off.

    Returns
    -------
    (frames,) bool
    """
    place, high = np.arange(len(values)), values > off
    low_before = place - np.maximum.accumulate(np.where(high, place, -1)) - 1
    goes_on, goes_off = values > on, ~high & (low_before >= frames)
    decided = np.maximum.accumulate(np.where(goes_on | goes_off, place, -1))
    return np.asarray((decided >= 0) & goes_on[decided])
