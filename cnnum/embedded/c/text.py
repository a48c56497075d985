"""A program as text, C99 or OpenCL C, and its structures in NumPy."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.embedded.arithmetic import total
from cnnum.embedded.emulator import Numbers
from cnnum.embedded.program import Array, IntegerProgram
from cnnum.kernels.expressions import operand
from cnnum.kernels.number_types import FLOAT32, INT32
from cnnum.kernels.printer import PRIMARY, UNARY, C99Printer, Ranked
from cnnum.kernels.statements import live, names_in

_LIMIT = """static {t} limit{w}({t} value, {t} least, {t} most)
{{
    return value < least ? least : value > most ? most : value;
}}"""
_COUNTED_LIMIT = """#ifdef CNNUM_COUNT_SATURATIONS
/* numbers that do not fit are counted where they are limited */
static {t} counted{w}(uint32_t *count, {t} value, {t} least, {t} most)
{{
    *count += value < least || value > most ? 1u : 0u;
    return limit{w}(value, least, most);
}}
#define limit{w}(value, least, most) counted{w}(&m->saturated, value, least, most)
#endif"""
_COUNTED_31 = """#ifdef CNNUM_COUNT_SATURATIONS
#define limited31(value) ((int32_t)limit64(value, -1073741824, 1073741823))
#endif"""
_PAIR = """static {t} {n}{w}({t} a, {t} b)
{{
    return a {s} b ? a : b;
}}"""
_ABSOLUTE = """static {t} absolute{w}({t} value)
{{
    return value < 0 ? -value : value;
}}"""
_QUOTIENT = """/* to the nearest, halves away from 0; 0 where b is 0 */
static {t} quotient{w}({t} a, {t} b)
{{
    const u{t} top = a < 0 ? 0u - (u{t})a : (u{t})a;
    const u{t} bottom = b < 0 ? 0u - (u{t})b : (u{t})b;
    {t} whole;
    if (b == 0) {{
        return 0;
    }}
    whole = ({t})((top + bottom / 2u) / bottom);
    return (a < 0) != (b < 0) ? -whole : whole;
}}"""
_ZEROS = """/* the zeros before the first bit of a number above 0 */
static int32_t zeros(uint32_t value)
{
#if defined(__GNUC__) && __SIZEOF_INT__ == 4 && !defined(__OPENCL_VERSION__)
    return (int32_t)__builtin_clz(value);
#else
    int32_t count = 0;
    for (; (value >> 31) == 0u; value <<= 1) {
        ++count;
    }
    return count;
#endif
}"""
_SCALED_ROOT = """/* the root, rounded down, of a number from 2^30 on: a line that is at most
   3 % off, two of Newton's steps, which end at the root or 1 above it, and one back */
static uint32_t scaled_root(uint32_t value)
{
    uint32_t root = (((value >> 16) + 32768u) * 11u) >> 4;
    root = (root + value / root) >> 1;
    root = (root + value / root) >> 1;
    return root > value / root ? root - 1u : root;
}"""
_WHOLE_ROOT = """/* the largest whole number whose square is not above the value */
static uint32_t whole_root(uint32_t value)
{
    int32_t places;
    if (value == 0u) {
        return 0u;
    }
    places = zeros(value) / 2;
    return scaled_root(value << (2 * places)) >> places;
}"""
_ROOT32 = """static int32_t root32(int32_t value)
{
    return value > 0 ? (int32_t)whole_root((uint32_t)value) : 0;
}"""
_ROOT64 = """/* the root of the upper half, and a division for the lower one: Zimmermann 1999,
   "Karatsuba square root" */
static int64_t root64(int64_t value)
{
    uint64_t scaled = value > 0 ? (uint64_t)value : 0u;
    uint32_t first, left, low, root;
    int32_t places;
    if ((scaled >> 32) == 0u) {
        return (int64_t)whole_root((uint32_t)scaled);
    }
    places = zeros((uint32_t)(scaled >> 32)) / 2;
    scaled <<= 2 * places;
    first = scaled_root((uint32_t)(scaled >> 32));
    left = (uint32_t)(scaled >> 32) - first * first;
    low = ((left << 15) | ((uint32_t)scaled >> 17)) / first;
    root = (first << 16) + (low > 65535u ? 65535u : low);
    if ((uint64_t)root * root > scaled) {
        --root;
    }
    return (int64_t)(root >> places);
}"""
_CUBE_ROOT = """/* the largest whole number whose cube is not above the value */
static int64_t cube_root64(int64_t value)
{
    uint64_t left = value > 0 ? (uint64_t)value : 0u, root = 0u;
    int place;
    for (place = 60; place >= 0; place -= 3) {
        uint64_t step;
        root *= 2u;
        step = 3u * root * (root + 1u) + 1u;
        if ((left >> place) >= step) {
            left -= step << place;
            root += 1u;
        }
    }
    return (int64_t)root;
}"""
_REALS = {
    "minimum_real": _PAIR.format(t="float", n="minimum", w="_real", s="<"),
    "maximum_real": _PAIR.format(t="float", n="maximum", w="_real", s=">"),
    "absolute_real": _ABSOLUTE.format(t="float", w="_real"),
    "ratio": """static float ratio(float a, float b)
{
    return b < 0.0f || b > 0.0f ? a / b : 0.0f;
}""",
    "real_root": "static float real_root(float a)\n{\n    return a > 0.0f ? sqrtf(a) : 0.0f;\n}",
    "power": """static float power(float a, float b)
{
    return a > 0.0f ? expf(b * logf(a)) : 0.0f;
}""",
    "logarithm": "static float logarithm(float a)\n{\n    return a > 0.0f ? logf(a) : 0.0f;\n}",
    "exponential": "static float exponential(float a)\n{\n    return expf(a);\n}",
}


