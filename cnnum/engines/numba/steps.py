"""One transient, compiled: cells, stages, phases of a step, and steps to the end.

One transient, compiled: generic in the template, whose couplings come as lists of taps.

The order of sums does not depend on the number of threads, so a frame gives bit-identical results
alone, in any batch, and on any number of cores.
"""

import math
from typing import Any

import numba
import numpy as np

from cnnum.engines.numba import records
from cnnum.engines.numba.compiling import ROOM, compiled, compiled_parallel, inlined, kept, merged
from cnnum.engines.numba.records import Batch, Frame, Plan, Reals
from cnnum.integrators.estimate import AROUND, LEAST_SLOPE


@inlined
def copy(source: Reals, target: Reals) -> None:
    """Copy as many values as both arrays have."""
    for i in range(min(source.size, target.size)):
        target[i] = source[i]


@compiled
def respond(response: Any, state: Reals, output: Reals) -> None:
    """Set y = f(x)."""
    one = state.dtype.type(1)
    if response == records.IDENTITY:
        copy(state, output)
    elif response == records.CLAMP:
        for i in range(state.size):
            output[i] = min(max(state[i], -one), one)
    elif response == records.TANH:
        for i in range(state.size):
            output[i] = math.tanh(state[i])
    else:
        for i in range(state.size):
            output[i] = one if state[i] >= 0 else -one


@inlined
def _of_one(what: Any, a: Any) -> Any:
    if what == records.NEGATE:
        return -a
    if what == records.EXP:
        return math.exp(a)
    if what == records.FABS:
        return abs(a)
    if what == records.LOG:
        return math.log(a)
    if what == records.SQRT:
        return math.sqrt(a)
    return math.tanh(a) if what == records.TANH_OF else a


@inlined
def _of_two(what: Any, a: Any, b: Any) -> Any:
    if what == records.ADD:
        return a + b
    if what == records.SUBTRACT:
        return a - b
    if what == records.MULTIPLY:
        return a * b
    if what == records.DIVIDE:
        return a / b
    if what == records.POW:
        return a**b
    return max(a, b) if what == records.FMAX else min(a, b)


@inlined
def _holds(what: Any, a: Any, b: Any) -> Any:
    if what == records.LESS:
        return a < b
    if what == records.NOT_MORE:
        return a <= b
    if what == records.MORE:
        return a > b
    if what == records.NOT_LESS:
        return a >= b
    return (a == b) == (what == records.EQUAL)


@compiled
def interpret(steps: Any, state: Reals, centre: Reals, output: Reals) -> None:
    """Set y = f(x), or f of a centre and a neighbour x, by the rows of an expression."""
    stack: Any = np.zeros((len(steps), state.size), state.dtype)
    top = -1
    for step in range(len(steps)):
        what = int(steps[step, 0])
        if what <= records.TAKE_NUMBER:
            top += 1
            for i in range(state.size):
                if what == records.TAKE_NUMBER:
                    stack[top, i] = steps[step, 1]
                else:
                    stack[top, i] = state[i] if what == records.TAKE_STATE else centre[i]
        elif what <= records.REAL:
            for i in range(state.size):
                stack[top, i] = _of_one(what, stack[top, i])
        elif what <= records.POW:
            top -= 1
            for i in range(state.size):
                stack[top, i] = _of_two(what, stack[top, i], stack[top + 1, i])
        elif what <= records.OTHER:
            top -= 1
            for i in range(state.size):
                stack[top, i] = 1 if _holds(what, stack[top, i], stack[top + 1, i]) else 0
        else:
            top -= 2
            first, second, third = stack[top], stack[top + 1], stack[top + 2]
            for i in range(state.size):
                if what == records.WITHIN:
                    first[i] = min(max(first[i], second[i]), third[i])
                else:
                    first[i] = second[i] if first[i] != 0 else third[i]
    for i in range(state.size):
        output[i] = stack[0, i]


