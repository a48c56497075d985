"""Expressions on whole numbers, each with the interval that it cannot leave; on reals without one.

The interval of an expression follows from those of its parts. So it says which C type is wide
enough, and a value that could leave 64 bits is refused where the expression is made.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

from cnnum.embedded.ir.primitives import PRIMITIVES, Bounds
from cnnum.errors import NotSupportedError

WIDEST = (1 << 63) - 1


@dataclass(frozen=True, slots=True)
class Whole:
    """A whole number that is written out."""

    value: int

    @property
    def bounds(self) -> Bounds:
        """The number itself."""
        return self.value, self.value


@dataclass(frozen=True, slots=True)
class Real:
    """A real number that is written out."""

    value: float
    bounds: None = None


@dataclass(frozen=True, slots=True)
class Name:
    """A variable; `bounds` is None for a real one."""

    text: str
    bounds: Bounds | None


@dataclass(frozen=True, slots=True)
class Item:
    """A number of an array."""

    array: str
    at: "Expression"
    bounds: Bounds | None


@dataclass(frozen=True, slots=True)
class Call:
    """A primitive on arguments, with whole parameters.

    Attributes
    ----------
    primitive : str
    arguments : tuple of Expression
    parameters : tuple of int
        Lengths of shifts, or limits.
    bounds : (int, int) or None
    """

    primitive: str
    arguments: "tuple[Expression, ...]"
    parameters: tuple[int, ...]
    bounds: Bounds | None


Expression = Whole | Real | Name | Item | Call


def call(primitive: str, *arguments: Expression, parameters: tuple[int, ...] = ()) -> Expression:
    """Return a primitive on arguments.

    Raises
    ------
    NotSupportedError
        If a value on the way could leave 64 bits.
    """
    known = PRIMITIVES[primitive]
    bounds = [one.bounds for one in arguments if one.bounds is not None]
    if known.always is not None:
        return Call(primitive, arguments, parameters, known.always)
    if len(bounds) < len(arguments) or primitive == "to_real":
        return Call(primitive, arguments, parameters, None)
    if primitive == "multiply" and arguments[0] == arguments[1]:
        most = max(abs(bounds[0][0]), abs(bounds[0][1]))
        return Call(primitive, arguments, parameters, (0, most * most))
    wide = [*known.within(bounds, parameters), known.bounds(bounds, parameters)]
    if any(max(-low, high) > WIDEST for low, high in wide):
        raise NotSupportedError(
            f"An intermediate value of '{primitive}' would need more than 64 bits: take a "
            "precision with fewer bits, or narrower ranges."
        )
    low, high = wide[-1]
    if low == high:  # expressions do nothing else than have a value
        return Whole(low)
    return Call(primitive, arguments, parameters, (low, high))


CHAIN = 32
"""Terms of a sum that are added one after the other; longer ones are sums of such sums."""


def total(terms: Sequence[Expression]) -> Expression:
    """Return the sum of terms, of which there is at least one."""
    while len(terms) > CHAIN:
        terms = [total(terms[at : at + CHAIN]) for at in range(0, len(terms), CHAIN)]
    return reduce(lambda a, b: call("add", a, b), terms)


def limited(value: Expression, low: int, high: int) -> Expression:
    """Return a value kept within limits; the value itself where it cannot leave them."""
    assert value.bounds is not None
    if low <= value.bounds[0] and value.bounds[1] <= high:
        return value
    return call("limit", value, parameters=(low, high))


def shifted(value: Expression, places: int) -> Expression:
    """Return a value times 2^places; halves are rounded up."""
    if not places:
        return value
    if isinstance(value, Whole) and places > 0:
        return Whole(value.value << places)
    if places < -62:
        return Whole(0)
    return call("up" if places > 0 else "down", value, parameters=(abs(places),))


def magnitude(value: Expression) -> int:
    """Return the largest magnitude that a whole value can have."""
    assert value.bounds is not None
    return max(-value.bounds[0], value.bounds[1], 1)
