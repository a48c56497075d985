"""One transient, compiled: generic in the template, whose couplings come as lists of taps.

No order of a sum depends on the number of threads. So a frame gives the same bits alone, in any
batch, and on any number of cores.
"""

from typing import Any

import numpy as np

from cnnum.engines.numba import codes
from cnnum.engines.numba.cells import add, bend, copy, couple, show
from cnnum.engines.numba.compiling import ROOM, compiled, kept
from cnnum.engines.numba.records import Batch, Frame, Plan, Reals
from cnnum.engines.numba.stages import evaluate_once, rests
from cnnum.engines.numba.steps import adaptive, fixed


@compiled
def _prepare(plan: Plan, batch: Batch, frame: Any, gains: Reals) -> Reals:
    """Return the maps of a frame at its start, with all that drives it."""
    settings = plan.settings[0]
    maps = codes.SLOPES + settings.stages + (settings.lag + 1 if settings.lag else 0)
    length = max(batch.state.shape[1], batch.inputs.shape[1])
    work = np.zeros((maps, length), batch.state.dtype)
    copy(batch.state[frame], work[codes.STATE])
    copy(batch.state[frame], work[codes.MOVED])
    copy(batch.drive[frame], work[codes.DRIVE])
    copy(batch.pace[frame % len(batch.pace)], work[codes.PACE])
    show(plan, work[codes.STATE], work[codes.OUTPUT])
    if settings.scheme == codes.KNOWN:
        return work
    copy((batch.previous if len(batch.previous) else batch.inputs)[frame], work[codes.INPUT])
    _drive(plan, codes.LATE_CONTROL, gains, work, work[codes.DRIVE])
    _drive(plan, codes.LATE_CONTROL, gains, work, work[codes.LATER])
    add(-2.0, work[codes.LATER].copy(), work[codes.LATER])
    copy(batch.inputs[frame], work[codes.INPUT])
    _drive(plan, codes.LATE_CONTROL, gains, work, work[codes.LATER])
    _drive(plan, codes.CONTROL, gains, work, work[codes.DRIVE])
    return work


@compiled
def _drive(plan: Plan, kind: Any, gains: Reals, work: Reals, total: Reals) -> None:
    """Add the drive of inputs."""
    for band in range(len(plan.bands)):
        layer, lo, hi = plan.bands[band]
        start = lo - layer * plan.settings[0].size
        couple(plan, kind, gains, layer, work[codes.INPUT], start, total[lo:hi])
        if kind == codes.CONTROL:
            bend(plan, codes.STILL, work, layer, start, total[lo:hi])


@kept
def run_frames(
    plan: Plan, batch: Batch, start: Any, end: Any, spread: bool, room: int = ROOM
) -> None:
    """Run frames one after the other; with `spread` the bands of each lie on all cores.

    Frames of a scheme without steps are at their end before, and learn whether all is at rest.
    """
    settings = plan.settings[0]
    for frame in range(start, end):
        figures = batch.figures[frame]
        gains = np.ones(settings.layers**2 + 1, batch.state.dtype)
        work = _prepare(plan, batch, frame, gains)
        found = np.zeros((len(plan.bands), 4), work.dtype)
        kept = np.zeros((2, work.shape[1] if batch.moments.size else 0), work.dtype)
        looks = (batch.moments, batch.seen[:, frame], batch.marks[:, frame])
        now = Frame(work, gains, found, kept, looks[0], looks[1], looks[2])
        if settings.scheme == codes.FIXED:
            fixed(plan, now, spread, figures)
        elif settings.scheme in (codes.ADAPTIVE, codes.CHEBYSHEV):
            adaptive(plan, now, spread, figures)
        if not settings.settle:
            evaluate_once(plan, now, settings.duration, spread)
            figures[2] = 1.0 if rests(plan, now, spread) else 0.0
        copy(work[codes.STATE], batch.state[frame])
        show(plan, batch.state[frame], batch.output[frame])


@kept
def drive_frames(plan: Plan, batch: Batch, start: Any, end: Any, room: int = ROOM) -> None:
    """Add to the drives of frames the sums of linear couplings over their inputs."""
    gains = np.ones(plan.settings[0].layers ** 2 + 1, batch.state.dtype)
    for frame in range(start, end):
        for band in range(len(plan.bands)):
            layer, lo, hi = plan.bands[band]
            at, drive = lo - layer * plan.settings[0].size, batch.drive[frame, lo:hi]
            couple(plan, codes.CONTROL, gains, layer, batch.inputs[frame], at, drive)
