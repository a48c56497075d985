"""The primitives: of each the interval of its result, its NumPy function, and its C text.

Whole numbers are int64 in NumPy; results are the same in C, since no intermediate leaves 64 bits.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import isqrt
from typing import Any

import numpy as np

Bounds = tuple[int, int]
Parameters = tuple[int, ...]
Intervals = Sequence[Bounds]
LOGIC = (0, 1)


def _nothing(_: Intervals, __: Parameters) -> list[Bounds]:
    return []


def _none(_: Intervals, __: Parameters) -> Bounds:
    raise AssertionError("a primitive of reals has no interval")


@dataclass(frozen=True, slots=True)
class Primitive:
    """One operation.

    Attributes
    ----------
    bounds : callable
        From the arguments' intervals and the parameters to the result's.
    numpy : callable
    c : str
        Text with {0}, {1}… for arguments, {p}, {q} for parameters, {h} and {u} for half of 2^p and
        2^p, {w} for the width: 32, 64, or _real.
    within : callable
        Intervals of values on the way, as C has them.
    always : (int, int) or None
        The interval of the result for all arguments: of logic.
    """

    bounds: Callable[[Intervals, Parameters], Bounds]
    numpy: Callable[..., Any]
    c: str
    within: Callable[[Intervals, Parameters], list[Bounds]] = _nothing
    always: Bounds | None = None


def _corners(function: Callable[[int, int], int]) -> Callable[[Intervals, Parameters], Bounds]:
    """Return the interval of a function that is monotonic in each of two arguments."""

    def bounds(given: Intervals, _: Parameters) -> Bounds:
        found = [function(a, b) for a, b in product(*given)]
        return min(found), max(found)

    return bounds


def _negated(given: Intervals, _: Parameters) -> Bounds:
    ((low, high),) = given
    return -high, -low


def _size(given: Intervals, _: Parameters) -> Bounds:
    ((low, high),) = given
    return max(low, -high, 0), max(-low, high)


def _half(places: int) -> int:
    return 1 << (places - 1)


def _down(given: Intervals, parameters: Parameters) -> Bounds:
    ((low, high),), (places,) = given, parameters
    return (low + _half(places)) >> places, (high + _half(places)) >> places


def _rounded(given: Intervals, parameters: Parameters) -> list[Bounds]:
    ((low, high),), (places,) = given, parameters
    return [(low, high + _half(places))]


def _up(given: Intervals, parameters: Parameters) -> Bounds:
    ((low, high),), (places,) = given, parameters
    return low << places, high << places


def _limits(given: Intervals, parameters: Parameters) -> Bounds:
    ((low, high),), (least, most) = given, parameters
    return min(max(low, least), most), max(min(high, most), least)


def _either(given: Intervals, _: Parameters) -> Bounds:
    _, (low, high), (least, most) = given
    return min(low, least), max(high, most)


def _quotient_bounds(given: Intervals, _: Parameters) -> Bounds:
    (low, high), (least, most) = given
    nearest = least if least > 0 else -most if most < 0 else 1
    size = (2 * max(-low, high) + nearest) // (2 * nearest)
    positive = least >= 0
    return (0 if positive and low >= 0 else -size), size


def _quotient_within(given: Intervals, _: Parameters) -> list[Bounds]:
    (low, high), (least, most) = given
    return [(0, max(-low, high) + max(-least, most))]


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


def _root_bounds(given: Intervals, _: Parameters) -> Bounds:
    ((low, high),) = given
    return isqrt(max(low, 0)), isqrt(max(high, 0))


def _cube_root_bounds(given: Intervals, _: Parameters) -> Bounds:
    ((_low, high),) = given
    return 0, int(cube_root(high))


def _ratio(a: Any, b: Any) -> Any:
    return np.where(b == 0, 0.0, a / np.where(b == 0, 1.0, b))


def _real_root(a: Any) -> Any:
    return np.sqrt(np.maximum(a, 0.0))


def _power(a: Any, b: Any) -> Any:
    return np.where(a > 0, np.power(np.where(a > 0, a, 1.0), b), 0.0)


def _up_by(a: Any, places: int) -> Any:
    return np.multiply(a, 1 << places)


def _down_by(a: Any, places: int) -> Any:
    return np.right_shift(np.add(a, _half(places)), places)


def _picked(holds: Any, a: Any, b: Any) -> Any:
    return np.where(np.asarray(holds, dtype=bool), np.asarray(a), np.asarray(b))


def _inverted(a: Any) -> Any:
    return 1 - np.asarray(a)


def _as_real(a: Any) -> Any:
    return np.asarray(a, dtype=np.float64)


def _holds(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda a, b: np.asarray(function(a, b), dtype=np.int64)


PRIMITIVES = {
    "add": Primitive(_corners(lambda a, b: a + b), np.add, "({0} + {1})"),
    "subtract": Primitive(_corners(lambda a, b: a - b), np.subtract, "({0} - {1})"),
    "multiply": Primitive(_corners(lambda a, b: a * b), np.multiply, "({0} * {1})"),
    "negate": Primitive(_negated, np.negative, "(-{0})"),
    "absolute": Primitive(_size, np.abs, "absolute{w}({0})"),
    "minimum": Primitive(_corners(min), np.minimum, "minimum{w}({0}, {1})"),
    "maximum": Primitive(_corners(max), np.maximum, "maximum{w}({0}, {1})"),
    "up": Primitive(_up, _up_by, "({0} * {u})"),
    "down": Primitive(_down, _down_by, "(({0} + {h}) >> {p})", _rounded),
    "limit": Primitive(_limits, np.clip, "limit{w}({0}, {p}, {q})"),
    "quotient": Primitive(_quotient_bounds, quotient, "quotient{w}({0}, {1})", _quotient_within),
    "root": Primitive(_root_bounds, root, "root{w}({0})"),
    "cube_root": Primitive(_cube_root_bounds, cube_root, "cube_root64({0})"),
    "pick": Primitive(_either, _picked, "({0} ? {1} : {2})"),
    "greater": Primitive(_none, _holds(np.greater), "({0} > {1})", always=LOGIC),
    "at_least": Primitive(_none, _holds(np.greater_equal), "({0} >= {1})", always=LOGIC),
    "equal": Primitive(_none, _holds(np.equal), "({0} == {1})", always=LOGIC),
    "and": Primitive(_none, np.bitwise_and, "({0} & {1})", always=LOGIC),
    "or": Primitive(_none, np.bitwise_or, "({0} | {1})", always=LOGIC),
    "xor": Primitive(_none, np.bitwise_xor, "({0} ^ {1})", always=LOGIC),
    "not": Primitive(_none, _inverted, "(1 - {0})", always=LOGIC),
    "ratio": Primitive(_none, _ratio, "ratio({0}, {1})"),
    "real_root": Primitive(_none, _real_root, "real_root({0})"),
    "power": Primitive(_none, _power, "power({0}, {1})"),
    "exponential": Primitive(_none, np.exp, "exponential({0})"),
    "to_real": Primitive(_none, _as_real, "((float){0})"),
}
"""By name; from "ratio" on they are of reals."""