@compiled
def show(plan: Plan, state: Reals, output: Reals) -> None:
    """Set y = f(x) of the plan's own function."""
    if plan.settings[0].response == records.EXPRESSION:
        interpret(plan.formula, state, state, output)
    else:
        respond(plan.settings[0].response, state, output)


@inlined
def largest(errors: Reals, column: Any) -> Any:
    """Return the maximum of a column of the bands' results."""
    return errors[:, column].max()


@inlined
def add(factor: Any, source: Reals, total: Reals) -> None:
    """Add values, weighted by one number."""
    weight = total.dtype.type(factor)
    for i in range(total.size):
        total[i] += weight * source[i]


@inlined
def look_up(plan: Plan, table: Any, v: Any) -> Any:
    """Return a function table's value: f_k for v_{k−1} < v ≤ v_k, or between the points."""
    k, last = plan.tables[table].first, plan.tables[table].last
    places, values = plan.points[0], plan.points[1]
    between = v > places[k] and v <= places[last]
    while k < last and v > places[k]:
        k += 1
    if not (plan.tables[table].linear and between):
        return values[k]
    part = (v - places[k - 1]) / (places[k] - places[k - 1])
    return values[k - 1] + (values[k] - values[k - 1]) * part


@inlined
def mean(plan: Plan, table: Any, begin: Any, end: Any) -> Any:
    """Return a table's mean between two arguments, as `Table.mean`."""
    places, values = plan.points[0], plan.points[1]
    total = float(values[plan.tables[table].first])
    for k in range(plan.tables[table].first, plan.tables[table].last):
        low, width = float(places[k]), float(places[k + 1] - places[k])
        if plan.tables[table].linear:
            first, last = (begin - low) / width, (end - low) / width
            least, most = min(max(first, 0.0), 1.0), min(max(last, 0.0), 1.0)
            inside = 0.5 * (most - least) * (most + least)
            share = (inside + max(last, 1.0) - max(first, 1.0)) / (last - first)
        else:
            share = min(max((end - low) / (end - begin), 0.0), 1.0)
        total += (values[k + 1] - values[k]) * share
    return total


@inlined
def couple(
    plan: Plan,
    kind: Any,
    gains: Reals,
    layer: Any,
    source: Reals,
    start: Any,
    total: Reals,
) -> None:
    """Add the weighted neighbours to `total`, whose first cell is `start` of its layer."""
    for t in range(plan.first[kind, layer], plan.first[kind, layer + 1]):
        at = start + plan.taps[t].offset
        add(plan.taps[t].weight * gains[plan.taps[t].gain], source[at : at + total.size], total)


@inlined
def bend(plan: Plan, kind: Any, work: Reals, layer: Any, start: Any, total: Reals) -> None:
    """Add nonlinear couplings to `total`, whose first cell is `start` of its layer."""
    for t in range(plan.first[kind, layer], plan.first[kind, layer + 1]):
        tap = plan.taps[t]
        weight, sign = total.dtype.type(tap.weight), total.dtype.type(tap.sign)
        neighbours = work[tap.neighbour, start + tap.offset :]
        alone = tap.centre == records.NOTHING
        centres = work[0 if alone else tap.centre, start + tap.centre_offset :]
        if tap.operations > 0:
            steps = plan.pairs[tap.begin : tap.begin + tap.operations]
            values = np.empty(total.size, total.dtype)
            interpret(steps, neighbours[: total.size], centres[: total.size], values)
            add(weight, values, total)
            continue
        for i in range(total.size):
            v = neighbours[i] if alone else sign * (centres[i] - neighbours[i])
            value = weight * look_up(plan, tap.table, v)
            total[i] += value * v if tap.times else value


@inlined
def _combine(
    plan: Plan, layer: Any, row: Any, work: Reals, step: Any, lo: Any, total: Reals
) -> None:
    """Add to `total` the sum of a tableau's row over the slopes of a step."""
    own = min(layer, len(plan.tableau) - 1)
    for stage in range(plan.settings[0].stages):
        weight = plan.tableau[own, row, stage]
        if weight != 0.0:
            add(step * weight, work[records.SLOPES + stage, lo : lo + total.size], total)


