"""From a solver to the settings of the compiled functions."""

from typing import Any

import numpy as np

from cnnum.engines.numba import codes
from cnnum.engines.numba.records import Real
from cnnum.integrators.chebyshev import MAX_STAGES, chebyshev_method
from cnnum.integrators.estimate import LOST, ROUNDINGS, SAFETY, error_growth
from cnnum.integrators.schemes import (
    MAX_STEPS,
    AdaptiveSteps,
    ChebyshevSteps,
    ExponentialSteps,
    FixedSteps,
)
from cnnum.integrators.solver import Solver
from cnnum.templating.template import Template


def method_settings(template: Template, solver: Solver, dtype: Real) -> dict[str, Any]:
    """Return the settings that say how a transient runs."""
    settings = {
        "duration": solver.duration,
        "settle": solver.settle,
        "rtol": solver.rtol,
        "atol": solver.atol,
        "slowest": template.tau.max(),
        "growth": error_growth(template),
        "safety": SAFETY,
        "rounding": ROUNDINGS * float(np.finfo(dtype).eps),
    }
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps):
        return settings | _fixed(template, scheme)
    if isinstance(scheme, ExponentialSteps):
        return settings | _exponential(scheme)
    if isinstance(scheme, AdaptiveSteps | ChebyshevSteps):
        return settings | _adaptive(scheme)
    # there are no steps, but one stage says whether all is at rest
    return settings | {"scheme": codes.KNOWN, "stages": 1, "step": 1.0}


def _fixed(template: Template, scheme: FixedSteps) -> dict[str, Any]:
    return {
        "scheme": codes.FIXED,
        "stages": scheme.tableau.stages,
        "count": scheme.count,
        "step": scheme.step,
        "last": scheme.last,
        "error": LOST,
        "lag": round(template.delayed.delay / scheme.step) if template.delayed else 0,
    }


def _exponential(scheme: ExponentialSteps) -> dict[str, Any]:
    return {
        "scheme": codes.FIXED,
        "stages": scheme.method.stages,
        "count": scheme.count,
        "step": scheme.step,
        "last": scheme.step,
        "error": LOST,
    }


def _adaptive(scheme: AdaptiveSteps | ChebyshevSteps) -> dict[str, Any]:
    steps = {"step": scheme.first_step, "count": MAX_STEPS}
    if isinstance(scheme, AdaptiveSteps):
        return steps | {
            "scheme": codes.ADAPTIVE,
            "stages": scheme.tableau.stages,
            "longest": scheme.longest,
            "exponent": -1.0 / scheme.tableau.order,
            "caution": 0.9,
            "least": 0.2,
        }
    stable = chebyshev_method(MAX_STAGES).real_stability
    return steps | {
        "scheme": codes.CHEBYSHEV,
        "stages": 2,
        "longest": stable / scheme.fastest,
        "exponent": -1.0 / 3.0,
        "caution": 0.8,
        "least": 0.1,
        "most": MAX_STAGES,
        "reach": scheme.fastest * (MAX_STAGES**2 - 1) / stable,
    }
