"""Finer runs that say how far off a run is: where steps do not show growth, and with delays.

Runs with a delay to a tolerance: steps are halved until two runs agree.

A delay is a whole number of steps. So no step has a length of its own, and none has an error
estimate. Heun's method is of order 2, also where an output has a corner: a step that jumps over it
is off by O(h²). The second of two runs, in steps of half the length, is off by d / (r − 1). Here d
is their difference, and r by how much that fell since the two runs before. This is Richardson's way
(Hairer, Nørsett & Wanner, Solving ODEs I, section II.4). Four times d / (r − 1) is stated, and half
the tolerance asked of it. A difference that fell by more than the order says did so by chance, and
counts as one that did not.

A gain in time may have jumps or kinks within steps, over which it is averaged. A jump after a share
θ of a step is off by θ(1 − θ) times a number that its neighbours share, which is no more than d; r
says nothing then, and is taken for 2. A cell of a limited state may leave its limit at such a jump,
and a step by a mean holds it there up to its end. Steps of half the length may end at the same
time, so that differences do not show it: the error is infinite there.

Runs whose steps do not show their error, or its growth: a finer run says how far off they are.

An error that is followed grows as the rates do. Where all of an array is small at first, its rates
may show the growth late: the part of the state that grows fastest is hidden behind others. And
steps that are within the tolerance of a large state may be long for a small one, so that they
grow it by too little. Gains in time move the rates by themselves, and couplings by tables have
slopes of their own. And what a step's rates show is the error of a linear array: where the output
is curved, as tanh is, it may vanish by chance while the step is as far off as its tolerance allows.
An array may also shrink before it grows: while its rates fall, errors rise unseen in the part that
grows later.
In these cases the first run is compared with one whose tolerances are a tenth, and
relative to the start, and whose order is no less than 5. The true error is below the distance of
the two and the error of the second.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import MethodError, SizeError
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.estimate import FLOOR, LOST, delayed_growth, error_growth
from cnnum.integrators.schemes import (
    MAX_STEPS,
    AdaptiveSteps,
    ChebyshevSteps,
    FixedSteps,
)
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import BOGACKI_SHAMPINE, DORMAND_PRINCE, TABLEAUX
from cnnum.runs.request import Request
from cnnum.runs.result import Result
from cnnum.templating.functions import PairFunction
from cnnum.templating.network import jumps, turning_points
from cnnum.templating.template import Template

MAPS = ("output", "state")
PARTS = (*MAPS, "time", "steps", "settled")

MOST_HALVINGS = 10
"""Steps are no shorter than this power of a half of the first."""

DELAY_SAFETY = 4.0
"""Safety factor of an error estimated from differences, which kinks of an output disturb."""

GOAL = 0.5
"""Fraction of the tolerance at which such an error counts as small enough."""

LEAST_FALL = 2.0
"""Taken for r where a difference falls by less, as roundings and chaos do, or is the first."""

PATIENCE = 2
"""Halvings in a row which lessen the error of no frame that goes on: it has its best run. Steps
that are long against a growth do so, too, and do not count."""

RESOLVED = 0.1
"""Part of the time of a growth by e in which a step is not long against it."""

LONGEST = 2.0
"""Part of the time of a growth by e beyond which a step jumps over what a limited state does at its
limit: any number of such steps may end there, and agree."""

LATELY = 0.75
"""Part of a run after which a limited cell that comes to its limit has come there lately."""

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
        Requested step, if any.
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

    result = halved(
        down(request),
        finer,
        delay_of(template),
        (spec.rtol, spec.atol),
        request.engine.precision,
        solver.scheme.step,
        growth=delayed_growth(template),
        turns=bool(turning_points(template, solver.duration)),
    )
    result = jumped(result, template, solver.duration)
    if not (template.output.limited and np.isfinite(result.error).any()):
        return result
    if not _near_limits(result).any():
        return result
    delay = delay_of(template)
    step = delay / max(1, round(delay * int(result.steps.max()) / solver.duration))
    earlier = replace(spec, dt=step, duration=LATELY * solver.duration)
    return arrived(result, down(request.by(earlier)).state)


def jumped(result: Result, template: Template, duration: float) -> Result:
    """Return a run with a delay without its error where steps may jump over the end of a limit."""
    if lets_go(template, duration):
        return unknown(result)
    if not template.output.limited:
        return result
    step = np.asarray(result.time) / np.maximum(result.steps, 1)
    long = step * delayed_growth(template) > LONGEST
    return replace(result, error=np.where(long, np.inf, result.error))


def arrived(result: Result, earlier: Floats) -> Result:
    """Return a run with a delay without its error where a limited cell has come to its limit.

    Runs that come there too early agree: how long before the state itself, no difference shows. And
    if the coarser one is there, and the other is not yet, they differ by too little.

    Parameters
    ----------
    result : Result
    earlier : (..., rows, cols) float
        The states since which no cell may have come to its limit.
    """
    came = _near_limits(result) & (result.state != earlier)
    inner = tuple(range(np.ndim(result.time), result.state.ndim))
    return replace(result, error=np.where(came.any(axis=inner), np.inf, result.error))


def _near_limits(result: Result) -> NDArray[np.bool_]:
    """Return the cells that are no further from a limit than the error."""
    inner = tuple(range(np.ndim(result.time), result.state.ndim))
    near: NDArray[np.bool_] = np.abs(result.state) + np.expand_dims(result.error, inner) >= 1.0
    return near


def lets_go(template: Template, duration: float) -> bool:
    """Return whether a limited state may leave its limit within a step, as a gain jumps there."""
    sudden = any(gain.table.interpolation == "constant" for gain in template.gains)
    return sudden and template.output.limited and bool(turning_points(template, duration))


def unknown(result: Result) -> Result:
    """Return a result with unknown error."""
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
        Result with the longest steps.
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
        Whether a gain in time has jumps or kinks during the run.

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
    result = _Frames(first, tolerances, 2.0**order, float(np.finfo(precision).eps), turns=turns)
    waiting = np.arange(result.count)
    room = min(MAX_STEPS / count, MOST_KEPT / (delay / step * result.states))
    for _ in range(min(MOST_HALVINGS, int(np.log2(max(room, 1.0))))):
        step *= 0.5
        try:
            resolved = step * growth <= RESOLVED
            waiting = result.take(waiting, run(step, waiting), resolved=resolved)
        except SizeError:  # the outputs that steps keep fill the memory: the error says the rest
            break
        if not len(waiting):
            break
    return result.result(f"{first.reason}; {REASON}")


def by_differences(
    results: Sequence[Result],
    tolerances: tuple[float, float],
    precision: str,
    *,
    turns: bool = False,
) -> Result:
    """Return the last of runs at times, each in steps of half the length of the one before.

    Its errors are known from the differences of all three.
    """
    coarse, middle, fine = results
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
    return replace(fine, error=np.maximum(DELAY_SAFETY * share * off + rounding, least))


class _Frames:
    """The frames of a batch, each with its best run."""

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
        error = DELAY_SAFETY * share * largest + rounding
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


FAR = 3.0
"""States that grow by more than this are compared with a finer run: those of pictures grow to twice
of what they begin with."""

AMPLIFIED = 100.0
"""An error of more tolerances than this has grown on the way, perhaps where the rates showed less
of it. One that is larger than the state says nothing, and another run would not change that."""

FINER = 0.1
"""Share of the tolerances in those of the finer run."""

SAFETY = 1.5
"""Safety factor on the difference of two runs."""

SMALLEST = 1e-30
"""Smallest tolerance: devices flush numbers that are not much smaller."""

Maps = Mapping[str, NDArray[np.floating]]
Again = Callable[[RunSpec, NDArray[np.intp]], Result]
"""Runs some of a batch's frames otherwise; results have one axis of frames, the last of `time`."""