@inlined
def _move(plan: Plan, work: Reals, layer: Any, stage: Any, step: Any, lo: Any, hi: Any) -> None:
    """Set the state at a stage and its outputs."""
    moved = work[records.MOVED, lo:hi]
    if plan.settings[0].scheme == records.CHEBYSHEV and stage > 0:
        _recur(plan, work, stage - 1, step, lo, hi)
    else:
        copy(work[records.STATE, lo:hi], moved)
        _combine(plan, layer, records.STAGES + stage, work, step, lo, moved)
        if plan.settings[0].limited:
            _limit(work[records.PACE, lo:hi], moved)
    show(plan, moved, work[records.OUTPUT, lo:hi])


@inlined
def _limit(pace: Reals, state: Reals) -> None:
    """Clip the states of cells that move; virtual cells keep theirs, which may be beyond 1."""
    one = state.dtype.type(1)
    for i in range(state.size):
        state[i] = min(max(state[i], -one), one) if pace[i] != 0 else state[i]


@inlined
def _recur(plan: Plan, work: Reals, row: Any, step: Any, lo: Any, hi: Any) -> None:
    """Set the state at one of Chebyshev's stages."""
    real, numbers = work.dtype.type, plan.chebyshev[row]
    state, moved = work[records.STATE, lo:hi], work[records.MOVED, lo:hi]
    earlier, first = work[records.EARLIER, lo:hi], work[records.SLOPES, lo:hi]
    rate, start, slope = real(step * numbers[2]), real(step * numbers[3]), work[records.SLOPES + 1]
    if row % plan.settings[0].most == 0:
        for i in range(moved.size):
            earlier[i] = state[i]
            moved[i] = state[i] + rate * first[i]
        return
    for i in range(moved.size):
        # by differences to the state, so that a held cell stays to the bit
        now, old, ahead = moved[i], state[i], rate * slope[lo + i] + start * first[i]
        moved[i] = old + numbers[0] * (now - old) + numbers[1] * (earlier[i] - old) + ahead
        earlier[i] = now


@inlined
def _slope(plan: Plan, work: Reals, gains: Reals, layer: Any, stage: Any, lo: Any, hi: Any) -> None:
    """Find dx/dt = (w − x + A∗y + …) / τ; 0 in held cells, and outwards at a limit of the state.

    Later stages of a step of fixed length keep what leads outwards: a cell that comes to its limit
    within the step is there at its end.
    """
    slope, moved = work[records.SLOPES + stage, lo:hi], work[records.MOVED, lo:hi]
    drive, pace = work[records.DRIVE, lo:hi], work[records.PACE, lo:hi]
    start = lo - layer * plan.settings[0].size
    for i in range(slope.size):
        slope[i] = drive[i] - moved[i]
    couple(plan, records.FEEDBACK, gains, layer, work[records.OUTPUT], start, slope)
    couple(plan, records.LATE_FEEDBACK, gains, layer, work[records.PAST], start, slope)
    bend(plan, records.MOVING, work, layer, start, slope)
    for i in range(slope.size):
        slope[i] *= pace[i]
    if plan.settings[0].limited and (stage == 0 or plan.settings[0].scheme != records.FIXED):
        one, none = slope.dtype.type(1), slope.dtype.type(0)
        for i in range(slope.size):
            slope[i] = min(slope[i], none if moved[i] >= one else slope[i])
            slope[i] = max(slope[i], none if moved[i] <= -one else slope[i])


