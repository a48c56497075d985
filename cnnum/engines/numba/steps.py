"""Steps from the start to the end: of one length, or as long as their error allows."""

import math
from typing import Any

import numpy as np

from cnnum.engines.numba import codes
from cnnum.engines.numba.cells import add, largest
from cnnum.engines.numba.compiling import inlined, merged
from cnnum.engines.numba.phases import all_bands
from cnnum.engines.numba.records import Frame, Plan, Reals
from cnnum.engines.numba.stages import evaluate, evaluate_once, rests


@merged
def fixed(plan: Plan, now: Frame, spread: bool, figures: Reals) -> None:
    """Take steps of one length; where it settles, until nothing changes for longer than a delay."""
    taken, time, settled, settings = codes.NONE, 0.0, 0.0, plan.settings[0]
    still = codes.NONE
    while taken < settings.count and settled == 0.0:
        step = settings.last if taken == settings.count - 1 else settings.step
        if taken == settings.lag:
            add(1.0, now.work[codes.LATER], now.work[codes.DRIVE])
        for stage in range(settings.stages):
            evaluate(plan, now, stage, step, time, taken, spread)
        if settings.settle:
            still = still + 1 if rests(plan, now, spread) else codes.NONE
            settled = 1.0 if still > settings.lag else 0.0
        all_bands(codes.STEP, plan, now, codes.NONE, step, spread)
        taken, time = taken + 1, time + step
    if taken <= settings.lag:
        add(1.0, now.work[codes.LATER], now.work[codes.DRIVE])
    figures[0], figures[1] = time if settings.settle else settings.duration, taken
    figures[2], figures[3] = settled, settings.error


@inlined
def _stages(plan: Plan, step: Any) -> tuple[Any, Any]:
    """Return the number of a step's stage after the first, and how many there are from it on."""
    settings = plan.settings[0]
    if settings.scheme != codes.CHEBYSHEV:
        return 1, settings.stages - 1
    stages, needed = 2, step * settings.reach + 1.0
    while stages < settings.most and stages * stages < needed:
        stages += 1
    return stages * settings.most + 1, stages


@merged
def adaptive(plan: Plan, now: Frame, spread: bool, figures: Reals) -> None:
    """Take steps that keep the error estimate within the tolerance."""
    taken, time, error, settled, settings = codes.NONE, 0.0, 0.0, 0.0, plan.settings[0]
    step, end = settings.step, settings.duration * (1.0 - 1e-6)
    evaluate_once(plan, now, time, spread)
    before = np.abs(now.work[codes.SLOPES]).max()
    while time < end and settled == 0.0 and taken < settings.count:
        step = min(step, settings.longest, settings.duration - time)
        first, stages = _stages(plan, step)
        for stage in range(first, first + stages):
            evaluate(plan, now, stage, step, time, codes.AT_REST, spread)
        all_bands(codes.JUDGE, plan, now, codes.NONE, step, spread)
        taken, worst = taken + 1, largest(now.found, 0)
        if worst <= 1.0:
            time, speed = time + step, largest(now.found, 3)
            # as `cnnum.integrators.estimate` has it
            grown = math.exp(min(settings.growth * step, codes.LARGEST_EXPONENT))
            grown = min(max(speed / max(before, codes.SMALLEST_RATE), 1.0), grown)
            error, before = min(error * grown + largest(now.found, 1), codes.LOST), speed
            settled = 1.0 if settings.settle and largest(now.found, 2) <= 1.0 else 0.0
            all_bands(codes.ACCEPT, plan, now, codes.NONE, step, spread)
        longer = settings.caution * max(worst, 1e-10) ** settings.exponent
        step *= min(max(longer, settings.least), 5.0)
    figures[0], figures[1], figures[2] = time, taken, settled
    figures[3] = settings.safety * error
    figures[4] = 1.0 if time < end and settled == 0.0 else 0.0
