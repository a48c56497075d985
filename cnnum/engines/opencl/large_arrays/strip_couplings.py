"""The neighbourhood sums in a strip's rows.

An output that is loaded serves all the cells of the block that it is a neighbour of.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.engines.opencl.large_arrays.lane_rows import inputs_of
from cnnum.engines.opencl.large_arrays.strip_rows import ONES, START, At, P, Rows, constant, vector
from cnnum.engines.opencl.transients.nonlinear_couplings import Reads, V, gain_name, summed
from cnnum.engines.opencl.transients.stencil_sums import shares_products, weighted_terms
from cnnum.templating.couplings import Quantity
from cnnum.templating.network import Tap, taps

FROM, PAST, NEXT, PART, STATES = ir.names("from past next part states")
"""Variables of the kernel: the outputs of the level before; those a delay before it; those of the
step after them. Then how far between both the level is, and the states of the level before."""


Value = Callable[[int, int, int], ir.Expression]
"""An output, by its layer, and by rows and vectors from the block's."""


@dataclass(frozen=True, slots=True)
class Through:
    """Linear couplings through outputs of one moment.

    Attributes
    ----------
    value : callable
        An output.
    weights : (layers, layers, k, k) float
    factor : Expression, optional
        Of all weights.
    """

    value: Value
    weights: Floats
    factor: ir.Expression | None = None

    def taps(self, layer: int) -> tuple[Tap, ...]:
        """Return the weights into a layer that are not 0."""
        return taps(self.weights, layer)


@dataclass(frozen=True, slots=True)
class Kept:
    """Outputs around a vector of a block's cells, made of states, and kept for the next vector.

    Attributes
    ----------
    rows : Rows
    """

    rows: Rows

    @property
    def begin(self) -> list[ir.Statement]:
        """The statements before the row's first vector."""
        return [vector(self.value(*at), self._made(*at, START)) for at in self._places(False)]

    @property
    def load(self) -> list[ir.Statement]:
        """The reads of the next vectors."""
        return [constant(self.value(*at), self._made(*at, P)) for at in self._places(True)]

    @property
    def move(self) -> list[ir.Statement]:
        """The statements after those of a vector."""
        return [
            ir.Assign(self.value(source, row, col), self.value(source, row, col + 1))
            for source, row, col in self._places(False)
        ]

    def value(self, source: int, row: int, col: int) -> ir.Name:
        """Return an output."""
        radius = self.rows.text.radius
        return ir.Name(f"y{source}_{row + radius}_{col + radius}")

    def _places(self, last: bool) -> Iterable[tuple[int, int, int]]:
        """Return layers, rows and vectors: the last vectors in reach, or those before them."""
        radius, layers = self.rows.text.radius, range(self.rows.text.layers)
        cols = range(radius, radius + 1) if last else range(-radius, radius)
        return product(layers, range(-radius, self.rows.high + radius), cols)

    def _made(self, source: int, row: int, col: int, start: ir.Name) -> ir.Expression:
        state = self.rows.layout.loaded(FROM, source, row, col, start)
        output = self.rows.text.template.output
        return state if output.linear or output.limited else ir.call("shown", state, ONES)


def coupled(
    rows: Rows,
    state: str,
    *,
    whole: bool = False,
    between: bool = False,
    kept: Kept | None = None,
) -> list[ir.Statement]:
    """Return the statements that find s = w + A ∗ y − state, all scaled, in a block's rows.

    Parameters
    ----------
    rows : Rows
    state : str
        The array of states.
    whole : bool
        Whether s is the new state, so that the state is added.
    between : bool
        Whether the delayed time lies between the outputs of two steps.
    kept : Kept, optional
        Outputs, where arrays hold states alone.
    """
    lines, driven = list[ir.Statement](), ir.Name("driven")
    for at in rows.block:
        own = ir.Number(float(whole) - rows.scales[at.layer])
        states = rows.cells(FROM, at) if kept else rows.array(state, at)
        lines.append(vector(at.sum, rows.cells(driven, at) + own * states))
    for through in _throughs(rows, between, kept):
        shares = any(shares_products(through.taps(layer)) for layer in range(rows.text.layers))
        lines.append(ir.block(*(_gather if shares else _scatter)(rows, through)))
    for at in rows.block:
        for coupling in rows.text.template.nonlinear:
            if not coupling.static and coupling.to == at.layer:
                scale = rows.scales[at.layer]
                lines += summed(coupling, _quantities(rows, at), at.sum, scale, "vec")
    return lines


