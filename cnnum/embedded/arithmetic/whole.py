"""Expressions on whole numbers, each with the interval that it cannot leave; on reals without one.

The interval of an expression follows from those of its parts. So it says which C type is wide
enough. A value that could leave 64 bits is refused where the expression is made.
"""

from collections.abc import Sequence
from functools import reduce

from cnnum import kernels as ir
from cnnum.embedded.arithmetic.primitives import LOGIC, PRIMITIVES
from cnnum.errors import NotSupportedError

WIDEST = (1 << 63) - 1


def call(primitive: str, *arguments: ir.Expression) -> ir.Expression:
    """Return a primitive on arguments.

    Raises
    ------
    NotSupportedError
        If a value on the way could leave 64 bits.
    """
    known = PRIMITIVES[primitive]
    given = [one.bounds for one in arguments if one.bounds is not None]
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
            f"An intermediate value of '{primitive}' would need more than 64 bits: take a "
            "precision with fewer bits, or narrower ranges."
        )
    if bounds[0] == bounds[1]:  # expressions do nothing else than have a value
        return ir.Integer(bounds[0])
    return _record(primitive, arguments, bounds, within)


def _decided(primitive: str, given: Sequence[ir.Bounds]) -> int | None:
    """Return the result of a comparison that intervals decide, of which compilers would warn."""
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
    """Return a number of an array."""
    return ir.Element(ir.Name(array), at, bounds)


CHAIN = 32
"""Terms of a sum that are added one after the other; longer ones are sums of such sums."""


def total(terms: Sequence[ir.Expression]) -> ir.Expression:
    """Return the sum of terms, of which there is at least one."""
    while len(terms) > CHAIN:
        terms = [total(terms[at : at + CHAIN]) for at in range(0, len(terms), CHAIN)]
    return reduce(lambda a, b: call("add", a, b), terms)


def limited(value: ir.Expression, low: int, high: int) -> ir.Expression:
    """Return a value kept within limits; the value itself where it cannot leave them."""
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
