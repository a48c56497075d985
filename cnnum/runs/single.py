"""One run of a plan: its outputs from checked maps, and the result in them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, number_type
from cnnum.integrators.estimate import LOST
from cnnum.integrators.solver import Solver
from cnnum.plan import Plan
from cnnum.runs.arguments import as_frame, has_many_cells
from cnnum.runs.planning import output_names
from cnnum.runs.result import Result, result_of
from cnnum.templating.template import Template

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


def finished(
    outputs: dict[str, Floats], solver: Solver, template: Template, *, linear: bool
) -> Result:
    """Return the result in the outputs of a plan.

    Parameters
    ----------
    outputs : dict of str to (..., rows, cols) or (...) float
    solver : Solver
        How it ran; a forced step marks the result.
    template : Template
        That was asked for.
    linear : bool
        Whether it ran as the linear array that it is.
    """
    if solver.forced:
        outputs |= {
            "settled": np.zeros_like(outputs["settled"]),
            "error": np.full_like(outputs["error"], LOST),
        }
    if linear:
        # rounding may lie beyond 1
        outputs |= {name: np.clip(outputs[name], -1.0, 1.0) for name in output_names(template)}
    reason = f"{NEVER_SATURATES}; {solver.reason}" if linear else solver.reason
    return result_of(outputs, template.layers, solver.method, reason)


def with_fallback(result: Result, plan: Plan) -> Result:
    """Return a result that also says on which engine it ran if not on the plan's own."""
    return replace(result, reason=f"{result.reason}; {plan.fallen}") if plan.fallen else result
