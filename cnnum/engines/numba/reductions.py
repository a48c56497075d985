"""Read-outs of a whole array whose rounding depends on the order of its cells."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.numba.compiling import compiled
from cnnum.engines.numba.records import Reals


@compiled
def sums(values: Reals) -> Floats:
    """Return the sum of every row of (batch, cells), cell by cell in float64."""
    totals = np.zeros(len(values))
    for row in range(len(values)):
        for value in values[row]:
            totals[row] += value
    return totals
