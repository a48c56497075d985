"""Runs to equilibrium, continued until there is one, or time is up."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import MethodError
from cnnum.graph.nodes import RunSpec
from cnnum.runs.request import Request
from cnnum.runs.result import Result
from cnnum.templating.network import last_change
from cnnum.templating.template import Template

STRETCH = 32.0
"""Time constants of the slowest layer by which a run is longer, at least, than one in which it was
not shown to rest. It is this times a power of 2, so that a frame runs for the same time alone and
in a batch."""

NEAR = 0.01
"""Cells so near to saturation count as linear."""

MOST_STEPS = 10_000
"""Steps after which a run is not taken anew for longer: these are steps of stiff arrays."""

LEAST_RTOL = {name: 64.0 * float(np.finfo(name).eps) for name in ("float32", "float64")}
"""Below it the roundings of a state are not small against the tolerance, by precision."""

Maps = NDArray[np.floating]
Given = Mapping[str, Maps]
FINER = 0.1
"""Part of the tolerances at which a frame is run once more whose error may lead elsewhere."""

Rerun = Callable[[dict[str, Maps], float, float], Result]
"""Runs frames from their start for a time, at a part of the tolerances."""


def to_rest(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run to equilibrium, and on where there is none yet."""
    result = down(request) if request.ready is None else request.ready
    engine, spec = request.engine, request.spec
    exact = result.method == "propagator" and engine.record.takes_steps
    if exact or engine.whole:
        # whole numbers rest where a step moves none of them
        settled = result.settled & (np.isfinite(result.error) | engine.whole)
        return replace(result, settled=settled, error=np.where(settled, result.error, np.inf))

    def again(given: dict[str, Maps], duration: float, part: float) -> Result:
        own = replace(spec, duration=duration, rtol=part * spec.rtol, atol=part * spec.atol)
        return down(request.by(own, given))

    return at_rest(result, request.template, request.given, again, spec, engine.precision)


def at_rest(
    result: Result,
    template: Template,
    given: Given,
    again: Rerun,
    spec: RunSpec,
    precision: str,
) -> Result:
    """Return a result whose frames rest where they say so.

    Parameters
    ----------
    result : Result
        Result of a run to equilibrium.
    template : Template
    given : mapping of str to (..., maps, rows, cols) float
        The run's maps, by role.
    again : callable
        Runs some frames for a time, at a part of the tolerances.
    spec : RunSpec
        Its limit is the time constants after which a frame is said not to rest.
    precision : str
        Precision of the engine: rates that are no more than its roundings move nothing.

    Returns
    -------
    Result
        Errors are those to the equilibrium that is come to; infinite where it is not shown that
        states as far off as the run may be come to it. Frames that were run for longer have a later
        time and more steps.
    """
    last = last_change(template)
    if template.output.discrete or not result.settled.any():
        settled = result.settled & (result.time >= last)
        return replace(result, settled=settled, error=np.where(settled, result.error, np.inf))
    # with SciPy, which takes its time
    from cnnum.runs.cells import Cells, Frame
    from cnnum.runs.equilibrium import Verdict, verdict

    frames = Frames(result, template, given)
    template = _after_gains(template)
    cells = Cells(template, frames.shape)
    slowest = float(template.tau.max())
    seen: dict[int, Verdict] = {}
    still: dict[int, bool] = {}
    coarser = float(np.finfo(precision).eps / np.finfo(np.float64).eps)
    unsure: list[int] = []
    # what rests before a gain changes need not rest after it
    early = np.flatnonzero(frames.settled & (frames.time < last))
    if len(early):
        frames.run_on(early, again, np.full(len(early), slowest * longer(last / slowest)))
        frames.settled[early] = frames.time[early] >= last
        frames.error[~frames.settled] = np.inf
    waiting, first = np.flatnonzero(frames.settled), True
    while len(waiting):
        left: list[int] = []
        for frame in waiting.tolist():
            x = frames.state[frame]
            tolerance = spec.atol + spec.rtol * np.abs(x)
            reach = float(frames.error[frame])
            # a run that ended on time may still move
            ready = None
            if first and spec.rtol >= LEAST_RTOL[precision]:
                ready = _all_saturated(template, x, reach, tolerance)
            if ready is not None:
                seen[frame] = Verdict("stable", x, ready)
                continue
            single = Frame(cells, frames.given_of(frame))
            # masked cells stay at their start, whatever the precision makes of it
            x = np.where(single.moving, x, single.start())
            seen[frame] = what = verdict(single, x, reach, tolerance)
            if what.stability == "stable" and math.isinf(what.error) and math.isfinite(reach):
                unsure.append(frame)
            late = longer(frames.time[frame] / slowest) > spec.settle_limit
            late |= bool(frames.steps[frame] > MOST_STEPS)
            rate, rounded = single.rates(x)
            still[frame] = bool((np.abs(rate) <= coarser * rounded).all())
            late |= still[frame]
            if what.stability != "stable" and what.decided and not late:
                left.append(frame)
        waiting = np.array(left, dtype=np.intp)
        if len(waiting):
            waiting, first = frames.run_on(waiting, again, frames.later(waiting)), False
    if template.delayed is None and unsure:
        sharp = np.array(unsure, dtype=np.intp)
        for frame in frames.run_on(sharp, again, frames.time[sharp], FINER).tolist():
            single = Frame(cells, frames.given_of(frame))
            x = np.where(single.moving, frames.state[frame], single.start())
            tolerance = spec.atol + spec.rtol * np.abs(x)
            what = verdict(single, x, float(frames.error[frame]), tolerance)
            seen[frame] = what if math.isfinite(what.error) else seen[frame]
    for frame, what in seen.items():
        frames.state[frame], frames.error[frame] = what.state, what.error
        known = what.decided and not (what.stability == "unknown" and still.get(frame, False))
        frames.settled[frame] = what.stability == "stable" or not known
    return frames.result()


