"""Fixed steps of an explicit method in NumPy, taken as they were asked for."""

from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.reference.equation import StateEquation
from cnnum.integrators.choice import FixedSteps, Solver
from cnnum.integrators.tableau import Row
from cnnum.templating.network import lag


def march(
    equation: StateEquation, solver: Solver, scheme: FixedSteps, moments: Sequence[float] = ()
) -> tuple[Floats, float, int, list[tuple[Floats, int]]]:
    """Return the state, the time and the number of steps at the end.

    Then the states and steps at moments, rising and none after the end: each takes the part of a
    step up to it.
    """
    x = equation.start()
    history = [equation.outputs(x)]
    delayed = equation.template.delayed
    late = lag(equation.template, scheme.step)
    fixed = equation.drive()
    slowest = float(equation.template.tau.max())
    layers = [scheme.of(layer) for layer in range(len(x))]
    carried = np.array([layer.carried for layer in layers])[:, np.newaxis, np.newaxis]

    def after(x: Floats, number: int, time: float, step: float) -> tuple[Floats, Floats]:
        """Return the state after a step, or a part of it, and the rates at its start."""
        drive = fixed + equation.delayed_drive(before=number < late)
        stages: list[Floats] = []
        moved = x
        for rows in zip(*(layer.a for layer in layers), strict=True):
            c = float(sum(rows[0]))
            past = _seen(history, number - late, c * step / scheme.step) if delayed else None
            moved = limited(equation, x + step * weighted(rows, stages, x))
            at = time + c * step
            within = step if delayed else 0.0
            interval = (past, at, time + 0.5 * step, within)
            # a cell that comes to its limit within the step is there at its end
            stages.append(equation.rate(drive, moved, *interval, outwards=bool(stages)))
        ahead = step * weighted([layer.b for layer in layers], stages, x)
        return limited(equation, x + carried * (moved - x) + ahead), stages[0]

    pieces = {piece.first: piece for piece in scheme.pieces}
    time, still, step, number = 0.0, 0, scheme.step, 0
    seen: list[tuple[Floats, int]] = []
    while number < scheme.count:
        if number in pieces:
            step, time = pieces[number].step, pieces[number].start
        elif not pieces:
            step = scheme.last if number == scheme.count - 1 else scheme.step
        while len(seen) < len(moments) and moments[len(seen)] < time + step:
            part = moments[len(seen)] - time
            passed = after(x, number, time, part)[0] if part > 0.0 else x
            seen.append((passed, number + (part > 0.0)))
        new, rate = after(x, number, time, step)
        change = np.abs(slowest * rate) / (solver.atol + solver.rtol * np.abs(x))
        x = new
        history.append(equation.outputs(x))
        time, number = time + step, number + 1
        still = still + 1 if float(change.max()) <= 1.0 else 0
        if solver.settle and still > late:
            break
    seen += [(x, number)] * (len(moments) - len(seen))
    return x, time, number, seen


def _seen(history: list[Floats], step: int, part: float) -> Floats:
    """Return the outputs at a (fractional) step of the past; before the start, the first."""
    before, after = history[max(step, 0)], history[max(min(step + 1, len(history) - 1), 0)]
    return before + part * (after - before)


def weighted(rows: Sequence[Row], stages: Sequence[Floats], like: Floats) -> Floats:
    """Return the sum of the slopes of a step's stages, weighted by a row for each layer."""
    total = np.zeros_like(like)
    for layer, row in enumerate(rows):
        for weight, slope in zip(row, stages, strict=True):
            total[layer] += float(weight) * slope[layer]
    return total


def limited(equation: StateEquation, x: Floats) -> Floats:
    """Return states of the range that an output function leaves them, where it limits them."""
    return np.clip(x, -1.0, 1.0) if equation.template.output.limited else x
