"""Powers of fields: products where the exponent is whole, roots, and the device's function."""

import math
from numbers import Real

from cnnum.errors import ProgramError
from cnnum.graph import elementwise as op
from cnnum.graph.nodes import Constant
from cnnum.programs.fields import Field, combine
from cnnum.safety.names import shown

LARGEST_POWER = 1024
"""Largest exponent of a power of a field; whole ones take twice its bits of multiplications."""


def power(base: object, exponent: object) -> Field:
    """Return a field raised to a number, or a number above 0 raised to a field.

    Whole powers are products; a negative one of 0 is 0, as 1 / 0 is. Others are 0 where the base is
    not above 0, as the root is.

    Raises
    ------
    ProgramError
        If neither is a number, or the number is out of range.
    """
    power, number = _number(exponent), _number(base)
    if power is not None and abs(power) <= LARGEST_POWER:
        if power.is_integer():
            whole = _product(base, abs(int(power)))
            return whole if power >= 0 else 1.0 / whole
        return combine(op.ROOT, base) if power == 0.5 else combine(op.POWER, base, power)
    if power is None and number is not None and 0 < number < math.inf:
        return combine(op.POWER, number, exponent)
    raise ProgramError(
        f"Expected a field raised to a number from -{LARGEST_POWER} to {LARGEST_POWER}, or a "
        f"number above 0 raised to a field; got {_shown(base)} raised to {_shown(exponent)}."
    )


def _shown(operand: object) -> str:
    number = _number(operand)
    if number is not None:
        return f"{number:g}" if math.isfinite(number) else shown(operand)
    return "a field" if isinstance(operand, Field) else f"{type(operand).__name__}"


def _number(operand: object) -> float | None:
    """Return the number that an operand is in every cell of every frame, None without one."""
    if isinstance(operand, Field):
        held = operand.node.operation
        return held.value if isinstance(held, Constant) else None
    if not isinstance(operand, Real):
        return None
    try:
        return float(operand)
    except OverflowError:  # of a whole number beyond all doubles, above or below
        return math.inf


def _product(base: object, count: int) -> Field:
    """Return a field times itself, `count` factors in all, by squares; 1 in every cell for none."""
    if count == 0:
        return combine(op.SELECT, combine(op.EQUAL, base, base), 1.0, 1.0)
    if count == 1:
        return combine(op.MULTIPLY, base, 1.0)
    half = _product(base, count // 2)
    square = combine(op.MULTIPLY, half, half)
    return square if count % 2 == 0 else combine(op.MULTIPLY, square, base)