def _whole_ones(bits: int) -> dict[str, str]:
    kind, width = f"int{bits}_t", str(bits)
    return {
        f"limit{bits}": _LIMIT.format(t=kind, w=width),
        f"minimum{bits}": _PAIR.format(t=kind, n="minimum", w=width, s="<"),
        f"maximum{bits}": _PAIR.format(t=kind, n="maximum", w=width, s=">"),
        f"absolute{bits}": _ABSOLUTE.format(t=kind, w=width),
        f"quotient{bits}": _QUOTIENT.format(t=kind, w=width),
    }


_DIGIT = """/* 16 bits of a quotient, and what is left for the next: Knuth 1997, algorithm D */
static uint32_t digit(uint32_t *left, uint32_t next, uint32_t divisor)
{
    const uint32_t high = divisor >> 16, low = divisor & 65535u;
    uint32_t whole = *left / high, rest = *left % high;
    while (rest < 65536u && whole * low > (rest << 16) + next) {
        --whole;
        rest += high;
    }
    *left = (*left << 16) + next - whole * divisor;
    return whole;
}"""
_QUOTIENT_BY_32 = """/* quotient64 for a divisor of 32 bits: no division of 64 bits */
static int64_t quotient_by_32(int64_t a, int32_t b)
{
    const uint32_t bottom = b < 0 ? 0u - (uint32_t)b : (uint32_t)b;
    const uint64_t top = (a < 0 ? 0u - (uint64_t)a : (uint64_t)a) + bottom / 2u;
    uint32_t first, second, left, divisor;
    uint64_t scaled;
    int64_t whole;
    if (b == 0) {
        return 0;
    }
    divisor = bottom << zeros(bottom);
    scaled = ((uint64_t)((uint32_t)(top >> 32) % bottom) << 32) | (uint32_t)top;
    scaled <<= zeros(bottom);
    left = (uint32_t)(scaled >> 32);
    first = digit(&left, (uint32_t)scaled >> 16, divisor);
    second = digit(&left, (uint32_t)scaled & 65535u, divisor);
    whole = (int64_t)(((uint64_t)((uint32_t)(top >> 32) / bottom) << 32) | (first << 16) | second);
    return (a < 0) != (b < 0) ? -whole : whole;
}"""
_LIMITED_31 = """/* limited to 31 bits: to 32 first, and then by SSAT, where the core has it */
static inline int32_t limited31(int64_t value)
{
#if CNNUM_PAIRS && defined(__thumb2__)
    int32_t low = (int32_t)value;
    const int32_t high = (int32_t)(value >> 32), most = 0x7FFFFFFF;
    __asm__("cmp %1, %0, asr #31\\n\\t"
            "it ne\\n\\t"
            "eorne %0, %2, %1, asr #31\\n\\t"
            "ssat %0, #31, %0" : "+r"(low) : "r"(high), "r"(most) : "cc");
    return low;
#else
    return (int32_t)limit64(value, -1073741824, 1073741823);
#endif
}"""
_PAIRS = """/* a sum and two products of 16 bits, by SMLAD where the core has it */
static inline int32_t plus_pair(int32_t sum, const int16_t *at, int16_t first, int16_t second)
{
#if CNNUM_PAIRS
    const uint32_t weights = (uint32_t)(uint16_t)first | ((uint32_t)(uint16_t)second << 16);
    uint32_t both;
    __builtin_memcpy(&both, at, sizeof both);
    __asm__("smlad %0, %1, %2, %0" : "+r"(sum) : "r"(both), "r"(weights));
    return sum;
#else
    return sum + at[0] * first + at[1] * second;
#endif
}"""
_PRODUCTS = """/* a sum and products of 16 bits, two by two by SMLALD where the core has it */
static inline int64_t plus_products(int64_t sum, const int16_t *a, const int16_t *b, int32_t count)
{
    int32_t n = 0;
#if CNNUM_PAIRS
    uint32_t low = (uint32_t)(uint64_t)sum, high = (uint32_t)((uint64_t)sum >> 32);
    for (; n + 1 < count; n += 2) {
        uint32_t of_a, of_b;
        __builtin_memcpy(&of_a, a + n, sizeof of_a);
        __builtin_memcpy(&of_b, b + n, sizeof of_b);
        __asm__("smlald %0, %1, %2, %3" : "+r"(low), "+r"(high) : "r"(of_a), "r"(of_b));
    }
    sum = (int64_t)(((uint64_t)high << 32) | low);
#endif
    for (; n < count; ++n) {
        sum += a[n] * b[n];
    }
    return sum;
}"""
IN_C = {
    "digit": _DIGIT, "quotient_by_32": _QUOTIENT_BY_32, "limited31": _LIMITED_31,
    "plus_pair": _PAIRS, "plus_products": _PRODUCTS,
}  # fmt: skip
"""Functions in C alone, which are faster on small cores: OpenCL C has pointers of other kinds."""

