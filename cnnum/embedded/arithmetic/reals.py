"""Arithmetic in floating-point numbers by the interface of `cnnum.embedded.arithmetic.fixed.Fixed`.

It measures the range of every value before formats are chosen, and it prints float32.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from cnnum import kernels as ir
from cnnum.embedded.arithmetic.fixed import Quantity
from cnnum.embedded.arithmetic.whole import call, total
from cnnum.embedded.formats import Format


@dataclass(frozen=True, slots=True)
class Reals:
    """Reals; fractions and formats are of no meaning."""

    def brought(self, one: Quantity, fraction: int) -> ir.Expression:
        """Return the number itself."""
        return one.value

    def fit(self, one: Quantity, format: Format | None) -> Quantity:
        """Return the number itself."""
        return one

    def stored(self, one: Quantity, format: Format | None) -> ir.Expression:
        """Return the number itself."""
        return one.value

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
        known = [call("multiply", _real(one), ir.Number(weight)) for weight, one in terms if weight]
        return Quantity(total(known) if known else ir.Number(0.0))


def _real(one: Quantity) -> ir.Expression:
    """Return the number, of a logic value as a real one."""
    return one.value if one.value.bounds is None else call("to_real", one.value)


def _made(which: str, *given: Quantity) -> Quantity:
    return Quantity(call(which, *(_real(one) for one in given)))
