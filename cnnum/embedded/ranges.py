"""The interval of every value of a program, and whether it can overflow: none can.

An interval follows from those that inputs and memories cannot leave in any frame. A value that
could leave its format is limited to it: it saturates. All values on the way fit in 64 bits, or
lowering refuses the program. Sums before a shift are among them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cnnum import kernels as ir
from cnnum.embedded.arithmetic.primitives import LOGIC
from cnnum.embedded.emulator import added_in
from cnnum.embedded.program import IntegerProgram
from cnnum.kernels.expressions import operands


@dataclass(frozen=True, slots=True)
class Range:
    """The interval of one value.

    Attributes
    ----------
    name : str
        A variable or an array.
    bounds : (int, int)
        Whole numbers that it cannot leave.
    fraction : int
        They stand for q · 2^−fraction.
    bits : int
        Bits of the widest value on the way, with its sign.
    saturates : bool
        Whether it is limited: the interval before that is wider than its format.
    """

    name: str
    bounds: ir.Bounds
    fraction: int
    bits: int
    saturates: bool


def ranges(program: IntegerProgram) -> list[Range]:
    """Return the interval of every value of a program in whole numbers."""
    found = list[Range]()
    for name, bounds, value in _all(program.body):
        if bounds is None:
            continue
        array = program.arrays.get(name)
        fraction = program.fractions.get(name, 0)
        if array is not None and array.format is not None:
            fraction = array.format.fraction
        bits = max(_bits(bounds), widest(value))
        found.append(Range(name, bounds, fraction, bits, saturating(value)))
    return found


def _all(body: Sequence[ir.Statement]) -> Iterator[tuple[str, ir.Bounds | None, ir.Expression]]:
    """Yield the targets of statements, with their bounds and their values; sums once."""
    sums = {name for one in body if isinstance(one, ir.Loop) for name in added_in(one)}
    for statement in body:
        if isinstance(statement, ir.Declare) and statement.type == "real":
            for name, value in statement.variables:
                if value is not None and name.text not in sums:
                    yield name.text, name.bounds, value
        elif isinstance(statement, ir.Assign | ir.Accumulate):
            target, value = statement.target, statement.value
            name = target.array if isinstance(target, ir.Element) else target
            adds = isinstance(statement, ir.Assign) and statement.sign == "+="
            yield name.text, target.bounds if adds else value.bounds, value
        elif isinstance(statement, ir.Sweep | ir.Loop | ir.Counted):
            yield from _all(statement.body)


def _bits(bounds: ir.Bounds) -> int:
    return max((-bounds[0] - 1).bit_length() if bounds[0] < 0 else 0, bounds[1].bit_length()) + 1


def widest(value: ir.Expression) -> int:
    """Return the bits of the widest whole number on the way to a value."""
    inner = max((widest(one) for one in operands(value)), default=0)
    if isinstance(value, ir.Binary) and value.bounds == LOGIC:
        return inner
    if isinstance(value, ir.Element):
        return inner
    own = [value.bounds, value.within] if isinstance(value, ir.Call) else [value.bounds]
    return max([inner, *(_bits(one) for one in own if one is not None)])


def saturating(value: ir.Expression) -> bool:
    """Return whether a value, or a part of it, is limited."""
    limits = isinstance(value, ir.Call) and value.function == "limit"
    return limits or any(saturating(one) for one in operands(value))


def range_lines(program: IntegerProgram) -> list[str]:
    """Return the intervals as lines of text."""
    found = ranges(program)
    if not found:
        return ["The program is of real numbers."]
    wide, limited = max(one.bits for one in found), sum(one.saturates for one in found)
    inputs = [one for one in program.of_kind("input") if one.format is not None]
    lines = [
        f"For all inputs, no value needs more than {wide} bits of 64: none overflows.",
        f"{len(found) - limited} of {len(found)} values cannot leave their formats; {limited} "
        "saturate.",
        "",
        f"{'value':24} {'least':>14} {'largest':>14}  format    bits  at the ends",
    ]
    for array in inputs:
        assert array.format is not None
        scale = array.format.step
        ends = f"{array.format.least * scale:>14.6g} {array.format.largest * scale:>14.6g}"
        lines.append(
            f"{array.name:24} {ends}  {array.format!s:8} {array.format.bits:>5}  saturates"
        )
    for one in found:
        scale = 2.0**-one.fraction
        ends = f"{one.bounds[0] * scale:>14.6g} {one.bounds[1] * scale:>14.6g}"
        form = f"2^{-one.fraction}"
        what = "saturates" if one.saturates else "cannot be left"
        lines.append(f"{one.name:24} {ends}  {form:8} {one.bits:>5}  {what}")
    return lines
