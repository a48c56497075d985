"""One transient, compiled: generic in the template, whose couplings come as lists of taps.

All that call each other stand in this file, as numba's cache looks only at the file of what is
called. Nothing is summed in an order that depends on the number of threads, so that a frame gives
the same bits alone, in any batch, and on any number of cores.
"""

import math
from typing import Any

import numba
import numpy as np

from cnnum.engines.numba import codes
from cnnum.engines.numba.compiling import compiled, compiled_parallel, inlined
from cnnum.engines.numba.records import Batch, Frame, Plan, Reals

_NONE, _AT_REST = np.int64(0), np.int64(codes.AT_REST)  # literals would each be compiled for


@inlined
def _copy(source: Reals, target: Reals) -> None:
    for i in range(min(source.size, target.size)):
        target[i] = source[i]


@compiled
def _respond(response: Any, state: Reals, output: Reals) -> None:
    """Set y = f(x)."""
    one = state.dtype.type(1)
    if response == codes.IDENTITY:
        _copy(state, output)
    elif response == codes.CLAMP:
        for i in range(state.size):
            output[i] = min(max(state[i], -one), one)
    elif response == codes.TANH:
        for i in range(state.size):
            output[i] = math.tanh(state[i])
    else:
        for i in range(state.size):
            output[i] = one if state[i] >= 0 else -one


@inlined
def _largest(found: Reals, column: Any) -> Any:
    return found[:, column].max()


@inlined
def _add(factor: Any, source: Reals, total: Reals) -> None:
    weight = total.dtype.type(factor)
    for i in range(total.size):
        total[i] += weight * source[i]


