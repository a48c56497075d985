"""The arguments of the compiled functions: a few arrays, of the same types for every template.

Maps are concatenated and flat, each with a rim around it, so a neighbour is at a fixed offset. Rim
cells never move, since their pace is 0.
"""

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape
from cnnum.templating.boundary import Boundary, rim_copies

KNOWN, FIXED, ADAPTIVE, CHEBYSHEV = range(4)
"""How a transient is run."""

CLAMP, IDENTITY, TANH, SIGN, EXPRESSION = range(5)
"""Output functions."""

TAKE_STATE, TAKE_CENTRE, TAKE_NUMBER = range(3)
NEGATE, EXP, FABS, LOG, SQRT, TANH_OF, REAL = range(3, 10)
ADD, SUBTRACT, MULTIPLY, DIVIDE, FMAX, FMIN, POW = range(10, 17)
LESS, NOT_MORE, MORE, NOT_LESS, EQUAL, OTHER = range(17, 23)
WITHIN, PICK = range(23, 25)
"""Of a function without a compiled form: pushes on a stack, and operations with one operand, with
two, and with three."""

FEEDBACK, CONTROL, LATE_FEEDBACK, LATE_CONTROL, MOVING, STILL = range(6)
"""Kinds of taps: A, B, delayed A and B; nonlinear ones that follow the states, or inputs alone."""

STATE, MOVED, OUTPUT, INPUT, DRIVE, PACE, PAST, LATER, SLOPES = range(9)
"""Maps of a frame at work: x; x at a stage; y = f(x); u; the drive of the cells. Then 1/τ, or 0
where a cell is held; outputs a delay ago; the delayed inputs' sum when the delay is over. From
SLOPES on one dx/dt a stage, then the outputs of the last steps."""

NOTHING = -1
"""Centre of a nonlinear coupling that reads only the neighbour."""

EARLIER = PAST
"""Of Chebyshev's stages, which know no delay: the state two stages ago."""

MOVE, SLOPE, JUDGE, CHANGE, ACCEPT, STEP = (np.int64(phase) for phase in range(6))
"""Phases of a step; not literals, as functions are compiled for each of those."""

WEIGHTS, TIMES, ERRORS, CARRIED, STAGES = range(5)
"""Rows of a tableau: b, c, b − b̂, and the part of the last stage's move carried to the end. From
STAGES on they are the rows of a; then the truncation error's."""

NONE, AT_REST = np.int64(0), np.int64(-1)
"""No stage or step in particular, and the number of no step: outputs a delay ago are those of now.
Not literals, as functions are compiled for each of those."""

ROUNDING, ALMOST = 1e-12, 1.0 - 1e-12
"""Parts of a step within which a moment is one of its ends."""

NEARLY = 1.000001
"""Part of a step that may reach a point of a gain in time at which it is to end."""

LARGEST_EXPONENT, SMALLEST_RATE, LOST = 80.0, 1e-30, 1e30
"""Limits within which a growth is a number of single precision."""

FUNCTIONS = {
    "exp": EXP,
    "fabs": FABS,
    "log": LOG,
    "sqrt": SQRT,
    "tanh": TANH_OF,
    "R": REAL,
    "fmax": FMAX,
    "fmin": FMIN,
    "pow": POW,
    "clamp": WITHIN,
    "PICK": PICK,
}
SIGNS: dict[type, int] = {
    ast.Add: ADD,
    ast.Sub: SUBTRACT,
    ast.Mult: MULTIPLY,
    ast.Div: DIVIDE,
    ast.Lt: LESS,
    ast.LtE: NOT_MORE,
    ast.Gt: MORE,
    ast.GtE: NOT_LESS,
    ast.Eq: EQUAL,
    ast.NotEq: OTHER,
}
"""Codes of the parts of an expression."""

# Python has no numbers that end with an f
_SUFFIX = re.compile(r"(?<=[0-9.])f\b")

Step = tuple[float, float]


def operations(
    expression: str, dtype: np.dtype[Any], variables: Mapping[str, int]
) -> NDArray[np.float64]:
    """Return (operations, 2) numbers: the code of each, and the number that is pushed.

    Parameters
    ----------
    expression : str
        As `cnnum.safety.values` has it.
    dtype : dtype
        Its largest number is `HUGE`.
    variables : mapping of str to int
        The code that takes each.
    """
    words = {"ONE": 1.0, "ZERO": 0.0, "HUGE": float(np.finfo(dtype).max)}
    tree = ast.parse(_SUFFIX.sub("", expression), mode="eval").body
    return np.array(_steps(tree, words, variables), dtype=np.float64)


