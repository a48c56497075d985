"""The arguments of the compiled functions: few arrays, of the same types for every template.

Maps lie one after the other, each with a rim around it, all flat: a neighbour is at a fixed
distance. Cells of a rim are cells that never move, as their pace is 0.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.floating[Any]]
"""Numbers of the engine's own type, float32 or float64."""

Ints = NDArray[np.int64]

Real = np.dtype[np.floating[Any]]

SETTINGS = np.dtype(
    [
        # the array: `size` is the length of a map with its rim
        ("layers", "i8"),
        ("size", "i8"),
        # the cells: code of the output function, whether the state is kept within [−1, 1],
        # whether a coupling reads the neighbours' states
        ("response", "i8"),
        ("limited", "i8"),
        ("reads_states", "i8"),
        # whether rates count by the slope of f in the growth of errors
        ("slopes_count", "i8"),
        # the method: code, stages, −1/order, length of a (first) step, of the longest and the last
        ("scheme", "i8"),
        ("stages", "i8"),
        ("exponent", "f8"),
        ("step", "f8"),
        ("longest", "f8"),
        ("last", "f8"),
        # of steps that follow their error: part of the longest that it allows, the smallest change.
        # The square of Chebyshev's stages less 1 a unit of time. Whether the truncation error sets
        # them, too. Chebyshev's largest number of stages
        ("caution", "f8"),
        ("least", "f8"),
        ("reach", "f8"),
        ("bends", "i8"),
        ("most", "i8"),
        ("duration", "f8"),
        # steps that are taken at most, the delay in steps, the kind of error estimate
        ("count", "i8"),
        ("lag", "i8"),
        ("error", "f8"),
        # of the error of adaptive steps: how fast it may grow, the safety factor, the least that
        # is stated, the roundings
        ("growth", "f8"),
        ("safety", "f8"),
        ("floor", "f8"),
        # the power of the growth of a step's own error
        ("later", "f8"),
        ("rounding", "f8"),
        # whether a gain in time jumps, and whether time is discrete
        ("jumping", "i8"),
        ("whole", "i8"),
        # parts in which a piece of a fixed step is taken up to a look
        ("cuts", "i8"),
        # when the state is at rest; `slowest` is the largest τ
        ("settle", "i8"),
        ("rtol", "f8"),
        ("atol", "f8"),
        ("slowest", "f8"),
    ]
)
"""Numbers of a plan."""

TAP = np.dtype(
    [
        # from a cell of the first map to the neighbour's; the weight; the place of its gain
        ("offset", "i8"),
        ("weight", "f8"),
        ("gain", "i8"),
        # of a nonlinear coupling: its reads of the neighbour and of the centre, and where that
        # lies. Then the sign of the argument, whether it is multiplied by it, the function
        ("neighbour", "i8"),
        ("centre", "i8"),
        ("centre_offset", "i8"),
        ("sign", "f8"),
        ("times", "i8"),
        ("table", "i8"),
        # of a function of two cells: where its operations begin, and their number; else 0
        ("begin", "i8"),
        ("operations", "i8"),
    ]
)
"""One weight of a template."""

TABLE = np.dtype([("first", "i8"), ("last", "i8"), ("linear", "i8")])
"""A function table: places of its points."""

GAIN = np.dtype([("place", "i8"), ("table", "i8")])
"""A gain in time."""


class Plan(NamedTuple):
    """A template on an array, and how it runs.

    Attributes
    ----------
    settings : (1,) SETTINGS
    tableau : (layers or 1, 4 + stages + parts, stages) float64
        b, c, b − b̂, the carried part, the rows of a, and those of the truncation error's parts.
    taps : (taps,) TAP
    first : (6, layers + 1) int
        Where the taps of every kind into each layer begin.
    tables : (tables,) TABLE
    points : (2, points) float
        Arguments and values of the function tables.
    gains : (gains,) GAIN
    pieces : (pieces, 3) float64
        Stretches of time within which no gain jumps or bends: the number of the first step, the
        start, and the length of fixed steps.
    rim : (2, rim cells) int
        Where a rim's cells lie in a map, and which cell each copies; none of a constant rim.
    bands : (bands, 3) int
        Pieces of the layers that are worked on at a time: layer, first place, place after the last.
    chebyshev : (rows, 4) float
        In row s · most + j back1, back2, rate and start of stage j of s.
    formula : (operations, 2) float64
        An output function without a compiled form, as `codes` names them; else none.
    pairs : (operations, 2) float64
        The functions of two cells that couplings have, one after the other.
    """

    settings: Any
    tableau: NDArray[np.float64]
    taps: Any
    first: Ints
    tables: Any
    points: Reals
    gains: Any
    pieces: NDArray[np.float64]
    rim: Ints
    bands: Ints
    chebyshev: Reals
    formula: NDArray[np.float64]
    pairs: NDArray[np.float64]


class Batch(NamedTuple):
    """Frames on their way: maps with rims; the state is left where the transient ends.

    Attributes
    ----------
    state, output : (batch, layers·size) float
    drive : (batch, layers·size) float
        z + bias.
    pace : (batch or 1, layers·size) float
    inputs, previous : (batch, inputs·size) float
        `previous` has no frame where it is not given.
    figures : (batch, 5) float64
        Time, steps, settled, error, unfinished.
    moments : (times,) float64
        Times at which frames are looked at on their way.
    seen : (times, batch, layers·size) float
        The states there.
    marks : (times, batch, 3) float64
        Steps, settled and error there.
    """

    state: Reals
    output: Reals
    drive: Reals
    pace: Reals
    inputs: Reals
    previous: Reals
    figures: NDArray[np.float64]
    moments: NDArray[np.float64]
    seen: Reals
    marks: NDArray[np.float64]


class Frame(NamedTuple):
    """One frame while its transient runs.

    Attributes
    ----------
    work : (maps, n) float
        Maps with rims of all layers, as `codes` names them.
    gains : (layers² + 1,) float
        Gain of every pair of layers, and the 1 of couplings that have none.
    found : (bands, 4) float
        Of every band: error in units of the tolerance, a step's share in the error of the state.
        Then change in units of the tolerance, largest rate.
    kept : (2, n) float
        State and rates that a look between the ends of steps has to leave as they were.
    moments, seen, marks : arrays
        Of the frame, as in a batch.
    """

    work: Reals
    gains: Reals
    found: Reals
    kept: Reals
    moments: NDArray[np.float64]
    seen: Reals
    marks: NDArray[np.float64]