def _after_gains(template: Template) -> Template:
    """Return the template as it is once no gain changes any more."""
    if not template.gains:
        return template
    feedback = template.A.copy()
    for gain in template.gains:
        feedback[gain.to, gain.source] *= gain.table.points[-1][1]
    return replace(template, A=feedback, gains=())


def longer(time: float) -> float:
    """Return for how long a frame is run anew that was not shown to rest at a time.

    Both are in time constants of the slowest layer.
    """
    return STRETCH * 2.0 ** math.ceil(math.log2(time / STRETCH + 1.0))


def saturated(
    result: Result | None, template: Template, rtol: float, atol: float, precision: str
) -> Result | None:
    """Return the result of a run to equilibrium if all its cells are saturated, else None.

    Such an array rests under any drive, as `verdict` has it. Most runs of a single frame end here,
    and a closer look would take as long as they do.

    Parameters
    ----------
    result : Result or None
    template : Template
    rtol, atol : float
    precision : str
        Precision of the engine.
    """
    if result is None or not result.settled.all() or template.output.name != "standard":
        return None
    if rtol < LEAST_RTOL[precision]:
        return None
    if result.method == "propagator" and not np.isfinite(result.error).all():
        return None  # a cell may have fallen to the other side
    sizes = np.abs(result.state)
    off = atol + rtol * float(sizes.max())
    if not template.plain or float(sizes.min()) < 1.0 + max(off, NEAR):
        return None
    # a way whose error leaves all cells saturated leads to the same equilibrium
    same = result.error < float(sizes.min()) - 1.0 - off
    return replace(result, error=np.where(same, off, np.inf))


def lanes_at_rest(result: Result, template: Template, rtol: float, atol: float) -> Result:
    """Return a result of many templates side by side, up to a rest, whose errors are shown.

    Frames are not looked at one by one: what is not all saturated has an infinite error.

    Parameters
    ----------
    result : Result
        Result of a batch, along its first axis.
    template : Template
        A template with the form of the batch.
    rtol, atol : float
    """
    error = np.full(result.error.shape, np.inf)
    result = replace(result, settled=result.settled & (result.time >= last_change(template)))
    if template.output.name == "standard" and template.plain:
        sizes = np.abs(result.state).reshape(len(error), -1)
        off, spare = atol + rtol * sizes.max(axis=1), sizes.min(axis=1) - 1.0
        shown = result.settled & (spare >= np.maximum(off, NEAR)) & (result.error < spare - off)
        error = np.where(shown, off, np.inf)
    return replace(result, error=error)