def _steps(node: ast.AST, words: dict[str, float], variables: Mapping[str, int]) -> list[Step]:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return [(TAKE_NUMBER, float(node.value))]
    if isinstance(node, ast.Name):
        taken = variables.get(node.id)
        return [(TAKE_NUMBER, words[node.id]) if taken is None else (taken, 0.0)]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        what, operands = FUNCTIONS[node.func.id], node.args
    elif isinstance(node, ast.UnaryOp):
        what, operands = NEGATE, [node.operand]
    elif isinstance(node, ast.BinOp):
        what, operands = SIGNS[type(node.op)], [node.left, node.right]
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        what, operands = SIGNS[type(node.ops[0])], [node.left, *node.comparators]
    else:
        raise SyntaxError(
            f"An expression contains something that no engine supports: {ast.unparse(node)!r}."
        )
    parts = (step for operand in operands for step in _steps(operand, words, variables))
    return [*parts, (what, 0.0)]


Reals = NDArray[np.floating[Any]]
"""Numbers in the engine's precision, float32 or float64."""

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
"""Settings of a plan."""

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
"""A time-varying gain."""


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
        Intervals within which no gain has a jump or a kink: the number of the first step, the
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
    parts : (times or 0, layers, rows, stages) float64
        Tableaux of the parts of steps up to there, where steps have numbers of their length.
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
    parts: NDArray[np.float64]


class Frame(NamedTuple):
    """The working data of one frame while its transient runs.

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
        State and rates to restore after sampling within a step.
    moments, seen, marks, parts : arrays
        Of the frame, as in a batch.
    """

    work: Reals
    gains: Reals
    found: Reals
    kept: Reals
    moments: NDArray[np.float64]
    seen: Reals
    marks: NDArray[np.float64]
    parts: NDArray[np.float64]


BAND = 2048
"""Cells processed at a time: the rows that a step reads for them stay in the L1 cache."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Maps of (rows, cols), each with a rim of `radius`, one after the other.

    Attributes
    ----------
    shape : (rows, cols)
    radius : int
    """

    shape: Shape
    radius: int

    @property
    def pitch(self) -> int:
        """Length of a row with its rim."""
        return self.shape[1] + 2 * self.radius

    @property
    def padded(self) -> Shape:
        """Rows and columns with the rim."""
        return self.shape[0] + 2 * self.radius, self.pitch

    @property
    def size(self) -> int:
        """Length of a map with its rim."""
        return self.padded[0] * self.pitch

    def maps(self, batch: int, count: int, value: float, dtype: Real) -> Reals:
        """Return new maps (batch, count·size) of one value."""
        return np.full((batch, count * self.size), value, dtype)

    def inner(self, maps: Reals) -> Reals:
        """Return the cells of maps without their rims, as a view (batch, count, rows, cols)."""
        count, r, (rows, cols) = maps.shape[1] // self.size, self.radius, self.shape
        blocks = maps.reshape(len(maps), count, *self.padded)
        return blocks[:, :, r : r + rows, r : r + cols]

    def fill_rims(self, maps: Reals, boundary: Boundary) -> None:
        """Set the rims of all maps by a boundary."""
        to, source = self.rim(boundary)
        blocks = maps.reshape(len(maps), maps.shape[1] // self.size, self.size)
        blocks[:, :, to] = blocks[:, :, source]

    def rim(self, boundary: Boundary) -> Ints:
        """Return (2, rim cells): the indices of rim cells in a map, and those that they copy."""
        if boundary.constant is not None:
            return np.zeros((2, 0), np.int64)
        return rim_copies(boundary, self.shape, self.radius)

    def bands(self, layers: int) -> Ints:
        """Return pieces of the layers, without the rows of the rim before and after them.

        Returns
        -------
        (bands, 3) int
            Layer, first place, place after the last.
        """
        skipped = self.radius * self.pitch + self.radius
        starts = np.arange(skipped, self.size - skipped, BAND)
        ends = np.minimum(starts + BAND, self.size - skipped)
        return np.array(
            [
                (layer, layer * self.size + lo, layer * self.size + hi)
                for layer in range(layers)
                for lo, hi in zip(starts, ends, strict=True)
            ],
            dtype=np.int64,
        )