@compiled
def speed(plan: Plan, state: Reals, slope: Reals) -> Any:
    """Return the largest |dx/dt|, weighted by each cell's error propagation factor."""
    real, largest = state.dtype.type, state.dtype.type(0)
    if plan.settings[0].slopes_count == 0:
        for i in range(slope.size):
            largest = max(largest, abs(slope[i]))
        return largest
    above, below = np.empty_like(slope), np.empty_like(slope)
    around, rise = real(AROUND), real(0.5 / AROUND)
    show(plan, state[: slope.size] + around, above)
    show(plan, state[: slope.size] - around, below)
    for i in range(slope.size):
        passes = max(rise * abs(above[i] - below[i]), real(LEAST_SLOPE))
        largest = max(largest, passes * abs(slope[i]))
    return largest


@inlined
def _judge(plan: Plan, work: Reals, layer: Any, step: Any, lo: Any, hi: Any, judged: Reals) -> None:
    """Find the error of a step from the state to the last stage, and change and rate there."""
    real, last = work.dtype.type, plan.settings[0].stages - 1
    worst = real(0)
    rtol, atol = real(plan.settings[0].rtol), real(plan.settings[0].atol)
    state, moved = work[records.STATE, lo:hi], work[records.MOVED, lo:hi]
    errors, slope = np.zeros(hi - lo, work.dtype), work[records.SLOPES + last, lo:hi]
    _combine(plan, layer, records.ERRORS, work, step, lo, errors)
    if plan.settings[0].scheme == records.CHEBYSHEV:
        _miss(work, step, lo, errors)
    off, added = np.abs(errors), np.zeros_like(errors)
    if plan.settings[0].scheme == records.CHEBYSHEV:
        added += off
    for row in range(records.STAGES + last + 1, plan.tableau.shape[1]):
        errors[:] = 0
        _combine(plan, layer, row, work, step, lo, errors)
        added += np.abs(errors)
    if plan.settings[0].bends:
        off = np.maximum(off, added)
    for i in range(errors.size):
        worst = max(worst, off[i] / (atol + rtol * max(abs(state[i]), abs(moved[i]))))
    added += real(plan.settings[0].rounding) * np.abs(moved)
    judged[0], judged[1], judged[3] = (
        worst,
        added.max(),
        speed(plan, moved, slope),
    )
    judged[2] = _change(plan, moved, slope)


@inlined
def _miss(work: Reals, step: Any, lo: Any, errors: Reals) -> None:
    """Set the error of Chebyshev's step (Sommeijer, Shampine & Verwer 1998, section 2.2)."""
    real, hi = work.dtype.type, lo + errors.size
    state, moved = work[records.STATE, lo:hi], work[records.MOVED, lo:hi]
    first, last = work[records.SLOPES, lo:hi], work[records.SLOPES + 1, lo:hi]
    whole, slopes = real(0.8), real(0.4 * step)
    for i in range(errors.size):
        errors[i] = whole * (state[i] - moved[i]) + slopes * (first[i] + last[i])


@inlined
def _change(plan: Plan, state: Reals, slope: Reals) -> Any:
    """Return the distance of cells from rest, in units of the tolerance."""
    real = state.dtype.type
    rtol, atol = real(plan.settings[0].rtol), real(plan.settings[0].atol)
    slowest, change = real(plan.settings[0].slowest), real(0)
    for i in range(state.size):
        change = max(change, abs(slowest * slope[i]) / (atol + rtol * abs(state[i])))
    return change


@inlined
def _advance(plan: Plan, work: Reals, layer: Any, step: Any, lo: Any, hi: Any) -> None:
    """Take a step of fixed length."""
    state, moved = work[records.STATE, lo:hi], work[records.MOVED, lo:hi]
    own = min(layer, len(plan.tableau) - 1)
    carried = state.dtype.type(plan.tableau[own, records.CARRIED, 0])
    if carried != 0:
        for i in range(state.size):
            state[i] += carried * (moved[i] - state[i])
    _combine(plan, layer, records.WEIGHTS, work, step, lo, state)
    if plan.settings[0].limited:
        _limit(work[records.PACE, lo:hi], state)


