"""The kernel text of the neighbourhood sums in a strip's rows.

An output that is loaded serves all the cells of the block that it is a neighbour of.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from cnnum.engines.opencl import ir
from cnnum.engines.opencl.large_arrays.strip_rows import At, Rows
from cnnum.engines.opencl.transients.nonlinear_couplings import gain_name
from cnnum.engines.opencl.transients.stencil_sums import shares_products, weighted_terms
from cnnum.templating.couplings import NonlinearCoupling, Quantity
from cnnum.templating.function_tables import Table
from cnnum.templating.network import Tap, taps
from cnnum.templating.reads import delays_outputs

FROM, PAST, NEXT, PART, STATES = "from", "past", "next", "part", "states"
"""Variables of the kernel: the outputs of the level before; those a delay before it, those of the
step after them, and how far between both the level is; and the states of the level before."""


def inputs_of(source: int) -> str:
    """Return the name of the array that holds an input in lanes."""
    return f"lane_u{source}"


Value = Callable[[int, int, int], str]
"""The expression of an output, by its layer, and by rows and vectors from the block's."""


@dataclass(frozen=True, slots=True)
class Through:
    """Linear couplings through outputs of one moment.

    Attributes
    ----------
    value : callable
        The expression of an output.
    factor : str
        The factor of their weights: nothing, or a vector times.
    taps : tuple of tuple of Tap
        Of each layer.
    """

    value: Value
    factor: str
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
    def begin(self) -> list[str]:
        """The statements before the row's first vector."""
        radius = self._radius
        return [
            f"vec {self.value(*at, col)} = {self._made(*at, col, 'start')};"
            for at in self._rows
            for col in range(-radius, radius)
        ]

    @property
    def load(self) -> list[str]:
        """The reads of the next vectors."""
        radius = self._radius
        return [
            f"const vec {self.value(*at, radius)} = {self._made(*at, radius, 'p')};"
            for at in self._rows
        ]

    @property
    def move(self) -> list[str]:
        """The statements after those of a vector."""
        radius = self._radius
        return [
            f"{self.value(*at, col)} = {self.value(*at, col + 1)};"
            for at in self._rows
            for col in range(-radius, radius)
        ]

    def value(self, source: int, row: int, col: int) -> str:
        """Return the name of an output."""
        radius = self._radius
        return f"y{source}_{row + radius}_{col + radius}"

    @property
    def _radius(self) -> int:
        return self.rows.text.radius

    @property
    def _rows(self) -> list[tuple[int, int]]:
        """Layers and rows."""
        radius, layers = self._radius, range(self.rows.text.layers)
        return [(layer, row) for layer in layers for row in range(-radius, self.block + radius)]

    def _made(self, source: int, row: int, col: int, start: str) -> str:
        state = self.rows.layout.loaded(FROM, source, row, col, start)
        output = self.rows.text.template.output
        return state if output.linear or output.limited else f"shown({state}, one)"


