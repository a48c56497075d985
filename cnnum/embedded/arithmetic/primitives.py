"""The primitives: of each the interval of its result, its NumPy function, and its sign in C.

Whole numbers are int64 in NumPy; results are the same in C, since no intermediate leaves 64 bits.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import isqrt
from operator import add, mul, sub
from typing import Any

import numpy as np

from cnnum import kernels as ir

Intervals = Sequence[ir.Bounds]
LOGIC = (0, 1)


@dataclass(frozen=True, slots=True)
class Primitive:
    """One operation.

    Attributes
    ----------
    bounds : callable
        From the arguments' intervals to the result's.
    numpy : callable
    sign : str
        Of C; empty where it is a function, or has a record of its own.
    within : callable or None
        The interval of values on the way, as C has them.
    always : (int, int) or None
        The interval of the result for all arguments: of logic.
    """

    bounds: Callable[[Intervals], ir.Bounds]
    numpy: Callable[..., Any]
    sign: str = ""
    within: Callable[[Intervals], ir.Bounds] | None = None
    always: ir.Bounds | None = None


def _none(_: Intervals) -> ir.Bounds:
    raise AssertionError("a primitive of reals has no interval")


def _corners(function: Callable[[int, int], int]) -> Callable[[Intervals], ir.Bounds]:
    """Return the interval of a function that is monotonic in each of two arguments."""

    def bounds(given: Intervals) -> ir.Bounds:
        found = [function(a, b) for a, b in product(*given)]
        return min(found), max(found)

    return bounds


def _negated(given: Intervals) -> ir.Bounds:
    ((low, high),) = given
    return -high, -low


def _size(given: Intervals) -> ir.Bounds:
    ((low, high),) = given
    return max(low, -high, 0), max(-low, high)


def _limits(given: Intervals) -> ir.Bounds:
    (low, high), (least, _), (most, _) = given
    return min(max(low, least), most), max(min(high, most), least)


def _either(given: Intervals) -> ir.Bounds:
    _, (low, high), (least, most) = given
    return min(low, least), max(high, most)


def _quotient_bounds(given: Intervals) -> ir.Bounds:
    (low, high), (least, most) = given
    nearest = least if least > 0 else -most if most < 0 else 1
    size = (2 * max(-low, high) + nearest) // (2 * nearest)
    positive = least >= 0
    return (0 if positive and low >= 0 else -size), size


def _quotient_within(given: Intervals) -> ir.Bounds:
    (low, high), (least, most) = given
    return 0, max(-low, high) + max(-least, most)


def _magnitude(a: Any) -> Any:
    return np.abs(a)


def quotient(a: Any, b: Any) -> Any:
    """Return a/b rounded to the nearest whole number, halves away from 0; 0 where b is 0."""
    size, divisor = _magnitude(a), _magnitude(b)
    whole: Any = np.floor_divide(size + divisor // 2, np.maximum(divisor, 1))
    sign: Any = np.sign(a) * np.sign(b)
    return whole * sign


def root(a: Any) -> Any:
    """Return the largest whole number whose square is not above a; 0 below 0."""
    positive = np.maximum(np.asarray(a, dtype=np.int64), 0)
    guess = np.asarray(np.sqrt(positive.astype(np.float64)), dtype=np.int64)
    guess = guess - (guess * guess > positive)
    return guess + ((guess + 1) * (guess + 1) <= positive)


def cube_root(a: Any) -> Any:
    """Return the largest whole number whose cube is not above a; 0 below 0."""
    positive = np.maximum(np.asarray(a, dtype=np.int64), 0)
    guess = np.asarray(np.cbrt(positive.astype(np.float64)), dtype=np.int64)
    guess = guess - (guess * guess * guess > positive)
    return guess + ((guess + 1) * (guess + 1) * (guess + 1) <= positive)


def _root_bounds(given: Intervals) -> ir.Bounds:
    ((low, high),) = given
    return isqrt(max(low, 0)), isqrt(max(high, 0))


def _cube_root_bounds(given: Intervals) -> ir.Bounds:
    ((_low, high),) = given
    return 0, int(cube_root(high))


def _ratio(a: Any, b: Any) -> Any:
    return np.where(b == 0, 0.0, a / np.where(b == 0, 1.0, b))


def _real_root(a: Any) -> Any:
    return np.sqrt(np.maximum(a, 0.0))


def _power(a: Any, b: Any) -> Any:
    return np.where(a > 0, np.power(np.where(a > 0, a, 1.0), b), 0.0)


def _logarithm(a: Any) -> Any:
    return np.log(np.where(np.asarray(a) > 0, a, 1.0))


def _picked(holds: Any, a: Any, b: Any) -> Any:
    return np.where(np.asarray(holds, dtype=bool), np.asarray(a), np.asarray(b))


def _as_real(a: Any) -> Any:
    return np.asarray(a, dtype=np.float64)


def _holds(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda a, b: np.asarray(function(a, b), dtype=np.int64)


PRIMITIVES = {
    "add": Primitive(_corners(add), np.add, "+"),
    "subtract": Primitive(_corners(sub), np.subtract, "-"),
    "multiply": Primitive(_corners(mul), np.multiply, "*"),
    "shift": Primitive(_corners(lambda a, places: a >> places), np.right_shift, ">>"),
    "negate": Primitive(_negated, np.negative),
    "absolute": Primitive(_size, np.abs),
    "minimum": Primitive(_corners(min), np.minimum),
    "maximum": Primitive(_corners(max), np.maximum),
    "limit": Primitive(_limits, np.clip),
    "quotient": Primitive(_quotient_bounds, quotient, within=_quotient_within),
    "root": Primitive(_root_bounds, root),
    "cube_root": Primitive(_cube_root_bounds, cube_root),
    "pick": Primitive(_either, _picked),
    "greater": Primitive(_none, _holds(np.greater), ">", always=LOGIC),
    "at_least": Primitive(_none, _holds(np.greater_equal), ">=", always=LOGIC),
    "equal": Primitive(_none, _holds(np.equal), "==", always=LOGIC),
    "and": Primitive(_none, np.bitwise_and, "&", always=LOGIC),
    "or": Primitive(_none, np.bitwise_or, "|", always=LOGIC),
    "xor": Primitive(_none, np.bitwise_xor, "^", always=LOGIC),
    "ratio": Primitive(_none, _ratio),
    "real_root": Primitive(_none, _real_root),
    "power": Primitive(_none, _power),
    "logarithm": Primitive(_none, _logarithm),
    "exponential": Primitive(_none, np.exp),
    "to_real": Primitive(_none, _as_real),
}
"""By name; from "ratio" on they are of reals."""

BY_SIGN = {known.sign: known for known in PRIMITIVES.values() if known.sign}
