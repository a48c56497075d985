"""One run of a plan on checked maps, by implicit steps where explicit ones are too many."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, number_type
from cnnum.engines.backend import EngineRecord
from cnnum.engines.failures import refuse_unfinished
from cnnum.errors import MethodError
from cnnum.integrators.estimate import LOST
from cnnum.integrators.rosenbrock import MOST_STATES, RODAS3, may_be_implicit
from cnnum.integrators.schemes import MAX_STEPS, AdaptiveSteps, ChebyshevSteps
from cnnum.integrators.solver import Solver
from cnnum.plan import Plan
from cnnum.runs.arguments import as_frame, has_many_cells
from cnnum.runs.delays import halves
from cnnum.runs.prepared import keep
from cnnum.runs.request import Request
from cnnum.runs.result import Result, result_of, with_fallback

SOONEST = 0.1
"""Part of a time constant before which no run comes to a rest that it does not start from."""

REASON = f"explicit steps would be more than {MAX_STEPS:,}; implicit ones, on the host in float64"


def may_be_stiff(request: Request) -> bool:
    """Return whether implicit steps are tried where explicit ones do not reach the end of a run.

    They are not where a method or a step was asked for, or the array is large. Engines that solve
    finely have their own.
    """
    spec, engine = request.spec, request.engine
    if spec.method != "auto" or spec.dt is not None or engine.whole:
        return False
    states = request.template.layers * request.shape[0] * request.shape[1]
    return engine.record.takes_steps and states <= MOST_STATES


def by_implicit_steps(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run by implicit steps where explicit ones do not reach its end."""
    try:
        return down(request)
    except MethodError:
        if not may_be_implicit(request.template):
            raise
        result = down(request.by(replace(request.spec, method=RODAS3.name)))
        return replace(result, reason=REASON)


def refuse_hopeless(engine: EngineRecord, solver: Solver, tau: float) -> None:
    """Raise as a run would whose steps are too short to reach its end, and so not begin it.

    Engines that solve finely take them only where they were asked for.

    Parameters
    ----------
    engine : EngineRecord
    solver : Solver
    tau : float
        The shortest time constant.

    Raises
    ------
    MethodError
        If so.
    """
    scheme = solver.scheme
    taken = solver.asked or engine.takes_steps
    if taken and isinstance(scheme, AdaptiveSteps | ChebyshevSteps):
        # up to a rest cells need their own time, whatever the others do
        end = min(SOONEST * tau, solver.duration) if solver.settle else solver.duration
        refuse_unfinished(np.array([end > MAX_STEPS * scheme.control.longest]))


NEVER_SATURATES = "no cell leaves the linear range"


def outputs_of(
    plan: Plan, given: dict[str, NDArray[np.floating]], lead: tuple[int, ...]
) -> dict[str, Floats]:
    """Run a plan on checked maps by role; errors are those of a call of the plan."""
    if has_many_cells(plan.schedule.shape):
        outputs = plan.run_large(list(given.values()), lead)
        if outputs is not None:
            return outputs
    return plan.run_finite(as_frame(given, lead, np.dtype(number_type(plan.precision))))


def plainly(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run by its plan, and keep it ready where others may differ in numbers alone."""
    plan, solver, template = request.plan, request.solver, request.ran
    refuse_hopeless(request.engine.record, solver, float(template.tau.min()))
    outputs = outputs_of(plan, request.given, request.lead)
    if solver.forced:  # nothing is known of its end
        outputs |= {
            "settled": np.zeros_like(outputs["settled"]),
            "error": np.full_like(outputs["error"], LOST),
        }
    result = result_of(outputs, template.layers, solver.method, solver.reason)
    result = with_fallback(result, plan)
    if request.form is not None and not halves(request):
        keep(request)
    return result


def linearly(request: Request, down: Callable[[Request], Result]) -> Result:
    """Run the linear array that a saturating one is as long as no cell leaves that range."""
    result = down(request)
    # rounding may lie beyond 1
    output = np.clip(result.output, -1.0, 1.0)
    return replace(result, output=output, reason=f"{NEVER_SATURATES}; {result.reason}")
