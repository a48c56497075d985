"""Stores to the rows of a strip and reads of them, a vector at a time."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.kernels.number_types import in_vectors
from cnnum.kernels.opencl import OpenCLPrinter
from cnnum.templating.reads import reads_states

HELD = "strip_held"
"""The array that is 1 where a mask holds a cell, else 0."""

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
    size : (int, int)
        The levels a launch, and the strips that are then high enough.
    """

    text: TransientBuilder
    layout: RowLayout
    scales: tuple[float, ...]
    offsets: dict[str, int | str]
    size: tuple[int, int]

    def declare(self, name: str, length: int) -> None:
        """Append another array."""
        places, first = self.text.arena.places, next(iter(self.offsets))
        self.text.array(ir.Name(name), length)
        self.offsets[name] = places[name] - places[first]

    def at(self, name: str) -> int:
        """Return how far an array is from the first."""
        return int(self.offsets[name])

    @property
    def span(self) -> int:
        """Numbers of a row of a layer."""
        return self.layout.vectors * self.layout.width

    @property
    def printer(self) -> OpenCLPrinter:
        """The printer of records in vectors."""
        return OpenCLPrinter(in_vectors(self.text.tables.printer.numbers), {"clamp": "between"})

    def case(
        self,
        number: int,
        body: Sequence[ir.Statement],
        head: Iterable[str | ir.Statement] = (),
        tail: Iterable[str] = (),
    ) -> ir.Case:
        """Return the case that takes a vector after the other of the rows from `start` on.

        The statements in `head` come before all of them, those in `tail` after.
        """
        each = ir.Loop(P, START + self.span, tuple(body), start=START, step=self.layout.width)
        texts = (one if isinstance(one, ir.Statement) else ir.Verbatim((one,)) for one in head)
        return ir.Case(number, (*texts, each, *(ir.Verbatim((line,)) for line in tail)))

    def block(self, rows: int) -> list[At]:
        """Return the rows of a block in all layers."""
        return [At(layer, row) for layer in range(self.text.layers) for row in range(rows)]

    def array(self, name: str, at: At) -> ir.Load:
        """Return the cells of an array."""
        return self.cells(self._base(name), at)

    def _base(self, name: str) -> ir.Expression:
        """Return where an array begins."""
        offset = self.offsets[name]
        if isinstance(offset, str):
            return X + ir.Name(offset)
        return X + offset if offset else X

    def store(self, name: str, at: At, value: ir.Expression) -> ir.Store:
        """Return the statement that keeps the cells of an array."""
        return ir.Store(self.place(self._base(name), at), value)

    def show(self, at: At, state: ir.Name) -> list[ir.Statement]:
        """Return the statements that keep a new state's outputs, and it within its limits."""
        shown, limited = ir.call("shown", state, ONES), self.text.template.output.limited
        lines: list[ir.Statement] = [ir.Assign(state, shown)] if limited else []
        lines.append(ir.Store(self.place(TO, at), state if limited else shown))
        if reads_states(self.text.template):
            lines.append(ir.Store(self.place(ir.Name(NEW_STATES), at), state))
        return lines

    @property
    def masked(self) -> bool:
        """Whether a mask holds cells."""
        return self.text.operands.mask is not None

    def set_held(self) -> list[str]:
        """Return the text that sets, for a row, which cells a mask holds."""
        held, to = self.text.arena.places.get("held"), self.offsets.get(HELD)
        return [f"to_lanes(x + p + {to}, mine + {held} + at, 1);"] if self.masked else []

    def free(self, at: At, value: ir.Expression, held: ir.Expression) -> ir.Expression:
        """Return a value, and another one where a mask holds the cells."""
        return ir.Choice(self.array(HELD, at) < ONES, value, held) if self.masked else value

    def place(self, array: ir.Expression, at: At) -> ir.Expression:
        """Return the place of a row's cells in an array."""
        return array + (at.row * self.layout.pitch + at.layer * self.layout.span) + P

    def cells(self, array: ir.Expression, at: At) -> ir.Load:
        """Return a row's cells, from where the block begins in an array."""
        return ir.Load(self.place(array, at))


def vector(name: ir.Name, value: ir.Expression) -> ir.Statement:
    """Return the declaration of a vector that changes."""
    return ir.declare(name, value, of="vec")


def constant(name: ir.Name, value: ir.Expression) -> ir.Statement:
    """Return the declaration of a vector that stays the same."""
    return ir.fixed(name, value, of="vec")