@inlined
def _work_on(phase: Any, plan: Plan, now: Frame, stage: Any, step: Any, band: Any) -> None:
    """Do one phase of a step on one band."""
    (layer, lo, hi), work = plan.bands[band], now.work
    if phase == records.MOVE:
        _move(plan, work, layer, stage, step, lo, hi)
    elif phase == records.SLOPE:
        _slope(plan, work, now.gains, layer, stage, lo, hi)
    elif phase == records.JUDGE:
        _judge(plan, work, layer, step, lo, hi, now.found[band])
    elif phase == records.CHANGE:
        now.found[band, 2] = _change(plan, work[records.STATE, lo:hi], work[records.SLOPES, lo:hi])
    elif phase == records.ACCEPT:
        copy(work[records.MOVED, lo:hi], work[records.STATE, lo:hi])
        copy(work[plan.settings[0].stages + records.SLOPES - 1, lo:hi], work[records.SLOPES, lo:hi])
    else:
        _advance(plan, work, layer, step, lo, hi)


@compiled_parallel
def _spread_bands(phase: Any, plan: Plan, now: Frame, stage: Any, step: Any) -> None:
    for band in numba.prange(len(plan.bands)):
        _work_on(phase, plan, now, stage, step, np.int64(band))


@compiled
def all_bands(phase: Any, plan: Plan, now: Frame, stage: Any, step: Any, spread: bool) -> None:
    """Do one phase of a step on all bands."""
    if spread:
        _spread_bands(phase, plan, now, stage, step)
    else:
        for band in range(len(plan.bands)):
            _work_on(phase, plan, now, stage, step, band)


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

    Steps with a delay may contain jumps and kinks, so gains are averaged over them.
    """
    middle = begin + 0.5 * step
    for g in range(plan.gains.size):
        gains[plan.gains[g].place] = 1
    for g in range(plan.gains.size):
        if plan.settings[0].lag and step > 0.0:
            gain = mean(plan, plan.gains[g].table, begin, begin + step)
            gains[plan.gains[g].place] += gains.dtype.type(gain - 1.0)
            continue
        at = time if plan.tables[plan.gains[g].table].linear else middle
        value = look_up(plan, plan.gains[g].table, gains.dtype.type(at))
        gains[plan.gains[g].place] += value - 1


@inlined
def _recall(plan: Plan, work: Reals, stage: Any, step: Any, number: Any, gone: Any) -> None:
    """Find the delayed outputs; those before the start equal those at the start.

    `gone` is the time of the step that is over where only a part of it is taken.
    """
    output, past, settings = work[records.OUTPUT], work[records.PAST], plan.settings[0]
    ring, lag = work[records.SLOPES + settings.stages :], settings.lag
    if number == records.AT_REST:
        copy(output, past)
        return
    if stage == 0 and gone == 0.0:
        copy(output, ring[number % len(ring)])
    since = gone + plan.tableau[0, records.TIMES, stage] * step
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
    at = time + plan.tableau[0, records.TIMES, slopes] * step
    _set_gains(plan, now.gains, at, time, step)
    all_bands(records.MOVE, plan, now, stage, step, spread)
    _fill_rims(plan, now.work[records.OUTPUT])
    if plan.settings[0].reads_states:
        _fill_rims(plan, now.work[records.MOVED])
    if plan.settings[0].lag:
        _recall(plan, now.work, stage, step, number, gone)
    all_bands(records.SLOPE, plan, now, slopes, step, spread)


@merged
def evaluate_once(plan: Plan, now: Frame, time: Any, spread: bool) -> None:
    """Find the slopes of the state as it is."""
    evaluate(plan, now, records.NONE, 0.0, time, records.AT_REST, spread)


@compiled
def rests(plan: Plan, now: Frame, spread: bool) -> bool:
    """Return whether nothing changes any more, by the slopes of the first stage."""
    all_bands(records.CHANGE, plan, now, records.NONE, 0.0, spread)
    return bool(largest(now.found, 2) <= 1.0)


@compiled
def _note(plan: Plan, now: Frame, at: Any, state: Reals, steps: Any, error: Any) -> None:
    """Store the sample at a moment; the change there is in `found`."""
    copy(state, now.seen[at])
    now.marks[at, 0] = steps
    now.marks[at, 1] = 1.0 if largest(now.found, 2) <= 1.0 else 0.0
    now.marks[at, 2] = error


@inlined
def _of_part(plan: Plan, now: Frame, at: Any) -> Plan:
    """Return the plan with the numbers of the part of a step up to a moment."""
    if len(now.parts) == 0:
        return plan
    return Plan(
        plan.settings, now.parts[at], plan.taps, plan.first, plan.tables, plan.points, plan.gains,
        plan.pieces, plan.rim, plan.bands, plan.chebyshev, plan.formula, plan.pairs,
    )  # fmt: skip


@compiled
def _look_at_fixed(
    plan: Plan, now: Frame, at: Any, time: Any, step: Any, taken: Any, spread: bool
) -> Any:
    """Look at the moments before a step ends: its part up to each is taken, and taken back.

    It is taken in `cuts`: runs that are compared with each other differ in these, too.
    """
    settings, state = plan.settings[0], now.work[records.STATE]
    while at < now.moments.size and now.moments[at] < time + step * records.ALMOST:
        part = now.moments[at] - time
        if settings.whole and part > records.ROUNDING:
            break  # in discrete time a step is taken as a whole
        copy(state, now.kept[0])
        some = part > step * records.ROUNDING
        if some:
            cut, own = part / settings.cuts, _of_part(plan, now, at)
            for number in range(settings.cuts):
                gone = number * cut
                for stage in range(settings.stages):
                    evaluate(own, now, stage, cut, time + gone, taken, spread, gone)
                all_bands(records.STEP, own, now, records.NONE, cut, spread)
        evaluate(plan, now, records.NONE, 0.0, now.moments[at], records.AT_REST, spread)
        all_bands(records.CHANGE, plan, now, records.NONE, 0.0, spread)
        _note(plan, now, at, state, taken + 1 if some else taken, settings.error)
        copy(now.kept[0], state)
        at += 1
    return at


@merged
def fixed(plan: Plan, now: Frame, spread: bool, figures: Reals) -> None:
    """Take steps of one length; where it settles, until nothing changes for longer than a delay."""
    taken, time, settled, settings = records.NONE, 0.0, 0.0, plan.settings[0]
    still = records.NONE
    piece, at = records.NONE, records.NONE
    while taken < settings.count and settled == 0.0:
        if piece + 1 < len(plan.pieces) and taken >= plan.pieces[piece + 1, 0]:
            piece += 1
            time = plan.pieces[piece, 1]
        step = plan.pieces[piece, 2]
        if len(plan.pieces) == 1 and taken == settings.count - 1:
            step = settings.last
        if taken == settings.lag:
            add(1.0, now.work[records.LATER], now.work[records.DRIVE])
        if at < now.moments.size:
            at = _look_at_fixed(plan, now, at, time, step, taken, spread)
        for stage in range(settings.stages):
            evaluate(plan, now, stage, step, time, taken, spread)
        if settings.settle:
            still = still + 1 if rests(plan, now, spread) else records.NONE
            settled = 1.0 if still > settings.lag else 0.0
        all_bands(records.STEP, plan, now, records.NONE, step, spread)
        taken, time = taken + 1, time + step
    if taken <= settings.lag:
        add(1.0, now.work[records.LATER], now.work[records.DRIVE])
    if at < now.moments.size:
        _look_at_fixed(plan, now, at, settings.duration, 1.0, taken, spread)
    figures[0], figures[1] = time if settings.settle else settings.duration, taken
    figures[2], figures[3] = settled, settings.error


@inlined
def _stages(plan: Plan, step: Any) -> tuple[Any, Any]:
    """Return the number of a step's stage after the first, and how many there are from it on."""
    settings = plan.settings[0]
    if settings.scheme != records.CHEBYSHEV:
        return 1, settings.stages - 1
    stages, needed = 2, step * settings.reach + 1.0
    while stages < settings.most and stages * stages < needed:
        stages += 1
    return stages * settings.most + 1, stages


