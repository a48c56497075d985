"""The base shared by all parts of a transient's lowering: names, sizes, arrays, loops and rims.

Weighted sums use one product for all neighbours with equal weights.

The neighbours in a column are added first: the cells to the left and right need the same sum, with
the same weight or another, so compilers compute it only once.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import Arena, Tables
from cnnum.integrators.choice import Solver
from cnnum.kernels.expressions import formula
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Tap, delays_inputs
from cnnum.templating.template import Template

X, Y, XP, YD, U = ir.names("x y xp yd u")
"""States, stacked by layer; padded outputs, states, delayed outputs, and inputs."""

W, LATER = ir.names("w later")
"""The drive of the cells, and its change when the delay has elapsed."""

SUM, NOW, RATE, PART = ir.names("sum now rate part")
"""Per cell: a sum, the current value, dx/dt, and a partial sum."""

XS = ir.Name("xs")
"""The states at a step's stages, and finally at its end."""

H, TIME, STEPS, RUNNING = ir.names("h time steps running")
"""Step length, time and steps since the start, and whether a frame takes another step."""

CHANGE, SETTLED, STILL = ir.names("change settled still")
"""Largest rate, in units of the tolerance; whether, and for how many steps, nothing has changed."""

LARGEST = ir.Name("largest")
"""The largest value, to which the rounding error of a closed form is proportional."""


def zeros(*variables: ir.Name) -> tuple[tuple[ir.Name, ir.Expression], ...]:
    """Return variables of a declaration, initialised to 0."""
    return tuple((name, ir.ZERO) for name in variables)


def rates_of(stage: int) -> ir.Name:
    """Return the array of a stage's rates."""
    return ir.Name(f"k{stage}")


def shared_products(weights: Iterable[Tap], least: int = 2) -> list[tuple[Tap, ...]]:
    """Return the taps, grouped column by column by weights of equal magnitude.

    Parameters
    ----------
    weights : iterable of Tap
    least : int
        Minimum number of taps in a group; smaller groups are split up.
    """
    equal: dict[float, list[Tap]] = {}
    for tap in weights:
        equal.setdefault(abs(tap.weight), []).append(tap)
    groups: list[tuple[Tap, ...]] = []
    for group in equal.values():
        many = len(group) >= least
        groups += [tuple(sorted(group, key=_column))] if many else [(tap,) for tap in group]
    return groups


def shares_products(weights: Iterable[Tap]) -> bool:
    """Return whether any two weights have equal magnitude."""
    return any(len(group) > 1 for group in shared_products(weights))


def weighted_terms(
    weights: Iterable[Tap],
    number: Callable[[float], ir.Expression],
    value: Callable[[Tap], ir.Expression],
    least: int = 2,
) -> list[ir.Expression]:
    """Return the terms of Σ weight · value, one per group of equal weights.

    Parameters
    ----------
    weights : iterable of Tap
    number : callable
        The literal of a weight.
    value : callable
        The expression of the value at a tap.
    least : int
        Minimum number of taps in a group; smaller groups are split up.
    """
    return [_term(group, number, value) for group in shared_products(weights, least)]


def _column(tap: Tap) -> tuple[int, int, int]:
    return tap.source, tap.col, tap.row


def _term(
    group: tuple[Tap, ...],
    number: Callable[[float], ir.Expression],
    value: Callable[[Tap], ir.Expression],
) -> ir.Expression:
    weight, total = group[0].weight, None
    for _, column in groupby(group, key=lambda tap: (tap.source, tap.col)):
        first, *others = column
        # within a column the first is added, so that the sum is the same wherever it is used
        inner = value(first)
        for tap in others:
            inner = _added(inner, value(tap), tap.weight == first.weight)
        total = inner if total is None else _added(total, inner, first.weight == weight)
    assert total is not None
    return number(weight) * total


def _added(total: ir.Expression, value: ir.Expression, same: bool) -> ir.Expression:
    return total + value if same else total - value


RIM = ir.Name("q")
"""Loop variable for rim cells."""

VECTORISE = "#pragma clang loop vectorize(assume_safety)"
"""With many neighbours, compilers cannot prove that iterations are independent."""


