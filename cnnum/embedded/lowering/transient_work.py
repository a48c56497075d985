"""One transient while it is lowered: its arguments, its drive, its start and its answers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import prod

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.embedded.arithmetic import Quantity, call, constant
from cnnum.embedded.formats import Format
from cnnum.embedded.lowering.builder import COLUMN, FINE, ROW, Builder, Padded, reach
from cnnum.embedded.program import Array
from cnnum.errors import NotSupportedError
from cnnum.graph.nodes import Pick
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.network import taps
from cnnum.templating.template import Template

Given = Mapping[str, Sequence[Array | Quantity]]
Terms = list[tuple[float, Quantity]]

Read = Callable[[str, int, int, int], Quantity]
"""Returns "x", "y" or "u" of a layer or input, so many rows below and columns to the right."""


J = ir.Name("j", (0, 1 << 16))
DOWN = ir.Name("d", (0, 1 << 16))


def item_at(
    to: Builder, array: Array, row: ir.Expression, width: int, col: ir.Expression
) -> Quantity:
    """Return the number of an array at a row and a column."""
    return to.item(array, call("add", call("multiply", row, ir.Integer(width)), col))


def sum_of(
    to: Builder, name: str, over: Sequence[tuple[ir.Name, int]], a: Quantity, b: Quantity
) -> Quantity:
    """Write a sum of products over counts, the last one innermost; return it."""
    count = prod(number for _, number in over)
    term = call("multiply", a.value, b.value)
    bounds = None
    if term.bounds is not None:
        bounds = min(0, count * term.bounds[0]), max(0, count * term.bounds[1])
    sum, nothing = ir.Name(name, bounds), to.zero()
    inner: ir.Statement = ir.add(sum, term)
    for variable, number in reversed(over):
        inner = ir.Loop(variable, number, (inner,))
    to.body += [ir.declare(sum, nothing), inner]
    return Quantity(sum, a.fraction + b.fraction)


@dataclass(slots=True, eq=False)
class TransientWork:
    """One transient while it is lowered.

    Attributes
    ----------
    to : Builder
    template : Template
    index : int
        Index of its node.
    given : mapping of str to sequence of Array or Quantity
        Arguments by role.
    picks : mapping of int to Pick
        Maps that are read of it, by the index of the node that reads.
    figures : dict of str to Quantity
        Numbers that are read of it, by name.
    watched : bool
        Whether the states of all layers are stored, since a flag says whether they rest.
    remembered : bool
        Whether a memory keeps its answers: they have the bits of a memory.
    """

    to: Builder
    template: Template
    index: int
    given: Given
    picks: Mapping[int, Pick]
    figures: dict[str, Quantity] = field(default_factory=dict[str, Quantity])
    watched: bool = False
    remembered: bool = False
    _padded: dict[tuple[int, float | None, int], Padded] = field(
        default_factory=dict[tuple[int, "float | None", int], Padded]
    )

    def check(self) -> None:
        """Check that a template and the results that are read from it can be exported."""
        template = self.template
        for pick in self.picks.values():
            if pick.what not in ("output", "state"):
                raise NotSupportedError(
                    f"The figure '{pick.what}' of a run cannot be exported: leave out the outputs "
                    "that need it."
                )
        for coupling in template.nonlinear:
            if not isinstance(coupling.function, Table):
                raise NotSupportedError(
                    f"The function '{coupling.function.name}' of two cells of template "
                    f"'{template.name}' cannot be exported: use a table of points."
                )
        if template.output.name not in ("standard", "linear", "full-range", "sign"):
            raise NotSupportedError(
                f"The output function '{template.output.name}' of template '{template.name}' "
                "cannot be exported: use a piecewise linear one."
            )

    @property
    def layers(self) -> list[int]:
        """The layers whose end anything reads."""
        if self.watched:
            return list(range(self.template.layers))
        return sorted({pick.layer for pick in self.picks.values()})

    def drive_terms(self, layer: int, share: float, late: str = "input") -> Terms:
        """Return the terms of a share of B ∗ u + z + bias of a cell; loops are padded by `halo`.

        `late` says which inputs a delayed B reads: "previous" ones, or those of the run.
        """
        template, terms = self.template, list[tuple[float, Quantity]]()
        if self.given["input"]:
            boundary = template.input_boundary
            if self.wide:
                terms += self._over_cells(layer, share)
            else:
                for tap in taps(template.B, layer):
                    padded = self.padded(self.given["input"][tap.source], boundary.constant)
                    terms.append((share * tap.weight, padded.at(tap.row, tap.col)))
            for number, coupling in self.couplings(layer, static=True):
                terms.append((share, self.coupled(number, coupling, self._input)))
            if template.delayed is not None:
                for tap in taps(template.delayed.B, layer):
                    padded = self.padded(self.given[late][tap.source], boundary.constant)
                    terms.append((share * tap.weight, padded.at(tap.row, tap.col)))
        if template.z[layer]:
            terms.append((1.0, self.fixed(share * float(template.z[layer]))))
        if self.given["bias"]:
            terms.append((share, self.cell(self.given["bias"][layer])))
        return terms

    def couplings(self, layer: int, *, static: bool) -> list[tuple[int, NonlinearCoupling]]:
        """Return the nonlinear couplings into a layer, with their numbers."""
        known = enumerate(self.template.nonlinear)
        return [
            (n, coupling)
            for n, coupling in known
            if coupling.to == layer and coupling.static == static
        ]

    def coupled(self, number: int, coupling: NonlinearCoupling, read: Read) -> Quantity:
        """Return the sum of weight · f(argument) of a nonlinear coupling; writes variables."""
        to, radius, terms = self.to, coupling.weights.shape[0] // 2, list[tuple[float, Quantity]]()
        for at, (row, col) in enumerate(np.argwhere(coupling.weights).tolist()):
            argument = read(coupling.neighbour, coupling.source, row - radius, col - radius)
            if coupling.centre is not None:
                own = read(coupling.centre, coupling.centre_source, 0, 0)
                first, second = (argument, own) if coupling.reversed_sign else (own, argument)
                argument = to.arithmetic.subtract(first, second, FINE)
            name = f"{self.index}_{number}_{at}"
            argument = self.register(f"v{name}", argument)
            value = self._function(coupling.table, argument)
            if coupling.times_argument:
                value = self.register(f"g{name}", value)
                value = to.arithmetic.multiply(value, argument, FINE)
            terms.append((float(coupling.weights[row, col]), self.register(f"f{name}", value)))
        total = to.arithmetic.weighted(terms, FINE)
        return self.register(f"f{self.index}_{number}", total)

    def register(self, name: str, value: Quantity) -> Quantity:
        """Return a value by a name, in the format that its range takes."""
        form = self.to.formats.register(name)
        return self.to.let(name, self.to.arithmetic.fit(value, form))  # type: ignore[arg-type]

    def _function(self, table: Table, v: Quantity) -> Quantity:
        """Return a table's function: steps as choices, straight lines as a sum of ramps."""
        arithmetic, points = self.to.arithmetic, table.points
        if table.interpolation == "constant":
            value_there = constant(points[-1][1])
            for place, value in reversed(points[:-1]):
                above = arithmetic.compare("greater", v, constant(place))
                value_there = arithmetic.select(above, value_there, constant(value), FINE)
            return value_there
        base, terms = points[0][1], list[tuple[float, Quantity]]()
        for (low, before), (high, after) in pairwise(points):
            slope = (after - before) / (high - low)
            if slope:
                ramp = arithmetic.extreme("maximum", v, constant(low), v.fraction)
                ramp = arithmetic.extreme("minimum", ramp, constant(high), v.fraction)
                terms.append((slope, ramp))
                base -= slope * low
        ramps = arithmetic.weighted(terms, FINE)
        return arithmetic.add(ramps, constant(base), FINE) if base else ramps

    def _input(self, quantity: str, source: int, row: int, col: int) -> Quantity:
        del quantity  # a coupling of the drive reads inputs alone
        return self.seen_input(source, self.halo).at(row, col)

    def seen_input(self, source: int, halo: int) -> Padded:
        """Return an input with a rim of that width."""
        edge = self.template.input_boundary.constant
        return self.padded(self.given["input"][source], edge, halo)

    def fixed(self, value: float) -> Quantity:
        """Return a constant term as the arithmetic has it."""
        number = constant(value)
        if not self.to.integer:
            return number
        return self.to.arithmetic.fit(number, self.to.formats.kept(f"z{self.index}"))  # type: ignore[arg-type]

    def start(self, layer: int) -> Quantity | None:
        """Return the initial state of a cell, or None if it is 0."""
        if self.given["state"]:
            return self.cell(self.given["state"][layer])
        if self.template.initial == "input":
            return self.cell(self.given["input"][layer])
        value = float(self.template.initial)
        return self.fixed(value) if value else None

    def cell(self, given: Array | Quantity) -> Quantity:
        """Return the cell's own value of an array or number."""
        return given if isinstance(given, Quantity) else self.to.item(given)

    @property
    def halo(self) -> int:
        """The width of the rims of inputs that the drive reads."""
        delayed = self.template.delayed
        late = 0 if delayed is None else reach(delayed.B)
        own = 0 if self.wide else reach(self.template.B)
        return max(own, self.far(static=True), late)

    @property
    def by_place(self) -> bool:
        """Whether the drive of a cell is written in loops over rows and columns."""
        return self.wide or self.halo > 0

    @property
    def wide(self) -> bool:
        """Whether B has more weights than the map has cells, and nothing lies beyond its edge.

        Then a sum over cells, by a table of weights, has fewer terms than one over weights: those
        of an 8×8 map by a 15×15 template are 64 and not 225.
        """
        template, inputs = self.template, self.given["input"]
        whole = all(
            isinstance(given, Array) for n, given in enumerate(inputs) if np.any(template.B[:, n])
        )
        most = int(np.count_nonzero(template.B, axis=(2, 3)).max(initial=0))
        return template.input_boundary.constant == 0.0 and whole and most > self.to.cells

    def _over_cells(self, layer: int, share: float) -> Terms:
        """Return a share of B ∗ u of a cell as sums over the cells of inputs; writes variables."""
        to, (rows, cols) = self.to, self.to.shape
        terms = list[tuple[float, Quantity]]()
        kernels = self.template.B[layer]
        middle, width = kernels.shape[-1] // 2, 2 * cols - 1
        row = call("add", call("subtract", ir.Integer(rows - 1), ROW), DOWN)
        col = call("add", call("subtract", ir.Integer(cols - 1), COLUMN), J)
        for source, kernel in enumerate(kernels):
            if not np.any(kernel):
                continue
            given = self.given["input"][source]
            assert isinstance(given, Array)
            weights = np.zeros((2 * rows - 1, width))
            down, across = (min(n - 1, middle) for n in (rows, cols))
            part = kernel[middle - down : middle + down + 1, middle - across : middle + across + 1]
            weights[rows - 1 - down : rows + down, cols - 1 - across : cols + across] = part
            name = f"k{self.index}_{layer}_{source}_{len(to.arrays)}"
            table, _ = to.table(name, share * weights, "weights by distance")
            a, b = item_at(to, table, row, width, col), item_at(to, given, DOWN, cols, J)
            over = [(DOWN, rows), (J, cols)]
            terms.append((1.0, sum_of(to, f"s{self.index}_{layer}_{source}", over, a, b)))
        return terms

    def far(self, *, static: bool) -> int:
        """Return how far nonlinear couplings reach: those of the drive, or those of each step."""
        known = [
            coupling.weights for coupling in self.template.nonlinear if coupling.static == static
        ]
        return max((reach(weights[np.newaxis, np.newaxis]) for weights in known), default=0)

    def padded(
        self, given: Array | Quantity, edge: float | None, halo: int | None = None
    ) -> Padded:
        """Return an input with its rim, which is written where it is asked for first."""
        width = self.halo if halo is None else halo
        key = (id(given), edge, width)
        if key not in self._padded:
            name = f"p{self.index}_{len(self._padded)}"
            self._padded[key] = Padded.copied(
                self.to, name, given, self.template.input_boundary, width
            )
        return self._padded[key]

    def prepare(self) -> None:
        """Write the rims of all inputs."""
        static = [coupling for coupling in self.template.nonlinear if coupling.static]
        read = {coupling.source for coupling in static}
        read |= {coupling.centre_source for coupling in static if coupling.centre}
        delayed, edge = self.template.delayed, self.template.input_boundary.constant
        for source, input_map in enumerate(self.given["input"]):
            late = delayed is not None and bool(np.any(delayed.B[:, source]))
            if late or source in read or np.any(self.template.B[:, source]):
                self.padded(input_map, edge)
            if late and self.given["previous"]:
                self.padded(self.given["previous"][source], edge)

    def target(self, layer: int, what: str) -> Array:
        """Return a new array for a layer's state or output."""
        name = f"x{self.index}_{layer}{'y' if what == 'output' else ''}"
        if name in self.to.arrays:
            return self.to.arrays[name]
        form = self.format_of(name)
        return self.to.array(name, "work", self.to.cells, form, f"template {self.template.name}")

    def table(self, name: str, values: Floats, description: str, bits: int = 0) -> Array:
        """Return a table of this transient, which may be there, as `Builder.table` does."""
        name = f"k{self.index}_{name}"
        return self.to.arrays.get(name) or self.to.table(name, values, description, bits)[0]

    def format_of(self, name: str) -> Format | None:
        """Return the format of a map of states."""
        formats = self.to.formats
        return formats.kept(name) if self.remembered else formats.stored(name)

    def uncoupled(self, kept: Floats) -> dict[int, Array]:
        """Write x = (1 − k) w + k x₀ of every layer that is read; masked cells stay at x₀."""
        self.prepare()
        result, masks = dict[int, Array](), self.given["mask"]
        for layer in self.layers:
            share = float(kept[layer])
            with self.to.within() as body:
                terms = self.drive_terms(layer, 1.0 - share)
                start = self.start(layer) if share or masks else None
                if start is not None and share:
                    terms.append((share, start))
                state = self.to.arithmetic.weighted(terms, FINE)
                if masks:
                    state = self.masked(state, start)
                result |= self.answers(layer, state)
            self.to.loop(body, cols=self.by_place, halo=self.halo)
        return result

    def masked(self, new: Quantity, kept: Quantity | None) -> Quantity:
        """Return a new state where the mask leaves a cell free, and the kept one elsewhere."""
        mask = self.cell(self.given["mask"][0])
        stays = constant(0.0) if kept is None else kept
        # the kept state keeps all its places
        return self.to.arithmetic.select(mask, stays, new, max(new.fraction, stays.fraction))

    def answers(self, layer: int, state: Quantity) -> dict[int, Array]:
        """Store the state of a layer, and its output where that is another."""
        result = dict[int, Array]()
        if self.watched:
            self.to.store(self.target(layer, "state"), state)
        for index, pick in self.picks.items():
            if pick.layer != layer:
                continue
            linear = self.template.output.linear or pick.what == "state"
            array = self.target(layer, "state" if linear else "output")
            value = state if linear else self.output(state)
            if array not in result.values() and not (linear and self.watched):
                self.to.store(array, value)
            result[index] = array
        return result

    def output(self, state: Quantity) -> Quantity:
        """Return the output f(x) of a state."""
        if self.template.output.discrete:
            positive = self.to.arithmetic.compare("at_least", state, constant(0.0))
            return self.to.arithmetic.select(positive, constant(1.0), constant(-1.0), FINE)
        return self.clipped(state)

    def clipped(self, state: Quantity) -> Quantity:
        """Return a state kept within −1 and 1."""
        arithmetic = self.to.arithmetic
        low = arithmetic.extreme("maximum", state, constant(-1.0), state.fraction)
        return arithmetic.extreme("minimum", low, constant(1.0), state.fraction)
