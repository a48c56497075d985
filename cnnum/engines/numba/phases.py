"""Phases of a step on a band of cells; bands one after the other, or on all cores."""

from typing import Any

import numba
import numpy as np

from cnnum.engines.numba import codes
from cnnum.engines.numba.cells import add, bend, copy, couple, show
from cnnum.engines.numba.compiling import compiled, compiled_parallel, inlined
from cnnum.engines.numba.records import Frame, Plan, Reals
from cnnum.integrators.estimate import AROUND, LEAST_SLOPE


@inlined
def _combine(
    plan: Plan, layer: Any, row: Any, work: Reals, step: Any, lo: Any, total: Reals
) -> None:
    """Add to `total` the sum of a tableau's row over the slopes of a step."""
    own = min(layer, len(plan.tableau) - 1)
    for stage in range(plan.settings[0].stages):
        weight = plan.tableau[own, row, stage]
        if weight != 0.0:
            add(step * weight, work[codes.SLOPES + stage, lo : lo + total.size], total)


@inlined
def _move(plan: Plan, work: Reals, layer: Any, stage: Any, step: Any, lo: Any, hi: Any) -> None:
    """Set the state at a stage and its outputs."""
    moved = work[codes.MOVED, lo:hi]
    if plan.settings[0].scheme == codes.CHEBYSHEV and stage > 0:
        _recur(plan, work, stage - 1, step, lo, hi)
    else:
        copy(work[codes.STATE, lo:hi], moved)
        _combine(plan, layer, codes.STAGES + stage, work, step, lo, moved)
        if plan.settings[0].limited:
            _limit(work[codes.PACE, lo:hi], moved)
    show(plan, moved, work[codes.OUTPUT, lo:hi])


@inlined
def _limit(pace: Reals, state: Reals) -> None:
    """Limit the states of cells that move: virtual cells keep theirs, which may lie beyond 1."""
    one = state.dtype.type(1)
    for i in range(state.size):
        state[i] = min(max(state[i], -one), one) if pace[i] != 0 else state[i]


@inlined
def _recur(plan: Plan, work: Reals, row: Any, step: Any, lo: Any, hi: Any) -> None:
    """Set the state at one of Chebyshev's stages."""
    real, numbers = work.dtype.type, plan.chebyshev[row]
    state, moved = work[codes.STATE, lo:hi], work[codes.MOVED, lo:hi]
    earlier, first = work[codes.EARLIER, lo:hi], work[codes.SLOPES, lo:hi]
    rate, start, slope = real(step * numbers[2]), real(step * numbers[3]), work[codes.SLOPES + 1]
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
    slope, moved = work[codes.SLOPES + stage, lo:hi], work[codes.MOVED, lo:hi]
    drive, pace = work[codes.DRIVE, lo:hi], work[codes.PACE, lo:hi]
    start = lo - layer * plan.settings[0].size
    for i in range(slope.size):
        slope[i] = drive[i] - moved[i]
    couple(plan, codes.FEEDBACK, gains, layer, work[codes.OUTPUT], start, slope)
    couple(plan, codes.LATE_FEEDBACK, gains, layer, work[codes.PAST], start, slope)
    bend(plan, codes.MOVING, work, layer, start, slope)
    for i in range(slope.size):
        slope[i] *= pace[i]
    if plan.settings[0].limited and (stage == 0 or plan.settings[0].scheme != codes.FIXED):
        one, none = slope.dtype.type(1), slope.dtype.type(0)
        for i in range(slope.size):
            slope[i] = min(slope[i], none if moved[i] >= one else slope[i])
            slope[i] = max(slope[i], none if moved[i] <= -one else slope[i])


@compiled
def speed(plan: Plan, state: Reals, slope: Reals) -> Any:
    """Return the largest |dx/dt|, each by how much its cell passes an error on."""
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
def _judge(plan: Plan, work: Reals, layer: Any, step: Any, lo: Any, hi: Any, found: Reals) -> None:
    """Find the error of a step from the state to the last stage, and change and rate there."""
    real, last = work.dtype.type, plan.settings[0].stages - 1
    worst = real(0)
    rtol, atol = real(plan.settings[0].rtol), real(plan.settings[0].atol)
    state, moved = work[codes.STATE, lo:hi], work[codes.MOVED, lo:hi]
    errors, slope = np.zeros(hi - lo, work.dtype), work[codes.SLOPES + last, lo:hi]
    _combine(plan, layer, codes.ERRORS, work, step, lo, errors)
    if plan.settings[0].scheme == codes.CHEBYSHEV:
        _miss(work, step, lo, errors)
    off, added = np.abs(errors), np.zeros_like(errors)
    if plan.settings[0].scheme == codes.CHEBYSHEV:
        added += off
    for row in range(codes.STAGES + last + 1, plan.tableau.shape[1]):
        errors[:] = 0
        _combine(plan, layer, row, work, step, lo, errors)
        added += np.abs(errors)
    if plan.settings[0].bends:
        off = np.maximum(off, added)
    for i in range(errors.size):
        worst = max(worst, off[i] / (atol + rtol * max(abs(state[i]), abs(moved[i]))))
    added += real(plan.settings[0].rounding) * np.abs(moved)
    found[0], found[1], found[3] = worst, added.max(), speed(plan, moved, slope)
    found[2] = _change(plan, moved, slope)


@inlined
def _miss(work: Reals, step: Any, lo: Any, errors: Reals) -> None:
    """Set the error of Chebyshev's step (Sommeijer, Shampine & Verwer 1998, section 2.2)."""
    real, hi = work.dtype.type, lo + errors.size
    state, moved = work[codes.STATE, lo:hi], work[codes.MOVED, lo:hi]
    first, last = work[codes.SLOPES, lo:hi], work[codes.SLOPES + 1, lo:hi]
    whole, slopes = real(0.8), real(0.4 * step)
    for i in range(errors.size):
        errors[i] = whole * (state[i] - moved[i]) + slopes * (first[i] + last[i])


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
def _advance(plan: Plan, work: Reals, layer: Any, step: Any, lo: Any, hi: Any) -> None:
    """Take a step of fixed length."""
    state, moved = work[codes.STATE, lo:hi], work[codes.MOVED, lo:hi]
    own = min(layer, len(plan.tableau) - 1)
    carried = state.dtype.type(plan.tableau[own, codes.CARRIED, 0])
    if carried != 0:
        for i in range(state.size):
            state[i] += carried * (moved[i] - state[i])
    _combine(plan, layer, codes.WEIGHTS, work, step, lo, state)
    if plan.settings[0].limited:
        _limit(work[codes.PACE, lo:hi], state)


@inlined
def _work_on(phase: Any, plan: Plan, now: Frame, stage: Any, step: Any, band: Any) -> None:
    """Do one phase of a step on one band."""
    (layer, lo, hi), work = plan.bands[band], now.work
    if phase == codes.MOVE:
        _move(plan, work, layer, stage, step, lo, hi)
    elif phase == codes.SLOPE:
        _slope(plan, work, now.gains, layer, stage, lo, hi)
    elif phase == codes.JUDGE:
        _judge(plan, work, layer, step, lo, hi, now.found[band])
    elif phase == codes.CHANGE:
        now.found[band, 2] = _change(plan, work[codes.STATE, lo:hi], work[codes.SLOPES, lo:hi])
    elif phase == codes.ACCEPT:
        copy(work[codes.MOVED, lo:hi], work[codes.STATE, lo:hi])
        copy(work[plan.settings[0].stages + codes.SLOPES - 1, lo:hi], work[codes.SLOPES, lo:hi])
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
