"""The neighbourhood sums in a strip's rows.

An output that is loaded serves all the cells of the block that it is a neighbour of.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from operator import eq

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_rows import inputs_of
from cnnum.engines.opencl.large_arrays.strip_rows import (
    ONES,
    START,
    At,
    P,
    Rows,
    X,
    constant,
    vector,
)
from cnnum.engines.opencl.transients.nonlinear_couplings import Reads, V, gain_name, summed
from cnnum.engines.opencl.transients.stencil_sums import shares_products, weighted_terms
from cnnum.templating.couplings import Quantity
from cnnum.templating.network import Tap, taps
from cnnum.templating.reads import delays_outputs

FROM, PAST, NEXT, PART, STATES = ir.names("from past next part states")
"""Variables of the kernel: the outputs of the level before; those a delay before it, those of the
step after them, and how far between both the level is; and the states of the level before."""


Value = Callable[[int, int, int], ir.Expression]
"""An output, by its layer, and by rows and vectors from the block's."""


@dataclass(frozen=True, slots=True)
class Through:
    """Linear couplings through outputs of one moment.

    Attributes
    ----------
    value : callable
        An output.
    factor : Expression or None
        The factor of their weights.
    taps : tuple of tuple of Tap
        Of each layer.
    """

    value: Value
    factor: ir.Expression | None
    taps: tuple[tuple[Tap, ...], ...]


@dataclass(frozen=True, slots=True)
class Kept:
    """Outputs around a vector of a block's cells, made of states, and kept for the next vector.

    Attributes
    ----------
    rows : Rows
    block : int
        Rows of a block.
    """

    rows: Rows
    block: int

    @property
    def begin(self) -> list[ir.Statement]:
        """The statements before the row's first vector."""
        radius = self._radius
        return [
            vector(self.value(*at, col), self._made(*at, col, START))
            for at in self._rows
            for col in range(-radius, radius)
        ]

    @property
    def load(self) -> list[ir.Statement]:
        """The reads of the next vectors."""
        radius = self._radius
        return [constant(self.value(*at, radius), self._made(*at, radius, P)) for at in self._rows]

    @property
    def move(self) -> list[ir.Statement]:
        """The statements after those of a vector."""
        radius = self._radius
        return [
            ir.Assign(self.value(*at, col), self.value(*at, col + 1))
            for at in self._rows
            for col in range(-radius, radius)
        ]

    def value(self, source: int, row: int, col: int) -> ir.Name:
        """Return an output."""
        radius = self._radius
        return ir.Name(f"y{source}_{row + radius}_{col + radius}")

    @property
    def _radius(self) -> int:
        return self.rows.text.radius

    @property
    def _rows(self) -> list[tuple[int, int]]:
        """Layers and rows."""
        radius, layers = self._radius, range(self.rows.text.layers)
        return [(layer, row) for layer in layers for row in range(-radius, self.block + radius)]

    def _made(self, source: int, row: int, col: int, start: ir.Name) -> ir.Expression:
        state = self.rows.layout.loaded(FROM, source, row, col, start)
        output = self.rows.text.template.output
        return state if output.linear or output.limited else ir.call("shown", state, ONES)


def coupled(
    rows: Rows,
    block: list[At],
    own: tuple[float, ...],
    state: str,
    *,
    between: bool = False,
    kept: Kept | None = None,
) -> list[ir.Statement]:
    """Return the statements that find s = w + own · state + A ∗ y in a block's rows.

    Parameters
    ----------
    rows : Rows
    block : list of At
    own : tuple of float
        One a layer.
    state : str
        The array of states.
    between : bool
        Whether the delayed time lies between the outputs of two steps.
    kept : Kept, optional
        Outputs, where arrays hold states alone.
    """
    states = {at: rows.cells(FROM, at) if kept else rows.array(state, at) for at in block}
    driven = ir.Name("driven")
    lines: list[ir.Statement] = [
        vector(at.sum, rows.cells(driven, at) + ir.Number(own[at.layer]) * states[at])
        for at in block
    ]
    for through in _throughs(rows, between, kept):
        shares = any(shares_products(found) for found in through.taps)
        lines.append(ir.block(*(_gather if shares else _scatter)(rows, block, through)))
    for at in block:
        for coupling in rows.text.template.nonlinear:
            if not coupling.static and coupling.to == at.layer:
                scale = rows.scales[at.layer]
                lines += summed(coupling, _quantities(rows, at), at.sum, scale, "vec")
    return lines