def coupled(
    rows: Rows,
    block: list[At],
    own: tuple[float, ...],
    state: str,
    *,
    between: bool = False,
    kept: Kept | None = None,
) -> list[str]:
    """Return the text of s = w + own · state + A ∗ y in each row of a block.

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
    lines = [
        f"vec {at.sum} = {rows.cells('driven', at)} + {rows.vector(own[at.layer])} * {states[at]};"
        for at in block
    ]
    for through in _throughs(rows, between, kept):
        lines += _added(rows, block, through)
    for at in block:
        for coupling in rows.text.template.nonlinear:
            if not coupling.static and coupling.to == at.layer:
                lines += _nonlinear(rows, coupling, at)
    return lines


def _added(rows: Rows, block: list[At], through: Through) -> list[str]:
    shares = any(shares_products(found) for found in through.taps)
    return rows.braced((_gather if shares else _scatter)(rows, block, through))


def _throughs(rows: Rows, between: bool, kept: Kept | None) -> list[Through]:
    """Return the linear couplings: the steady ones, those that vary in time, those that delay."""
    text = rows.text
    layers, gains = range(text.layers), text.template.gains
    varied = {(gain.to, gain.source) for gain in gains}
    every = tuple(taps(text.template.A, layer) for layer in layers)
    now = kept.value if kept else _loaded(rows, FROM)

    def chosen(to: int, source: int) -> tuple[tuple[Tap, ...], ...]:
        return tuple(
            tuple(tap for tap in every[layer] if layer == to and tap.source == source)
            for layer in layers
        )

    steady = tuple(
        tuple(tap for tap in every[layer] if (layer, tap.source) not in varied) for layer in layers
    )
    found = [Through(now, "", steady)]
    found += [
        Through(now, f"(vec)({gain_name(k).text}) * ", chosen(gain.to, gain.source))
        for k, gain in enumerate(gains)
    ]
    if text.template.delayed is not None and delays_outputs(text.template):
        past = _mixed(rows) if between else _loaded(rows, PAST)
        late = tuple(taps(text.template.delayed.A, layer) for layer in layers)
        found.append(Through(past, "", late))
    return [through for through in found if any(through.taps)]


def _loaded(rows: Rows, array: str) -> Value:
    return lambda source, row, col: rows.layout.loaded(array, source, row, col)


def _mixed(rows: Rows) -> Value:
    past, following = _loaded(rows, PAST), _loaded(rows, NEXT)

    def value(source: int, row: int, col: int) -> str:
        before, after = (each(source, row, col) for each in (past, following))
        return f"({before} + {PART} * ({after} - {before}))"

    return value


def _scatter(rows: Rows, block: list[At], through: Through) -> list[str]:
    """Return the text that adds every output, as it is loaded, to its sums."""
    found = {
        (layer, tap.source, tap.row, tap.col): tap.weight
        for layer, each in enumerate(through.taps)
        for tap in each
    }
    radius, lines, high = rows.text.radius, list[str](), max(at.row for at in block) + 1
    around = range(-radius, radius + 1)
    for row, source, col in product(
        range(-radius, high + radius), sorted({key[1] for key in found}), around
    ):
        adds = [
            f"{at.sum} += {_weight(rows, through, at.layer, found[key])} * v;"
            for at in block
            if (key := (at.layer, source, row - at.row, col)) in found
        ]
        if adds:
            value = through.value(source, row, col)
            lines.append(f"{{ const vec v = {value}; {' '.join(adds)} }}")
    return lines


def _gather(rows: Rows, block: list[At], through: Through) -> list[str]:
    """Return the text that loads all outputs, and adds those of equal weights first."""
    radius = rows.text.radius

    def name(source: int, row: int, col: int) -> str:
        return f"v{source}_{row + radius}_{col + radius}"

    places = {
        (tap.source, at.row + tap.row, tap.col) for at in block for tap in through.taps[at.layer]
    }
    lines = [f"const vec {name(*at)} = {through.value(*at)};" for at in sorted(places)]
    for at in block:

        def number(weight: float, layer: int = at.layer) -> ir.Expression:
            return ir.Constant(_weight(rows, through, layer, weight))

        def output(tap: Tap, row: int = at.row) -> ir.Expression:
            return ir.Name(name(tap.source, row + tap.row, tap.col))

        terms = weighted_terms(through.taps[at.layer], number, output)
        lines += rows.text.tables.printer.lines([ir.add(ir.Name(at.sum), term) for term in terms])
    return lines


def _weight(rows: Rows, through: Through, layer: int, weight: float) -> str:
    return f"{through.factor}{rows.vector(rows.scales[layer] * weight)}"


def _nonlinear(rows: Rows, coupling: NonlinearCoupling, at: At) -> list[str]:
    """Return the text that adds a nonlinear coupling's sum to that of a row."""
    radius, lines = coupling.weights.shape[0] // 2, list[str]()
    for row, col in np.argwhere(coupling.weights):
        offsets = at.row + int(row) - radius, int(col) - radius
        argument = _quantity(rows, coupling.neighbour, coupling.source, *offsets)
        if coupling.centre is not None:
            centre = _quantity(rows, coupling.centre, coupling.centre_source, at.row, 0)
            pair = (argument, centre) if coupling.reversed_sign else (centre, argument)
            argument = f"{pair[0]} - {pair[1]}"
        weight = rows.vector(rows.scales[at.layer] * float(coupling.weights[row, col]))
        value = f"{weight} * ({_table(rows, coupling.function)})"
        factor = " * v" if coupling.times_argument else ""
        lines.append(f"{{ const vec v = {argument}; {at.sum} += {value}{factor}; }}")
    return lines


def _quantity(rows: Rows, name: Quantity, source: int, row: int, col: int) -> str:
    """Return the expression of a cell's state, output or input."""
    if name == "u":  # every input is an array of its own
        array, source = f"x + {rows.offsets[inputs_of(source)]}", 0
    else:
        array = FROM if name == "y" else STATES
    return _loaded(rows, array)(source, row, col)


def _table(rows: Rows, function: Table) -> str:
    """Return the expression of a function table of `v`."""
    points = [(rows.vector(place), rows.vector(level)) for place, level in function.points]
    value = points[-1][1] if function.interpolation == "constant" else points[0][1]
    if function.interpolation == "constant":
        for place, level in reversed(points[:-1]):
            value = f"(v <= {place} ? {level} : {value})"
        return value
    for (v0, f0), (v1, f1) in zip(function.points, function.points[1:], strict=False):
        if f1 != f0:
            slope, low, high = (rows.vector(n) for n in ((f1 - f0) / (v1 - v0), v0, v1))
            value += f" + {slope} * (between(v, {low}, {high}) - {low})"
    return value
