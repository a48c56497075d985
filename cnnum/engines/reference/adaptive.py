"""Adaptive steps in NumPy: embedded pairs and Chebyshev methods.

The control is that of the other engines, so that the steps are too: each as long as the estimate
of the one before allows. See Hairer, Nørsett & Wanner, Solving ODEs I, section II.4, and Sommeijer,
Shampine & Verwer, J. Comput. Appl. Math. 88 (1998) 315-326, section 2.2.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.notices import refuse_unfinished
from cnnum.engines.reference.equation import StateEquation
from cnnum.engines.reference.march import limited, weighted
from cnnum.integrators.estimate import (
    AROUND,
    FLOOR,
    LEAST_SLOPE,
    LOST,
    ROUNDINGS,
    SMALLEST_RATE,
    error_growth,
    slopes_count,
)
from cnnum.integrators.schemes import MAX_STEPS, NEARLY, AdaptiveSteps, ChebyshevSteps
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import MAX_STAGES, chebyshev_method, stages_for
from cnnum.templating.network import gains_jump


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A trial step: its end, the rate there, and its error estimate.

    Attributes
    ----------
    state, rate : (layers, rows, cols) float
    first : (layers, rows, cols) float
        The rate at its start, after a jump of a gain in time.
    off : (layers, rows, cols) float
        The method's own estimate, which sets the length of steps.
    added : (layers, rows, cols) float
        Its contribution to the error of the run.
    """

    state: Floats
    rate: Floats
    first: Floats
    off: Floats
    added: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """Steps of an embedded pair whose last stage is the first of the next step."""

    equation: StateEquation
    drive: Floats
    scheme: AdaptiveSteps

    def trial(self, x: Floats, rate: Floats, time: float, h: float) -> Trial:
        layers = [self.scheme.of(layer) for layer in range(len(x))]
        middle = time + 0.5 * h
        if gains_jump(
            self.equation.template
        ):  # the rate at the start is that after a jump of a gain
            rate = self.equation.rate(self.drive, x, None, time, middle)
        stages, moved = [rate], x
        for number in range(1, layers[0].stages):
            ahead = weighted([layer.a[number] for layer in layers], stages, x)
            moved = limited(self.equation, x + h * ahead)
            at = time + float(sum(layers[0].a[number])) * h
            stages.append(self.equation.rate(self.drive, moved, None, at, middle))
        parts = zip(*(layer.truncation for layer in layers), strict=True)
        added = [np.abs(h * weighted(rows, stages, x)) for rows in parts]
        off = np.abs(h * weighted([layer.error for layer in layers], stages, x))
        left_out = np.sum(added, axis=0)
        if self.scheme.bends:
            off = np.maximum(off, left_out)
        return Trial(moved, stages[-1], rate, off, left_out)


@dataclass(frozen=True, slots=True, eq=False)
class _Chebyshev:
    """Steps of a Chebyshev method, with as many stages as their length needs."""

    equation: StateEquation
    drive: Floats
    scheme: ChebyshevSteps

    def trial(self, x: Floats, rate: Floats, time: float, h: float) -> Trial:
        method = chebyshev_method(min(stages_for(h * self.scheme.fastest), MAX_STAGES))
        before, now = x, x + method.first * h * rate
        for back1, back2, weight, start in method.rows:
            ahead = weight * self.equation.rate(self.drive, now, None, time) + start * rate
            before, now = now, x + back1 * (now - x) + back2 * (before - x) + h * ahead
        last = self.equation.rate(self.drive, now, None, time + h)
        off = np.abs(0.8 * (x - now) + 0.4 * h * (rate + last))
        return Trial(now, last, rate, off, off)


_TRIALS: dict[type, Callable[..., _Pair | _Chebyshev]] = {
    AdaptiveSteps: _Pair,
    ChebyshevSteps: _Chebyshev,
}
"""The function that takes the steps of each scheme."""


def march_adaptive(
    equation: StateEquation, solver: Solver, scheme: AdaptiveSteps | ChebyshevSteps
) -> tuple[Floats, float, int, float]:
    """Return the state, the time, the number of steps tried and the estimated error at the end.

    Raises
    ------
    MethodError
        If the end is not reached within `MAX_STEPS`.
    """
    steps, control = _TRIALS[type(scheme)](equation, equation.drive(), scheme), scheme.control
    slowest, growth = float(equation.template.tau.max()), error_growth(equation.template)
    x, time, error, h, end = equation.start(), 0.0, 0.0, scheme.first_step, solver.duration
    rate, taken = equation.rate(steps.drive, x, None, time), 0
    stops = list(scheme.stops) if isinstance(scheme, AdaptiveSteps) else []
    while time < end * (1.0 - 1e-6):
        refuse_unfinished(np.array([taken == MAX_STEPS]))
        h, taken = min(h, control.longest, end - time), taken + 1
        usual = h
        # no sliver of a step is left before a point of a gain in time
        ends = bool(stops) and time + NEARLY * h >= stops[0]
        h = stops[0] - time if ends else h
        trial = steps.trial(x, rate, time, h)
        size = np.maximum(np.abs(x), np.abs(trial.state))
        worst = float((trial.off / (solver.atol + solver.rtol * size)).max())
        if worst <= 1.0:
            before, after = (
                _speed(equation, x, trial.first),
                _speed(equation, trial.state, trial.rate),
            )
            faster = after / max(before, SMALLEST_RATE)
            error = _grown(error, growth * h, faster, trial, scheme.later)
            x, rate, time = trial.state, trial.rate, stops.pop(0) if ends else time + h
            h = max(h, usual) if ends else h
            change = np.abs(slowest * rate) / (solver.atol + solver.rtol * np.abs(x))
            if scheme.settle and float(change.max()) <= 1.0:
                break
        longer = control.caution * max(worst, 1e-10) ** (-1.0 / control.order)
        h *= min(max(longer, control.least), 5.0)
    return x, time, taken, scheme.safety * error + (FLOOR * solver.atol if taken else 0.0)


def _speed(equation: StateEquation, x: Floats, rate: Floats) -> float:
    """Return the largest rate, weighted by each cell's error propagation factor."""
    if not slopes_count(equation.template):
        return float(np.abs(rate).max())
    rise = equation.outputs(x + AROUND) - equation.outputs(x - AROUND)
    slope = np.maximum(np.abs(rise) / (2.0 * AROUND), LEAST_SLOPE)
    return float((slope * np.abs(rate)).max())


def _grown(error: float, exponent: float, faster: float, trial: Trial, later: float) -> float:
    """Return the error of a run after a step, as in `cnnum.integrators.estimate`."""
    rounding = ROUNDINGS * float(np.finfo(np.float64).eps)
    added = float((trial.added + rounding * np.abs(trial.state)).max())
    # e^80 is more than `LOST`
    grown = min(max(faster, 1.0), math.exp(min(exponent, 80.0)))
    return min(error * grown + added * math.pow(max(grown, 1.0), later), LOST)
