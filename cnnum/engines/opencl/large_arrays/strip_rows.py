"""The arrays of strips; stores to their rows and reads of them, a vector at a time."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.large_arrays.lane_rows import BLOCK_ROWS, inputs_of, row_layout
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.kernels.number_types import in_vectors
from cnnum.kernels.opencl import OpenCLPrinter
from cnnum.templating.reads import moving_inputs, reads_states

LEVELS = 32
"""Stages of steps a launch, at most: the gap between strips grows with them. Euler's steps
of 512×512 cells take four fifths of the time that they take with 8 (AMD EPYC)."""

LEAST_LEVELS = 8
"""Stages a launch even if their rows do not fit the cache."""

SHARES = 8
"""Strips that an array can be parted into, at least."""

OUTPUTS = ("strip_even", "strip_odd")
"""Arrays of outputs after an even and an odd number of levels."""

SEEN = ("strip_states_even", "strip_states_odd")
"""The same of states, where couplings read those of neighbours."""

LATER = "strip_later"
"""The array of the cells' drive once a delay is over."""

DRIVE = "strip_w"
"""The array of the cells' drive."""

HELD = "strip_held"
"""The array that is 1 where a mask holds a cell, else 0."""

HELD_CELLS = ir.Name("held")
"""The same, as cells lie elsewhere."""

CONTROL, FINDINGS = ir.names("strip_control strip_findings")
"""The arrays of the registers between the plan's body and the strips, and of the strips' findings.
A finding is the largest of a figure in a strip's cells, in every lane."""

CELLS = "strip_cells"
"""The array that is 1 where a number of a row is a cell, else 0; there is none where all are."""

NEW_STATES = "new_states"
"""The variable that says where states go that couplings read of neighbours."""

X, TO, P, START = ir.names("x to p start")
"""The arrays of states and of new outputs, and the places of a vector and of a row's first."""

ONES = ir.Name("one")
"""1 in every lane."""


class At(NamedTuple):
    """A row of a block, in a layer."""

    layer: int
    row: int

    @property
    def sum(self) -> ir.Name:
        """The sum of its cells' couplings."""
        return ir.Name(f"s{self.layer}_{self.row}")


@dataclass(frozen=True, slots=True)
class Rows:
    """Writes the statements of a few rows.

    Attributes
    ----------
    text : TransientBuilder
    layout : RowLayout
    scales : tuple of float
        The factor of each layer's couplings and drive.
    offsets : dict of str to int or str
        Numbers from the array of states to each array that is kept. Or the variable that holds
        them, by its name.
    levels, strips : int
        The levels a launch, and the strips that are then high enough.
    high : int
        The rows.
    """

    text: TransientBuilder
    layout: RowLayout
    scales: tuple[float, ...]
    offsets: dict[str, int | str]
    levels: int
    strips: int
    high: int = BLOCK_ROWS

    def declare(self, name: str, length: int) -> None:
        """Append another array."""
        places, first = self.text.arena.places, next(iter(self.offsets))
        self.text.array(ir.Name(name), length)
        self.offsets[name] = places[name] - places[first]

    def at(self, name: str) -> int:
        """Return how far an array is from the first."""
        return int(self.offsets[name])

    def declare_findings(self, registers: int, findings: int) -> None:
        """Append the arrays of a number of registers, and of a number of findings a strip."""
        self.declare(CONTROL.text, registers)
        self.declare(FINDINGS.text, findings * self.finding)
        if self.span > self.layout.cols:
            self.declare(CELLS, self.span)

    @property
    def finding(self) -> int:
        """Numbers of a finding in the lanes of all strips."""
        return self.strips * self.layout.width

    def register(self, place: int) -> str:
        """Return the text of a register that the plan's body sets."""
        return f"x[{self.at(CONTROL.text)} + {place}]"

    @property
    def empty(self) -> ir.Expression | None:
        """In which lanes there is no cell; None where all have one."""
        if CELLS not in self.offsets:
            return None
        return ir.Load(X + self.at(CELLS) + P - START) < ONES

    @property
    def span(self) -> int:
        """Numbers of a row of a layer."""
        return self.layout.length * self.layout.width

    @property
    def block(self) -> list[At]:
        """The rows, in all layers."""
        return [At(layer, row) for layer in range(self.text.layers) for row in range(self.high)]

    def case(
        self,
        number: int,
        body: Sequence[ir.Statement],
        head: Iterable[str | ir.Statement] = (),
        findings: Mapping[str, int | str] | None = None,
    ) -> ir.Case:
        """Return the case that takes a vector after the other of the rows from `start` on.

        Statements in `head` come before all of them. The `findings` are vectors that these change,
        by name, and their numbers among those of a strip. They are kept after each vector: in
        registers over all of them the steps of Dormand and Prince's pair took a third longer.
        """
        kept = {f"*finding(x, {n}, piece)": name for name, n in (findings or {}).items()}
        before = [f"vec {name} = {place};" for place, name in kept.items()]
        after = [f"{place} = {name};" for place, name in kept.items()]
        each = (*map(_statement, before), *body, *map(_statement, after))
        vectors = ir.Loop(P, START + self.span, each, start=START, step=self.layout.width)
        return ir.Case(number, (*map(_statement, head), vectors))

    def numbers(self) -> dict[str, int | str]:
        """Return the numbers of strips and of their findings that their kernel's text names."""
        return {
            "levels": self.levels,
            "strips": self.strips,
            "found": self.offsets.get(FINDINGS.text, 0),
            "marked": self.span if CELLS in self.offsets else 0,
            "marks": self.offsets.get(CELLS, 0),
        }

    def lines(self, cases: Iterable[ir.Case]) -> list[str]:
        """Return the text of cases, in vectors."""
        numbers = in_vectors(self.text.tables.printer.numbers)
        return OpenCLPrinter(numbers, {"clamp": "between"}).lines(cases)

    def array(self, name: str, at: At) -> ir.Load:
        """Return the cells of an array."""
        return self.cells(self.base(name), at)

    def base(self, name: str) -> ir.Expression:
        """Return where an array begins."""
        offset = self.offsets[name]
        if isinstance(offset, str):
            return X + ir.Name(offset)
        return X + offset if offset else X

    def store(self, name: str, at: At, value: ir.Expression) -> ir.Store:
        """Return the statement that keeps the cells of an array."""
        return ir.Store(self.place(self.base(name), at), value)

    def new(self, at: At, value: ir.Expression) -> ir.Store:
        """Return the statement that keeps what the next level reads of neighbours."""
        return ir.Store(self.place(TO, at), value)

    def show(self, at: At, state: ir.Name) -> list[ir.Statement]:
        """Return the statements that keep a new state's outputs, and it within its limits."""
        shown, limited = ir.call("shown", state, ONES), self.text.template.output.limited
        lines: list[ir.Statement] = [ir.Assign(state, shown)] if limited else []
        lines.append(self.new(at, state if limited else shown))
        if reads_states(self.text.template):
            lines.append(ir.Store(self.place(ir.Name(NEW_STATES), at), state))
        return lines

    @property
    def masked(self) -> bool:
        """Whether a mask holds cells."""
        return self.text.operands.mask is not None

    def set_held(self) -> list[str]:
        """Return the text that sets, for a row, which cells a mask holds."""
        return [self.brought(HELD, HELD_CELLS.text, place="at")] if self.masked else []

    def brought(self, to: str, array: str, scale: str = "1", place: str = "cell") -> str:
        """Return the text that brings a row of a plan's array into one of strips, by a scale."""
        source = self.text.arena.places[array]
        return f"to_lanes(x + p + {self.offsets[to]}, mine + {source} + {place}, {scale});"

    def by_turns(self, names: tuple[str, str]) -> str:
        """Return the expression of one of two arrays after `level` levels."""
        even, odd = (self.offsets[name] for name in names)
        return f"x + (level & 1 ? {odd} : {even})"

    def of_layer(self, values: Iterable[float]) -> str:
        """Return the expression of the number of the layer at hand."""
        numbers = [self.text.literal(value) for value in values]
        if len(set(numbers)) == 1:
            return numbers[0]
        *others, last = numbers
        picks = "".join(f"layer == {layer} ? {number} : " for layer, number in enumerate(others))
        return f"({picks}{last})"

    def free(self, at: At, value: ir.Expression, held: ir.Expression) -> ir.Expression:
        """Return a value, and another one where a mask holds the cells."""
        return ir.Choice(self.array(HELD, at) < ONES, value, held) if self.masked else value

    def place(self, array: ir.Expression, at: At) -> ir.Expression:
        """Return the place of a row's cells in an array."""
        return array + (at.row * self.layout.pitch + at.layer * self.layout.span) + P

    def cells(self, array: ir.Expression, at: At) -> ir.Load:
        """Return a row's cells, from where the block begins in an array."""
        return ir.Load(self.place(array, at))


