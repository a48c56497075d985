"""Steps from the start to the end: of one length, or as long as their error allows."""

import math
from typing import Any

from cnnum.engines.numba import codes
from cnnum.engines.numba.cells import add, copy, largest
from cnnum.engines.numba.compiling import compiled, inlined, merged
from cnnum.engines.numba.phases import all_bands, speed
from cnnum.engines.numba.records import Frame, Plan, Reals
from cnnum.engines.numba.stages import evaluate, evaluate_once, rests


@compiled
def _note(plan: Plan, now: Frame, at: Any, state: Reals, steps: Any, error: Any) -> None:
    """Keep what a look at a moment finds; the change there is in `found`."""
    copy(state, now.seen[at])
    now.marks[at, 0] = steps
    now.marks[at, 1] = 1.0 if largest(now.found, 2) <= 1.0 else 0.0
    now.marks[at, 2] = error


@compiled
def _look_at_fixed(
    plan: Plan, now: Frame, at: Any, time: Any, step: Any, taken: Any, spread: bool
) -> Any:
    """Look at the moments before a step ends: its part up to each is taken, and taken back.

    It is taken in `cuts`: runs that are compared with each other differ in these, too.
    """
    settings, state = plan.settings[0], now.work[codes.STATE]
    while at < now.moments.size and now.moments[at] < time + step * codes.ALMOST:
        part = now.moments[at] - time
        if settings.whole and part > codes.ROUNDING:
            break  # in discrete time a step is taken as a whole
        copy(state, now.kept[0])
        some = part > step * codes.ROUNDING
        if some:
            cut = part / settings.cuts
            for number in range(settings.cuts):
                gone = number * cut
                for stage in range(settings.stages):
                    evaluate(plan, now, stage, cut, time + gone, taken, spread, gone)
                all_bands(codes.STEP, plan, now, codes.NONE, cut, spread)
        evaluate(plan, now, codes.NONE, 0.0, now.moments[at], codes.AT_REST, spread)
        all_bands(codes.CHANGE, plan, now, codes.NONE, 0.0, spread)
        _note(plan, now, at, state, taken + 1 if some else taken, settings.error)
        copy(now.kept[0], state)
        at += 1
    return at


@merged
def fixed(plan: Plan, now: Frame, spread: bool, figures: Reals) -> None:
    """Take steps of one length; where it settles, until nothing changes for longer than a delay."""
    taken, time, settled, settings = codes.NONE, 0.0, 0.0, plan.settings[0]
    still = codes.NONE
    piece, at = codes.NONE, codes.NONE
    while taken < settings.count and settled == 0.0:
        if piece + 1 < len(plan.pieces) and taken >= plan.pieces[piece + 1, 0]:
            piece += 1
            time = plan.pieces[piece, 1]
        step = plan.pieces[piece, 2]
        if len(plan.pieces) == 1 and taken == settings.count - 1:
            step = settings.last
        if taken == settings.lag:
            add(1.0, now.work[codes.LATER], now.work[codes.DRIVE])
        if at < now.moments.size:
            at = _look_at_fixed(plan, now, at, time, step, taken, spread)
        for stage in range(settings.stages):
            evaluate(plan, now, stage, step, time, taken, spread)
        if settings.settle:
            still = still + 1 if rests(plan, now, spread) else codes.NONE
            settled = 1.0 if still > settings.lag else 0.0
        all_bands(codes.STEP, plan, now, codes.NONE, step, spread)
        taken, time = taken + 1, time + step
    if taken <= settings.lag:
        add(1.0, now.work[codes.LATER], now.work[codes.DRIVE])
    if at < now.moments.size:
        _look_at_fixed(plan, now, at, settings.duration, 1.0, taken, spread)
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


@inlined
def _grown(plan: Plan, error: Any, step: Any, before: Any, now: Frame) -> Any:
    """Return the error after a step, as `cnnum.integrators.estimate` has it."""
    grown = math.exp(min(plan.settings[0].growth * step, codes.LARGEST_EXPONENT))
    grown = min(max(largest(now.found, 3) / max(before, codes.SMALLEST_RATE), 1.0), grown)
    added = largest(now.found, 1) * max(grown, 1.0) ** plan.settings[0].later
    return min(error * grown + added, codes.LOST)


