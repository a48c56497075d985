"""Sums, products and roots, in whole numbers and in reals.

The primitives: of each the interval of its result, its NumPy function, and its sign in C.

Whole numbers are int64 in NumPy; results are the same in C, since no intermediate leaves 64 bits.

Expressions on whole numbers, each with the interval that it cannot leave; on reals without one.

The interval of an expression follows from those of its parts. So it says which C type is wide
enough. A value that could leave 64 bits is refused where the expression is made.

Arithmetic on quantities: whole numbers with a fraction, or reals, by one interface.

Lowering asks for sums, products and roots; `Fixed` makes them of shifts and whole numbers, `Reals`
of floating-point numbers. A result is as fine as its operands make it, and not finer than its
format.

Arithmetic in floating-point numbers by the interface of `Fixed`.

It measures the range of every value before formats are chosen, and it prints float32.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import product
from math import ceil, floor, isqrt, log2
from operator import add, mul, sub
from typing import Any

import numpy as np

from cnnum import kernels as ir
from cnnum.embedded.formats import FACTOR, FINEST, SHORT, Format
from cnnum.errors import NotSupportedError

Intervals = Sequence[ir.Bounds]
LOGIC = (0, 1)


@dataclass(frozen=True, slots=True)
class Primitive:
    """One operation.

    Attributes
    ----------
    bounds : callable
        Computes the interval of the result from those of the arguments.
    numpy : callable
    sign : str
        C operator; empty for a function, or if the primitive has its own record.
    within : callable or None
        Computes the interval of intermediate values in C.
    always : (int, int) or None
        Interval of the result for all arguments, as for logic.
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
        result = [function(a, b) for a, b in product(*given)]
        return min(result), max(result)

    return bounds


def _negated(given: Intervals) -> ir.Bounds:
    ((low, high),) = given
    return -high, -low


def _remainder_bounds(given: Intervals) -> ir.Bounds:
    """Return the interval of a remainder of numbers that are not below 0."""
    _, (_, most) = given
    return 0, most - 1


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
    "remainder": Primitive(_remainder_bounds, np.remainder, "%"),
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
"""Primitives by name; those from "ratio" on are for floating point."""

BY_SIGN = {known.sign: known for known in PRIMITIVES.values() if known.sign}


WIDEST = (1 << 63) - 1


def call(primitive: str, *arguments: ir.Expression) -> ir.Expression:
    """Return a primitive applied to arguments.

    Raises
    ------
    NotSupportedError
        If an intermediate value could exceed 64 bits.
    """
    known = PRIMITIVES[primitive]
    given = [argument.bounds for argument in arguments if argument.bounds is not None]
    if known.always is not None:
        decided = _decided(primitive, given) if len(given) == len(arguments) else None
        return (
            _record(primitive, arguments, known.always) if decided is None else ir.Integer(decided)
        )
    if len(given) < len(arguments) or primitive == "to_real":
        return _record(primitive, arguments, None)
    within = known.within(given) if known.within else None
    bounds = known.bounds(given)
    if primitive == "multiply" and arguments[0] == arguments[1]:
        bounds = bounds if bounds[0] == bounds[1] else (0, bounds[1])
    if any(max(-low, high) > WIDEST for low, high in (bounds, within or bounds)):
        raise NotSupportedError(
            f"An intermediate value of '{primitive}' would need more than 64 bits: use a "
            "precision with fewer bits, or narrower ranges."
        )
    if bounds[0] == bounds[1]:  # expressions have no side effects
        return ir.Integer(bounds[0])
    return _record(primitive, arguments, bounds, within)


def _decided(primitive: str, given: Sequence[ir.Bounds]) -> int | None:
    """Return the result of a comparison decided by intervals, about which compilers would warn."""
    (low, high), (least, most) = given
    if primitive == "equal":
        return 0 if high < least or most < low else None
    if primitive == "greater":
        return 1 if low > most else 0 if high <= least else None
    if primitive == "at_least":
        return 1 if low >= most else 0 if high < least else None
    return None


def _record(
    primitive: str,
    arguments: tuple[ir.Expression, ...],
    bounds: ir.Bounds | None,
    within: ir.Bounds | None = None,
) -> ir.Expression:
    a, *others = arguments
    if sign := PRIMITIVES[primitive].sign:
        return ir.Binary(sign, a, others[0], bounds)
    if primitive == "negate":
        return ir.Negative(a, bounds)
    if primitive == "pick":
        return ir.Choice(a, others[0], others[1], bounds)
    if primitive == "to_real":
        return ir.Cast("real", a)
    return ir.Call(primitive, arguments, bounds, within)


