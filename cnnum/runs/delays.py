"""Runs with a delay to a tolerance: steps are halved until two runs agree.

A delay is a whole number of steps. So no step has a length of its own, and none has an error
estimate. Heun's method is of order 2, also where an output has a corner: a step that jumps over it
is off by O(h²). The second of two runs, in steps of half the length, is off by d / (r − 1). Here d
is their difference, and r by how much that fell since the two runs before. This is Richardson's way
(Hairer, Nørsett & Wanner, Solving ODEs I, section II.4). Four times d / (r − 1) is stated, and half
the tolerance asked of it. A difference that fell by more than the order says did so by chance, and
counts as one that did not.

A gain in time jumps or bends within steps, where it counts by its mean. A jump after a share θ of a
step is off by θ(1 − θ) times a number that its neighbours share, which is no more than d; r says
nothing then, and is taken for 2. A cell of a limited state may leave its limit at such a jump, and
a step by a mean holds it there up to its end. Steps of half the length may end at the same time, so
that differences do not show it: the error is infinite there.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import SizeError
from cnnum.integrators.estimate import LOST, delayed_growth
from cnnum.integrators.schemes import MAX_STEPS, FixedSteps
from cnnum.integrators.tableau import TABLEAUX
from cnnum.runs.request import Request
from cnnum.runs.result import Result
from cnnum.templating.reads import jumps, turning_points
from cnnum.templating.template import Template

MAPS = ("output", "state")
PARTS = (*MAPS, "time", "steps", "settled")

MOST_HALVINGS = 10
"""Steps are no shorter than this power of a half of the first."""

SAFETY = 4.0
"""Of an error that is known from differences: corners of an output make these irregular."""

GOAL = 0.5
"""Part of the tolerance at which such an error is taken for small enough."""

LEAST_FALL = 2.0
"""Taken for r where a difference falls by less, as roundings and chaos do, or is the first."""

PATIENCE = 2
"""Halvings in a row which lessen the error of no frame that goes on: it has its best run. Steps
that are long against a growth do so, too, and do not count."""

RESOLVED = 0.1
"""Part of the time of a growth by e in which a step is not long against it."""

MOST_KEPT = 2**26
"""Numbers of a frame that the steps of a delay keep, half a gigabyte in double precision."""

REASON = "halved until two runs agree within the tolerance"

Run = Callable[[float, NDArray[np.intp]], Result]
"""Runs some of a batch's frames in steps of that length; results have one axis of frames."""


def by_halving(template: Template, *, dt: float | None, settle: bool) -> bool:
    """Return whether a run's steps follow its tolerance by halving: a delay, and no step given.

    Parameters
    ----------
    template : Template
    dt : float or None
        That was asked for.
    settle : bool
        It ends where rates are small, which steps of any length find.
    """
    return template.delayed is not None and dt is None and not settle and not jumps(template)


def halves(request: Request) -> bool:
    """Return whether a run's steps are halved until they keep its tolerance."""
    if request.template.delayed is None or request.engine.whole:
        return False
    known = by_halving(request.ran, dt=request.spec.dt, settle=request.settles)
    taken = request.engine.record.takes_steps
    return known and taken and isinstance(request.solver.scheme, FixedSteps)


