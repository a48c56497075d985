"""Local operations of a cell, or of numbers, by the arithmetic of a precision."""

from collections.abc import Sequence

from cnnum import kernels as ir
from cnnum.embedded.arithmetic.fixed import Fixed, Quantity
from cnnum.embedded.arithmetic.reals import Reals
from cnnum.embedded.arithmetic.whole import call, opposite
from cnnum.errors import NotSupportedError

Arithmetic = Fixed | Reals


def applied(arithmetic: Arithmetic, name: str, given: Sequence[Quantity], finest: int) -> Quantity:
    """Return the result of an operation of the graph on quantities.

    Raises
    ------
    NotSupportedError
        If the precision has no such operation.
    """
    if name == "not":
        return Quantity(opposite(_logic(given[0])))
    if name in ("and", "or", "xor"):
        return Quantity(call(name, *(_logic(one) for one in given)))
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


def _logic(one: Quantity) -> ir.Expression:
    """Return a flag as 0 or 1."""
    return one.value if one.exact is None else ir.Integer(int(one.exact != 0))
