"""A stage of a step: the state there, the rims, and the slopes."""

from typing import Any

from cnnum.engines.numba import codes
from cnnum.engines.numba.cells import copy, largest, look_up, mean
from cnnum.engines.numba.compiling import compiled, inlined, merged
from cnnum.engines.numba.phases import all_bands
from cnnum.engines.numba.records import Frame, Plan, Reals


@inlined
def _fill_rims(plan: Plan, maps: Reals) -> None:
    """Set the rims of all maps by the boundary; a constant rim never changes."""
    for layer in range(plan.settings[0].layers):
        start = layer * plan.settings[0].size
        for cell in range(plan.rim.shape[1]):
            maps[start + plan.rim[0, cell]] = maps[start + plan.rim[1, cell]]


@inlined
def _set_gains(plan: Plan, gains: Reals, time: Any, begin: Any, step: Any) -> None:
    """Set the gains at a time; those that jump are the ones of the middle of its step.

    Steps with a delay may hold jumps and bends: there gains count by their means.
    """
    middle = begin + 0.5 * step
    for g in range(plan.gains.size):
        gains[plan.gains[g].place] = 1
    for g in range(plan.gains.size):
        if plan.settings[0].lag and step > 0.0:
            found = mean(plan, plan.gains[g].table, begin, begin + step)
            gains[plan.gains[g].place] += gains.dtype.type(found - 1.0)
            continue
        at = time if plan.tables[plan.gains[g].table].linear else middle
        value = look_up(plan, plan.gains[g].table, gains.dtype.type(at))
        gains[plan.gains[g].place] += value - 1


@inlined
def _recall(plan: Plan, work: Reals, stage: Any, step: Any, number: Any, gone: Any) -> None:
    """Find the outputs a delay ago; those before the start are those at the start.

    `gone` is the time of the step that is over where only a part of it is taken.
    """
    output, past, settings = work[codes.OUTPUT], work[codes.PAST], plan.settings[0]
    ring, lag = work[codes.SLOPES + settings.stages :], settings.lag
    if number == codes.AT_REST:
        copy(output, past)
        return
    if stage == 0 and gone == 0.0:
        copy(output, ring[number % len(ring)])
    since = gone + plan.tableau[0, codes.TIMES, stage] * step
    part = past.dtype.type(since / settings.step)
    before, after = (
        ring[max(number - lag, 0) % len(ring)],
        ring[max(number + 1 - lag, 0) % len(ring)],
    )
    for i in range(past.size):
        past[i] = before[i] + part * (after[i] - before[i])


@compiled
def evaluate(
    plan: Plan,
    now: Frame,
    stage: Any,
    step: Any,
    time: Any,
    number: Any,
    spread: bool,
    gone: float = 0.0,
) -> None:
    """Find the slopes at a stage of the step that begins at `time`.

    That is `gone` after the start of the step of that number.
    """
    slopes = min(stage, plan.settings[0].stages - 1)
    at = time + plan.tableau[0, codes.TIMES, slopes] * step
    _set_gains(plan, now.gains, at, time, step)
    all_bands(codes.MOVE, plan, now, stage, step, spread)
    _fill_rims(plan, now.work[codes.OUTPUT])
    if plan.settings[0].reads_states:
        _fill_rims(plan, now.work[codes.MOVED])
    if plan.settings[0].lag:
        _recall(plan, now.work, stage, step, number, gone)
    all_bands(codes.SLOPE, plan, now, slopes, step, spread)


@merged
def evaluate_once(plan: Plan, now: Frame, time: Any, spread: bool) -> None:
    """Find the slopes of the state as it is."""
    evaluate(plan, now, codes.NONE, 0.0, time, codes.AT_REST, spread)


@compiled
def rests(plan: Plan, now: Frame, spread: bool) -> bool:
    """Return whether nothing changes any more, by the slopes of the first stage."""
    all_bands(codes.CHANGE, plan, now, codes.NONE, 0.0, spread)
    return bool(largest(now.found, 2) <= 1.0)
