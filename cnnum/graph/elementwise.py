"""Local arithmetic and logic of a cell: one record per operation, shared by all engines.

A logic value is 0 or 1 in the engine's number type, so that masks can be multiplied and added.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ProgramError
from cnnum.safety.values import check_expression


@dataclass(frozen=True, slots=True)
class ElementOp:
    """An operation on the values of one cell.

    Attributes
    ----------
    name : str
    arity : int
        Number of arguments, called a, b, c in the OpenCL text.
    numpy : callable
        The operation on float64 arrays; logic in and out as 0 and 1.
    opencl : str
        The operation as an expression of a, b, c; `PICK(c, t, f)` is t where c holds, else f.
    logic : bool
        The result is a logic value.
    """

    name: str
    arity: int
    numpy: Callable[..., Floats]
    opencl: str
    logic: bool = False

    def __post_init__(self) -> None:
        what = f"The OpenCL form of '{self.name}'"
        check_expression(what, self.opencl, "abc"[: self.arity], ProgramError)


def _divide(a: Floats, b: Floats) -> Floats:
    # 0 where nothing can be divided: a cell without load has no friction, not a NaN
    return np.divide(a, b, out=np.zeros(np.broadcast_shapes(a.shape, b.shape)), where=b != 0)


def _root(a: Floats) -> Floats:
    return np.sqrt(np.maximum(a, 0.0))


def _logarithm(a: Floats) -> Floats:
    return np.log(np.where(np.asarray(a) > 0.0, a, 1.0))


def _power(a: Floats, b: Floats) -> Floats:
    # as for the root and for division: 0 where there is no such number
    zeros = np.zeros(np.broadcast_shapes(a.shape, b.shape))
    return np.power(a, b, out=zeros, where=a > 0)


def _invert(a: Floats) -> Floats:
    return 1.0 - a


def _select(a: Floats, b: Floats, c: Floats) -> Floats:
    return np.where(np.asarray(a != 0.0), b, c)


ADD = ElementOp("add", 2, np.add, "a + b")
SUBTRACT = ElementOp("subtract", 2, np.subtract, "a - b")
MULTIPLY = ElementOp("multiply", 2, np.multiply, "a * b")
DIVIDE = ElementOp("divide", 2, _divide, "PICK(b != ZERO, a / b, ZERO)")
NEGATE = ElementOp("negate", 1, np.negative, "-a")
ABSOLUTE = ElementOp("absolute", 1, np.abs, "fabs(a)")
ROOT = ElementOp("root", 1, _root, "sqrt(fmax(a, ZERO))")
EXPONENTIAL = ElementOp("exponential", 1, np.exp, "exp(a)")
LOGARITHM = ElementOp("logarithm", 1, _logarithm, "log(PICK(a > ZERO, a, ONE))")
POWER = ElementOp("power", 2, _power, "PICK(a > ZERO, pow(fmax(a, ZERO), b), ZERO)")
MINIMUM = ElementOp("minimum", 2, np.minimum, "fmin(a, b)")
MAXIMUM = ElementOp("maximum", 2, np.maximum, "fmax(a, b)")
GREATER = ElementOp("greater", 2, np.greater, "PICK(a > b, ONE, ZERO)", logic=True)
AT_LEAST = ElementOp("at_least", 2, np.greater_equal, "PICK(a >= b, ONE, ZERO)", logic=True)
EQUAL = ElementOp("equal", 2, np.equal, "PICK(a == b, ONE, ZERO)", logic=True)
AND = ElementOp("and", 2, np.multiply, "a * b", logic=True)
OR = ElementOp("or", 2, np.maximum, "fmax(a, b)", logic=True)
XOR = ElementOp("xor", 2, np.not_equal, "PICK(a != b, ONE, ZERO)", logic=True)
NOT = ElementOp("not", 1, _invert, "ONE - a", logic=True)
SELECT = ElementOp("select", 3, _select, "PICK(a != ZERO, b, c)")


@dataclass(frozen=True, slots=True)
class ReduceOp:
    """A reduction of the whole array to one number per frame.

    Attributes
    ----------
    name : str
    numpy : callable
        The reduction over the last two axes of float64 arrays.
    start : str
        An OpenCL expression: the value before the first cell.
    how : str
        How a cell is combined with the value, in any order: "+", or an OpenCL function of both.
    logic : bool
        The result is a logic value (global OR, global AND).
    """

    name: str
    numpy: Callable[[Floats], Floats]
    start: str
    how: str
    logic: bool = False

    def __post_init__(self) -> None:
        what = f"The OpenCL form of '{self.name}'"
        check_expression(what, self.start, (), ProgramError)
        step = "total + a" if self.how == "+" else f"{self.how}(total, a)"
        check_expression(what, step, ("total", "a"), ProgramError)


def _sum(a: Floats) -> Floats:
    return np.asarray(a.sum(axis=(-2, -1)))


def _largest(a: Floats) -> Floats:
    return np.asarray(a.max(axis=(-2, -1)))


def _smallest(a: Floats) -> Floats:
    return np.asarray(a.min(axis=(-2, -1)))


SUM = ReduceOp("sum", _sum, "ZERO", "+")
LARGEST = ReduceOp("largest", _largest, "-HUGE", "fmax")
SMALLEST = ReduceOp("smallest", _smallest, "HUGE", "fmin")
ANY = ReduceOp("any", _largest, "ZERO", "fmax", logic=True)
ALL = ReduceOp("all", _smallest, "ONE", "fmin", logic=True)