PAIRS = [
    "/* DSP instructions: two products of 16 bits at once, and limits; the answers are the same",
    "   with 0, which turns them off */",
    "#ifndef CNNUM_PAIRS",
    "#if defined(__ARM_FEATURE_DSP) && defined(__GNUC__) && !defined(__ARM_BIG_ENDIAN)",
    "#define CNNUM_PAIRS 1",
    "#else",
    "#define CNNUM_PAIRS 0",
    "#endif",
    "#endif",
]

HELPERS = {
    **_whole_ones(32), **_whole_ones(64), "zeros": _ZEROS, "scaled_root": _SCALED_ROOT,
    "whole_root": _WHOLE_ROOT, "root32": _ROOT32, "root64": _ROOT64, "cube_root64": _CUBE_ROOT,
    **_REALS, **IN_C,
}  # fmt: skip
"""By name; those that another one calls stand before it."""


PREFIX = {"input": "in->", "state": "m->", "work": "m->", "output": "out->", "table": ""}
APART = PREFIX | {"work": "w->"}
WIDTHS = {"uint8_t": 1, "int8_t": 1, "int16_t": 2, "int32_t": 4, "float": 4}


@dataclass(frozen=True, slots=True)
class CText:
    """The parts of the text.

    Attributes
    ----------
    helpers : list of str
        Functions.
    tables : list of Array
        Constants that are read.
    body : list of str
        Lines of one frame.
    memory : list of Array
        The arrays in memory: those that outlive a frame first.
    """

    helpers: list[str]
    tables: list[Array]
    body: list[str]
    memory: list[Array]

    @property
    def kept(self) -> list[Array]:
        """The arrays that outlive a frame."""
        return [array for array in self.memory if array.kind == "state"]

    @property
    def scratch(self) -> list[Array]:
        """The arrays that a frame works in."""
        return [array for array in self.memory if array.kind != "state"]

    @property
    def memory_bytes(self) -> int:
        """The size of what is kept and of the scratch together, as C lays them out."""
        scratch = -(-bytes_of(self.scratch) // 4) * 4
        return bytes_of(self.kept, memory=True) + scratch


MEMORY_ENDS = [ir.Integer(-(1 << 30)), ir.Integer((1 << 30) - 1)]
"""The ends of 31 bits, as memories and values within a frame have."""


@dataclass(frozen=True, slots=True)
class _CorePrinter(C99Printer):
    """Writes what a small core does faster: products of 16 bits by two, limits, quotients."""

    def call(self, call: ir.Call) -> Ranked:
        """Write a limit to 31 bits of a wide number, or a quotient with a narrow divisor."""
        first, *others = call.arguments
        if first.bounds is not None and self.whole.needs_wide(call.within or first.bounds):
            if call.function == "limit" and others == MEMORY_ENDS:
                return f"limited31({self.expression(first)})", PRIMARY
            divisor = others[0].bounds if call.function == "quotient" else None
            if divisor is not None and not self.whole.needs_wide(divisor):
                inner = f"{self._widened(first, 0)}, {self.expression(others[0])}"
                return self._narrowed((f"quotient_by_32({inner})", PRIMARY), call, wide=True)
        return C99Printer.call(self, call)

    def binary(self, both: ir.Binary) -> Ranked:
        """Write a sum of 32 bits with its products of neighbours as pairs."""
        if both.sign == "+" and (text := self._in_pairs(both)):
            return text, PRIMARY
        return C99Printer.binary(self, both)

    def loop(self, loop: ir.Loop) -> list[str]:
        """Write a sum of 64 bits of products of numbers that follow each other as a call."""
        v = loop.variable
        match loop.body:
            case (ir.Assign(ir.Name() as sum, ir.Binary("*", a, b), "+="),):
                ends = [self._start(part, v) for part in (a, b)]
                wide = sum.bounds is not None and self.whole.needs_wide(sum.bounds)
                if wide and all(ends) and (loop.start, loop.step) == (0, 1):
                    places, end = ", ".join(map(str, ends)), self.expression(operand(loop.end))
                    name = self.expression(sum)
                    return [f"{name} = plus_products({name}, {places}, {end});"]
            case _:
                pass
        return C99Printer.loop(self, loop)

    def _short(self, array: ir.Name) -> bool:
        return self.elements.get(array.text) == "int16_t"

    def _start(self, part: ir.Expression, variable: ir.Name) -> str:
        """Return where the numbers of a factor begin, or "" if they do not follow each other."""
        if not isinstance(part, ir.Element) or not self._short(part.array):
            return ""
        if part.at == variable:
            return self.name(part.array)[0]
        place = _without(part.at, variable)
        return "" if place is None else f"&{self.name(part.array)[0]}[{self.expression(place)}]"

    def _in_pairs(self, sum: ir.Binary) -> str:
        """Return the text of a sum, or "" if it has no pairs, or may leave 32 bits on the way."""
        terms = list(_terms(sum))
        bounds = [term.bounds for term in terms if term.bounds is not None]
        ends = sum_of_bounds(bounds)
        if len(bounds) < len(terms) or self.whole.needs_wide(ends):
            return ""
        known = [self._weighted(term) for term in terms]
        places = {key[:3]: n for n, key in enumerate(known) if key}
        text, left = "", dict(enumerate(terms))
        for n, key in enumerate(known):
            if key is None or n not in left:
                continue
            other = places.get((key[0], key[1], key[2] + 1))
            if other is None or other not in left or places[key[:3]] != n:
                continue
            weights = key[3], known[other][3]  # type: ignore[index]
            del left[n], left[other]
            array, place = ir.Name(key[0]), self.expression(key[4].at)
            at = f"&{self.name(array)[0]}[{place}]"
            text = f"plus_pair({text or '@'}, {at}, {weights[0]}, {weights[1]})"
        if not text:
            return ""
        rest = " + ".join(self.within(term, UNARY) for term in left.values())
        return text.replace("@", rest or "0", 1)

    def _weighted(self, term: ir.Expression) -> tuple[str, str, int, int, ir.Element] | None:
        """Return array, base, distance and weight of a number of 16 bits times a constant."""
        weight = 1
        match term:
            case ir.Binary("*", ir.Element() as number, ir.Integer(weight)):
                pass
            case ir.Element() as number:
                pass
            case _:
                return None
        if not self._short(number.array) or not -(1 << 15) <= weight < 1 << 15:
            return None
        match number.at:
            case ir.Binary("+", ir.Name(base), ir.Integer(distance)):
                return number.array.text, base, distance, weight, number
            case ir.Name(base):
                return number.array.text, base, 0, weight, number
            case _:
                return None


def sum_of_bounds(some: Sequence[ir.Bounds]) -> ir.Bounds:
    """Return the interval that no part of a sum leaves, in whichever order it is added."""
    return sum(min(low, 0) for low, _ in some), sum(max(high, 0) for _, high in some)


def _terms(value: ir.Expression) -> Iterable[ir.Expression]:
    """Yield the terms of a sum of sums."""
    if isinstance(value, ir.Binary) and value.sign == "+":
        yield from _terms(value.left)
        yield from _terms(value.right)
    else:
        yield value


def _without(place: ir.Expression, variable: ir.Name) -> ir.Expression | None:
    """Return a sum without a variable that it adds once, or None if there is no such term."""
    terms = list(_terms(place))
    others = [term for term in terms if term != variable]
    if len(others) != len(terms) - 1 or variable.text in names_in(tuple(others)):
        return None
    return total(others)


def c_text(program: IntegerProgram, *, shares: bool = False, c99: bool = False) -> CText:
    """Return the parts of a program's text; of its arrays only those that are read.

    With `shares`, working arrays that are not needed at the same time lie in the same place. With
    `c99`, they have a structure of their own, `w`, and products of 16 bits are written two by two.
    """
    body = live(program.body, set[str]())
    places = _shared(program, body) if shares else {}
    names = {name: places[name].name if name in places else name for name in program.arrays}
    prefix = APART if c99 else PREFIX
    printer = (_CorePrinter if c99 else C99Printer)(
        FLOAT32,
        {name: f"{prefix[array.kind]}{names[name]}" for name, array in program.arrays.items()},
        {name: element_type(array) for name, array in program.arrays.items()},
        HELPERS,
    )
    lines, used = printer.lines(body, 1), names_in(body)
    text = "\n".join(lines)
    helpers, written = list[str](), text
    for name, code in reversed(HELPERS.items()):
        if re.search(rf"\b{name}\(", written):
            helpers.insert(0, code)
            written += code
    arrays = [array for array in program.arrays.values() if array.name in used]
    kept = [array for array in arrays if array.kind == "state"]
    work = [places.get(array.name, array) for array in arrays if array.kind == "work"]
    if c99:
        counted = [
            _COUNTED_LIMIT.format(t=f"int{bits}_t", w=bits)
            for bits in (32, 64)
            if HELPERS[f"limit{bits}"] in helpers
        ]
        helpers += counted
        if _LIMITED_31 in helpers:
            helpers.append(_COUNTED_31)
    return CText(
        helpers,
        [array for array in arrays if array.kind == "table"],
        lines,
        [array for array in arrays if array.kind in ("state", "work")]
        if not shares
        else [*kept, *{array.name: array for array in work}.values()],
    )


def _shared(program: IntegerProgram, body: Sequence[ir.Statement]) -> dict[str, Array]:
    """Return the places of working arrays, which those of one type share one after the other.

    An array is written in every frame before it is read, and no longer needed after the last
    statement that names it.
    """
    spans: dict[str, tuple[int, int]] = {}
    for number, statement in enumerate(body):
        for name in names_in(statement):
            array = program.arrays.get(name)
            if array is not None and array.kind == "work":
                spans[name] = spans.get(name, (number, number))[0], number
    result, places = dict[str, Array](), list[Array]()
    ends: dict[str, int] = {}
    for name, (first, last) in sorted(spans.items(), key=lambda span: span[1]):
        array = program.arrays[name]
        kind, length = element_type(array), max(1, array.length)
        free = [p for p in places if ends[p.name] < first and element_type(p) == kind]
        # the smallest that holds it, or else the largest, which grows
        fits = sorted((place for place in free if place.length >= length), key=_length)
        grows = sorted((place for place in free if place.length < length), key=_length)[-1:]
        if place := next(iter([*fits, *grows]), None):
            places.remove(place)
            place = replace(place, length=max(place.length, length))
        else:
            shared_name = f"shared_{len(places)}"
            place = replace(array, name=shared_name, length=length, about="several, in turn")
        places.append(place)
        ends[place.name] = last
        result[name] = place
    sizes = {place.name: place for place in places}
    return {name: sizes[place.name] for name, place in result.items()}


def _length(array: Array) -> int:
    return array.length


def element_type(array: Array) -> str:
    """Return the C type of an array's numbers."""
    if array.logic:
        return "uint8_t"
    if array.format is None:
        return FLOAT32.scalar
    return f"int{array.bits}_t"


def literal(array: Array, value: float) -> str:
    """Return a number of an array as C writes it."""
    if array.format is None and not array.logic:
        return C99Printer(FLOAT32).expression(ir.Number(value))
    return INT32.literal(int(value))


def members(arrays: Iterable[Array]) -> list[str]:
    """Return the members of a structure, the widest first, so that nothing is padded."""
    return [
        f"    {element_type(array)} {declared(array)}; {comment(array)}"
        for array in in_order(arrays)
    ]


def in_order(arrays: Iterable[Array]) -> list[Array]:
    """Return the members of a structure in their order, the widest first."""
    return sorted(arrays, key=lambda array: -WIDTHS[element_type(array)])


def declared(array: Array) -> str:
    """Return how an array or a number is declared."""
    return f"{array.name}[{array.length}]" if array.length else array.name


def comment(array: Array) -> str:
    """Return an array's content, as a comment."""
    words = array.about.replace("*/", "")
    if array.logic:
        return f"/* {words}: 0 or 1 */"
    if array.format is None:
        return f"/* {words} */"
    return f"/* {words}: times 2^{-array.format.fraction} */"


def table_lines(array: Array, kind: str) -> list[str]:
    """Return the definition of a table."""
    assert array.values is not None
    flat = np.asarray(array.values).ravel()
    numbers = [literal(array, number) for number in flat.tolist()]
    rows = [numbers[at : at + 12] for at in range(0, len(numbers), 12)]
    lines = [f"    {', '.join(row)}," for row in rows]
    head = f"{kind} {element_type(array)} {array.name}[{array.length}] = {{"
    return [f"/* {array.about} */", head, *lines, "};"]


def size_of(arrays: Iterable[Array]) -> int:
    """Return how many bytes arrays take."""
    return sum(WIDTHS[element_type(array)] * max(1, array.length) for array in arrays)


CODES = {"float": "<f4", "uint8_t": "<u1", "int8_t": "<i1", "int16_t": "<i2", "int32_t": "<i4"}


def record_type(arrays: Sequence[Array], *, memory: bool = False) -> np.dtype[Any]:
    """Return the layout of a structure of the header, its widest members first.

    Parameters
    ----------
    arrays : sequence of Array
    memory : bool
        Whether it is that of the memory, which begins with a flag and a count.
    """
    members: list[Any] = [
        (array.name, CODES[element_type(array)], (max(1, array.length),))
        for array in in_order(arrays)
    ]
    if memory:
        members = [("started", "<i4"), ("saturated", "<u4"), *members]
    return np.dtype(members or [("nothing", "<u1")], align=True)


def bytes_of(arrays: Sequence[Array], *, memory: bool = False) -> int:
    """Return the size of a structure, with the bytes that C adds at its end."""
    return record_type(arrays, memory=memory).itemsize


def packed(
    arrays: Sequence[Array], values: Mapping[str, Numbers], batch: int, *, memory: bool = False
) -> NDArray[Any]:
    """Return a batch of structures; fields that are not given are 0."""
    records = np.zeros(batch, dtype=record_type(arrays, memory=memory))
    for array in arrays:
        if array.name in values:
            records[array.name] = values[array.name]
    return records


def unpacked(arrays: Sequence[Array], records: NDArray[Any]) -> dict[str, Numbers]:
    """Return the numbers of structures by array, (batch, length) each."""
    real = {"f": np.float64}
    return {
        array.name: records[array.name].astype(real.get(records[array.name].dtype.kind, np.int64))
        for array in arrays
    }
