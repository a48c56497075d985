"""Arithmetic on quantities: whole numbers with a fraction, or reals, by one interface.

Lowering asks for sums, products and roots; `Fixed` makes them of shifts and whole numbers, `Reals`
of floating-point numbers. A result is as fine as its operands make it, and not finer than its
format.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor, log2

from cnnum import kernels as ir
from cnnum.embedded.arithmetic.whole import call, limited, magnitude, shifted, total
from cnnum.embedded.formats import FINEST, Format
from cnnum.errors import NotSupportedError

ROOM = 62
"""Bits of a magnitude before a division or a root."""

SUMMED = 60
"""Bits of a magnitude that a sum adds; eight of them are below 2^63."""

SPREAD = 30
"""Places at most that an operand is moved up to meet another one."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """An expression, and the value of its whole numbers q: q · 2^−fraction.

    Attributes
    ----------
    value : Expression
    fraction : int
    exact : Fraction or None
        Of a constant: the number itself, which each operation rounds for itself.
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
    """Return a whole number of limited bits with its sign, and its fraction; the fewest bits."""
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

    def brought(self, one: Quantity, fraction: int) -> ir.Expression:
        """Return the whole numbers of a quantity at another fraction."""
        if one.exact is not None:
            return ir.Integer(nearest(one.exact * Fraction(2) ** fraction))
        return shifted(one.value, fraction - one.fraction)

    def common(self, some: Sequence[Quantity], finest: int) -> int:
        """Return the fraction at which quantities meet."""
        known = [one for one in some if one.exact is None]
        fractions = [one.fraction for one in known]
        for one in some:
            if one.exact is not None:
                fractions.append(min(significant(one.exact, self.weight)[1], finest))
        lowest = min([one.fraction for one in known], default=finest)
        return min(finest, max(fractions), lowest + SPREAD)

    def fit(self, one: Quantity, format: Format) -> Quantity:
        """Return a quantity in a format; values that do not fit saturate."""
        one = self.settled(one)
        fraction = min(one.fraction, format.fraction)
        value = limited(self.brought(one, fraction), format.least, format.largest)
        return Quantity(value, fraction)

    def stored(self, one: Quantity, format: Format) -> ir.Expression:
        """Return the whole numbers that a format holds of a quantity."""
        return limited(self.brought(one, format.fraction), format.least, format.largest)

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

    def settled(self, one: Quantity) -> Quantity:
        """Return a constant as the nearest whole number of 31 bits, and another one as it is."""
        if one.exact is None:
            return one
        whole, fraction = significant(one.exact, 31)
        return Quantity(ir.Integer(whole), min(fraction, FINEST))

    def multiply(self, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a · b; a factor that is a power of two only moves the point."""
        if a.exact is not None:
            a, b = b, self.settled(a) if b.exact is not None else a
            a = self.settled(a)
        if b.exact is not None:
            whole, fraction = significant(b.exact, self.weight)
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
            found = positive
            for _ in range(int(exponent) - 1):
                found = self.multiply(found, positive, finest)
            return found
        raise NotSupportedError(
            f"A power in whole numbers has the exponent 1/2, 1/3, 1, 2, 3 or 4, got {exponent!s}: "
            "use precision='float32'."
        )

    def exponential(self, a: Quantity, finest: int) -> Quantity:
        """Refuse.

        Raises
        ------
        NotSupportedError
            Always.
        """
        raise NotSupportedError(
            "An exponential has no form in whole numbers: use precision='float32', or leave out "
            "the outputs that need it."
        )

    def logarithm(self, a: Quantity, finest: int) -> Quantity:
        """Refuse.

        Raises
        ------
        NotSupportedError
            Always.
        """
        raise NotSupportedError(
            "A logarithm has no form in whole numbers: use precision='float32', or leave out the "
            "outputs that need it."
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
        return Quantity(call(how, self.brought(a, fraction), self.brought(b, fraction)))

    def select(self, holds: Quantity, a: Quantity, b: Quantity, finest: int) -> Quantity:
        """Return a where a flag holds, else b."""
        fraction = self.common((a, b), finest)
        both = self.brought(a, fraction), self.brought(b, fraction)
        return Quantity(call("pick", holds.value, *both), fraction)

    def weights(self, numbers: Sequence[float]) -> tuple[list[int], int]:
        """Return the weights of a template as whole numbers, and their fraction."""
        largest = max((abs(one) for one in numbers), default=0.0)
        if not largest:
            return [0 for _ in numbers], 0
        fraction = self.weight - 1 - ceil(log2(largest))
        whole = [nearest(Fraction(one) * Fraction(2) ** fraction) for one in numbers]
        if max(abs(one) for one in whole) >= 1 << (self.weight - 1):
            fraction -= 1
            whole = [nearest(Fraction(one) * Fraction(2) ** fraction) for one in numbers]
        while fraction > 0 and all(one % 2 == 0 for one in whole):
            whole, fraction = [one // 2 for one in whole], fraction - 1
        return whole, fraction

    def weighted(self, terms: Sequence[tuple[float, Quantity]], finest: int) -> Quantity:
        """Return a sum of quantities with weights that share a fraction."""
        whole, fraction = self.weights([weight for weight, _ in terms])
        sums: dict[int, list[ir.Expression]] = {}
        for weight, (_, one) in zip(whole, terms, strict=True):
            if not weight:
                continue
            term = one.value if weight == 1 else call("multiply", one.value, ir.Integer(weight))
            sums.setdefault(one.fraction, []).append(term)
        if not sums:
            return Quantity(ir.Integer(0), 0)
        products = {at: total(each) for at, each in sorted(sums.items())}
        rooms = (at + SUMMED - magnitude(one).bit_length() for at, one in products.items())
        met = min(max(sums), min(sums) + SPREAD, *rooms)
        whole_sum = total([shifted(one, met - at) for at, one in products.items()])
        fraction += met
        return Quantity(shifted(whole_sum, min(0, finest - fraction)), min(fraction, finest))
