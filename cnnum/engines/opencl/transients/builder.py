"""The base that all parts of a transient's lowering share: sizes, arrays, loops and rims."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import Arena, Tables
from cnnum.engines.opencl.transients.names import SUM, X
from cnnum.engines.opencl.transients.stencil_sums import weighted_terms
from cnnum.integrators.choice import Solver
from cnnum.kernels.formulas import formula
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Tap
from cnnum.templating.reads import delays_inputs
from cnnum.templating.template import Template

RIM = ir.Name("q")
"""The variable of loops over cells of rims."""

VECTORISE = "#pragma clang loop vectorize(assume_safety)"
"""With many neighbours compilers cannot prove that no round writes a cell that others read."""


@dataclass(frozen=True, slots=True)
class OwnNumbers:
    """The variables of frames' own numbers.

    Attributes
    ----------
    weights : mapping of float to Name
        By the numbers that stand for them in the template.
    taus : tuple of Name
        A layer each; `rates` are one over them.
    growth : Name
        Of errors, 1/time.
    delay : Name or None
    """

    weights: Mapping[float, ir.Name]
    taus: tuple[ir.Name, ...]
    growth: ir.Name
    delay: ir.Name | None

    @classmethod
    def of(cls, weights: Sequence[float], template: Template) -> "OwnNumbers":
        """Return the variables of a template's stand-ins."""
        return cls(
            {w: ir.Name(f"weight_{k}") for k, w in enumerate(weights)},
            tuple(ir.Name(f"tau_{layer}") for layer in range(template.layers)),
            ir.Name("growth"),
            None if template.delayed is None else ir.Name("delay"),
        )

    @property
    def rates(self) -> tuple[ir.Name, ...]:
        """One over τ of every layer."""
        return tuple(ir.Name(f"rate_{layer}") for layer in range(len(self.taus)))

    def declared(self, packed: Sequence[ir.Name], cells: int) -> list[ir.Statement]:
        """Return the statements that take them from the cells of maps."""
        names = (*self.weights.values(), *self.taus, self.growth)
        names += () if self.delay is None else (self.delay,)
        taken = [
            ir.fixed(name, packed[k // cells][ir.Integer(k % cells)])
            for k, name in enumerate(names)
        ]
        pairs = zip(self.rates, self.taus, strict=True)
        return [*taken, *(ir.fixed(rate, ir.ONE / tau) for rate, tau in pairs)]


@dataclass(frozen=True, slots=True)
class Operands:
    """Expressions of `i` for the maps that a transient reads; empty where one is not given.

    `own` are the variables of frames' own numbers, None where all share one template.
    """

    inputs: tuple[ir.Expression, ...]
    previous: tuple[ir.Expression, ...]
    states: tuple[ir.Expression, ...]
    biases: tuple[ir.Expression, ...]
    mask: ir.Expression | None
    own: OwnNumbers | None = None


@dataclass(slots=True)
class TransientBuilder:
    """Collects a transient's statements.

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
    body: list[ir.Statement] = field(default_factory=list[ir.Statement])

    @property
    def cells(self) -> int:
        """Cells of a layer."""
        return self.shape[0] * self.shape[1]

    @property
    def layers(self) -> int:
        """Layers of the template."""
        return self.template.layers

    @property
    def states(self) -> int:
        """Cells of all layers."""
        return self.layers * self.cells

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

    @property
    def has_history(self) -> bool:
        """Whether delayed inputs were others before the start."""
        return delays_inputs(self.template) and bool(self.operands.previous)

    def literal(self, value: float) -> str:
        """Return the text of a number of the kernel's type."""
        return self.tables.printer.expression(ir.Number(value))

    @property
    def places(self) -> list[ir.Expression]:
        """The places of cell `i` of every layer among the stacked states."""
        return [self.at(layer) for layer in range(self.layers)]

    def at(self, layer: int) -> ir.Expression:
        """Return the place of cell `i` of a layer among the stacked states."""
        return ir.Integer(layer * self.cells) + ir.CELL

    def padded_at(self, layer: int) -> ir.Expression:
        """Return the place of cell `i` of a layer among padded ones."""
        return ir.Integer(layer * self.padded) + ir.PLACE

    def each(self, array: ir.Name) -> list[ir.Element]:
        """Return cell `i` of every layer of stacked states."""
        return [array[place] for place in self.places]

    def output(self, state: ir.Expression) -> ir.Expression:
        """Return f(state)."""
        return formula(self.template.output.opencl, x=state)

    def rim_output(self) -> float:
        """Return the output of the virtual cells of a fixed boundary."""
        state = np.asarray(self.template.boundary.constant)
        return float(self.template.output.numpy(state))

    def start_of(self, layer: int) -> ir.Expression:
        """Return the initial state in cell `i` of a layer."""
        if self.operands.states:
            return self.operands.states[layer]
        initial = self.template.initial
        return self.operands.inputs[layer] if initial == "input" else ir.Number(float(initial))

    def start(self, name: ir.Name = X) -> None:
        """Append the array of states, set to where they start."""
        self.array(name, self.states)
        states = enumerate(self.each(name))
        self.over_cells([ir.Assign(state, self.start_of(layer)) for layer, state in states])

    def array(self, name: ir.Name, length: int) -> None:
        """Declare an array of the block."""
        self.body.append(self.arena.array(name.text, length))

    def aside(self, append: Callable[[], object]) -> list[ir.Statement]:
        """Return the statements that a call appends, instead of keeping them."""
        kept, self.body = self.body, []
        append()
        found, self.body = self.body, kept
        return found

    def over_cells(self, body: Sequence[ir.Statement]) -> None:
        """Run the body for every cell `i`."""
        self.body.append(ir.sweep(ir.CELL, self.cells, body))

    def over_grid(self, body: Sequence[ir.Statement]) -> None:
        """Run the body for every cell `i` that stands at `p` in a padded array."""
        hint = "" if self.arena.private else VECTORISE
        self.body.append(ir.grid(*self.shape, self.radius, body, hint))

    def fill_rims(
        self, array: ir.Name, layers: int, boundary: Boundary, constant: float | None
    ) -> None:
        """Fill the rims of all layers of a padded array: a constant, or copies of its cells."""
        if self.radius == 0:
            return
        to, source, count = self.tables.halo(boundary, self.shape, self.radius)
        places = [ir.Integer(layer * self.padded) for layer in range(layers)]
        body = [
            ir.Assign(
                array[place + to[RIM]],
                array[place + source[RIM]] if constant is None else ir.Number(constant),
            )
            for place in places
        ]
        self.body.append(ir.sweep(RIM, count, body))

    def copy_rims(self, array: ir.Name) -> None:
        """Fill the rims of outputs, or states, with copies of cells, unless they are fixed."""
        if self.template.boundary.constant is None:
            self.fill_rims(array, self.layers, self.template.boundary, None)

    def neighbour(self, array: ir.Name, tap: Tap) -> ir.Element:
        """Return a neighbour of cell `p`."""
        return array[ir.PLACE + (tap.source * self.padded + tap.row * self.pitch + tap.col)]

    def weighted(
        self, array: ir.Name, found: tuple[Tap, ...], total: ir.Name = SUM
    ) -> list[ir.Statement]:
        """Return statements that add the weighted neighbours of cell `p` to `total`."""
        terms = weighted_terms(found, self.number, lambda tap: self.neighbour(array, tap))
        return [ir.add(total, term) for term in terms]

    def number(self, weight: float) -> ir.Expression:
        """Return a weight: a number, or the variable that the number stands for."""
        own = self.operands.own
        return (own and own.weights.get(weight)) or ir.Number(weight)

    def unless_held(self, value: ir.Expression, held: ir.Expression) -> ir.Expression:
        """Return a value, and another one in cells that a mask holds."""
        mask = self.operands.mask
        return value if mask is None else ir.pick(mask.differs(ir.ZERO), held, value)

    def rate(self, layer: int) -> ir.Expression:
        """Return one over τ of a layer."""
        own = self.operands.own
        return own.rates[layer] if own else ir.Number(1.0 / float(self.template.tau[layer]))

    def slowest(self) -> ir.Expression:
        """Return the largest τ of any layer."""
        own = self.operands.own
        if own is None:
            return ir.Number(float(self.template.tau.max()))
        found: ir.Expression = own.taus[0]
        for tau in own.taus[1:]:
            found = ir.call("fmax", found, tau)
        return found

    def scale(self, value: ir.Expression) -> ir.Expression:
        """Return the tolerance of a value of this size."""
        return ir.Number(self.solver.atol) + ir.Number(self.solver.rtol) * ir.size(value)