@inlined
def _grown(plan: Plan, error: Any, step: Any, before: Any, now: Frame) -> Any:
    """Return the error after a step, as in `cnnum.integrators.estimate`."""
    grown = math.exp(min(plan.settings[0].growth * step, records.LARGEST_EXPONENT))
    grown = min(max(largest(now.found, 3) / max(before, records.SMALLEST_RATE), 1.0), grown)
    added = largest(now.found, 1) * max(grown, 1.0) ** plan.settings[0].later
    return min(error * grown + added, records.LOST)


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
    """Sample the moments within an accepted step, as runs that end there would.

    Each takes the step's part up to the moment. State, end and rates are left as they were.
    """
    settings, work = plan.settings[0], now.work
    last = records.SLOPES + settings.stages - 1
    copy(work[records.MOVED], now.kept[0])
    copy(work[last], now.kept[1])
    figures = now.found.copy()
    while at < now.moments.size and now.moments[at] < time + step * records.ALMOST:
        part = now.moments[at] - time
        if part > step * records.ROUNDING:
            first, stages = _stages(plan, part)
            own = _of_part(plan, now, at)
            for stage in range(first, first + stages):
                evaluate(own, now, stage, part, time, records.AT_REST, spread)
            all_bands(records.JUDGE, own, now, records.NONE, part, spread)
            stated = settings.safety * _grown(plan, error, part, before, now) + settings.floor
            _note(plan, now, at, work[records.MOVED], taken, stated)
        else:
            all_bands(records.CHANGE, plan, now, records.NONE, step, spread)
            stated = settings.safety * error + (settings.floor if taken > 1 else 0.0)
            _note(plan, now, at, work[records.STATE], taken - 1, stated)
        at += 1
    now.found[:] = figures
    copy(now.kept[0], work[records.MOVED])
    copy(now.kept[1], work[last])
    return at


