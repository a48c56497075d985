"""Expressions as C text: each in 32 bits where its interval allows, in 64 bits elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass

from cnnum.embedded.ir.expressions import Call, Expression, Item, Name, Real, Whole
from cnnum.embedded.ir.primitives import PRIMITIVES, Bounds
from cnnum.embedded.ir.statements import Array

MOST = (1 << 31) - 1
PREFIX = {"input": "in->", "state": "m->", "work": "m->", "output": "out->", "table": ""}
COMPARISONS = ("greater", "at_least", "equal")


def wide(bounds: Bounds) -> bool:
    """Return whether an interval needs more than 32 bits."""
    return bounds[0] < -MOST - 1 or bounds[1] > MOST


def type_of(bounds: Bounds | None) -> str:
    """Return the C type of a variable."""
    if bounds is None:
        return "float"
    return "int64_t" if wide(bounds) else "int32_t"


def element_type(array: Array) -> str:
    """Return the C type of an array's numbers."""
    if array.logic:
        return "uint8_t"
    if array.format is None:
        return "float"
    bits = next(bits for bits in (8, 16, 32) if array.format.bits <= bits)
    return f"int{bits}_t"


def whole(value: int) -> str:
    """Return a whole number as C writes it."""
    if value == -MOST - 1:
        return f"(-{MOST} - 1)"
    if wide((value, value)):
        return f"INT64_C({value})" if value >= 0 else f"(-INT64_C({-value}))"
    return str(value) if value >= 0 else f"({value})"


def real(value: float) -> str:
    """Return a real number as C writes it."""
    text = f"{value:.9g}"
    text = text if set(text) & {".", "e"} else f"{text}.0"
    return f"{text}f" if value >= 0 else f"({text}f)"


@dataclass(frozen=True, slots=True)
class CExpressions:
    """Writes expressions.

    Attributes
    ----------
    arrays : mapping of str to Array
    used : set of str
        Where the names of helpers and variables are noted.
    """

    arrays: Mapping[str, Array]
    used: set[str]

    def text(self, value: Expression) -> str:
        """Return the text of an expression."""
        if isinstance(value, Whole):
            return whole(value.value)
        if isinstance(value, Real):
            return real(value.value)
        if isinstance(value, Name):
            return self.name(value.text)
        if isinstance(value, Item):
            return f"{self.name(value.array)}[{self.text(value.at)}]"
        return self._call(value)

    def name(self, text: str) -> str:
        """Return how a variable or an array is written."""
        self.used.add(text)
        array = self.arrays.get(text)
        return text if array is None else PREFIX[array.kind] + text

    def _call(self, value: Call) -> str:
        known = PRIMITIVES[value.primitive]
        given = [one.bounds for one in value.arguments]
        whole_ones = [one for one in given if one is not None]
        real_ones = len(whole_ones) < len(given)
        within = [] if real_ones or known.always else known.within(whole_ones, value.parameters)
        result = [] if value.bounds is None else [value.bounds]
        counted = whole_ones[1:] if value.primitive == "pick" else whole_ones
        in_64 = not real_ones and any(map(wide, [*counted, *within, *result]))
        texts = [
            self._argument(one, in_64, value.primitive, n) for n, one in enumerate(value.arguments)
        ]
        width = "_real" if real_ones else "64" if in_64 else "32"
        text = known.c.format(*texts, w=width, **_parameters(value.parameters))
        self.used.add(text.split("(")[0])
        narrow = in_64 and value.bounds is not None and not wide(value.bounds)
        return f"(int32_t){text}" if narrow and not known.always else text

    def _argument(self, one: Expression, in_64: bool, primitive: str, place: int) -> str:
        text = self.text(one)
        narrow = one.bounds is not None and not wide(one.bounds) and not isinstance(one, Whole)
        widened = in_64 and narrow and not (primitive == "pick" and place == 0)
        return f"(int64_t){text}" if widened else text


def _parameters(parameters: tuple[int, ...]) -> dict[str, str]:
    if len(parameters) == 2:
        low, high = parameters
        return {"p": whole(low), "q": whole(high)}
    if len(parameters) == 1:
        (places,) = parameters
        return {"p": str(places), "h": whole(1 << (places - 1)), "u": whole(1 << places)}
    return {}
