"""Runs of stiff arrays: where explicit steps are too many, implicit ones on the host."""

from dataclasses import replace

import numpy as np

from cnnum.arrays import Shape
from cnnum.engines.backend import EngineRecord
from cnnum.engines.failures import refuse_unfinished
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.rosenbrock import MOST_STATES, RODAS3, may_be_implicit
from cnnum.integrators.schemes import MAX_STEPS, AdaptiveSteps, ChebyshevSteps
from cnnum.integrators.solver import Solver
from cnnum.runs.result import Result
from cnnum.templating.template import Template

SOONEST = 0.1
"""Part of a time constant before which no run comes to a rest that it does not start from."""

REASON = f"explicit steps would be more than {MAX_STEPS:,}; implicit ones, on the host in float64"


def implicit_spec(
    engine: EngineRecord, template: Template, shape: Shape, spec: RunSpec
) -> RunSpec | None:
    """Return how a run is taken by implicit steps where explicit ones do not reach its end.

    None where a method or a step was asked for, or the array is not one for implicit steps. The
    engines that solve finely have their own.

    Parameters
    ----------
    engine : EngineRecord
    template : Template
    shape : (rows, cols)
    spec : RunSpec
    """
    states = template.layers * shape[0] * shape[1]
    free = spec.method == "auto" and spec.dt is None and engine.takes_steps
    able = may_be_implicit(template) and states <= MOST_STATES
    return replace(spec, method=RODAS3.name) if free and able else None


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


def stiffly(result: Result) -> Result:
    """Return the result of implicit steps that were taken in place of explicit ones."""
    return replace(result, reason=REASON)
