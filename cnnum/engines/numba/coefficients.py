"""From a solver to the numbers of its method: a tableau a layer, or Chebyshev's stages."""

from fractions import Fraction

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.numba import codes
from cnnum.engines.numba.records import Real, Reals
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps, FixedSteps
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import MAX_STAGES, Explicit, Row, chebyshev_method


def tableaux(solver: Solver) -> Floats:
    """Return (layers or 1, rows, stages) numbers, whose rows `codes` names."""
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps):
        return np.array([_fixed(one) for one in scheme.tableaux])
    if isinstance(scheme, AdaptiveSteps):
        found = [_rows(one.a, errors=one.error, parts=one.truncation) for one in scheme.tableaux]
        return np.array(found)
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


def _fixed(tableau: Explicit) -> Floats:
    rows = _rows(tableau.a, weights=tableau.b)
    rows[codes.CARRIED, 0] = tableau.carried
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