def _throughs(rows: Rows, between: bool, kept: Kept | None) -> list[Through]:
    """Return the linear couplings: the steady ones, those that vary in time, those that delay."""
    template, now = rows.text.template, kept.value if kept else _loaded(rows, FROM)
    steady, found = template.A.copy(), list[Through]()
    for k, gain in enumerate(template.gains):
        varying = np.zeros_like(steady)
        varying[gain.to, gain.source] = template.A[gain.to, gain.source]
        steady[gain.to, gain.source] = 0.0
        found.append(Through(now, varying, ir.call("(vec)", gain_name(k))))
    if template.delayed is not None:
        past = _mixed(rows) if between else _loaded(rows, PAST)
        found.append(Through(past, template.delayed.A))
    return [through for through in (Through(now, steady), *found) if through.weights.any()]


def _loaded(rows: Rows, array: ir.Expression) -> Value:
    return lambda source, row, col: rows.layout.loaded(array, source, row, col, P)


def _mixed(rows: Rows) -> Value:
    def value(source: int, row: int, col: int) -> ir.Expression:
        before, after = (_loaded(rows, each)(source, row, col) for each in (PAST, NEXT))
        return before + PART * (after - before)

    return value


def _scatter(rows: Rows, through: Through) -> list[ir.Statement]:
    """Return the statements that add every output, as it is loaded, to its sums."""
    found = {
        (layer, tap.source, tap.row, tap.col): tap.weight
        for layer in range(rows.text.layers)
        for tap in through.taps(layer)
    }
    radius, lines = rows.text.radius, list[ir.Statement]()
    sources = sorted({source for _, source, _, _ in found})
    around = range(-radius, radius + 1)
    for row, source, col in product(range(-radius, rows.high + radius), sources, around):
        adds = [
            ir.add(at.sum, _weight(rows, through, at.layer, found[key]) * V)
            for at in rows.block
            if (key := (at.layer, source, row - at.row, col)) in found
        ]
        if adds:
            lines.append(ir.block(constant(V, through.value(source, row, col)), *adds))
    return lines


def _gather(rows: Rows, through: Through) -> list[ir.Statement]:
    """Return the statements that load all outputs, and add those of equal weights first."""
    radius = rows.text.radius

    def name(source: int, row: int, col: int) -> ir.Name:
        return ir.Name(f"v{source}_{row + radius}_{col + radius}")

    places = {
        (tap.source, at.row + tap.row, tap.col)
        for at in rows.block
        for tap in through.taps(at.layer)
    }
    lines: list[ir.Statement] = [constant(name(*at), through.value(*at)) for at in sorted(places)]
    for at in rows.block:

        def output(tap: Tap, row: int = at.row) -> ir.Expression:
            return name(tap.source, row + tap.row, tap.col)

        weight = partial(_weight, rows, through, at.layer)
        terms = weighted_terms(through.taps(at.layer), weight, output)
        lines += [ir.add(at.sum, term) for term in terms]
    return lines


def _weight(rows: Rows, through: Through, layer: int, weight: float) -> ir.Expression:
    number = ir.Number(rows.scales[layer] * weight)
    return number if through.factor is None else through.factor * number


def _quantities(rows: Rows, at: At) -> Reads:
    """Return the states, outputs or inputs around a row's cells."""

    def quantity(name: Quantity, source: int, row: int, col: int) -> ir.Expression:
        if name == "u":  # every input is an array of its own
            return _loaded(rows, rows.base(inputs_of(source)))(0, at.row + row, col)
        return _loaded(rows, FROM if name == "y" else STATES)(source, at.row + row, col)

    return quantity
