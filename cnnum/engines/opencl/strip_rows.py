"""The kernel text of what the rows of a strip do to each other, a vector of cells wide.

An output that is loaded serves all the cells of the block that it is a neighbour of.
"""

from dataclasses import dataclass

from cnnum.engines.opencl.equal_weights import shares_products, weighted_terms
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.transients import TransientText
from cnnum.network import Tap, taps


@dataclass(frozen=True, slots=True)
class Rows:
    """Writes what a few rows do.

    Attributes
    ----------
    text : TransientText
    layout : RowLayout
    scale : float
        What the couplings and the drive come with.
    apart : dict of str to int
        Numbers from the array of states to each of the arrays that are kept.
    """

    text: TransientText
    layout: RowLayout
    scale: float
    apart: dict[str, int]

    def case(self, number: int, lines: list[str]) -> list[str]:
        """Return the text that takes a vector after the other of the rows from `start` on."""
        width = self.layout.width
        end = f"start + {self.layout.vectors * width}"
        return [
            f"case {number}:",
            f"    for (int p = start; p < {end}; p += {width}) {{",
            *(f"        {line}" for line in lines),
            "    }",
            "    break;",
        ]

    def coupled(self, block: int, own: float, state: str) -> list[str]:
        """Return the text of s = w + own · state + A ∗ y in each row of a block."""
        lines = [
            f"vec s{row} = {self._at('w', row)} + {self.vector(own)} * {self.array(state, row)};"
            for row in range(block)
        ]
        shares = shares_products(taps(self.text.template.A, 0))
        return lines + (self._gather(block) if shares else self._scatter(block))

    def vector(self, value: float) -> str:
        """Return a number in all lanes."""
        return self.text.number(value).replace("R(", "(vec)(")

    def array(self, name: str, row: int) -> str:
        """Return the expression of the cells of an array."""
        apart = self.apart[name]
        return self._at(f"x + {apart}" if apart else "x", row)

    def store(self, name: str, row: int, value: str) -> str:
        """Return the statement that keeps the cells of an array."""
        return f"{self.array(name, row).replace('const vec', 'vec')} = {value};"

    def show(self, row: int, state: str) -> list[str]:
        """Return the statements that keep a new state's outputs, and it within its limits."""
        place = f"*(__global vec *)(to + {self._place(row)})"
        if self.text.template.output.limited:
            return [f"{state} = shown({state}, one);", f"{place} = {state};"]
        return [f"{place} = shown({state}, one);"]

    def _scatter(self, block: int) -> list[str]:
        """Return the text that adds every output, as it is loaded, to its sums."""
        found = {(tap.row, tap.col): tap.weight for tap in taps(self.text.template.A, 0)}
        radius, lines = self.text.radius, list[str]()
        for row in range(-radius, block + radius):
            for col in range(-radius, radius + 1):
                adds = [
                    f"s{to} += {self._weight(found[row - to, col])} * v;"
                    for to in range(block)
                    if (row - to, col) in found
                ]
                if adds:
                    lines.append(f"{{ const vec v = {self._output(row, col)}; {' '.join(adds)} }}")
        return lines

    def _gather(self, block: int) -> list[str]:
        """Return the text that loads all outputs, and adds those of equal weights first."""
        found, radius = taps(self.text.template.A, 0), self.text.radius
        places = sorted({(to + tap.row, tap.col) for to in range(block) for tap in found})
        lines = [
            f"const vec v{row + radius}_{col + radius} = {self._output(row, col)};"
            for row, col in places
        ]
        for to in range(block):

            def output(tap: Tap, to: int = to) -> str:
                return f"v{to + tap.row + radius}_{tap.col + radius}"

            terms = weighted_terms(found, self._weight, output)
            lines += [f"s{to} += {term};" for term in terms]
        return lines

    def _output(self, row: int, col: int) -> str:
        apart = row * self.layout.pitch + col * self.layout.step
        return f"*(__global const vec *)(from + {apart} + p)"

    def _weight(self, weight: float) -> str:
        return self.vector(self.scale * weight)

    def _place(self, row: int) -> str:
        return f"{row * self.layout.pitch} + p"

    def _at(self, array: str, row: int) -> str:
        return f"*(__global const vec *)({array} + {self._place(row)})"
