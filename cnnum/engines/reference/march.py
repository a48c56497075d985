"""Fixed steps of an explicit method in NumPy, taken as they were asked for."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.reference.equation import StateEquation
from cnnum.integrators.choice import FixedSteps, Solver
from cnnum.integrators.tableau import Row


def march(equation: StateEquation, solver: Solver, scheme: FixedSteps) -> tuple[Floats, float, int]:
    """Return the state, the time and the number of steps at the end."""
    x = equation.start()
    history = [equation.outputs(x)]
    delayed = equation.template.delayed
    lag = round(delayed.delay / scheme.step) if delayed else 0
    fixed = equation.drive()
    slowest = float(equation.template.tau.max())
    time = 0.0
    for number in range(scheme.count):
        step = scheme.last if number == scheme.count - 1 else scheme.step
        drive = fixed + equation.delayed_drive(before=number < lag)
        stages: list[Floats] = []
        for row in scheme.tableau.a:
            c = float(sum(row))
            past = _seen(history, number - lag, c * step / scheme.step) if delayed else None
            moved = limited(equation, x + step * combined(row, stages, x))
            stages.append(equation.rate(drive, moved, past, time + c * step))
        change = np.abs(slowest * stages[0]) / (solver.atol + solver.rtol * np.abs(x))
        x = limited(equation, x + step * combined(scheme.tableau.b, stages, x))
        history.append(equation.outputs(x))
        time += step
        if solver.settle and float(change.max()) <= 1.0:
            return x, time, number + 1
    return x, time, scheme.count


def _seen(history: list[Floats], step: int, part: float) -> Floats:
    """Return the outputs at a (fractional) step of the past; before the start, the first."""
    before, after = history[max(step, 0)], history[max(min(step + 1, len(history) - 1), 0)]
    return before + part * (after - before)


def combined(weights: Row, stages: list[Floats], like: Floats) -> Floats:
    """Return the sum of the slopes of a step, weighted by a row of a tableau."""
    total = np.zeros_like(like)
    for weight, stage in zip(weights, stages, strict=True):
        total += float(weight) * stage
    return total


def limited(equation: StateEquation, x: Floats) -> Floats:
    """Return states of the range that an output function leaves them, where it limits them."""
    return np.clip(x, -1.0, 1.0) if equation.template.output.limited else x
