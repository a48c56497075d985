"""The kernel text of what the rows of a strip do to each other, a vector of cells wide.

An output that is loaded serves all the cells of the block that it is a neighbour of.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

from cnnum.engines.opencl.equal_weights import shares_products, weighted_terms
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.transients import TransientText
from cnnum.network import Tap, taps

HELD = "strip_held"
"""The array that is 1 where a mask holds a cell, else 0."""


class At(NamedTuple):
    """A row of a block, in a layer."""

    layer: int
    row: int

    @property
    def sum(self) -> str:
        """The name of the sum of what its cells are coupled to."""
        return f"s{self.layer}_{self.row}"


@dataclass(frozen=True, slots=True)
class Rows:
    """Writes what a few rows do.

    Attributes
    ----------
    text : TransientText
    layout : RowLayout
    scales : tuple of float
        What the couplings and the drive of each layer come with.
    apart : mapping of str to int or str
        Numbers from the array of states to each of the arrays that are kept, or the name of the
        variable that holds them.
    """

    text: TransientText
    layout: RowLayout
    scales: tuple[float, ...]
    apart: Mapping[str, int | str]

    def case(
        self, number: int, lines: list[str], head: Sequence[str] = (), tail: Sequence[str] = ()
    ) -> list[str]:
        """Return the text that takes a vector after the other of the rows from `start` on.

        What stands in `head` comes before all of them, what stands in `tail` after.
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

    def coupled(self, block: list[At], own: tuple[float, ...], state: str) -> list[str]:
        """Return the text of s = w + own · state + A ∗ y in each row of a block.

        Parameters
        ----------
        block : list of At
        own : tuple of float
            One a layer.
        state : str
            The array of states.
        """
        lines = [
            f"vec {at.sum} = {self._at('w', at)} + "
            f"{self.vector(own[at.layer])} * {self.array(state, at)};"
            for at in block
        ]
        shares = any(shares_products(self._taps(layer)) for layer in range(self.text.layers))
        return lines + (self._gather(block) if shares else self._scatter(block))

    def vector(self, value: float) -> str:
        """Return a number in all lanes."""
        return self.text.number(value).replace("R(", "(vec)(")

    def array(self, name: str, at: At) -> str:
        """Return the expression of the cells of an array."""
        apart = self.apart[name]
        return self._at(f"x + {apart}" if apart else "x", at)

    def store(self, name: str, at: At, value: str) -> str:
        """Return the statement that keeps the cells of an array."""
        return f"{self.array(name, at).replace('const vec', 'vec')} = {value};"

    def show(self, at: At, state: str) -> list[str]:
        """Return the statements that keep a new state's outputs, and it within its limits."""
        place = f"*(__global vec *)(to + {self._place(at)})"
        if self.text.template.output.limited:
            return [f"{state} = shown({state}, one);", f"{place} = {state};"]
        return [f"{place} = shown({state}, one);"]

    @property
    def masked(self) -> bool:
        """Whether a mask holds cells."""
        return self.text.operands.mask is not None

    def set_held(self) -> list[str]:
        """Return the text that sets, for a row, which cells a mask holds."""
        held, to = self.text.arena.places.get("held"), self.apart.get(HELD)
        return [f"to_lanes(x + p + {to}, mine + {held} + at, 1);"] if self.masked else []

    def free(self, at: At, value: str, held: str) -> str:
        """Return the expression of a value where no mask holds the cells, else of another one."""
        return f"{self.array(HELD, at)} < one ? {value} : {held}"

    def _scatter(self, block: list[At]) -> list[str]:
        """Return the text that adds every output, as it is loaded, to its sums."""
        found = {
            (layer, tap.source, tap.row, tap.col): tap.weight
            for layer in range(self.text.layers)
            for tap in self._taps(layer)
        }
        radius, lines, rows = self.text.radius, list[str](), max(at.row for at in block) + 1
        around = range(-radius, radius + 1)
        for row, source, col in product(
            range(-radius, rows + radius), range(self.text.layers), around
        ):
            adds = [
                f"{at.sum} += {self._weight(at.layer, found[key])} * v;"
                for at in block
                if (key := (at.layer, source, row - at.row, col)) in found
            ]
            if adds:
                value = self._output(source, row, col)
                lines.append(f"{{ const vec v = {value}; {' '.join(adds)} }}")
        return lines

    def _gather(self, block: list[At]) -> list[str]:
        """Return the text that loads all outputs, and adds those of equal weights first."""
        radius = self.text.radius

        def name(source: int, row: int, col: int) -> str:
            return f"v{source}_{row + radius}_{col + radius}"

        places = {
            (tap.source, at.row + tap.row, tap.col) for at in block for tap in self._taps(at.layer)
        }
        lines = [f"const vec {name(*at)} = {self._output(*at)};" for at in sorted(places)]
        for at in block:

            def number(weight: float, layer: int = at.layer) -> str:
                return self._weight(layer, weight)

            def output(tap: Tap, row: int = at.row) -> str:
                return name(tap.source, row + tap.row, tap.col)

            terms = weighted_terms(self._taps(at.layer), number, output)
            lines += [f"{at.sum} += {term};" for term in terms]
        return lines

    def _taps(self, layer: int) -> tuple[Tap, ...]:
        return taps(self.text.template.A, layer)

    def _output(self, source: int, row: int, col: int) -> str:
        apart = row * self.layout.pitch + source * self.layout.span + col * self.layout.width
        return f"*(__global const vec *)(from + {apart} + p)"

    def _weight(self, layer: int, weight: float) -> str:
        return self.vector(self.scales[layer] * weight)

    def _place(self, at: At) -> str:
        return f"{at.row * self.layout.pitch + at.layer * self.layout.span} + p"

    def _at(self, array: str, at: At) -> str:
        return f"*(__global const vec *)({array} + {self._place(at)})"
