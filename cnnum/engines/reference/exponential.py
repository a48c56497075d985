"""Exponential steps in NumPy, by the formulas of Cox & Matthews, stage by stage.

J. Comput. Phys. 176 (2002) 430-455; the weights are those of `cnnum.integrators.exponential`.
"""

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.reference.equation import StateEquation
from cnnum.engines.reference.march import limited
from cnnum.integrators.schemes import ExponentialSteps
from cnnum.integrators.solver import Solver


def march_exponential(
    equation: StateEquation, solver: Solver, scheme: ExponentialSteps
) -> tuple[Floats, float, int]:
    """Return the state, the time and the number of steps at the end."""
    taus = equation.template.tau
    tau = taus[:, np.newaxis, np.newaxis]
    kept, first, second = (
        weight[:, np.newaxis, np.newaxis] for weight in scheme.method.weights(scheme.step, taus)
    )
    drive, x = equation.drive(), equation.start()
    for number in range(scheme.count):
        rate = equation.rate(drive, x, None, 0.0)
        # N = A ∗ y + w is the rate without the decay: where a mask holds, it is x itself
        coupled = tau * rate + x
        change = np.abs(float(taus.max()) * rate) / (solver.atol + solver.rtol * np.abs(x))
        x = limited(equation, kept * x + first * coupled)
        if scheme.method.order == 2:
            later = tau * equation.rate(drive, x, None, 0.0) + x
            x = limited(equation, x + second * (later - coupled))
        if scheme.settle and float(change.max()) <= 1.0:
            return x, (number + 1) * scheme.step, number + 1
    return x, solver.duration, scheme.count
