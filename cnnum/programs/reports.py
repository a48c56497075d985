"""Reports of an event: the level of a strength by its false reports, and the flag that it sets."""

from collections.abc import Sequence
from math import log

import numpy as np

from cnnum.programs.fields import Field, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside

HOLD = 0.5
"""Share of its level below which a report may end."""


def level_of(false_reports: float, levels: Sequence[tuple[float, float]]) -> float:
    """Return the level of a strength that leads to a rate of false reports.

    Parameters
    ----------
    false_reports : float, 1/10 min
    levels : sequence of (float, float)
        Rates that were measured, from few to many, each with its level. Between two of them a level
        is straight over the rate's logarithm.

    Raises
    ------
    ProgramError
        If the rate is outside those that were measured.
    """
    refuse_outside(false_reports=(false_reports, levels[0][0], levels[-1][0]))
    rates = [log(rate) for rate, _ in levels]
    found = np.interp(np.array([log(false_reports)]), rates, [level for _, level in levels])
    return float(found[0])


def report(frame: FrameFields, strength: Field, level: float, frames: float) -> Field:
    """Return a flag, on at a level, and off when below a share of it for longer than some frames.

    Parameters
    ----------
    frame : FrameFields
    strength : Field
        A number a frame.
    level, frames : float
    """
    on = frame.memory("flag", scalar=True, logic=True)
    low = frame.memory("frames below its level", scalar=True)
    high = strength > HOLD * level
    low.store(where(high, 0.0, low.value + 1.0))
    return on.latch(strength > level, high | (low.value < frames - 0.5))
