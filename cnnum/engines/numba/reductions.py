"""Sums over a whole array, whose rounding depends on the order of its cells."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.numba.compiling import ROOM, kept
from cnnum.engines.numba.records import Reals


@kept
def sums(values: Reals, room: int = ROOM) -> Floats:
    """Return the sum of every row of (batch, cells), cell by cell in float64."""
    totals = np.zeros(len(values))
    for row in range(len(values)):
        for value in values[row]:
            totals[row] += value
    return totals


@kept
def products(columns: Floats, values: Reals, totals: Floats, room: int = ROOM) -> None:
    """Add matrix · values to every row of totals, column by column in float64.

    Parameters
    ----------
    columns : (cells, cells) float64
        The matrix, one column a row.
    values : (batch or 1, cells) float
    totals : (batch, cells) float64
        Changed in place.
    """
    for row in range(len(totals)):
        given = values[min(row, len(values) - 1)]
        for cell in range(len(given)):
            totals[row] += columns[cell] * np.float64(given[cell])