@merged
def adaptive(plan: Plan, now: Frame, spread: bool, figures: Reals) -> None:
    """Take adaptive steps that keep the error estimate within the tolerance."""
    taken, time, error, settled, settings = records.NONE, 0.0, 0.0, 0.0, plan.settings[0]
    step, end = settings.step, settings.duration * (1.0 - 1e-6)
    evaluate_once(plan, now, time, spread)
    state, rates = now.work[records.STATE], now.work[records.SLOPES]
    before, piece = speed(plan, state, rates), records.NONE
    at = records.NONE
    while time < end and settled == 0.0 and taken < settings.count:
        step, ends = min(step, settings.longest, settings.duration - time), False
        usual = step
        # no sliver of a step is left before a point of a gain in time
        if (
            piece + 1 < len(plan.pieces)
            and time + records.NEARLY * step >= plan.pieces[piece + 1, 1]
        ):
            step, ends = plan.pieces[piece + 1, 1] - time, True
        if settings.jumping:  # the rates at a step's start are those after a jump
            evaluate(plan, now, records.NONE, step, time, records.AT_REST, spread)
            before = speed(plan, state, rates)
        first, stages = _stages(plan, step)
        for stage in range(first, first + stages):
            evaluate(plan, now, stage, step, time, records.AT_REST, spread)
        all_bands(records.JUDGE, plan, now, records.NONE, step, spread)
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
            all_bands(records.ACCEPT, plan, now, records.NONE, step, spread)
        longer = settings.caution * max(worst, 1e-10) ** settings.exponent
        step *= min(max(longer, settings.least), 5.0)
    stated = settings.safety * error + (settings.floor if taken else 0.0)
    while at < now.moments.size:
        all_bands(records.CHANGE, plan, now, records.NONE, 0.0, spread)
        _note(plan, now, at, now.work[records.STATE], taken, stated)
        at += 1
    figures[0], figures[1], figures[2] = time, taken, settled
    figures[3] = stated
    figures[4] = 1.0 if time < end and settled == 0.0 else 0.0


