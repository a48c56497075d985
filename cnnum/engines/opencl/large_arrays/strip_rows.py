"""The kernel text of stores to the rows of a strip and reads of them, a vector at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.templating.reads import reads_states

HELD = "strip_held"
"""The array that is 1 where a mask holds a cell, else 0."""

NEW_STATES = "new_states"
"""The variable that says where states go that couplings read of neighbours."""


class At(NamedTuple):
    """A row of a block, in a layer."""

    layer: int
    row: int

    @property
    def sum(self) -> str:
        """The name of the sum of its cells' couplings."""
        return f"s{self.layer}_{self.row}"


@dataclass(frozen=True, slots=True)
class Rows:
    """Writes the statements of a few rows.

    Attributes
    ----------
    text : TransientBuilder
    layout : RowLayout
    scales : tuple of float
        The factor of each layer's couplings and drive.
    offsets : mapping of str to int or str
        Numbers from the array of states to each of the arrays that are kept, or the name of the
        variable that holds them.
    """

    text: TransientBuilder
    layout: RowLayout
    scales: tuple[float, ...]
    offsets: Mapping[str, int | str]

    def case(
        self, number: int, lines: list[str], head: Sequence[str] = (), tail: Sequence[str] = ()
    ) -> list[str]:
        """Return the text that takes a vector after the other of the rows from `start` on.

        Those in `head` come before all of them, those in `tail` after.
        """
        width = self.layout.width
        end = f"start + {self.layout.vectors * width}"
        return [
            f"case {number}: {{",
            *(f"    {line}" for line in head),
            f"    for (int p = start; p < {end}; p += {width}) {{",
            *(f"        {line}" for line in lines),
            "    }",
            *(f"    {line}" for line in tail),
            "    break;",
            "}",
        ]

    def braced(self, lines: list[str]) -> list[str]:
        """Return the text as a block, whose names end with it."""
        return ["{", *(f"    {line}" for line in lines), "}"]

    def block(self, rows: int) -> list[At]:
        """Return the rows of a block in all layers."""
        return [At(layer, row) for layer in range(self.text.layers) for row in range(rows)]

    def vector(self, value: float) -> str:
        """Return a number in all lanes."""
        return f"(vec)({self.text.tables.printer.numbers.digits(value)})"

    def array(self, name: str, at: At) -> str:
        """Return the expression of the cells of an array."""
        return self.cells(self._base(name), at)

    def _base(self, name: str) -> str:
        """Return the expression of where an array begins."""
        return f"x + {self.offsets[name]}" if self.offsets[name] else "x"

    def store(self, name: str, at: At, value: str) -> str:
        """Return the statement that keeps the cells of an array."""
        return f"*(__global vec *)({self._base(name)} + {self.place(at)}) = {value};"

    def show(self, at: At, state: str) -> list[str]:
        """Return the statements that keep a new state's outputs, and it within its limits."""
        place = f"*(__global vec *)(to + {self.place(at)})"
        limited = self.text.template.output.limited
        lines = [f"{state} = shown({state}, one);"] if limited else []
        lines.append(f"{place} = {state if limited else f'shown({state}, one)'};")
        if reads_states(self.text.template):
            lines.append(f"*(__global vec *)({NEW_STATES} + {self.place(at)}) = {state};")
        return lines

    @property
    def masked(self) -> bool:
        """Whether a mask holds cells."""
        return self.text.operands.mask is not None

    def set_held(self) -> list[str]:
        """Return the text that sets, for a row, which cells a mask holds."""
        held, to = self.text.arena.places.get("held"), self.offsets.get(HELD)
        return [f"to_lanes(x + p + {to}, mine + {held} + at, 1);"] if self.masked else []

    def free(self, at: At, value: str, held: str) -> str:
        """Return the expression of a value where no mask holds the cells, else of another one."""
        return f"{self.array(HELD, at)} < one ? {value} : {held}"

    def place(self, at: At) -> str:
        """Return the expression of the place of a row's cells in an array."""
        return f"{at.row * self.layout.pitch + at.layer * self.layout.span} + p"

    def cells(self, array: str, at: At) -> str:
        """Return the expression of a row's cells, from where the block begins in an array."""
        return f"*(__global const vec *)({array} + {self.place(at)})"
