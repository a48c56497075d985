"""The kernel text of one stage of some rows of a strip, a vector of cells wide.

An output that is loaded serves all the cells of the block that it is a neighbour of.
"""

from dataclasses import dataclass

from cnnum.engines.opencl.equal_weights import shares_products, weighted_terms
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.strip_stages import Stage, Stages, Sum
from cnnum.engines.opencl.transients import TransientText
from cnnum.network import Tap, taps


@dataclass(frozen=True, slots=True)
class StripRows:
    """Writes stages.

    Attributes
    ----------
    text : TransientText
    layout : RowLayout
    stages : Stages
    apart : tuple of int
        Numbers from the array `x` to each of the arrays of states and sums.
    """

    text: TransientText
    layout: RowLayout
    stages: Stages
    apart: tuple[int, ...]

    def cases(self, block: int) -> list[str]:
        """Return the text of all stages of so many rows that begin at `start`."""
        width, lines = self.layout.width, list[str]()
        end = f"start + {self.layout.vectors * width}"
        for number, stage in enumerate(self.stages.stages):
            lines += [
                f"case {number}:",
                f"    for (int p = start; p < {end}; p += {width}) {{",
                *(f"        {line}" for line in self._stage(stage, block)),
                "    }",
                "    break;",
            ]
        return lines

    def _stage(self, stage: Stage, block: int) -> list[str]:
        own = float(stage.whole) - self.stages.scale
        lines = [
            f"vec s{row} = {self._at('w', row)} + {self._vector(own)} * "
            f"{self._array(stage.state, row)};"
            for row in range(block)
        ]
        shares = shares_products(taps(self.text.template.A, 0))
        lines += self._gather(block) if shares else self._scatter(block)
        for row in range(block):
            lines += self._end(stage, row)
        return lines

    def _end(self, stage: Stage, row: int) -> list[str]:
        """Return the text that makes the sums of a row, once its d is known."""
        limited = self.text.template.output.limited
        known = set[int]()
        if not stage.whole:
            known |= {place for one in stage.sums for place, _ in one.terms}
            known |= {stage.state} if limited else set[int]()
        lines = [f"vec a{place} = {self._array(place, row)};" for place in sorted(known)]
        if limited and not stage.whole:
            lines.append(f"s{row} = inwards(s{row}, a{stage.state}, one);")
        for one in stage.sums:
            value = f"s{row}" if stage.whole else self._sum(one, row)
            lines.append(f"{'' if one.place in known else 'vec '}a{one.place} = {value};")
            known.add(one.place)
            if one is stage.sums[0] and limited:
                lines.append(f"a{one.place} = shown(a{one.place}, one);")
            lines.append(f"{self._array(one.place, row, '')} = a{one.place};")
        place = stage.sums[0].place
        new = f"a{place}" if limited else f"shown(a{place}, one)"
        lines.append(f"*(__global vec *)(to + {self._place(row)}) = {new};")
        return ["{", *(f"    {line}" for line in lines), "}"]

    def _sum(self, one: Sum, row: int) -> str:
        terms = [(f"a{place}", factor) for place, factor in one.terms]
        return " + ".join(
            name if factor == 1.0 else f"{self._vector(factor)} * {name}"
            for name, factor in [*terms, (f"s{row}", one.factor)]
        )

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
        return self._vector(self.stages.scale * weight)

    def _vector(self, value: float) -> str:
        return self.text.number(value).replace("R(", "(vec)(")

    def _place(self, row: int) -> str:
        return f"{row * self.layout.pitch} + p"

    def _at(self, array: str, row: int, const: str = "const ") -> str:
        return f"*(__global {const}vec *)({array} + {self._place(row)})"

    def _array(self, number: int, row: int, const: str = "const ") -> str:
        apart = self.apart[number]
        return self._at(f"x + {apart}" if apart else "x", row, const)