def opposite(flag: ir.Expression) -> ir.Expression:
    """Return 1 − a flag."""
    return ir.Binary("-", ir.Integer(1), flag, LOGIC)


def item(array: str, at: ir.Expression, bounds: ir.Bounds | None) -> ir.Element:
    """Return an array element."""
    return ir.Element(ir.Name(array), at, bounds)


CHAIN = 32
"""Number of terms that are added one by one; a longer sum is a sum of such sums."""


def total(terms: Sequence[ir.Expression]) -> ir.Expression:
    """Return the sum of one or more terms."""
    while len(terms) > CHAIN:
        terms = [total(terms[at : at + CHAIN]) for at in range(0, len(terms), CHAIN)]
    return reduce(lambda a, b: call("add", a, b), terms)


def limited(value: ir.Expression, low: int, high: int) -> ir.Expression:
    """Return a value clipped to limits; the value itself if it cannot leave them."""
    assert value.bounds is not None
    if low <= value.bounds[0] and value.bounds[1] <= high:
        return value
    return call("limit", value, ir.Integer(low), ir.Integer(high))


def shifted(value: ir.Expression, places: int) -> ir.Expression:
    """Return a value times 2^places; halves are rounded up."""
    if not places:
        return value
    if places > 0:
        return call("multiply", value, ir.Integer(1 << places))
    if places < -62:
        return ir.Integer(0)
    return call("shift", call("add", value, ir.Integer(1 << (-places - 1))), ir.Integer(-places))


def magnitude(value: ir.Expression) -> int:
    """Return the largest magnitude that a whole value can have."""
    assert value.bounds is not None
    return max(-value.bounds[0], value.bounds[1], 1)


ROOM = 62
"""Bits of a magnitude before a division or a root."""

SUMMED = 60
"""Bits of a magnitude that a sum adds; eight of them are below 2^63."""

SPREAD = 30
"""Largest left shift that aligns an operand with another one."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A fixed-point expression: the integer q represents q · 2^−fraction.

    Attributes
    ----------
    value : Expression
    fraction : int
    exact : Fraction or None
        Exact value of a constant, which each operation rounds separately.
    """

    value: ir.Expression
    fraction: int = 0
    exact: Fraction | None = None


def constant(number: float) -> Quantity:
    """Return a constant."""
    return Quantity(ir.Number(number), 0, Fraction(number))


def nearest(number: Fraction) -> int:
    """Return the nearest whole number, halves up."""
    return floor(number + Fraction(1, 2))


def significant(number: Fraction, bits: int) -> tuple[int, int]:
    """Return a signed whole number with as few bits as possible, and its fraction."""
    if not number:
        return 0, 0
    fraction = bits - 1 - (floor(log2(abs(number))) + 1)
    whole = nearest(number * Fraction(2) ** fraction)
    if abs(whole) >= 1 << (bits - 1):
        whole, fraction = nearest(Fraction(whole, 2)), fraction - 1
    while whole % 2 == 0:
        whole, fraction = whole // 2, fraction - 1
    return whole, fraction


