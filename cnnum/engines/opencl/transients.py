"""What every part of a transient's kernel text shares: its sizes, arrays, loops and rims."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from cnnum.engines.opencl.equal_weights import weighted_terms
from cnnum.engines.opencl.storage import Arena, Tables
from cnnum.engines.opencl.text import number
from cnnum.integrators.choice import Solver
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Tap
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True)
class Operands:
    """Expressions of `i` for what a transient reads; empty where it is not given."""

    inputs: tuple[str, ...]
    previous: tuple[str, ...]
    states: tuple[str, ...]
    biases: tuple[str, ...]
    mask: str | None


@dataclass(slots=True)
class TransientText:
    """Collects a transient's text.

    States of all layers are stacked: layer l's cell i is `x[l * cells + i]`. Outputs `y` (and,
    where a coupling wants them, states `xp` and inputs `u`) are padded by their rim: cell i
    stands at `p`.
    """

    template: Template
    shape: tuple[int, int]
    solver: Solver
    operands: Operands
    arena: Arena
    tables: Tables
    lines: list[str] = field(default_factory=list[str])

    @property
    def cells(self) -> int:
        """Cells of a layer."""
        return self.shape[0] * self.shape[1]

    @property
    def layers(self) -> int:
        """Layers of the template."""
        return self.template.layers

    @property
    def radius(self) -> int:
        """Width of the rims: the largest neighbourhood radius of the template."""
        return self.template.radius

    @property
    def padded(self) -> int:
        """Cells of a layer with its rim."""
        return (self.shape[0] + 2 * self.radius) * self.pitch

    @property
    def pitch(self) -> int:
        """Distance from one row to the next in a padded layer."""
        return self.shape[1] + 2 * self.radius

    def number(self, value: float) -> str:
        """Return a literal of the kernel's type."""
        return number(value, self.tables.dtype)

    def at(self, layer: int) -> str:
        """Return the place of cell `i` of a layer among the stacked states."""
        return f"{layer * self.cells} + i"

    def array(self, name: str, length: int) -> None:
        """Declare an array of the block."""
        self.lines.append(self.arena.array(name, length))

    @contextmanager
    def aside(self) -> Generator[list[str]]:
        """Collect what is appended within the block instead of appending it."""
        kept, self.lines = self.lines, []
        yield self.lines
        self.lines = kept

    def over_cells(self, body: list[str]) -> None:
        """Run the body for every cell `i`."""
        self.lines.append(f"for (int i = 0; i < {self.cells}; ++i) {{")
        self.lines += [f"    {line}" for line in body]
        self.lines.append("}")

    def over_grid(self, body: list[str]) -> None:
        """Run the body for every cell `i` that stands at `p` in a padded array."""
        rows, cols = self.shape
        self.lines.append(f"for (int r = 0; r < {rows}; ++r) {{")
        if not self.arena.private:
            # with many neighbours compilers give up to prove that no round writes what others read
            self.lines.append("#pragma clang loop vectorize(assume_safety)")
        self.lines.append(f"    for (int c = 0; c < {cols}; ++c) {{")
        at = f"(r + {self.radius}) * {self.pitch} + c + {self.radius}"
        self.lines.append(f"        const int i = r * {cols} + c, p = {at};")
        self.lines += [f"        {line}" for line in body]
        self.lines += ["    }", "}"]

    def fill_rims(
        self, array: str, layers: int, boundary: Boundary, constant: float | None
    ) -> None:
        """Fill the rims of all layers of a padded array: a constant, or copies of its cells."""
        if self.radius == 0:
            return
        to, source, count = self.tables.halo(boundary, self.shape, self.radius)
        self.lines.append(f"for (int q = 0; q < {count}; ++q) {{")
        for layer in range(layers):
            place = f"{array}[{layer * self.padded} + {to}[q]]"
            copied = f"{array}[{layer * self.padded} + {source}[q]]"
            value = copied if constant is None else self.number(constant)
            self.lines.append(f"    {place} = {value};")
        self.lines.append("}")

    def neighbour(self, array: str, tap: Tap) -> str:
        """Return the expression for a neighbour of cell `p`."""
        offset = tap.source * self.padded + tap.row * self.pitch + tap.col
        return f"{array}[p + {offset}]"

    def weighted(self, array: str, found: tuple[Tap, ...], total: str = "sum") -> list[str]:
        """Return statements that add the weighted neighbours of cell `p` to `total`."""
        terms = weighted_terms(found, self.number, lambda tap: self.neighbour(array, tap))
        return [f"{total} += {term};" for term in terms]

    def scale(self, size: str) -> str:
        """Return the tolerance of a value of this size."""
        return f"({self.number(self.solver.atol)} + {self.number(self.solver.rtol)} * fabs({size}))"