def _all_saturated(template: Template, x: Floats, reach: float, tolerance: Floats) -> float | None:
    """Return the error that `saturated` states of a state, None if not all cells are."""
    if template.output.name != "standard" or not template.plain:
        return None
    least, off = float(np.abs(x).min()), float(tolerance.max())
    if least < 1.0 + max(off, NEAR):
        return None
    return off if reach < least - 1.0 - off else np.inf


class Frames:
    """The frames of a batch in one row."""

    def __init__(self, result: Result, template: Template, given: Given) -> None:
        self._result, self._template = result, template
        self._lead = result.settled.shape
        self._batch = int(np.prod(self._lead, dtype=np.int64))
        self.shape = (int(result.state.shape[-2]), int(result.state.shape[-1]))
        self.state = np.array(result.state, dtype=np.float64).reshape(self._batch, -1)
        self.time = np.array(result.time, dtype=np.float64).reshape(self._batch)
        self.steps = np.array(result.steps).reshape(self._batch)
        self.error = np.array(result.error, dtype=np.float64).reshape(self._batch)
        self.settled = np.array(result.settled).reshape(self._batch)
        self.error[~self.settled] = np.inf  # what does not rest is not near a rest
        self._given = {role: self._flat(maps) for role, maps in given.items()}

    def _flat(self, maps: Maps) -> Maps:
        """Return maps as (batch or 1, maps, rows, cols)."""
        if maps.ndim == 3 or all(n == 1 for n in maps.shape[:-3]):
            return maps.reshape(1, *maps.shape[-3:])
        whole = np.broadcast_to(maps, (*self._lead, *maps.shape[-3:]))
        return whole.reshape(self._batch, *maps.shape[-3:])

    def given_of(self, frame: int) -> dict[str, Floats]:
        """Return the maps of a frame, (maps, rows, cols) by role."""
        return {
            role: np.asarray(maps[0 if len(maps) == 1 else frame], dtype=np.float64)
            for role, maps in self._given.items()
        }

    def later(self, frames: NDArray[np.intp]) -> Floats:
        """Return the times up to which frames are run that were not shown to rest."""
        slowest = float(self._template.tau.max())
        return np.array([slowest * longer(float(self.time[frame]) / slowest) for frame in frames])

    def run_on(
        self, frames: NDArray[np.intp], again: Rerun, ends: Floats, part: float = 1.0
    ) -> NDArray[np.intp]:
        """Run some frames anew up to their times; return those that are elsewhere then."""
        moved: list[NDArray[np.intp]] = []
        for end in np.unique(ends):
            some = frames[ends == end]
            given = {
                role: np.broadcast_to(maps, (self._batch, *maps.shape[1:]))[some]
                for role, maps in self._given.items()
            }
            before = self.state[some]
            try:
                more = again(given, float(end), part)
            except MethodError:  # it would take too many steps: these frames do not rest
                continue
            count = len(some)
            self.state[some] = more.state.reshape(count, -1)
            self.time[some] = more.time.reshape(count)
            self.steps[some] += more.steps.reshape(count)
            self.error[some] = more.error.reshape(count)
            moved.append(some[(self.state[some] != before).any(axis=1)])
        return np.sort(np.concatenate(moved)) if moved else np.zeros(0, dtype=np.intp)

    def result(self) -> Result:
        """Return the result of all frames."""
        old, lead, output = self._result, self._lead, self._template.output
        state = self.state.reshape(old.state.shape)
        moved = bool((state != old.state).any())
        return replace(
            old,
            state=state,
            output=np.asarray(output.numpy(state), dtype=np.float64) if moved else old.output,
            time=self.time.reshape(lead),
            steps=self.steps.reshape(lead),
            settled=self.settled.reshape(lead),
            error=self.error.reshape(lead),
        )
