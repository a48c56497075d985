"""One run of a plan: its outputs from checked maps, and the result in them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, number_type
from cnnum.integrators.estimate import LOST
from cnnum.plan import Plan
from cnnum.runs.arguments import as_frame, has_many_cells
from cnnum.runs.delays import halves
from cnnum.runs.prepared import keep
from cnnum.runs.request import Request
from cnnum.runs.result import Result, result_of, with_fallback
from cnnum.runs.stiff import refuse_hopeless

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
