"""From a solver to the settings of the compiled functions."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.engines.numba import codes
from cnnum.engines.numba.records import Real
from cnnum.integrators.estimate import FLOOR, LOST, ROUNDINGS, error_growth
from cnnum.integrators.schemes import (
    MAX_STEPS,
    AdaptiveSteps,
    ChebyshevSteps,
    FixedSteps,
)
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import MAX_STAGES, chebyshev_method
from cnnum.templating.reads import lag
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
        "floor": FLOOR * solver.atol,
        "rounding": ROUNDINGS * float(np.finfo(dtype).eps),
    }
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps):
        return settings | _fixed(template, scheme)
    if isinstance(scheme, AdaptiveSteps):
        own = {
            "scheme": codes.ADAPTIVE,
            "stages": scheme.tableau.stages,
            "bends": scheme.bends,
        }
        return settings | _controlled(scheme) | own
    if isinstance(scheme, ChebyshevSteps):
        return settings | _controlled(scheme) | _chebyshev(scheme)
    # there are no steps, but one stage says whether all is at rest
    return settings | {"scheme": codes.KNOWN, "stages": 1, "step": 1.0}


def _fixed(template: Template, scheme: FixedSteps) -> dict[str, Any]:
    return {
        "scheme": codes.FIXED,
        "stages": scheme.stages,
        "count": scheme.count,
        "step": scheme.step,
        "last": scheme.last,
        "error": LOST,
        "lag": lag(template, scheme.step),
    }


def _controlled(scheme: AdaptiveSteps | ChebyshevSteps) -> dict[str, Any]:
    return {
        "step": scheme.first_step,
        "count": MAX_STEPS,
        "longest": scheme.control.longest,
        "exponent": -1.0 / scheme.control.order,
        "caution": scheme.control.caution,
        "least": scheme.control.least,
        "safety": scheme.safety,
        "later": scheme.later,
    }


def pieces_of(solver: Solver) -> NDArray[np.float64]:
    """Return the stretches of a run's time: first step, start, and length of fixed steps."""
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps) and scheme.pieces:
        return np.array([[piece.first, piece.start, piece.step] for piece in scheme.pieces])
    step = scheme.step if isinstance(scheme, FixedSteps) else 0.0
    stops = scheme.stops if isinstance(scheme, AdaptiveSteps) else ()
    return np.array([[0.0, start, step] for start in (0.0, *stops)])


def _chebyshev(scheme: ChebyshevSteps) -> dict[str, Any]:
    reach = (MAX_STAGES**2 - 1) / chebyshev_method(MAX_STAGES).real_stability
    own = {"scheme": codes.CHEBYSHEV, "stages": 2, "most": MAX_STAGES}
    return own | {"reach": scheme.fastest * reach}