def _throughs(rows: Rows, between: bool, kept: Kept | None) -> list[Through]:
    """Return the linear couplings: the steady ones, those that vary in time, those that delay."""
    text = rows.text
    layers = range(text.layers)
    varied = [(gain.to, gain.source) for gain in text.template.gains]
    every = tuple(taps(text.template.A, layer) for layer in layers)
    now = kept.value if kept else _loaded(rows, FROM)

    def some(wanted: Callable[[tuple[int, int]], bool]) -> tuple[tuple[Tap, ...], ...]:
        return tuple(
            tuple(tap for tap in every[layer] if wanted((layer, tap.source))) for layer in layers
        )

    found = [Through(now, None, some(lambda pair: pair not in varied))]
    found += [
        Through(now, ir.call("(vec)", gain_name(k)), some(partial(eq, pair)))
        for k, pair in enumerate(varied)
    ]
    if text.template.delayed is not None and delays_outputs(text.template):
        past = _mixed(rows) if between else _loaded(rows, PAST)
        late = tuple(taps(text.template.delayed.A, layer) for layer in layers)
        found.append(Through(past, None, late))
    return [through for through in found if any(through.taps)]


def _loaded(rows: Rows, array: ir.Expression) -> Value:
    return lambda source, row, col: rows.layout.loaded(array, source, row, col, P)


def _mixed(rows: Rows) -> Value:
    past, following = _loaded(rows, PAST), _loaded(rows, NEXT)

    def value(source: int, row: int, col: int) -> ir.Expression:
        before, after = (each(source, row, col) for each in (past, following))
        return before + PART * (after - before)

    return value


def _scatter(rows: Rows, block: list[At], through: Through) -> list[ir.Statement]:
    """Return the statements that add every output, as it is loaded, to its sums."""
    found = {
        (layer, tap.source, tap.row, tap.col): tap.weight
        for layer, each in enumerate(through.taps)
        for tap in each
    }
    radius, lines = rows.text.radius, list[ir.Statement]()
    high, around = max(at.row for at in block) + 1, range(-radius, radius + 1)
    for row, source, col in product(
        range(-radius, high + radius), sorted({key[1] for key in found}), around
    ):
        adds = [
            ir.add(at.sum, _weight(rows, through, at.layer, found[key]) * V)
            for at in block
            if (key := (at.layer, source, row - at.row, col)) in found
        ]
        if adds:
            lines.append(ir.block(constant(V, through.value(source, row, col)), *adds))
    return lines


def _gather(rows: Rows, block: list[At], through: Through) -> list[ir.Statement]:
    """Return the statements that load all outputs, and add those of equal weights first."""
    radius = rows.text.radius

    def name(source: int, row: int, col: int) -> ir.Name:
        return ir.Name(f"v{source}_{row + radius}_{col + radius}")

    places = {
        (tap.source, at.row + tap.row, tap.col) for at in block for tap in through.taps[at.layer]
    }
    lines: list[ir.Statement] = [constant(name(*at), through.value(*at)) for at in sorted(places)]
    for at in block:

        def output(tap: Tap, row: int = at.row) -> ir.Expression:
            return name(tap.source, row + tap.row, tap.col)

        terms = weighted_terms(
            through.taps[at.layer], partial(_weight, rows, through, at.layer), output
        )
        lines += [ir.add(at.sum, term) for term in terms]
    return lines


def _weight(rows: Rows, through: Through, layer: int, weight: float) -> ir.Expression:
    number = ir.Number(rows.scales[layer] * weight)
    return number if through.factor is None else through.factor * number


def _quantities(rows: Rows, at: At) -> Reads:
    """Return the states, outputs or inputs around a row's cells."""

    def quantity(name: Quantity, source: int, row: int, col: int) -> ir.Expression:
        if name == "u":  # every input is an array of its own
            array = X + int(rows.offsets[inputs_of(source)])
            return _loaded(rows, array)(0, at.row + row, col)
        return _loaded(rows, FROM if name == "y" else STATES)(source, at.row + row, col)

    return quantity
