"""The range of every value, measured on frames like those to come, and what can overflow.

The interval of every value of a program, and whether it can overflow: none can.

An interval follows from those that inputs and memories cannot leave in any frame. A value that
could leave its format is limited to it: it saturates. All values on the way fit in 64 bits, or
lowering refuses the program. Sums before a shift are among them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.embedded.arithmetic import LOGIC
from cnnum.embedded.emulator import Emulator, added_in, cleared
from cnnum.embedded.formats import NoFormats, Precision, Sizes, precision_named
from cnnum.embedded.lowering.schedules import lower
from cnnum.embedded.program import IntegerProgram, array_names
from cnnum.graph.nodes import Apply, Constant, Node
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver
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
    result = list[Range]()
    for name, bounds, value in _all(program.body):
        if bounds is None:
            continue
        array = program.arrays.get(name)
        fraction = program.fractions.get(name, 0)
        if array is not None and array.format is not None:
            fraction = array.format.fraction
        bits = max(_bits(bounds), widest(value))
        result.append(Range(name, bounds, fraction, bits, saturating(value)))
    return result


def _all(body: Sequence[ir.Statement]) -> Iterator[tuple[str, ir.Bounds | None, ir.Expression]]:
    """Yield the targets of statements, with their bounds and their values; sums once."""
    sums = {name for part in body if isinstance(part, ir.Loop) for name in added_in(part)}
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
    inner = max((widest(operand) for operand in operands(value)), default=0)
    if isinstance(value, ir.Binary) and value.bounds == LOGIC:
        return inner
    if isinstance(value, ir.Element):
        return inner
    own = [value.bounds, value.within] if isinstance(value, ir.Call) else [value.bounds]
    return max([inner, *(_bits(part) for part in own if part is not None)])


def saturating(value: ir.Expression) -> bool:
    """Return whether a value, or a part of it, is limited."""
    limits = isinstance(value, ir.Call) and value.function == "limit"
    return limits or any(saturating(operand) for operand in operands(value))


def range_lines(program: IntegerProgram) -> list[str]:
    """Return the intervals as lines of text."""
    spans = ranges(program)
    if not spans:
        return ["The program is of real numbers."]
    wide, limited = max(span.bits for span in spans), sum(span.saturates for span in spans)
    inputs = [channel for channel in program.of_kind("input") if channel.format is not None]
    lines = [
        f"For all inputs, no value needs more than {wide} bits of 64: none overflows.",
        f"{len(spans) - limited} of {len(spans)} values cannot leave their formats; {limited} "
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
    for span in spans:
        scale = 2.0**-span.fraction
        ends = f"{span.bounds[0] * scale:>14.6g} {span.bounds[1] * scale:>14.6g}"
        form = f"2^{-span.fraction}"
        what = "saturates" if span.saturates else "cannot be left"
        lines.append(f"{span.name:24} {ends}  {form:8} {span.bits:>5}  {what}")
    return lines


Limit = float | Floats
"""Magnitude from which a value need not be known, (batch, 1) or (batch, cells): 0 where it does not
count, infinity where it always counts. A number is that of all cells."""

LEAST = float(np.finfo(np.float64).tiny)
"""Limit of a value of which only the sign counts."""

RESOLVED = 256.0
"""A dividend that is smaller than the largest of its frame by more than this, and by the room of a
register, may be divided by too much where its quotient is limited."""

Values = Mapping[str, NDArray[Any]]


def needed_sizes(schedule: Schedule, values: Values) -> dict[str, float]:
    """Return the largest magnitude that counts, of variables of which some values do not.

    Parameters
    ----------
    schedule : Schedule
    values : mapping of str to (batch, 1 or cells) float
        Variables and arrays of the program after a frame, by their names.

    Returns
    -------
    dict of str to float
        0 where no value counts.
    """
    result: dict[str, float] = {}
    for name, limit in _limits(schedule, values).items():
        if limit is not np.inf and name in values:
            size = float(np.minimum(np.abs(values[name]), limit).max(initial=0.0))
            result[name] = size if size > LEAST else 0.0
    return result


def _limits(schedule: Schedule, values: Values) -> dict[str, Limit]:
    """Return the magnitudes from which the variables of each node need not be known."""
    ends = [*schedule.outputs.values(), *(memory.store for memory in schedule.memories.values())]
    need: dict[int, Limit] = {node.index: np.inf for node in ends}
    inverses: dict[int, Limit] = {}
    for node in reversed(schedule.nodes):
        if node.index not in need:
            continue
        mine = need[node.index]
        for argument, limit in _shares(node, mine, values):
            _raise_limit(need, argument, _spread(limit, node, argument))
        if _name(node) == "divide":
            divisor = node.arguments[1]
            limit = _of_inverse(mine, _values(node.arguments[0], values))
            _raise_limit(inverses, divisor, _spread(limit, node, divisor))
    return {f"{kind}{at}": limit for at, limit in need.items() for kind in "nat"} | {
        f"r{at}": limit for at, limit in inverses.items()
    }


def _shares(node: Node, mine: Limit, values: Values) -> Iterator[tuple[Node, Limit]]:
    """Yield each argument of a node, and its limit."""
    name, given = _name(node), node.arguments
    whole = mine if mine is np.inf else np.where(np.greater(mine, 0.0), np.inf, 0.0)
    if name == "select":
        holds = _values(given[0], values)
        yield given[0], whole
        yield given[1], mine if holds is None else np.where(holds != 0, mine, 0.0)
        yield given[2], mine if holds is None else np.where(holds != 0, 0.0, mine)
    elif name in ("multiply", "divide"):
        for part, factor in (given, given[::-1]):
            known = None if _constant(factor) is not None else _values(factor, values)
            yield part, whole if known is None else np.where(known != 0, whole, 0.0)
    elif name in ("minimum", "maximum"):
        for part, other in (given, given[::-1]):
            yield part, _beside(name, part, _constant(other), mine, values)
    else:
        for part in given:
            yield part, whole


def _beside(name: str, part: Node, bound: float | None, mine: Limit, values: Values) -> Limit:
    """Return the limit of a value beside a constant bound: it need not be known beyond that."""
    own = _values(part, values)
    if bound is None or own is None:
        return mine
    beyond = own > bound if name == "minimum" else own < bound
    return np.where(beyond, np.minimum(mine, max(abs(bound), LEAST)), mine)


def _of_inverse(mine: Limit, dividend: NDArray[Any] | None) -> Limit:
    """Return the limit of an inverse, from which the dividends that count reach the quotient's."""
    if dividend is None:
        return mine
    size = np.abs(dividend)
    largest = np.maximum(size.max(axis=-1, keepdims=True), RESOLVED * LEAST)
    return np.where(size > 0.0, mine * (RESOLVED / largest), 0.0)