def strip_rows(text: TransientBuilder, arrays: tuple[str, ...], scales: tuple[float, ...]) -> Rows:
    """Append arrays that hold all rows, and return the writer of their statements."""
    layout, names = row_layout(text), [*(arrays or OUTPUTS)]
    if text.operands.mask is not None:
        text.array(HELD_CELLS, text.cells)
        held = ir.pick(text.operands.mask.differs(ir.ZERO), ir.ONE, ir.ZERO)
        text.over_cells([ir.Assign(HELD_CELLS[ir.CELL], held)])
        names.append(HELD)
    names += SEEN if reads_states(text.template) else ()
    names += (LATER,) if text.has_history else ()
    names = list(dict.fromkeys((*names, DRIVE, *OUTPUTS)))
    for name in names:
        text.array(ir.Name(name), layout.size)
    places, given = text.arena.places, map(inputs_of, moving_inputs(text.template))
    offsets: dict[str, int | str] = {
        name: places[name] - places[names[0]] for name in (*names, *given)
    }
    return Rows(text, layout, scales, offsets, *_levels_of(text, layout, len(offsets)))


def _levels_of(text: TransientBuilder, layout: RowLayout, arrays: int) -> tuple[int, int]:
    """Return the stages a launch, and the strips high enough for that, by the number of arrays."""
    # strips must not vanish before the last of the levels
    high = layout.rows // (2 * layout.radius * SHARES) - 1
    row_bytes = layout.pitch * text.tables.dtype.itemsize
    near = text.tables.near_bytes // (BLOCK_ROWS * arrays * row_bytes)
    levels = max(1, min(LEVELS, max(LEAST_LEVELS, near), high))
    return levels, max(1, layout.rows // (2 * (levels + 1) * layout.radius))


def vector(name: ir.Name, value: ir.Expression) -> ir.Statement:
    """Return the declaration of a vector that changes."""
    return ir.declare(name, value, of="vec")


def constant(name: ir.Name, value: ir.Expression) -> ir.Statement:
    """Return the declaration of a vector that stays the same."""
    return ir.fixed(name, value, of="vec")


def _statement(line: str | ir.Statement) -> ir.Statement:
    return ir.Verbatim((line,)) if isinstance(line, str) else line