@inlined
def _look_up(plan: Plan, table: Any, v: Any) -> Any:
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
def _couple(
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
        _add(plan.taps[t].weight * gains[plan.taps[t].gain], source[at : at + total.size], total)


@inlined
def _bend(plan: Plan, kind: Any, work: Reals, layer: Any, start: Any, total: Reals) -> None:
    """Add nonlinear couplings to `total`, whose first cell is `start` of its layer."""
    for t in range(plan.first[kind, layer], plan.first[kind, layer + 1]):
        tap = plan.taps[t]
        weight, sign = total.dtype.type(tap.weight), total.dtype.type(tap.sign)
        neighbours = work[tap.neighbour, start + tap.offset :]
        alone = tap.centre == codes.NOTHING
        centres = work[0 if alone else tap.centre, start + tap.centre_offset :]
        for i in range(total.size):
            v = neighbours[i] if alone else sign * (centres[i] - neighbours[i])
            value = weight * _look_up(plan, tap.table, v)
            total[i] += value * v if tap.times else value


@inlined
def _combine(plan: Plan, row: Any, work: Reals, step: Any, lo: Any, total: Reals) -> None:
    """Add to `total` what a row of the tableau makes of the slopes of a step."""
    for stage in range(plan.settings[0].stages):
        weight = plan.tableau[row, stage]
        if weight != 0.0:
            _add(step * weight, work[codes.SLOPES + stage, lo : lo + total.size], total)


@inlined
def _move(plan: Plan, work: Reals, stage: Any, step: Any, lo: Any, hi: Any) -> None:
    """Set the state at a stage and what it puts out."""
    moved = work[codes.MOVED, lo:hi]
    _copy(work[codes.STATE, lo:hi], moved)
    _combine(plan, codes.STAGES + stage, work, step, lo, moved)
    if plan.settings[0].limited:
        _respond(codes.CLAMP, moved, moved)
    _respond(plan.settings[0].response, moved, work[codes.OUTPUT, lo:hi])


@inlined
def _slope(plan: Plan, work: Reals, gains: Reals, layer: Any, stage: Any, lo: Any, hi: Any) -> None:
    """Find dx/dt = (w − x + A∗y + …) / τ; 0 in held cells, and outwards at a limit of the state."""
    slope, moved = work[codes.SLOPES + stage, lo:hi], work[codes.MOVED, lo:hi]
    drive, pace = work[codes.DRIVE, lo:hi], work[codes.PACE, lo:hi]
    start = lo - layer * plan.settings[0].size
    for i in range(slope.size):
        slope[i] = drive[i] - moved[i]
    _couple(plan, codes.FEEDBACK, gains, layer, work[codes.OUTPUT], start, slope)
    _couple(plan, codes.LATE_FEEDBACK, gains, layer, work[codes.PAST], start, slope)
    _bend(plan, codes.MOVING, work, layer, start, slope)
    for i in range(slope.size):
        slope[i] *= pace[i]
    if plan.settings[0].limited:
        one, none = slope.dtype.type(1), slope.dtype.type(0)
        for i in range(slope.size):
            slope[i] = min(slope[i], none if moved[i] >= one else slope[i])
            slope[i] = max(slope[i], none if moved[i] <= -one else slope[i])


@inlined
def _judge(plan: Plan, work: Reals, step: Any, lo: Any, hi: Any, found: Reals) -> None:
    """Find the error of a step from the state to the last stage, and change and rate there."""
    real, last = work.dtype.type, plan.settings[0].stages - 1
    worst, speed = real(0), real(0)
    rtol, atol = real(plan.settings[0].rtol), real(plan.settings[0].atol)
    state, moved = work[codes.STATE, lo:hi], work[codes.MOVED, lo:hi]
    errors, slope = np.zeros(hi - lo, work.dtype), work[codes.SLOPES + last, lo:hi]
    _combine(plan, codes.ERRORS, work, step, lo, errors)
    for i in range(errors.size):
        worst = max(worst, abs(errors[i]) / (atol + rtol * max(abs(state[i]), abs(moved[i]))))
        speed = max(speed, abs(slope[i]))
    added = real(plan.settings[0].rounding) * np.abs(moved)
    for row in range(codes.STAGES + last + 1, len(plan.tableau)):
        errors[:] = 0
        _combine(plan, row, work, step, lo, errors)
        added += np.abs(errors)
    found[0], found[1], found[3] = worst, added.max(), speed
    found[2] = _change(plan, moved, slope)


@inlined
def _change(plan: Plan, state: Reals, slope: Reals) -> Any:
    """Return how far cells are from rest, in units of the tolerance."""
    real = state.dtype.type
    rtol, atol = real(plan.settings[0].rtol), real(plan.settings[0].atol)
    slowest, change = real(plan.settings[0].slowest), real(0)
    for i in range(state.size):
        change = max(change, abs(slowest * slope[i]) / (atol + rtol * abs(state[i])))
    return change


@inlined
def _advance(plan: Plan, work: Reals, step: Any, lo: Any, hi: Any) -> None:
    """Take a step of fixed length."""
    state = work[codes.STATE, lo:hi]
    _combine(plan, codes.WEIGHTS, work, step, lo, state)
    if plan.settings[0].limited:
        _respond(codes.CLAMP, state, state)


@inlined
def _work_on(phase: Any, plan: Plan, now: Frame, stage: Any, step: Any, band: Any) -> None:
    """Do one phase of a step on one band."""
    (layer, lo, hi), work = plan.bands[band], now.work
    if phase == codes.MOVE:
        _move(plan, work, stage, step, lo, hi)
    elif phase == codes.SLOPE:
        _slope(plan, work, now.gains, layer, stage, lo, hi)
    elif phase == codes.JUDGE:
        _judge(plan, work, step, lo, hi, now.found[band])
    elif phase == codes.CHANGE:
        now.found[band, 2] = _change(plan, work[codes.STATE, lo:hi], work[codes.SLOPES, lo:hi])
    elif phase == codes.ACCEPT:
        _copy(work[codes.MOVED, lo:hi], work[codes.STATE, lo:hi])
        _copy(work[plan.settings[0].stages + codes.SLOPES - 1, lo:hi], work[codes.SLOPES, lo:hi])
    else:
        _advance(plan, work, step, lo, hi)


@compiled_parallel
def _spread_bands(phase: Any, plan: Plan, now: Frame, stage: Any, step: Any) -> None:
    for band in numba.prange(len(plan.bands)):
        _work_on(phase, plan, now, stage, step, np.int64(band))


@inlined
def _all_bands(phase: Any, plan: Plan, now: Frame, stage: Any, step: Any, spread: bool) -> None:
    if spread:
        _spread_bands(phase, plan, now, stage, step)
    else:
        for band in range(len(plan.bands)):
            _work_on(phase, plan, now, stage, step, band)


@inlined
def _fill_rims(plan: Plan, maps: Reals) -> None:
    """Let the rims of all maps copy what the boundary says; a constant rim never changes."""
    for layer in range(plan.settings[0].layers):
        start = layer * plan.settings[0].size
        for cell in range(plan.rim.shape[1]):
            maps[start + plan.rim[0, cell]] = maps[start + plan.rim[1, cell]]


@inlined
def _set_gains(plan: Plan, gains: Reals, time: Any) -> None:
    for g in range(plan.gains.size):
        gains[plan.gains[g].place] = 1
    for g in range(plan.gains.size):
        value = _look_up(plan, plan.gains[g].table, gains.dtype.type(time))
        gains[plan.gains[g].place] += value - 1


@inlined
def _recall(plan: Plan, work: Reals, stage: Any, step: Any, number: Any) -> None:
    """Find the outputs a delay ago; what was before the start is what was there at the start."""
    output, past, settings = work[codes.OUTPUT], work[codes.PAST], plan.settings[0]
    ring, lag = work[codes.SLOPES + settings.stages :], settings.lag
    if number == codes.AT_REST:
        _copy(output, past)
        return
    if stage == 0:
        _copy(output, ring[number % len(ring)])
    part = past.dtype.type(plan.tableau[codes.TIMES, stage] * step / settings.step)
    before, after = (
        ring[max(number - lag, 0) % len(ring)],
        ring[max(number + 1 - lag, 0) % len(ring)],
    )
    for i in range(past.size):
        past[i] = before[i] + part * (after[i] - before[i])


@inlined
def _evaluate(
    plan: Plan, now: Frame, stage: Any, step: Any, time: Any, number: Any, spread: bool
) -> None:
    """Find the slopes at a stage of the step that begins at `time`."""
    _set_gains(plan, now.gains, time + plan.tableau[codes.TIMES, stage] * step)
    _all_bands(codes.MOVE, plan, now, stage, step, spread)
    _fill_rims(plan, now.work[codes.OUTPUT])
    if plan.settings[0].reads_states:
        _fill_rims(plan, now.work[codes.MOVED])
    if plan.settings[0].lag:
        _recall(plan, now.work, stage, step, number)
    _all_bands(codes.SLOPE, plan, now, stage, step, spread)


@compiled
def _fixed(plan: Plan, now: Frame, spread: bool, figures: Reals) -> None:
    """Take steps of one length; where it settles, until nothing changes any more."""
    taken, time, settled, settings = _NONE, 0.0, 0.0, plan.settings[0]
    while taken < settings.count and settled == 0.0:
        step = settings.last if taken == settings.count - 1 else settings.step
        if taken == settings.lag:
            _add(1.0, now.work[codes.LATER], now.work[codes.DRIVE])
        for stage in range(settings.stages):
            _evaluate(plan, now, stage, step, time, taken, spread)
        if settings.settle:
            _all_bands(codes.CHANGE, plan, now, _NONE, 0.0, spread)
            settled = 1.0 if _largest(now.found, 2) <= 1.0 else 0.0
        _all_bands(codes.STEP, plan, now, _NONE, step, spread)
        taken, time = taken + 1, time + step
    if taken <= settings.lag:
        _add(1.0, now.work[codes.LATER], now.work[codes.DRIVE])
    figures[0], figures[1] = time if settings.settle else settings.duration, taken
    figures[2], figures[3] = settled, settings.error


@compiled
def _adaptive(plan: Plan, now: Frame, spread: bool, figures: Reals) -> None:
    """Take steps that keep the error estimate within the tolerance."""
    taken, time, error, settled, settings = _NONE, 0.0, 0.0, 0.0, plan.settings[0]
    step, end = settings.step, settings.duration * (1.0 - 1e-6)
    _evaluate(plan, now, _NONE, step, time, _AT_REST, spread)
    before = np.abs(now.work[codes.SLOPES]).max()
    while time < end and settled == 0.0 and taken < settings.count:
        step = min(step, settings.longest, settings.duration - time)
        for stage in range(1, settings.stages):
            _evaluate(plan, now, stage, step, time, _AT_REST, spread)
        _all_bands(codes.JUDGE, plan, now, _NONE, step, spread)
        taken, worst = taken + 1, _largest(now.found, 0)
        if worst <= 1.0:
            time, speed = time + step, _largest(now.found, 3)
            # as `cnnum.integrators.estimate` has it
            grown = math.exp(min(settings.growth * step, codes.LARGEST_EXPONENT))
            grown = min(max(speed / max(before, codes.SMALLEST_RATE), 1.0), grown)
            error, before = min(error * grown + _largest(now.found, 1), codes.LOST), speed
            settled = 1.0 if settings.settle and _largest(now.found, 2) <= 1.0 else 0.0
            _all_bands(codes.ACCEPT, plan, now, _NONE, step, spread)
        step *= min(max(0.9 * max(worst, 1e-10) ** settings.exponent, 0.2), 5.0)
    figures[0], figures[1], figures[2] = time, taken, settled
    figures[3] = settings.safety * error
    figures[4] = 1.0 if time < end and settled == 0.0 else 0.0


@compiled
def _decay(plan: Plan, state: Reals, drive: Reals, pace: Reals) -> None:
    """Set x = w + (x₀ − w)·kept in cells that are not held."""
    for i in np.flatnonzero(pace):
        kept = plan.exact[0, i // plan.settings[0].size]
        state[i] = drive[i] + (kept * (state[i] - drive[i]) if kept != 0 else kept)


@compiled
def _propagate(plan: Plan, state: Reals, drive: Reals) -> None:
    """Set x = E x₀ + D w + constant, summed column by column, in one order for every batch."""
    n = plan.inside.size
    end = plan.exact[2 * n].copy()
    for column in range(n):
        _add(state[plan.inside[column]], plan.exact[column], end)
        _add(drive[plan.inside[column]], plan.exact[n + column], end)
    for i in range(n):
        state[plan.inside[i]] = end[i]


@compiled
def _prepare(plan: Plan, batch: Batch, frame: Any, gains: Reals) -> Reals:
    """Return the maps of a frame at its start, with all that drives it."""
    settings = plan.settings[0]
    maps = codes.SLOPES + settings.stages + (settings.lag + 1 if settings.lag else 0)
    length = max(batch.state.shape[1], batch.inputs.shape[1])
    work = np.zeros((maps, length), batch.state.dtype)
    _copy(batch.state[frame], work[codes.STATE])
    _copy(batch.state[frame], work[codes.MOVED])
    _copy(batch.drive[frame], work[codes.DRIVE])
    _copy(batch.pace[frame % len(batch.pace)], work[codes.PACE])
    _respond(settings.response, work[codes.STATE], work[codes.OUTPUT])
    _copy((batch.previous if len(batch.previous) else batch.inputs)[frame], work[codes.INPUT])
    _drive(plan, codes.LATE_CONTROL, gains, work, work[codes.DRIVE])
    _drive(plan, codes.LATE_CONTROL, gains, work, work[codes.LATER])
    _add(-2.0, work[codes.LATER].copy(), work[codes.LATER])
    _copy(batch.inputs[frame], work[codes.INPUT])
    _drive(plan, codes.LATE_CONTROL, gains, work, work[codes.LATER])
    _drive(plan, codes.CONTROL, gains, work, work[codes.DRIVE])
    return work


@compiled
def _drive(plan: Plan, kind: Any, gains: Reals, work: Reals, total: Reals) -> None:
    """Add what inputs drive."""
    for band in range(len(plan.bands)):
        layer, lo, hi = plan.bands[band]
        start = lo - layer * plan.settings[0].size
        _couple(plan, kind, gains, layer, work[codes.INPUT], start, total[lo:hi])
        if kind == codes.CONTROL:
            _bend(plan, codes.STILL, work, layer, start, total[lo:hi])


@compiled
def _run_frame(plan: Plan, batch: Batch, frame: Any, spread: bool) -> None:
    figures, settings = batch.figures[frame], plan.settings[0]
    gains = np.ones(settings.layers**2 + 1, batch.state.dtype)
    work = _prepare(plan, batch, frame, gains)
    now = Frame(work, gains, np.zeros((len(plan.bands), 4), work.dtype))
    if settings.scheme == codes.ADAPTIVE:
        _adaptive(plan, now, spread, figures)
    elif settings.scheme == codes.FIXED:
        _fixed(plan, now, spread, figures)
    else:
        if settings.scheme == codes.DECAY:
            _decay(plan, work[codes.STATE], work[codes.DRIVE], work[codes.PACE])
        else:
            _propagate(plan, work[codes.STATE], work[codes.DRIVE])
        figures[0], figures[2] = settings.duration, 1.0
    if not settings.settle:
        _evaluate(plan, now, _NONE, 0.0, settings.duration, _AT_REST, spread)
        _all_bands(codes.CHANGE, plan, now, _NONE, 0.0, spread)
        figures[2] = 1.0 if _largest(now.found, 2) <= 1.0 else 0.0
    _copy(work[codes.STATE], batch.state[frame])
    _respond(settings.response, batch.state[frame], batch.output[frame])


@compiled
def run_frames(plan: Plan, batch: Batch, start: Any, end: Any, spread: bool) -> None:
    """Run frames one after the other; with `spread` the bands of each lie on all cores."""
    for frame in range(start, end):
        _run_frame(plan, batch, frame, spread)