@dataclass(frozen=True, slots=True)
class OwnNumbers:
    """The variables that hold per-frame parameters.

    Attributes
    ----------
    weights : mapping of float to Name
        Variables of weights, by their placeholder values in the template.
    taus : tuple of Name
        One per layer; `rates` are their reciprocals.
    growth : Name
        Growth rate of errors, 1/time.
    delay : Name or None
    """

    weights: Mapping[float, ir.Name]
    taus: tuple[ir.Name, ...]
    growth: ir.Name
    delay: ir.Name | None

    @classmethod
    def of(cls, weights: Sequence[float], template: Template) -> "OwnNumbers":
        """Return the variables for a template's placeholder values."""
        return cls(
            {w: ir.Name(f"weight_{k}") for k, w in enumerate(weights)},
            tuple(ir.Name(f"tau_{layer}") for layer in range(template.layers)),
            ir.Name("growth"),
            None if template.delayed is None else ir.Name("delay"),
        )

    @property
    def rates(self) -> tuple[ir.Name, ...]:
        """The value of 1/τ in every layer."""
        return tuple(ir.Name(f"rate_{layer}") for layer in range(len(self.taus)))

    def declared(self, packed: Sequence[ir.Name], cells: int) -> list[ir.Statement]:
        """Return the statements that read them from the cells of maps."""
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
    """Expressions in `i` for the maps that a transient reads; empty if a map is not given.

    `own` holds the variables of per-frame parameters, None if all frames share one template.
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

    States of all layers are stacked: cell i of layer l is `x[l * cells + i]`. Outputs `y` (and, if
    a coupling needs them, states `xp` and inputs `u`) are padded by a rim: cell i is at `p`.
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
        """Whether delayed inputs were different before the start."""
        return delays_inputs(self.template) and bool(self.operands.previous)

    def literal(self, value: float) -> str:
        """Return the literal of a number of the kernel's type."""
        return self.tables.printer.expression(ir.Number(value))

    @property
    def places(self) -> list[ir.Expression]:
        """The indices of cell `i` of every layer in the stacked states."""
        return [self.at(layer) for layer in range(self.layers)]

    def at(self, layer: int) -> ir.Expression:
        """Return the index of cell `i` of a layer in the stacked states."""
        return ir.Integer(layer * self.cells) + ir.CELL

    def padded_at(self, layer: int) -> ir.Expression:
        """Return the index of cell `i` of a layer in padded arrays."""
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
        """Append the array of states, set to the initial states."""
        self.array(name, self.states)
        states = enumerate(self.each(name))
        self.over_cells([ir.Assign(state, self.start_of(layer)) for layer, state in states])

    def array(self, name: ir.Name, length: int) -> None:
        """Declare an array in the block."""
        self.body.append(self.arena.array(name.text, length))

    def aside(self, append: Callable[[], object]) -> list[ir.Statement]:
        """Return the statements that a call would append, without appending them."""
        kept, self.body = self.body, []
        append()
        result, self.body = self.body, kept
        return result

    def over_cells(self, body: Sequence[ir.Statement]) -> None:
        """Append a loop of the body over every cell `i`."""
        self.body.append(ir.sweep(ir.CELL, self.cells, body))

    def over_grid(self, body: Sequence[ir.Statement]) -> None:
        """Append a loop of the body over every cell `i`, with its index `p` in padded arrays."""
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
        """Fill the rims of outputs or states with copies of cells, unless the boundary is fixed."""
        if self.template.boundary.constant is None:
            self.fill_rims(array, self.layers, self.template.boundary, None)

    def neighbour(self, array: ir.Name, tap: Tap) -> ir.Element:
        """Return a neighbour of cell `p`."""
        return array[ir.PLACE + (tap.source * self.padded + tap.row * self.pitch + tap.col)]

    def weighted(
        self, array: ir.Name, weights: tuple[Tap, ...], total: ir.Name = SUM
    ) -> list[ir.Statement]:
        """Return statements that add the weighted neighbours of cell `p` to `total`."""
        terms = weighted_terms(weights, self.number, lambda tap: self.neighbour(array, tap))
        return [ir.add(total, term) for term in terms]

    def number(self, weight: float) -> ir.Expression:
        """Return a weight: a number, or the variable for which the number is a placeholder."""
        own = self.operands.own
        return (own and own.weights.get(weight)) or ir.Number(weight)

    def unless_held(self, value: ir.Expression, held: ir.Expression) -> ir.Expression:
        """Return `value`, replaced by `held` in cells that the mask holds fixed."""
        mask = self.operands.mask
        return value if mask is None else ir.pick(mask.differs(ir.ZERO), held, value)

    def rate(self, layer: int) -> ir.Expression:
        """Return 1/τ of a layer."""
        own = self.operands.own
        return own.rates[layer] if own else ir.Number(1.0 / float(self.template.tau[layer]))

    def slowest(self) -> ir.Expression:
        """Return the largest τ of any layer."""
        own = self.operands.own
        if own is None:
            return ir.Number(float(self.template.tau.max()))
        result: ir.Expression = own.taus[0]
        for tau in own.taus[1:]:
            result = ir.call("fmax", result, tau)
        return result

    def scale(self, value: ir.Expression) -> ir.Expression:
        """Return the tolerance for a value of this size."""
        return ir.Number(self.solver.atol) + ir.Number(self.solver.rtol) * ir.size(value)