def may_grow(template: Template, solver: Solver) -> bool:
    """Return whether a run is one whose followed error may miss something."""
    scheme = solver.scheme
    if solver.settle or not isinstance(scheme, AdaptiveSteps | ChebyshevSteps):
        return False
    return error_growth(template) > 0.0 or hides_errors(template, solver)


def hides_errors(template: Template, solver: Solver) -> bool:
    """Return whether every run takes another one to say how far off it is.

    Steps of a fixed length may be long against a growth: their stages see too little of it. And one
    that jumps over a corner of the output is off by more than its order says, as is its estimate.
    """
    straight = template.output.linear
    if _even(solver):
        straight = straight and error_growth(template) <= 0.0
    else:
        straight = straight or template.output.name in ("standard", "full-range")
    moving = any(not coupling.static for coupling in template.nonlinear)
    return not straight or bool(template.gains) or moving


def follows(request: Request) -> bool:
    """Return whether the engine takes the chosen steps, whose error may miss a growth."""
    if request.engine.whole or request.settles:
        return False
    solver = request.solver
    steps = solver.asked or request.engine.record.takes_steps
    return steps and may_grow(request.ran, solver)


def followed(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run whose error holds where its state has grown far, too."""
    result = down(request)
    if result.method != request.solver.method:  # implicit steps, whose error misses none
        return result

    def again(finer: RunSpec, frames: NDArray[np.intp]) -> Result:
        return down(request.by(finer, request.frames(frames)))

    return compared(result, request.ran, request.solver, request.given, request.spec, again)


def looks_again(
    solver: Solver, begun: Floats | float, ended: Floats | float, error: Floats | float
) -> NDArray[np.bool_]:
    """Return whether a run's own error is not enough, by its sizes at the start and at the end."""
    tolerance = solver.atol + solver.rtol * np.asarray(ended)
    amplified = (error > AMPLIFIED * tolerance) & (error < FAR * np.asarray(ended))
    return np.asarray((np.asarray(ended) > FAR * begun) | amplified)


def _even(solver: Solver) -> bool:
    """Return whether steps are of one length, whatever their error."""
    return isinstance(solver.scheme, AdaptiveSteps) and not any(solver.scheme.tableau.error)


def scale(template: Template, sizes: Mapping[str, Floats]) -> Floats:
    """Return a bound on the size of all that a run begins with: start, drive and rims.

    Parameters
    ----------
    template : Template
    sizes : mapping of str to (..., maps) float
        The largest number in each map of the run, by role.
    """
    output, A = template.output, np.abs(template.A).sum(axis=(2, 3))
    total: Floats = np.asarray(np.abs(template.z), dtype=np.float64)
    rim = template.boundary.constant or 0.0
    still = abs(float(output.numpy(np.asarray(0.0)))) + abs(float(output.numpy(np.asarray(rim))))
    total = total + A.sum(axis=1) * still
    for coupling in template.nonlinear:
        none = np.zeros(1)
        value = abs(float(coupling.value(none, none)[0]))
        if not isinstance(coupling.function, PairFunction):
            value += coupling.function.steepest * abs(rim)
        total[coupling.to] += value * float(np.abs(coupling.weights).sum())
    if "input" in sizes and template.inputs:
        edge = abs(template.input_boundary.constant or 0.0)
        seen = np.maximum(sizes["input"], edge)
        total = total + seen @ np.abs(template.B).sum(axis=(2, 3)).T
    if "bias" in sizes:
        total = total + sizes["bias"]
    if "state" in sizes:
        total = total + sizes["state"]
    elif template.initial == "input":
        total = total + sizes["input"]
    else:
        total = total + abs(float(template.initial))
    return np.asarray(total.max(axis=-1), dtype=np.float64)


def compared(
    result: Result, template: Template, solver: Solver, given: Maps, spec: RunSpec, again: Again
) -> Result:
    """Return a result whose errors hold where its own steps do not show them, too.

    Parameters
    ----------
    result : Result
        Result of a batch, perhaps at several times.
    template : Template
    solver : Solver
        Solver that took its steps.
    given : mapping of str to (..., maps, rows, cols) float
        The maps of its frames.
    spec : RunSpec
        Specification of the run.
    again : callable
    """
    lead = np.shape(result.time)
    inner = tuple(range(len(lead), result.state.ndim))
    sizes = {role: np.abs(maps).max(axis=(-2, -1)) for role, maps in given.items()}
    begun = np.broadcast_to(scale(template, sizes), lead)
    ended = np.abs(result.state).max(axis=inner, initial=0.0)
    again_by_size = looks_again(solver, begun, ended, np.asarray(result.error, dtype=np.float64))
    grew = (again_by_size | hides_errors(template, solver)) & np.isfinite(result.error)
    times = len(result.times) if result.times else 1
    frames = np.flatnonzero(grew.reshape(times, -1).any(axis=0))
    if not len(frames):
        return result
    smallest = float(begun.reshape(times, -1)[0, frames].min())
    state = np.asarray(result.state, dtype=np.float64).reshape(times, -1, *_inner(result))
    error = np.array(result.error, dtype=np.float64).reshape(times, -1)
    try:
        finer = again(_finer(spec, smallest, solver), frames)
    except MethodError:  # it would take too many steps
        error[:, frames] = math.inf
    else:
        apart = finer.state.reshape(times, len(frames), *_inner(result)) - state[:, frames]
        off = np.abs(apart).reshape(times, len(frames), -1).max(axis=2)
        errors = SAFETY * off + np.asarray(finer.error).reshape(times, -1)
        # both may miss a corner, as any run by steps does
        taken = np.asarray(finer.steps).reshape(times, -1) > 0
        error[:, frames] = np.maximum(errors, np.where(taken, FLOOR * spec.atol, 0.0))
    return replace(result, error=error.reshape(lead))


def _inner(result: Result) -> tuple[int, ...]:
    return result.state.shape[np.ndim(result.time) :]


def _finer(spec: RunSpec, begun: float, solver: Solver) -> RunSpec:
    """Return a finer run: its tolerances are powers of 10, so that few plans are made of them.

    Where stability sets the steps, a finer run of the same method takes the same ones, and agrees.
    """
    atol = FINER * min(spec.atol, max(spec.rtol, spec.atol) * begun)
    exponent = math.floor(math.log10(max(atol, SMALLEST)))
    coarse = solver.method == BOGACKI_SHAMPINE.name or _even(solver)
    method = DORMAND_PRINCE.name if coarse else spec.method
    return replace(
        spec, method=method, dt=None, estimate=False, rtol=FINER * spec.rtol, atol=10.0**exponent
    )