@dataclass(frozen=True, slots=True)
class Fixed:
    """Whole numbers.

    Attributes
    ----------
    weight : int
        Bits of a constant factor.
    """

    weight: int

    def brought(self, quantity: Quantity, fraction: int) -> ir.Expression:
        """Return the integers of a quantity at another fraction."""
        if quantity.exact is not None:
            return ir.Integer(nearest(quantity.exact * Fraction(2) ** fraction))
        return shifted(quantity.value, fraction - quantity.fraction)

    def common(self, some: Sequence[Quantity], finest: int) -> int:
        """Return the common fraction of quantities."""
        known = [quantity for quantity in some if quantity.exact is None]
        fractions = [quantity.fraction for quantity in known]
        for quantity in some:
            if quantity.exact is not None:
                fractions.append(min(significant(quantity.exact, self.weight)[1], finest))
        lowest = min([quantity.fraction for quantity in known], default=finest)
        return min(finest, max(fractions), lowest + SPREAD)

    def fit(self, quantity: Quantity, format: Format) -> Quantity:
        """Return a quantity in a format; values that do not fit saturate."""
        quantity = self.settled(quantity)
        fraction = min(quantity.fraction, format.fraction)
        value = limited(self.brought(quantity, fraction), format.least, format.largest)
        return Quantity(value, fraction)

    def stored(self, quantity: Quantity, format: Format) -> ir.Expression:
        """Return a quantity as whole numbers of a format."""
        return limited(self.brought(quantity, format.fraction), format.least, format.largest)

    def add(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a + b."""
        return self._met("add", a, b, finest)

    def subtract(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a − b."""
        return self._met("subtract", a, b, finest)

    def extreme(self, which: str, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return the "minimum" or the "maximum"."""
        return self._met(which, a, b, finest)

    def _met(self, which: str, a: Quantity, b: Quantity, finest: int) -> Quantity:
        fraction = self.common((a, b), finest)
        return Quantity(call(which, self.brought(a, fraction), self.brought(b, fraction)), fraction)

    def settled(self, quantity: Quantity) -> Quantity:
        """Return a constant as the nearest whole number of 31 bits, and others unchanged."""
        if quantity.exact is None:
            return quantity
        whole, fraction = significant(quantity.exact, 31)
        return Quantity(ir.Integer(whole), min(fraction, FINEST))

    def multiply(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a · b; a factor that is a power of two only moves the point."""
        if a.exact is not None:
            a, b = b, self.settled(a) if b.exact is not None else a
            a = self.settled(a)
        if b.exact is not None:
            whole, fraction = significant(b.exact, self.bits_beside([a]))
            if abs(whole) == 1:
                value = a.value if whole == 1 else call("negate", a.value)
                return Quantity(value, a.fraction + fraction)
            other: ir.Expression = ir.Integer(whole)
        else:
            other, fraction = b.value, b.fraction
        fraction += a.fraction
        product = call("multiply", a.value, other)
        return Quantity(shifted(product, min(0, finest - fraction)), min(fraction, finest))

    def divide(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a / b, rounded to the nearest; 0 where b is 0."""
        if b.exact is not None:
            inverse = 1 / b.exact if b.exact else Fraction(0)
            return self.multiply(a, Quantity(b.value, 0, inverse), finest)
        a = self.settled(a)
        places = finest - a.fraction + b.fraction
        places = min(places, ROOM - magnitude(a.value).bit_length())
        top, bottom = shifted(a.value, max(places, 0)), b.value
        if places < 0:
            top = shifted(top, places)
        return Quantity(call("quotient", top, bottom), places + a.fraction - b.fraction)

    def root(self, a: Quantity, finest: int) -> Quantity:
        """Return √a, rounded down; 0 below 0."""
        return self._root("root", 2, a, finest)

    def power(self, a: Quantity, exponent: Fraction, finest: int) -> Quantity:
        """Return a to a constant power; 0 where a is not above 0.

        Raises
        ------
        NotSupportedError
            If the exponent is not 1/2, 1/3 or a whole number from 1 to 4.
        """
        third = exponent.limit_denominator(1000)
        if third == Fraction(1, 3):
            return self._root("cube_root", 3, a, finest)
        if exponent == Fraction(1, 2):
            return self.root(a, finest)
        if exponent.denominator == 1 and 1 <= exponent <= 4:
            positive = Quantity(call("maximum", a.value, ir.Integer(0)), a.fraction)
            quantity = positive
            for _ in range(int(exponent) - 1):
                quantity = self.multiply(quantity, positive, finest)
            return quantity
        raise NotSupportedError(
            "A power in whole numbers must have the exponent 1/2, 1/3, 1, 2, 3 or 4, got "
            f"{exponent!s}: use precision='float32'."
        )

    def exponential(self, a: Quantity, finest: int) -> Quantity:
        """Raise an error: whole numbers have no exponential.

        Raises
        ------
        NotSupportedError
            Always.
        """
        raise NotSupportedError(
            "An exponential is not available in whole numbers: use precision='float32', or leave "
            "out the outputs that need it."
        )

    def logarithm(self, a: Quantity, finest: int) -> Quantity:
        """Raise an error: whole numbers have no logarithm.

        Raises
        ------
        NotSupportedError
            Always.
        """
        raise NotSupportedError(
            "A logarithm is not available in whole numbers: use precision='float32', or leave "
            "out the outputs that need it."
        )

    def _root(self, which: str, order: int, a: Quantity, finest: int) -> Quantity:
        a = self.settled(a)
        room = ROOM - magnitude(a.value).bit_length()
        fraction = min(finest, (room + a.fraction) // order, FINEST)
        value = shifted(a.value, order * fraction - a.fraction)
        return Quantity(call(which, value), fraction)

    def negate(self, a: Quantity) -> Quantity:
        """Return −a."""
        a = self.settled(a)
        return Quantity(call("negate", a.value), a.fraction)

    def absolute(self, a: Quantity) -> Quantity:
        """Return |a|."""
        a = self.settled(a)
        return Quantity(call("absolute", a.value), a.fraction)

    def compare(self, how: str, a: Quantity, b: Quantity) -> Quantity:
        """Return whether a is "greater" than, "at_least" or "equal" to b."""
        fraction = self.common((a, b), FINEST)
        both = self.brought(a, fraction), self.brought(b, fraction)
        if both[0] == both[1]:  # compilers warn of a number that is compared with itself
            return Quantity(ir.Integer(int(how != "greater")))
        return Quantity(call(how, *both))

    def select(self, holds: Quantity, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a where a flag holds, else b."""
        fraction = self.common((a, b), finest)
        both = self.brought(a, fraction), self.brought(b, fraction)
        return Quantity(call("pick", holds.value, *both), fraction)

    def bits_beside(self, some: Sequence[Quantity], terms: int = 1) -> int:
        """Return the bits of the constant factors in a sum of products.

        A memory has more than 16 bits, and a product with it takes 64 bits anyway. There, a factor
        such as 0.999 of a slow average has up to 24: an error of it adds up frame by frame.

        Parameters
        ----------
        some : sequence of Quantity
            What the factors multiply.
        terms : int
            Products of each of them.
        """
        longest = max((magnitude(quantity.value).bit_length() for quantity in some), default=0)
        room = SUMMED - longest - (terms * len(some)).bit_length()
        return max(self.weight, min(FACTOR, room)) if longest > SHORT else self.weight

    def weights(self, numbers: Sequence[float], bits: int = 0) -> tuple[list[int], int]:
        """Return the weights of a template as whole numbers, and their fraction.

        Parameters
        ----------
        numbers : sequence of float
        bits : int
            Bits of a weight; 0 for those of the precision.
        """
        bits = bits or self.weight
        largest = max((abs(number) for number in numbers), default=0.0)
        if not largest:
            return [0 for _ in numbers], 0
        fraction = bits - 1 - ceil(log2(largest))
        whole = [nearest(Fraction(number) * Fraction(2) ** fraction) for number in numbers]
        if max(abs(number) for number in whole) >= 1 << (bits - 1):
            fraction -= 1
            whole = [nearest(Fraction(number) * Fraction(2) ** fraction) for number in numbers]
        while fraction > 0 and all(number % 2 == 0 for number in whole):
            whole, fraction = [number // 2 for number in whole], fraction - 1
        return whole, fraction

    def weighted(self, terms: Sequence[tuple[float, Quantity]], finest: int) -> Quantity:
        """Return a sum of quantities with weights that share a fraction."""
        bits = self.bits_beside([quantity for _, quantity in terms])
        whole, fraction = self.weights([weight for weight, _ in terms], bits)
        sums: dict[int, list[ir.Expression]] = {}
        for weight, (_, quantity) in zip(whole, terms, strict=True):
            if not weight:
                continue
            term = (
                quantity.value
                if weight == 1
                else call("multiply", quantity.value, ir.Integer(weight))
            )
            sums.setdefault(quantity.fraction, []).append(term)
        if not sums:
            return Quantity(ir.Integer(0), 0)
        products = {at: total(parts) for at, parts in sorted(sums.items())}
        rooms = (
            at + SUMMED - magnitude(product_sum).bit_length()
            for at, product_sum in products.items()
        )
        met = min(max(sums), min(sums) + SPREAD, *rooms)
        whole_sum = total([shifted(product_sum, met - at) for at, product_sum in products.items()])
        fraction += met
        return Quantity(shifted(whole_sum, min(0, finest - fraction)), min(fraction, finest))


@dataclass(frozen=True, slots=True)
class Reals:
    """Floating-point arithmetic; fractions and formats have no meaning."""

    def brought(self, quantity: Quantity, fraction: int) -> ir.Expression:
        """Return the number itself."""
        return quantity.value

    def fit(self, quantity: Quantity, format: Format | None) -> Quantity:
        """Return the number itself."""
        return quantity

    def stored(self, quantity: Quantity, format: Format | None) -> ir.Expression:
        """Return the number itself."""
        return quantity.value

    def add(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a + b."""
        return _made("add", a, b)

    def subtract(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a − b."""
        return _made("subtract", a, b)

    def extreme(self, which: str, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return the "minimum" or the "maximum"."""
        return _made(which, a, b)

    def multiply(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a · b."""
        return _made("multiply", a, b)

    def divide(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a / b; 0 where b is 0."""
        return _made("ratio", a, b)

    def root(self, a: Quantity, finest: int) -> Quantity:
        """Return √a; 0 below 0."""
        return _made("real_root", a)

    def power(self, a: Quantity, exponent: Fraction, finest: int) -> Quantity:
        """Return a to a power; 0 where a is not above 0."""
        return Quantity(call("power", _real(a), ir.Number(float(exponent))))

    def exponential(self, a: Quantity, finest: int) -> Quantity:
        """Return e to the power of a."""
        return _made("exponential", a)

    def logarithm(self, a: Quantity, finest: int) -> Quantity:
        """Return the natural logarithm of a; 0 where a is not above 0."""
        return _made("logarithm", a)

    def negate(self, a: Quantity) -> Quantity:
        """Return −a."""
        return _made("negate", a)

    def absolute(self, a: Quantity) -> Quantity:
        """Return |a|."""
        return _made("absolute", a)

    def compare(self, how: str, a: Quantity, b: Quantity) -> Quantity:
        """Return whether a is "greater" than, "at_least" or "equal" to b."""
        return _made(how, a, b)

    def select(self, holds: Quantity, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a where a flag holds, else b."""
        both = a.value, b.value
        if None in (both[0].bounds, both[1].bounds):
            both = _real(a), _real(b)
        return Quantity(call("pick", holds.value, *both))

    def weighted(self, terms: Sequence[tuple[float, Quantity]], finest: int) -> Quantity:
        """Return a sum of quantities with weights."""
        known = [
            call("multiply", _real(quantity), ir.Number(weight))
            for weight, quantity in terms
            if weight
        ]
        return Quantity(total(known) if known else ir.Number(0.0))


def _real(quantity: Quantity) -> ir.Expression:
    """Return the number, of a logic value as a real one."""
    return quantity.value if quantity.value.bounds is None else call("to_real", quantity.value)


def _made(which: str, *given: Quantity) -> Quantity:
    return Quantity(call(which, *(_real(quantity) for quantity in given)))


Arithmetic = Fixed | Reals


def applied(arithmetic: Arithmetic, name: str, given: Sequence[Quantity], finest: int) -> Quantity:
    """Return the result of an operation of the graph on quantities.

    Raises
    ------
    NotSupportedError
        If the precision does not support the operation.
    """
    if name == "not":
        return Quantity(opposite(_logic(given[0])))
    if name in ("and", "or", "xor"):
        return Quantity(call(name, *(_logic(quantity) for quantity in given)))
    if name == "select":
        holds, yes, no = given
        return arithmetic.select(Quantity(_logic(holds)), yes, no, finest)
    if len(given) == 1:
        return _of_one(arithmetic, name, given[0], finest)
    return _of_two(arithmetic, name, given[0], given[1], finest)


def _of_one(arithmetic: Arithmetic, name: str, a: Quantity, finest: int) -> Quantity:
    if name == "negate":
        return arithmetic.negate(a)
    if name == "absolute":
        return arithmetic.absolute(a)
    if name == "root":
        return arithmetic.root(a, finest)
    if name == "logarithm":
        return arithmetic.logarithm(a, finest)
    assert name == "exponential"
    return arithmetic.exponential(a, finest)


def _of_two(arithmetic: Arithmetic, name: str, a: Quantity, b: Quantity, finest: int) -> Quantity:
    if name == "add":
        return arithmetic.add(a, b, finest)
    if name == "subtract":
        return arithmetic.subtract(a, b, finest)
    if name == "multiply":
        return arithmetic.multiply(a, b, finest)
    if name == "divide":
        return arithmetic.divide(a, b, finest)
    if name in ("minimum", "maximum"):
        return arithmetic.extreme(name, a, b, finest)
    if name in ("greater", "at_least", "equal"):
        return arithmetic.compare(name, a, b)
    assert name == "power"
    if b.exact is None:
        raise NotSupportedError(
            "A power needs a constant exponent, got a varying one: leave out the outputs "
            "that need it."
        )
    # the graph's constant is the nearest double: 1/3 stays 1/3
    return arithmetic.power(a, b.exact.limit_denominator(10**9), finest)


def _logic(quantity: Quantity) -> ir.Expression:
    """Return a flag as 0 or 1."""
    return quantity.value if quantity.exact is None else ir.Integer(int(quantity.exact != 0))
