"""A transient at several times: one run, looked at on its way."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite, number_type
from cnnum.engines.backend import Looking
from cnnum.engines.registry import first_that, open_record
from cnnum.errors import ArrayError, MethodError
from cnnum.graph.nodes import RunSpec, Transient
from cnnum.integrators.choice import exact_end
from cnnum.integrators.estimate import LOST, ROUNDINGS
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS, ImplicitSteps
from cnnum.integrators.series import Stretch, in_stretches
from cnnum.integrators.solver import Exact, Solver, Stepping
from cnnum.plan import Plan
from cnnum.runs.growth import (
    LATELY,
    arrived,
    by_differences,
    by_halving,
    compared,
    delay_of,
    follows,
    jumped,
)
from cnnum.runs.request import Ask, Request, as_frame, maps_by_role
from cnnum.runs.result import ROLES, Result
from cnnum.runs.symmetry import breaks, with_broken
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.network import Network, turning_points
from cnnum.templating.template import Duration, Template

MOST = 10_000
"""Times of one run."""

ALMOST = 1e-9
"""Share of a step by which a time may exceed a whole number of steps and still count as it."""

OF_TIMES = ("output", "state", "time", "steps", "settled", "error")
"""Attributes of a result with an axis of times."""

Maps = Mapping[str, NDArray[np.floating]]


def checked_times(at: ArrayLike, duration: Duration | None = None) -> tuple[float, ...]:
    """Return times in the unit of τ, each after the one before.

    Raises
    ------
    MethodError
        If they are not, or there are none; or if there is a duration, too.
    """
    if duration is not None:
        raise MethodError("A run takes a duration or times 'at', not both.")
    try:
        times = finite("at", at)
    except ArrayError as error:
        raise MethodError(str(error)) from None
    rising = times.ndim == 1 and times.size and times[0] >= 0.0 and (np.diff(times) > 0.0).all()
    if not rising or times.size > MOST:
        raise MethodError(
            f"'at' must be 1 to {MOST} increasing times from 0 on, in the unit of tau, got "
            f"{np.array2string(times, threshold=8).rstrip('.')}."
        )
    return tuple(float(time) for time in times)


def at_times(ask: Ask, down: Callable[[Ask], Result]) -> Result:
    """Return the results of a run at times on its way and at its end."""
    times = checked_times(cast(ArrayLike, ask.at), ask.options[0])
    own = ask.template
    template = own.template if isinstance(own, TemplateBatch) else own
    end = down(ask.until(times[-1]))
    looks = None
    if len(times) > 1 and not ask.engine.whole:
        maps: dict[str, ArrayLike | None] = dict(zip(ROLES, ask.arrays, strict=True))
        given, shape = maps_by_role(ask.template, maps)
        spec = ask.until(times[-1]).spec
        request = Request(ask.engine, ask.template, given, shape, spec)
        looks = _looks(request, times[:-1], end)
        if looks is not None and breaks(request):
            looks = with_broken(looks, request)
    if looks is None:
        ends = [*(down(ask.until(time)) for time in times[:-1]), end]
        return stacked(template, ends, times)
    return ended(template, looks, end, times)


def _looks(request: Request, times: tuple[float, ...], end: Result) -> Result | None:
    """Return the states of a run at given times, or None if each needs a separate run."""
    if end.method in IMPLICIT_METHODS:
        request = request.by(replace(request.spec, method=end.method))
    engine, solver, ran, spec = request.engine, request.solver, request.ran, request.spec
    steps = isinstance(solver.scheme, Stepping)
    if steps and end.method != solver.method:
        return None
    if _finely(request.plan):
        return looked_at(request.plan, request.given, request.lead, times)
    if steps and by_halving(ran, dt=spec.dt, settle=False):
        return _halved_looks(request, times, end)
    looks = looked_at(request.plan, request.given, request.lead, times)
    if not follows(request):
        return looks

    def again(finer: RunSpec, frames: NDArray[np.intp]) -> Result:
        own = Request(engine, ran, request.frames(frames), request.shape, finer)
        plan = engine.plan_for(ran, request.shape, own.names, finer)
        return looked_at(plan, own.given, own.lead, times)

    return compared(looks, ran, solver, request.given, spec, again)


def _halved_looks(request: Request, times: tuple[float, ...], end: Result) -> Result:
    """Return the looks at a run with a delay: in the steps of its end, twice and four times."""
    template, spec, precision = request.ran, request.spec, request.engine.precision
    step = float(np.max(end.time)) / max(int(np.max(end.steps)), 1)
    delay = delay_of(template)
    parts = 4 * max(1, math.ceil(delay / step / 4.0 - 1e-9)) if step else 4
    limited, results = template.output.limited, list[Result]()
    lately = [LATELY * time for time in times] if limited else []
    every = sorted({*times, *lately})
    for coarser in (4, 2, 1):
        run = request.by(replace(spec, dt=coarser * delay / parts, method=end.method))
        # before the first step ends, runs would be the same one but for these
        results.append(looked_at(run.plan, run.given, run.lead, every, cuts=4 // coarser))
    turns = bool(turning_points(template, times[-1]))
    looks = by_differences(results, (spec.rtol, spec.atol), precision, turns=turns)
    looks = jumped(looks, template, times[-1])
    if not limited:
        return looks
    earlier, places = looks.state[np.searchsorted(every, lately)], np.searchsorted(every, times)
    own: dict[str, Any] = {name: getattr(looks, name)[places] for name in OF_TIMES}
    return arrived(replace(looks, **own, times=times), earlier)


def _finely(plan: Plan) -> bool:
    """Return whether an engine that takes no chosen steps solves a run its own way."""
    (solver,), (node,) = plan.solvers.values(), plan.schedule.transients
    assert isinstance(node.operation, Transient)
    taken = plan.backend.record.takes_steps or solver.asked
    return not (taken or node.operation.template.output.discrete)


def looked_at(
    plan: Plan,
    given: Maps,
    lead: tuple[int, ...],
    times: Sequence[float],
    cuts: int = 1,
) -> Result:
    """Return what a plan's run passes through at times before its end.

    Steps are those of the run itself: each time takes the part of a step up to it, so that state
    and error are those of a run which ends there. Where the engine cannot look, one of the host
    takes the same steps and does.

    Parameters
    ----------
    plan : Plan
        Plan of one transient.
    given : mapping of str to (..., maps, rows, cols) float
    lead : tuple of int
        Leading axes of the batch.
    times : sequence of float
        Rising, none after the end of the run.
    cuts : int
        Parts in which a piece of a step of fixed length is taken up to a time.
    """
    (solver,) = plan.solvers.values()
    backend, precision = plan.backend, plan.precision
    implicit = isinstance(solver.scheme, ImplicitSteps)
    if not (backend.record.looks or implicit or _finely(plan)):
        backend = open_record(first_that(lambda record: record.looks), None, precision)
    executable = cast(Looking, backend.build(plan.schedule, plan.solvers))
    frames, _ = plan.read(as_frame(dict(given), lead, np.dtype(number_type(precision))))
    ends = [] if _finely(plan) else _ends_at(plan, solver, times)
    findings = executable.look(frames, times, ends, cuts)
    (transient,) = {n.operation for n in plan.schedule.transients}
    assert isinstance(transient, Transient)
    template = transient.template
    state = np.asarray(findings["seen"], dtype=np.float64)
    marks, shape = findings["marks"], (len(times), *lead)
    if not np.isfinite(state).all():
        raise ArrayError(
            f"The state of template '{template.name}' is not finite at one of the times: it "
            "exceeds the range of the precision."
        )
    if template.layers == 1:
        state = state[:, :, 0]
    state = state.reshape(*shape, *state.shape[2:])
    error = marks[..., 2].reshape(shape)
    if isinstance(solver.scheme, Stepping):  # before the first step, the start is rounded
        sizes = np.abs(state).max(axis=tuple(range(len(shape), state.ndim)), initial=0.0)
        error = np.maximum(error, ROUNDINGS * np.finfo(precision).eps * sizes)
    return Result(
        output=template.output.numpy(state),
        state=state,
        time=reached(template, times, lead),
        steps=marks[..., 0].reshape(shape).astype(np.int64),
        settled=marks[..., 1].reshape(shape) != 0.0,
        error=np.where(error < LOST, error, np.inf),
        method=solver.method,
        reason=solver.reason,
        times=tuple(times),
    )


def reached(template: Template, times: Sequence[float], lead: tuple[int, ...]) -> Floats:
    """Return the time that runs to each of some times reach: in discrete time, whole steps."""
    result = np.reshape(np.asarray(times, dtype=np.float64), (-1, *(1,) * len(lead)))
    if template.output.discrete:
        result = np.ceil(result - ALMOST) + 0.0  # no −0
    return np.broadcast_to(result, (len(times), *lead)).copy()


def _ends_at(plan: Plan, solver: Solver, times: Sequence[float]) -> list[Stretch]:
    """Return the intervals that contain times, if ends are known in closed form."""
    if not isinstance(solver.scheme, Exact):
        return []
    (node,) = plan.schedule.transients
    operation = node.operation
    assert isinstance(operation, Transient)
    network = Network(operation.template, plan.schedule.shape)
    stretches: list[Stretch] = []
    for first, *others in in_stretches(operation.template, times):
        scheme, _ = exact_end(operation, network, first)
        assert scheme is not None  # as there is one up to the end
        stretches.append(Stretch(scheme, tuple(time - first for time in others)))
    return stretches


def ended(template: Template, looks: Result, end: Result, times: Sequence[float]) -> Result:
    """Return the result at times on the way of a run and at its end, which comes last."""

    def both(name: str) -> np.ndarray:
        return np.concatenate([getattr(looks, name), np.asarray(getattr(end, name))[np.newaxis]])

    parts: dict[str, Any] = {
        name: both(name) for name in ("output", "state", "steps", "settled", "error")
    }
    time = reached(template, times, np.shape(end.time))
    return Result(**parts, time=time, method=end.method, reason=end.reason, times=tuple(times))


def stacked(template: Template, results: Sequence[Result], times: Sequence[float]) -> Result:
    """Return results at several times as one, with the times along a new first axis."""

    def over(name: str) -> np.ndarray:
        return np.stack([np.asarray(getattr(result, name)) for result in results])

    methods = dict.fromkeys(result.method for result in results)
    return Result(
        output=over("output"),
        state=over("state"),
        time=reached(template, times, np.shape(results[0].time)),
        steps=over("steps"),
        settled=over("settled"),
        error=over("error"),
        method=", ".join(methods),
        reason=results[-1].reason,
        times=tuple(times),
    )
