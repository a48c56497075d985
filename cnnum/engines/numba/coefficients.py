"""From a solver to the numbers of its method: a tableau a layer, or Chebyshev's stages."""

from fractions import Fraction

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.numba import codes
from cnnum.engines.numba.records import Real, Reals
from cnnum.integrators.chebyshev import MAX_STAGES, chebyshev_method
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps, ExponentialSteps, FixedSteps
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import Row
from cnnum.templating.template import Template


def tableaux(template: Template, solver: Solver) -> Floats:
    """Return (layers or 1, rows, stages) numbers, whose rows `codes` names."""
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps):
        tableau = scheme.tableau
        return _rows(tableau.a, weights=tableau.b)[np.newaxis]
    if isinstance(scheme, AdaptiveSteps):
        found = [_rows(one.a, errors=one.error, parts=one.truncation) for one in scheme.tableaux]
        return np.array(found)
    if isinstance(scheme, ExponentialSteps):
        return _exponential(scheme, template.tau)
    # one stage of no step gives the slopes
    return np.zeros((1, codes.STAGES + 1, 2))


def _rows(
    a: tuple[Row, ...], weights: Row = (), errors: Row = (), parts: tuple[Row, ...] = ()
) -> Floats:
    """Return the rows that `codes` names; nothing is carried."""
    times = tuple(sum(row, Fraction(0)) for row in a)
    rows = np.zeros((codes.STAGES + len(a) + len(parts), len(a)))
    for at, row in enumerate((weights, times, errors, (), *a, *parts)):
        rows[at, : len(row)] = [float(x) for x in row]
    return rows


def _exponential(scheme: ExponentialSteps, tau: Floats) -> Floats:
    """Return exponential steps as those of a tableau of every layer's own.

    The coupling is N = x + τk, and the kept part of x is 1 − first, so that

        a = x + first·τk₀,   x⁺ = x + (1 + second)(a − x) + second·τ(k₁ − k₀)

    and a cell whose rate is 0 stays to the bit.
    """
    _, first, second = scheme.method.weights(scheme.step, tau)
    rows = np.zeros((len(tau), codes.STAGES + scheme.method.stages, scheme.method.stages))
    first, second_slope = first * tau / scheme.step, second * tau / scheme.step
    if scheme.method.order == 1:
        rows[:, codes.WEIGHTS, 0] = first
        return rows
    rows[:, codes.STAGES + 1, 0] = first
    rows[:, codes.CARRIED, 0] = 1.0 + second
    rows[:, codes.WEIGHTS, 0], rows[:, codes.WEIGHTS, 1] = -second_slope, second_slope
    return rows


def chebyshev_rows(solver: Solver, dtype: Real) -> Reals:
    """Return (s · most + j, 4) numbers: stage j of s; the first stage's weight at j = 0."""
    if not isinstance(solver.scheme, ChebyshevSteps):
        return np.zeros((0, 4), dtype)
    table = np.zeros((MAX_STAGES + 1, MAX_STAGES, 4), dtype)
    for stages in range(2, MAX_STAGES + 1):
        method = chebyshev_method(stages)
        table[stages, 0, 2] = method.first
        table[stages, 1:stages] = method.rows
    return table.reshape(-1, 4)