@compiled
def _prepare(plan: Plan, batch: Batch, frame: Any, gains: Reals) -> Reals:
    """Return the maps of a frame at its start, with all that drives it."""
    settings = plan.settings[0]
    maps = records.SLOPES + settings.stages + (settings.lag + 1 if settings.lag else 0)
    length = max(batch.state.shape[1], batch.inputs.shape[1])
    work = np.zeros((maps, length), batch.state.dtype)
    copy(batch.state[frame], work[records.STATE])
    copy(batch.state[frame], work[records.MOVED])
    copy(batch.drive[frame], work[records.DRIVE])
    copy(batch.pace[frame % len(batch.pace)], work[records.PACE])
    show(plan, work[records.STATE], work[records.OUTPUT])
    if settings.scheme == records.KNOWN:
        return work
    copy((batch.previous if len(batch.previous) else batch.inputs)[frame], work[records.INPUT])
    _drive(plan, records.LATE_CONTROL, gains, work, work[records.DRIVE])
    _drive(plan, records.LATE_CONTROL, gains, work, work[records.LATER])
    add(-2.0, work[records.LATER].copy(), work[records.LATER])
    copy(batch.inputs[frame], work[records.INPUT])
    _drive(plan, records.LATE_CONTROL, gains, work, work[records.LATER])
    _drive(plan, records.CONTROL, gains, work, work[records.DRIVE])
    return work


@compiled
def _drive(plan: Plan, kind: Any, gains: Reals, work: Reals, total: Reals) -> None:
    """Add the drive of inputs."""
    for band in range(len(plan.bands)):
        layer, lo, hi = plan.bands[band]
        start = lo - layer * plan.settings[0].size
        couple(plan, kind, gains, layer, work[records.INPUT], start, total[lo:hi])
        if kind == records.CONTROL:
            bend(plan, records.STILL, work, layer, start, total[lo:hi])


@kept
def run_frames(
    plan: Plan, batch: Batch, start: Any, end: Any, spread: bool, room: int = ROOM
) -> None:
    """Run frames in sequence; with `spread` the bands of each are distributed over all cores.

    Frames of a scheme without steps are at their end before, and learn whether all is at rest.
    """
    settings = plan.settings[0]
    for frame in range(start, end):
        figures = batch.figures[frame]
        gains = np.ones(settings.layers**2 + 1, batch.state.dtype)
        work = _prepare(plan, batch, frame, gains)
        errors = np.zeros((len(plan.bands), 4), work.dtype)
        kept = np.zeros((2, work.shape[1] if batch.moments.size else 0), work.dtype)
        seen, marks = batch.seen[:, frame], batch.marks[:, frame]
        now = Frame(work, gains, errors, kept, batch.moments, seen, marks, batch.parts)
        if settings.scheme == records.FIXED:
            fixed(plan, now, spread, figures)
        elif settings.scheme in (records.ADAPTIVE, records.CHEBYSHEV):
            adaptive(plan, now, spread, figures)
        if not settings.settle:
            evaluate_once(plan, now, settings.duration, spread)
            figures[2] = 1.0 if rests(plan, now, spread) else 0.0
        copy(work[records.STATE], batch.state[frame])
        show(plan, batch.state[frame], batch.output[frame])


@kept
def drive_frames(plan: Plan, batch: Batch, start: Any, end: Any, room: int = ROOM) -> None:
    """Add to the drives of frames the sums of linear couplings over their inputs."""
    gains = np.ones(plan.settings[0].layers ** 2 + 1, batch.state.dtype)
    for frame in range(start, end):
        for band in range(len(plan.bands)):
            layer, lo, hi = plan.bands[band]
            at, drive = lo - layer * plan.settings[0].size, batch.drive[frame, lo:hi]
            couple(plan, records.CONTROL, gains, layer, batch.inputs[frame], at, drive)
