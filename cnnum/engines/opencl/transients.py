"""The kernel text of one transient: its drive w = B∗u + z, its start, its steps, its results."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from cnnum.boundary import Boundary
from cnnum.engines.opencl.storage import Arena, Tables
from cnnum.engines.opencl.text import number, rename
from cnnum.integrators.choice import Solver
from cnnum.network import Tap, taps
from cnnum.template import Template


@dataclass(frozen=True, slots=True)
class Operands:
    """Expressions of `i` for what a transient reads; None where it is not given."""

    inputs: tuple[str, ...]
    states: tuple[str, ...] | None
    biases: tuple[str, ...] | None
    mask: str | None


@dataclass(slots=True)
class TransientText:
    """Shared parts of a transient's text; the schemes in `schemes.py` are built of them.

    States of all layers are stacked: layer l's cell i is `x[l * cells + i]`.
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
    def feedback_radius(self) -> int:
        """Neighbourhood radius of A."""
        return int(self.template.A.shape[-1]) // 2

    def number(self, value: float) -> str:
        """Return a literal of the kernel's type."""
        return number(value, self.tables.dtype)

    def padded(self, radius: int) -> int:
        """Return the number of cells of a layer with its rim."""
        return (self.shape[0] + 2 * radius) * (self.shape[1] + 2 * radius)

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

    def over_grid(self, radius: int, body: list[str]) -> None:
        """Run the body for every cell `i` that stands at `p` in an array padded by `radius`."""
        rows, cols = self.shape
        self.lines.append(f"for (int r = 0; r < {rows}; ++r) {{")
        self.lines.append(f"    for (int c = 0; c < {cols}; ++c) {{")
        at = f"(r + {radius}) * {cols + 2 * radius} + c + {radius}"
        self.lines.append(f"        const int i = r * {cols} + c, p = {at};")
        self.lines += [f"        {line}" for line in body]
        self.lines += ["    }", "}"]

    def fill_rim(self, array: str, boundary: Boundary, radius: int, constant: str | None) -> None:
        """Fill the rim of one padded layer, by a constant or by copying cells of the array."""
        if radius == 0:
            return
        to, source, count = self.tables.halo(boundary, self.shape, radius)
        value = f"{array}[{source}[q]]" if constant is None else constant
        self.lines.append(f"for (int q = 0; q < {count}; ++q) {{ {array}[{to}[q]] = {value}; }}")

    def weighted(self, array: str, radius: int, found: tuple[Tap, ...]) -> list[str]:
        """Return statements that add the weighted neighbours of cell `p` to `sum`."""
        pitch, layer = self.shape[1] + 2 * radius, self.padded(radius)
        return [
            f"sum += {self.number(tap.weight)} * "
            f"{array}[p + {tap.source * layer + tap.row * pitch + tap.col}];"
            for tap in found
        ]

    # the drive: w = B∗u + z + bias, once a frame

    def drive(self) -> None:
        """Compute w where it is not just z."""
        template, radius = self.template, int(self.template.B.shape[-1]) // 2
        self.lines.append(f"// {template.name}: w = B * u + z")
        if self.constant_drive is not None:
            return
        self.array("w", self.layers * self.cells)
        if template.B.any():
            self._pad_inputs(radius)
        body: list[str] = []
        for layer in range(self.layers):
            start = self.number(float(template.z[layer]))
            if self.operands.biases is not None:
                start += f" + {self.operands.biases[layer]}"
            body.append(f"sum = {start};")
            body += self.weighted("u", radius, taps(template.B, layer))
            body.append(f"w[{layer * self.cells} + i] = sum;")
        self.over_grid(radius, ["real sum;", *body])

    def _pad_inputs(self, radius: int) -> None:
        size, boundary = self.padded(radius), self.template.input_boundary
        self.array("u", self.template.inputs * size)
        fills = [f"u[{m * size} + p] = {text};" for m, text in enumerate(self.operands.inputs)]
        self.over_grid(radius, fills)
        constant = None if boundary.constant is None else self.number(boundary.constant)
        for m in range(self.template.inputs):
            self.fill_rim(f"(u + {m * size})", boundary, radius, constant)

    @property
    def constant_drive(self) -> tuple[float, ...] | None:
        """Z of every layer where nothing else drives the cells."""
        if self.template.B.any() or self.operands.biases is not None:
            return None
        return tuple(float(z) for z in self.template.z)

    def drive_of(self, layer: int) -> str:
        """Return the expression for w in cell `i` of a layer."""
        constant = self.constant_drive
        if constant is not None:
            return self.number(constant[layer])
        return f"w[{layer * self.cells} + i]"

    # the start

    @property
    def constant_start(self) -> float | None:
        """The initial state where it is the same in every cell and frame."""
        if self.operands.states is None and self.template.initial != "input":
            return float(self.template.initial)
        return None

    def start_of(self, layer: int) -> str:
        """Return the expression for the initial state in cell `i` of a layer."""
        if self.operands.states is not None:
            return self.operands.states[layer]
        if self.template.initial == "input":
            return self.operands.inputs[layer]
        return self.number(float(self.template.initial))

    def start(self, name: str = "x") -> None:
        """Declare the state and set it to where it starts."""
        self.array(name, self.layers * self.cells)
        starts = [(layer * self.cells, self.start_of(layer)) for layer in range(self.layers)]
        self.over_cells([f"{name}[{at} + i] = {text};" for at, text in starts])

    # the neighbours' outputs and the rates

    def declare_outputs(self) -> None:
        """Declare the padded outputs y and fill what of their rim stays the same."""
        radius, boundary = self.feedback_radius, self.template.boundary
        size = self.padded(radius)
        self.array("y", self.layers * size)
        if boundary.constant is not None:
            value = float(self.template.output.numpy(np.asarray(boundary.constant)))
            for layer in range(self.layers):
                self.fill_rim(f"(y + {layer * size})", boundary, radius, self.number(value))

    def outputs(self, state: list[str], keep: str | None = None) -> None:
        """Set y = f(state), the state given by one expression a layer; keep it in an array."""
        radius, template = self.feedback_radius, self.template
        size = self.padded(radius)
        body: list[str] = []
        for layer, text in enumerate(state):
            inner = [f"real now = {text};"]
            if template.output.limited:
                inner.append("now = clamp(now, -ONE, ONE);")
            if keep is not None:
                inner.append(f"{keep}[{layer * self.cells} + i] = now;")
            output = rename(template.output.opencl, {"x": "now"})
            inner.append(f"y[{layer * size} + p] = {output};")
            body.append("{ " + " ".join(inner) + " }")
        self.over_grid(radius, body)
        if template.boundary.constant is None:
            for layer in range(self.layers):
                self.fill_rim(f"(y + {layer * size})", template.boundary, radius, None)

    def rates(self, state: str, then: list[str]) -> None:
        """Evaluate `rate` = dx/dt in every cell of every layer and run `then` on it.

        In `then`, {at} is the cell's place among the stacked states.
        """
        template = self.template
        body: list[str] = ["real sum, rate;"]
        for layer in range(self.layers):
            at = f"{layer * self.cells} + i"
            body.append(f"sum = {self.drive_of(layer)} - {state}[{at}];")
            body += self.weighted("y", self.feedback_radius, taps(template.A, layer))
            body.append(f"rate = {self.number(1.0 / float(template.tau[layer]))} * sum;")
            if self.operands.mask is not None:
                body.append(f"rate = PICK({self.operands.mask} != ZERO, ZERO, rate);")
            body += [line.replace("{at}", at) for line in then]
        self.over_grid(self.feedback_radius, body)

    def watch_change(self, state: str) -> list[str]:
        """Return statements that keep the largest rate, in units of the tolerance, in `change`.

        A state whose rate times its layer's τ is below the tolerance stays within about that of
        its equilibrium.
        """
        tau = self.number(float(self.template.tau.max()))
        return [f"change = fmax(change, fabs({tau} * rate) / {self.scale(f'{state}[{{at}}]')});"]

    def scale(self, size: str) -> str:
        """Return the tolerance of a value of this size."""
        return f"({self.number(self.solver.atol)} + {self.number(self.solver.rtol)} * fabs({size}))"
