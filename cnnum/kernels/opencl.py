"""The printer of OpenCL C: vectors, global arrays, and kernels of strips."""

from dataclasses import dataclass

from cnnum.kernels.expressions import Component, Expression, Load
from cnnum.kernels.printer import PRIMARY, UNARY, Printer, Ranked
from cnnum.kernels.statements import Alias, Array, Store, StripSteps, Swap, Verbatim


@dataclass(frozen=True, slots=True)
class OpenCLPrinter(Printer):
    """Writes records as OpenCL C."""

    def component(self, component: Component) -> Ranked:
        """Write a number of a vector."""
        return f"{self.name(component.vector)[0]}.s{component.lane:x}", PRIMARY

    def load(self, load: Load) -> Ranked:
        """Write the vector at a place."""
        return f"*(__global const vec *)({self.expression(load.place)})", UNARY

    def array(self, array: Array) -> list[str]:
        """Write a new array."""
        if array.start is None:
            return [f"real {array.name.text}[{array.length}];"]
        return [f"__global real *const {array.name.text} = {self.expression(array.start)};"]

    def alias(self, alias: Alias) -> list[str]:
        """Write a name for numbers of a private array."""
        kept, start = "const " if alias.fixed else "", f" + {alias.start}" if alias.start else ""
        return [f"__private real *{kept}{alias.name.text} = {alias.array.text}{start};"]

    def swap(self, swap: Swap) -> list[str]:
        """Write that two aliases change places."""
        one, other = swap.one.text, swap.other.text
        return [f"__private real *const swap = {one}; {one} = {other}; {other} = swap;"]

    def store(self, store: Store) -> list[str]:
        """Write that a place gets a vector."""
        place, value = self.expression(store.place), self.expression(store.value)
        return [f"*(__global vec *)({place}) = {value};"]

    def strip_steps(self, steps: StripSteps) -> list[str]:
        """Write the call of a large array's steps."""
        levels = None if steps.levels is None else self.expression(steps.levels)
        return [steps.strips.within(levels)]

    def verbatim(self, text: Verbatim) -> list[str]:
        """Write a text with records in it."""
        written = ""
        for piece in text.pieces:
            if isinstance(piece, str):
                written += piece
            elif isinstance(piece, Expression):
                written += self.expression(piece)
            else:
                # statements stand as deep as the line that they begin
                pad = written[written.rfind("\n") + 1 :]
                depth = len(pad) // 4 if not pad.strip() else 0
                written += "\n".join(self.lines(piece, depth))[len(pad) if depth else 0 :]
        return written.splitlines()
