"""Numbers that stand for words inside compiled functions."""

import ast
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

KNOWN, FIXED, ADAPTIVE, CHEBYSHEV = range(4)
"""How a transient is brought to its end."""

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
        As `cnnum.safety.names` has it.
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
        raise SyntaxError(f"An expression has a part that no engine has: {ast.unparse(node)!r}.")
    parts = (step for operand in operands for step in _steps(operand, words, variables))
    return [*parts, (what, 0.0)]
