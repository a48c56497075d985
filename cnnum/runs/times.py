"""A transient at several times: one run, looked at on its way."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import finite, number_type
from cnnum.engines.backend import Looking
from cnnum.engines.registry import first_that, open_record
from cnnum.errors import ArrayError, MethodError
from cnnum.graph.nodes import Transient
from cnnum.integrators.estimate import LOST
from cnnum.integrators.exact_ends.choice_of_end import exact_end
from cnnum.integrators.rosenbrock import ImplicitSteps
from cnnum.integrators.solver import Exact, Solver
from cnnum.plan import Plan
from cnnum.runs.arguments import as_frame
from cnnum.runs.result import Result
from cnnum.templating.network import Network
from cnnum.templating.template import Duration

MOST = 10_000
"""Times of one run."""

Maps = Mapping[str, NDArray[np.floating]]


def checked_times(at: ArrayLike, duration: Duration | None = None) -> tuple[float, ...]:
    """Return times in the unit of τ, each after the one before.

    Raises
    ------
    MethodError
        If they are not, or there are none; or if there is a duration, too.
    """
    if duration is not None:
        raise MethodError("A run has a duration, or times 'at' which it is looked at: not both.")
    try:
        times = finite("at", at)
    except ArrayError as error:
        raise MethodError(str(error)) from None
    rising = times.ndim == 1 and times.size and times[0] >= 0.0 and (np.diff(times) > 0.0).all()
    if not rising or times.size > MOST:
        raise MethodError(
            f"'at' is a list of 1 to {MOST} times from 0 up, each after the one before, in the "
            f"unit of tau, got {np.array2string(times, threshold=8).rstrip('.')}."
        )
    return tuple(float(time) for time in times)


def looked_at(
    plan: Plan,
    given: Maps,
    lead: tuple[int, ...],
    times: Sequence[float],
    precision: str,
    cuts: int = 1,
) -> Result | None:
    """Return what a plan's run passes through at times before its end; None where it cannot say.

    Steps are those of the run itself: each time takes the part of a step up to it, so that state
    and error are those of a run which ends there. Where the engine cannot look, one of the host
    takes the same steps and does.

    Parameters
    ----------
    plan : Plan
        Of one transient.
    given : mapping of str to (..., maps, rows, cols) float
    lead : tuple of int
        Leading axes of the batch.
    times : sequence of float
        Rising, none after the end of the run.
    precision : str
        Of the engine.
    cuts : int
        Parts in which a piece of a step of fixed length is taken up to a time.
    """
    (solver,) = plan.solvers.values()
    if isinstance(solver.scheme, ImplicitSteps):
        return None
    backend = plan.backend
    if not backend.record.looks:
        backend = open_record(first_that(lambda record: record.looks), None, precision)
    executable = cast(Looking, backend.build(plan.schedule, plan.solvers))
    frames, _ = plan.read(as_frame(dict(given), lead, np.dtype(number_type(precision))))
    found = executable.look(frames, times, _ends_at(plan, solver, times), cuts)
    (transient,) = {n.operation for n in plan.schedule.transients}
    assert isinstance(transient, Transient)
    template = transient.template
    state = np.asarray(found["seen"], dtype=np.float64)
    marks, shape = found["marks"], (len(times), *lead)
    if not np.isfinite(state).all():
        raise ArrayError(
            f"The state of template '{template.name}' is not finite at one of the times: it grows "
            "beyond the numbers of the precision."
        )
    if template.layers == 1:
        state = state[:, :, 0]
    state = state.reshape(*shape, *state.shape[2:])
    error = marks[..., 2].reshape(shape)
    return Result(
        output=template.output.numpy(state),
        state=state,
        time=np.broadcast_to(np.reshape(times, (-1, *(1,) * len(lead))), shape).copy(),
        steps=marks[..., 0].reshape(shape).astype(np.int64),
        settled=marks[..., 1].reshape(shape) != 0.0,
        error=np.where(error < LOST, error, np.inf),
        method=solver.method,
        reason=solver.reason,
        times=tuple(times),
    )


def _ends_at(plan: Plan, solver: Solver, times: Sequence[float]) -> list[Exact]:
    """Return the schemes of a transient up to times, where ends are known without a step."""
    if not isinstance(solver.scheme, Exact):
        return []
    (node,) = plan.schedule.transients
    operation = node.operation
    assert isinstance(operation, Transient)
    network = Network(operation.template, plan.schedule.shape)
    ends = [exact_end(operation, network, time)[0] for time in times]
    return [end for end in ends if end is not None]


def ended(looks: Result, end: Result) -> Result:
    """Return the result at times on the way of a run and at its end, which comes last."""

    def both(name: str) -> np.ndarray:
        return np.concatenate([getattr(looks, name), np.asarray(getattr(end, name))[np.newaxis]])

    time = float(np.max(end.time))
    parts: dict[str, Any] = {
        name: both(name) for name in ("output", "state", "steps", "settled", "error")
    }
    last = np.full((1, *np.shape(end.time)), time)
    return Result(
        **parts,
        time=np.concatenate([looks.time, last]),
        method=end.method,
        reason=end.reason,
        times=(*looks.times, time),
    )


def stacked(results: Sequence[Result], times: Sequence[float]) -> Result:
    """Return results at several times as one, with the times along a new first axis."""

    def over(name: str) -> np.ndarray:
        return np.stack([np.asarray(getattr(result, name)) for result in results])

    lead = np.ndim(results[0].time)
    reached = np.array(times).reshape(-1, *(1,) * lead)
    methods = dict.fromkeys(result.method for result in results)
    return Result(
        output=over("output"),
        state=over("state"),
        time=np.broadcast_to(reached, over("time").shape).copy(),
        steps=over("steps"),
        settled=over("settled"),
        error=over("error"),
        method=", ".join(methods),
        reason=results[-1].reason,
        times=tuple(times),
    )