def in_halves(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run with a delay to its tolerance."""
    template, solver, spec = request.ran, request.solver, request.spec
    assert isinstance(solver.scheme, FixedSteps)

    def finer(step: float, frames: NDArray[np.intp]) -> Result:
        return down(request.by(replace(spec, dt=step), request.frames(frames)))

    found = halved(
        down(request),
        finer,
        delay_of(template),
        (spec.rtol, spec.atol),
        request.engine.precision,
        solver.scheme.step,
        growth=delayed_growth(template),
        turns=bool(turning_points(template, solver.duration)),
    )
    return unknown(found) if lets_go(template, solver.duration) else found


def lets_go(template: Template, duration: float) -> bool:
    """Return whether a limited state may leave its limit within a step, as a gain jumps there."""
    sudden = any(gain.table.interpolation == "constant" for gain in template.gains)
    return sudden and template.output.limited and bool(turning_points(template, duration))


def unknown(result: Result) -> Result:
    """Return a result of whose error nothing is known."""
    return replace(result, error=np.full_like(result.error, np.inf))


def delay_of(template: Template) -> float:
    """Return the delay of a template that has one."""
    assert template.delayed is not None
    return template.delayed.delay


def halved(
    first: Result,
    run: Run,
    delay: float,
    tolerances: tuple[float, float],
    precision: str,
    step: float | None = None,
    growth: float = 0.0,
    *,
    turns: bool = False,
) -> Result:
    """Return a run whose frames are within the tolerance, each in steps as long as it may have.

    Parameters
    ----------
    first : Result
        In the longest steps.
    run : callable
        Runs frames in shorter ones.
    delay : float
    tolerances : (rtol, atol)
    precision : str
        Precision of the engine.
    step : float, optional
        Step of the first run; it is its time over its steps unless given.
    growth : float
        Bound on how fast states grow, 1/time.
    turns : bool
        Whether a gain in time jumps or bends on the way.

    Returns
    -------
    Result
        Errors are those of the best run of each frame. They may be above the tolerance where
        roundings grow. They may be, too, where steps would be more than `MAX_STEPS` or keep too
        many outputs.
    """
    count = int(first.steps.max(initial=0))
    if not count:
        return replace(first, error=np.zeros_like(first.error))
    if step is None:
        step = float(np.max(first.time)) / count
    order = TABLEAUX[first.method].order
    found = _Frames(first, tolerances, 2.0**order, float(np.finfo(precision).eps), turns=turns)
    waiting = np.arange(found.count)
    room = min(MAX_STEPS / count, MOST_KEPT / (delay / step * found.states))
    for _ in range(min(MOST_HALVINGS, int(np.log2(max(room, 1.0))))):
        step *= 0.5
        try:
            resolved = step * growth <= RESOLVED
            waiting = found.take(waiting, run(step, waiting), resolved=resolved)
        except SizeError:  # the outputs that steps keep fill the memory: the error says the rest
            break
        if not len(waiting):
            break
    return found.result(f"{first.reason}; {REASON}")


def by_differences(
    found: Sequence[Result],
    tolerances: tuple[float, float],
    precision: str,
    *,
    turns: bool = False,
) -> Result:
    """Return the last of runs at times, each in steps of half the length of the one before.

    Its errors are known from the differences of all three.
    """
    coarse, middle, fine = found
    axes = tuple(range(np.ndim(fine.time), fine.state.ndim))
    before = np.abs(middle.state - coarse.state).max(axis=axes, initial=0.0)
    off = np.abs(fine.state - middle.state).max(axis=axes, initial=0.0)
    most = 2.0 ** TABLEAUX[fine.method].order
    off = np.maximum(off, before / most)
    with np.errstate(divide="ignore", invalid="ignore"):
        fell = np.where(off > 0.0, before / off, most)
    share = 1.0 / (np.clip(fell, LEAST_FALL, LEAST_FALL if turns else most) - 1.0)
    size = np.abs(fine.state).max(axis=axes, initial=0.0)
    rounding = float(np.finfo(precision).eps) * fine.steps * size
    least = GOAL * (tolerances[1] + tolerances[0] * size)
    return replace(fine, error=np.maximum(SAFETY * share * off + rounding, least))


class _Frames:
    """The frames of a batch in one row, each by its best run."""

    def __init__(
        self,
        first: Result,
        tolerances: tuple[float, float],
        most: float,
        eps: float,
        *,
        turns: bool,
    ) -> None:
        self._first, self._most, self._eps, self._turns = first, most, eps, turns
        self._rtol, self._atol = tolerances
        self._inner = first.state.ndim - first.settled.ndim
        self.count = max(first.settled.size, 1)
        self._found = {name: self._flat(first, name) for name in PARTS}
        self._last = np.array(self._found["state"], dtype=np.float64)
        self._differed = np.full(self.count, np.inf)
        self._error = np.full(self.count, np.inf)
        self._failed = np.zeros(self.count, dtype=int)
        self.states = self._last[0].size

    def _flat(self, result: Result, name: str) -> NDArray[np.generic]:
        value = np.array(getattr(result, name))
        inner = value.shape[value.ndim - self._inner :] if name in MAPS else ()
        return value.reshape(self.count, *inner)

    def take(self, frames: NDArray[np.intp], finer: Result, *, resolved: bool) -> NDArray[np.intp]:
        """Take frames' states from a run in steps of half the length; return those that go on.

        Where steps do not resolve a growth, errors that do not fall say nothing.
        """
        state = np.asarray(finer.state, dtype=np.float64)
        axes, size = tuple(range(1, state.ndim)), np.abs(state)
        off = np.abs(state - self._last[frames])
        far = np.max(off / (self._atol + self._rtol * size), axis=axes, initial=0.0)
        largest = off.max(axis=axes, initial=0.0)
        before = self._differed[frames] / self._most
        largest = np.where(np.isfinite(before), np.maximum(largest, before), largest)
        share = self._share(largest, frames)
        # the roundings of steps add up like those of a walk at random
        rounding = self._eps * np.sqrt(finer.steps) * size.max(axis=axes, initial=0.0)
        error = SAFETY * share * largest + rounding
        better = error < self._error[frames]
        for name in PARTS:
            self._found[name][frames[better]] = getattr(finer, name)[better]
        self._error[frames[better]] = error[better]
        self._failed[frames] = np.where(better, 0, self._failed[frames] + resolved)
        self._last[frames], self._differed[frames] = state, largest
        on: NDArray[np.bool_] = (share * far > GOAL) & (self._failed[frames] < PATIENCE)
        return np.asarray(frames[on], dtype=np.intp)

    def _share(self, largest: Floats, frames: NDArray[np.intp]) -> Floats:
        """Return the errors as shares of the differences."""
        before = self._differed[frames]
        with np.errstate(divide="ignore", invalid="ignore"):
            fell = np.where(np.isfinite(before), before / largest, LEAST_FALL)
        most = LEAST_FALL if self._turns else self._most
        return np.asarray(1.0 / (np.clip(fell, LEAST_FALL, most) - 1.0), dtype=np.float64)

    def result(self, reason: str) -> Result:
        """Return the result of all frames."""
        first, error = self._first, np.where(self._error < LOST, self._error, np.inf)
        sizes = np.abs(self._found["state"]).reshape(self.count, -1).max(axis=1, initial=0.0)
        # two runs may agree by chance, as where neither meets a corner
        error = np.maximum(error, GOAL * (self._atol + self._rtol * sizes))
        # where a state hardly moves in a step, the roundings of all steps have the same sign
        steps = np.asarray(self._found["steps"], dtype=np.float64)
        error = error + self._eps * steps * sizes
        shaped: dict[str, Any] = {
            name: value.reshape(np.shape(getattr(first, name)))
            for name, value in {**self._found, "error": error}.items()
        }
        return replace(first, **shaped, reason=reason)
