"""Output functions that have no compiled form of their own: expressions as rows of numbers.

A row is an operation, in the order in which a stack takes them: a state or a number is pushed,
every other operation takes its operands from the top and leaves one value there.
"""

import ast
import math
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.engines.numba.compiling import compiled, inlined
from cnnum.engines.numba.records import Reals

STATE, NUMBER = 0, 1
NEGATE, EXP, FABS, LOG, SQRT, TANH, REAL = range(2, 9)
ADD, SUBTRACT, MULTIPLY, DIVIDE, FMAX, FMIN, POW = range(9, 16)
LESS, NOT_MORE, MORE, NOT_LESS, EQUAL, OTHER = range(16, 22)
CLAMP, PICK = range(22, 24)
"""What is pushed, and operations of one operand, of two, and of three."""

FUNCTIONS = {
    "exp": EXP, "fabs": FABS, "log": LOG, "sqrt": SQRT, "tanh": TANH, "R": REAL, "fmax": FMAX,
    "fmin": FMIN, "pow": POW, "clamp": CLAMP, "PICK": PICK,
}  # fmt: skip
SIGNS: dict[type, int] = {
    ast.Add: ADD, ast.Sub: SUBTRACT, ast.Mult: MULTIPLY, ast.Div: DIVIDE, ast.Lt: LESS,
    ast.LtE: NOT_MORE, ast.Gt: MORE, ast.GtE: NOT_LESS, ast.Eq: EQUAL, ast.NotEq: OTHER,
}  # fmt: skip

# Python has no numbers that end with an f
_SUFFIX = re.compile(r"(?<=[0-9.])f\b")

Step = tuple[float, float]


def operations(expression: str, dtype: np.dtype[Any]) -> NDArray[np.float64]:
    """Return (operations, 2) numbers: what is done, and the number that is pushed.

    Parameters
    ----------
    expression : str
        Of `x`, as `cnnum.safety.expressions` has it.
    dtype : dtype
        Its largest number is `HUGE`.
    """
    words = {"ONE": 1.0, "ZERO": 0.0, "HUGE": float(np.finfo(dtype).max)}
    tree = ast.parse(_SUFFIX.sub("", expression), mode="eval").body
    return np.array(_steps(tree, words), dtype=np.float64)


def _steps(node: ast.AST, words: dict[str, float]) -> list[Step]:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return [(NUMBER, float(node.value))]
    if isinstance(node, ast.Name):
        return [(STATE, 0.0) if node.id == "x" else (NUMBER, words[node.id])]
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
    return [*(step for operand in operands for step in _steps(operand, words)), (what, 0.0)]


@inlined
def _of_one(what: Any, a: Any) -> Any:
    if what == NEGATE:
        return -a
    if what == EXP:
        return math.exp(a)
    if what == FABS:
        return abs(a)
    if what == LOG:
        return math.log(a)
    if what == SQRT:
        return math.sqrt(a)
    return math.tanh(a) if what == TANH else a


@inlined
def _of_two(what: Any, a: Any, b: Any) -> Any:
    if what == ADD:
        return a + b
    if what == SUBTRACT:
        return a - b
    if what == MULTIPLY:
        return a * b
    if what == DIVIDE:
        return a / b
    if what == POW:
        return a**b
    return max(a, b) if what == FMAX else min(a, b)


@inlined
def _holds(what: Any, a: Any, b: Any) -> Any:
    if what == LESS:
        return a < b
    if what == NOT_MORE:
        return a <= b
    if what == MORE:
        return a > b
    if what == NOT_LESS:
        return a >= b
    return (a == b) == (what == EQUAL)


@compiled
def interpret(steps: Any, state: Reals, output: Reals) -> None:
    """Set y = f(x) by the rows of an expression."""
    stack, top = np.zeros((len(steps), state.size), state.dtype), -1
    for step in range(len(steps)):
        what = int(steps[step, 0])
        if what <= NUMBER:
            top += 1
            for i in range(state.size):
                stack[top, i] = state[i] if what == STATE else steps[step, 1]
        elif what <= REAL:
            for i in range(state.size):
                stack[top, i] = _of_one(what, stack[top, i])
        elif what <= POW:
            top -= 1
            for i in range(state.size):
                stack[top, i] = _of_two(what, stack[top, i], stack[top + 1, i])
        elif what <= OTHER:
            top -= 1
            for i in range(state.size):
                stack[top, i] = 1 if _holds(what, stack[top, i], stack[top + 1, i]) else 0
        else:
            top -= 2
            first, second, third = stack[top], stack[top + 1], stack[top + 2]
            for i in range(state.size):
                if what == CLAMP:
                    first[i] = min(max(first[i], second[i]), third[i])
                else:
                    first[i] = second[i] if first[i] != 0 else third[i]
    for i in range(state.size):
        output[i] = stack[0, i]