def _name(node: Node) -> str:
    return node.operation.function.name if isinstance(node.operation, Apply) else ""


def _constant(node: Node) -> float | None:
    return node.operation.value if isinstance(node.operation, Constant) else None


def _values(node: Node, values: Values) -> NDArray[Any] | None:
    """Return the values of a node, (batch, 1 or cells); None where they are not known."""
    if (constant := _constant(node)) is not None:
        return np.array([[constant]])
    for kind in "na":
        if (known := values.get(f"{kind}{node.index}")) is not None:
            return np.atleast_2d(known)
    return None


def _spread(limit: Limit, node: Node, argument: Node) -> Limit:
    """Return the limit of an argument: any cell of a map needs all of a number, or a template's."""
    if isinstance(limit, float) or (isinstance(node.operation, Apply) and not argument.scalar):
        return limit
    return np.asarray(np.max(limit, axis=-1, keepdims=True))


def _raise_limit(limits: dict[int, Limit], node: Node, limit: Limit) -> None:
    """Raise the limit of a node to what one more use of it needs."""
    known = limits.get(node.index, 0.0)
    whole = known is np.inf or limit is np.inf
    limits[node.index] = np.inf if whole else np.maximum(known, limit)


WARMING = 8
"""First frames of a stream, in which memories are empty."""

REALS = precision_named("float32")


@dataclass(frozen=True, slots=True)
class Seen:
    """The largest magnitude of every variable and array.

    Attributes
    ----------
    later, early : dict of str to float
        Ranges of the values that count, and of those in the first frames.
    idle : dict of str to float
        Ranges of all values, used if none counted.
    """

    later: dict[str, float] = field(default_factory=dict[str, float])
    early: dict[str, float] = field(default_factory=dict[str, float])
    idle: dict[str, float] = field(default_factory=dict[str, float])

    def sizes(self, precision: Precision) -> Sizes:
        """Return the formats of a precision."""
        never = {
            name: size
            for name, size in self.idle.items()
            if not self.later.get(name) and not self.early.get(name)
        }
        return Sizes(precision, self.later | never, self.early)


def measured(schedule: Schedule, solvers: Mapping[int, Solver], frames: Floats) -> Seen:
    """Return the largest magnitudes, by which each value gets its format.

    Parameters
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    frames : (frames, batch, rows, cols, channels) float
        Streams side by side; channels are all of the schedule's.
    """
    program = lower("measured", schedule, solvers, NoFormats(REALS))
    result, state = Seen(), cleared(program, frames.shape[1])
    for number, frame in enumerate(frames):
        emulator = Emulator(program, sizes={})
        assert emulator.sizes is not None
        inputs = inputs_of(schedule, frame)
        emulator.run(inputs, state, first=number == 0, batch=len(frame))
        _raise(result.idle, emulator.sizes)
        emulator.sizes |= needed_sizes(schedule, emulator.values)
        counts = number >= WARMING or number == len(frames) - 1
        _raise(result.later if counts else result.early, emulator.sizes)
    for name, array in _inputs(schedule).items():
        at = schedule.channels.index(name)
        result.later[array] = float(np.abs(frames[..., at]).max())
    return result


def _raise(known: dict[str, float], sizes: Mapping[str, float]) -> None:
    for name, size in sizes.items():
        known[name] = max(size, known.get(name, 0.0))


def inputs_of(schedule: Schedule, frame: Floats) -> dict[str, Floats]:
    """Return the channels that are read of a batch of frames, (batch, cells) each."""
    return {
        array: frame[..., schedule.channels.index(name)].reshape(len(frame), -1)
        for name, array in _inputs(schedule).items()
    }


def _inputs(schedule: Schedule) -> dict[str, str]:
    """Return the arrays of the channels that are read."""
    arrays = array_names("in", schedule.channels)
    return {name: arrays[name] for name in schedule.channels_read}
