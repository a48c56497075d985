"""From a solver to the numbers that the compiled functions take."""

import math
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.numba.codes import ADAPTIVE, DECAY, FIXED, PROPAGATE
from cnnum.engines.numba.records import Real, Reals
from cnnum.integrators.choice import MAX_STEPS, AdaptiveSteps, FixedSteps, Solver
from cnnum.integrators.estimate import ROUNDINGS, SAFETY, error_growth
from cnnum.integrators.propagator import Decay, Propagator
from cnnum.integrators.tableau import ButcherTableau, Row
from cnnum.template import Template


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
    return settings | _steps(template, solver)


def _steps(template: Template, solver: Solver) -> dict[str, Any]:
    scheme = solver.scheme
    if isinstance(scheme, Decay | Propagator):
        code = DECAY if isinstance(scheme, Decay) else PROPAGATE
        # there are no steps, but one stage says whether all is at rest
        return {"scheme": code, "stages": 1, "step": 1.0}
    assert isinstance(scheme, FixedSteps | AdaptiveSteps)
    settings = {"stages": scheme.tableau.stages, "exponent": -1.0 / scheme.tableau.order}
    if isinstance(scheme, AdaptiveSteps):
        # the estimate of the error belongs to the state at the last stage
        assert scheme.tableau.first_same_as_last
        steps = {"step": scheme.first_step, "longest": scheme.longest, "count": MAX_STEPS}
        return settings | steps | {"scheme": ADAPTIVE}
    return settings | {
        "scheme": FIXED,
        "count": scheme.count,
        "step": scheme.step,
        "last": scheme.last,
        "error": -1.0 if math.isinf(scheme.error) else scheme.error,
        "lag": round(template.delayed.delay / scheme.step) if template.delayed else 0,
    }


def exact(solver: Solver, dtype: Real) -> Reals:
    """Return the numbers of a scheme that needs no steps."""
    scheme = solver.scheme
    if isinstance(scheme, Decay):
        return scheme.kept[np.newaxis].astype(dtype)
    if isinstance(scheme, Propagator):
        # transposed, so that the products of a column lie side by side
        parts = (scheme.state.T, scheme.drive.T, scheme.constant[np.newaxis])
        return np.ascontiguousarray(np.concatenate(parts), dtype=dtype)
    return np.zeros((0, 0), dtype)


def tableau_rows(solver: Solver) -> Floats:
    """Return b, c, b − b̂, the rows of a, and those of the truncation error's parts."""
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps | AdaptiveSteps):
        return _rows(scheme.tableau)
    return np.zeros((4, 1))


def _rows(tableau: ButcherTableau) -> Floats:
    def padded(row: Row) -> list[float]:
        return [float(x) for x in row] + [0.0] * (tableau.stages - len(row))

    times = [float(sum(row)) for row in tableau.a]
    rows = [padded(tableau.b), times, padded(tableau.error), *map(padded, tableau.a)]
    rows += map(padded, tableau.truncation) if tableau.adaptive else ()
    return np.array(rows)