@compiled
def _look(
    plan: Plan,
    now: Frame,
    at: Any,
    time: Any,
    step: Any,
    taken: Any,
    error: Any,
    before: Any,
    spread: bool,
) -> Any:
    """Look at the moments within a step that was accepted, as runs do that end there.

    Each takes the step's part up to the moment. State, end and rates are left as they were.
    """
    settings, work = plan.settings[0], now.work
    last = codes.SLOPES + settings.stages - 1
    copy(work[codes.MOVED], now.kept[0])
    copy(work[last], now.kept[1])
    figures = now.found.copy()
    while at < now.moments.size and now.moments[at] < time + step * codes.ALMOST:
        part = now.moments[at] - time
        if part > step * codes.ROUNDING:
            first, stages = _stages(plan, part)
            for stage in range(first, first + stages):
                evaluate(plan, now, stage, part, time, codes.AT_REST, spread)
            all_bands(codes.JUDGE, plan, now, codes.NONE, part, spread)
            stated = settings.safety * _grown(plan, error, part, before, now) + settings.floor
            _note(plan, now, at, work[codes.MOVED], taken, stated)
        else:
            all_bands(codes.CHANGE, plan, now, codes.NONE, step, spread)
            stated = settings.safety * error + (settings.floor if taken > 1 else 0.0)
            _note(plan, now, at, work[codes.STATE], taken - 1, stated)
        at += 1
    now.found[:] = figures
    copy(now.kept[0], work[codes.MOVED])
    copy(now.kept[1], work[last])
    return at


@merged
def adaptive(plan: Plan, now: Frame, spread: bool, figures: Reals) -> None:
    """Take steps that keep the error estimate within the tolerance."""
    taken, time, error, settled, settings = codes.NONE, 0.0, 0.0, 0.0, plan.settings[0]
    step, end = settings.step, settings.duration * (1.0 - 1e-6)
    evaluate_once(plan, now, time, spread)
    state, rates = now.work[codes.STATE], now.work[codes.SLOPES]
    before, piece = speed(plan, state, rates), codes.NONE
    at = codes.NONE
    while time < end and settled == 0.0 and taken < settings.count:
        step, ends = min(step, settings.longest, settings.duration - time), False
        usual = step
        # no sliver of a step is left before a point of a gain in time
        if piece + 1 < len(plan.pieces) and time + codes.NEARLY * step >= plan.pieces[piece + 1, 1]:
            step, ends = plan.pieces[piece + 1, 1] - time, True
        if settings.jumping:  # the rates at a step's start are those after a jump
            evaluate(plan, now, codes.NONE, step, time, codes.AT_REST, spread)
            before = speed(plan, state, rates)
        first, stages = _stages(plan, step)
        for stage in range(first, first + stages):
            evaluate(plan, now, stage, step, time, codes.AT_REST, spread)
        all_bands(codes.JUDGE, plan, now, codes.NONE, step, spread)
        taken, worst = taken + 1, largest(now.found, 0)
        if worst <= 1.0:
            if at < now.moments.size:
                at = _look(plan, now, at, time, step, taken, error, before, spread)
            time, error = time + step, _grown(plan, error, step, before, now)
            before = largest(now.found, 3)
            if ends:
                piece += 1
                time, step = plan.pieces[piece, 1], max(step, usual)
            settled = 1.0 if settings.settle and largest(now.found, 2) <= 1.0 else 0.0
            all_bands(codes.ACCEPT, plan, now, codes.NONE, step, spread)
        longer = settings.caution * max(worst, 1e-10) ** settings.exponent
        step *= min(max(longer, settings.least), 5.0)
    stated = settings.safety * error + (settings.floor if taken else 0.0)
    while at < now.moments.size:
        all_bands(codes.CHANGE, plan, now, codes.NONE, 0.0, spread)
        _note(plan, now, at, now.work[codes.STATE], taken, stated)
        at += 1
    figures[0], figures[1], figures[2] = time, taken, settled
    figures[3] = stated
    figures[4] = 1.0 if time < end and settled == 0.0 else 0.0
