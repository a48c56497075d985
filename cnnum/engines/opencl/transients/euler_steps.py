"""Forward Euler steps: linear couplings in few operations, and small frames in registers.

    x⁺ = (1 − h/τ) x + (h/τ) w + Σ (h/τ) a y

Weights include the factor h/τ, and w is scaled once. New outputs go to a second padded array, so
that a step is one sweep. A loaded output is added to all its neighbours while in a register.

For a single small frame, each row of the array is one vector.

Neighbours in a row are the same vector with its components shifted, so nothing goes through memory
between steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.arrays import distinct
from cnnum.engines.opencl.lowering.dense_products import largest_divisor
from cnnum.engines.opencl.text import fill
from cnnum.engines.opencl.transients.builder import (
    TransientBuilder,
    W,
    X,
    Y,
    shares_products,
    weighted_terms,
)
from cnnum.engines.opencl.transients.couplings import constant_drive
from cnnum.engines.opencl.transients.fixed_steps import fixed_figures
from cnnum.engines.opencl.transients.step_control import Figures
from cnnum.integrators.schemes import FixedSteps
from cnnum.templating.boundary import line_sources
from cnnum.templating.network import Tap, taps

BLOCK_COLUMNS = 10
BLOCK_STATEMENTS = 400
"""Limit on unrolled statements: more of them cost compile time without benefit."""

REGISTERS_FROM = 64
"""Vector size in bytes from which a CPU has 32 registers (AVX-512), enough for two rows of sums. A
sum waits four cycles for each of its products. Two rows have as many independent sums as the CPU
can process in parallel; one row relies on reordering and takes a third longer."""

Z, SCALED, FROM, TO = ir.names("z wh from to")
"""The second array of outputs, the scaled drive, and the outputs before and after a step."""

V, B = ir.names("v b")


@dataclass(frozen=True, slots=True)
class StepWeights:
    """The coefficients of an Euler step with linear couplings, scaled by h/τ of each layer."""

    text: TransientBuilder
    scheme: FixedSteps

    def declared(self) -> list[ir.Statement]:
        """Return statements that compute per-frame coefficients: h/τ, 1 − h/τ, and each weight."""
        lines, text = list[ir.Statement](), self.text
        for layer in range(text.layers if text.operands.own else 0):
            move, kept = _move(layer), ir.Name(f"kept_{layer}")
            lines += [
                ir.fixed(move, ir.Number(self.scheme.move(layer, 1.0)) * text.rate(layer)),
                ir.fixed(kept, ir.ONE - move),
            ]
            own = [text.number(tap.weight) for tap in taps(text.template.A, layer)]
            lines += [ir.fixed(_scaled(n), move * n) for n in own if isinstance(n, ir.Name)]
        return lines

    def _share(self, layer: int) -> float:
        return self.scheme.move(layer, float(self.text.template.tau[layer]))

    def number(self, layer: int, factor: float = 1.0) -> ir.Expression:
        """Return a number times h/τ."""
        if self.text.operands.own is not None:
            return ir.Number(factor) * _move(layer)
        return ir.Number(factor * self._share(layer))

    def weight(self, layer: int, weight: float) -> ir.Expression:
        """Return a weight times h/τ."""
        own = self.text.number(weight)
        return _scaled(own) if isinstance(own, ir.Name) else self.number(layer, weight)

    def kept(self, layer: int) -> ir.Expression:
        """Return the fraction of a state that a step retains."""
        own = self.text.operands.own
        return ir.Number(1.0 - self._share(layer)) if own is None else ir.Name(f"kept_{layer}")


def _move(layer: int) -> ir.Name:
    return ir.Name(f"move_{layer}")


def _scaled(weight: ir.Name) -> ir.Name:
    return ir.Name(f"{weight.text}_h")


def fuses(text: TransientBuilder, scheme: FixedSteps) -> bool:
    """Return whether steps of a scheme can be fused into the weights."""
    even = scheme.last == scheme.step and scheme.count > 0 and not scheme.settle
    return scheme.stages == 1 and text.template.plain and even and text.arena.private


def fused_euler(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append the steps, from and to the states `x`, and return the figures of the run."""
    weights = StepWeights(text, scheme)
    _declare(text, weights)
    step = text.aside(lambda: _sweep(text, weights))
    text.body += [
        ir.Note(f"// {scheme.name}: {scheme.count} steps of {scheme.step:g}, each one sweep"),
        ir.Alias(FROM, Y, fixed=False),
        ir.Alias(TO, Z, fixed=False),
        ir.Counted(ir.ROUND, 0, scheme.count, None, (*step, ir.Swap(FROM, TO))),
    ]
    return fixed_figures(text, scheme)


def _declare(text: TransientBuilder, weights: StepWeights) -> None:
    """Append the second array of outputs, the initial values of both, and the scaled drive."""
    text.body += weights.declared()
    boundary = text.template.boundary
    text.array(Z, text.layers * text.padded)
    if boundary.constant is not None:
        for name in (Y, Z):
            text.fill_rims(name, text.layers, boundary, text.rim_output())
    if constant_drive(text) is None:
        text.array(SCALED, text.states)
        pairs = enumerate(zip(text.each(SCALED), text.each(W), strict=True))
        text.over_cells([ir.Assign(to, weights.number(m) * w) for m, (to, w) in pairs])
    states = enumerate(text.each(X))
    text.over_grid([ir.Assign(Y[text.padded_at(m)], text.output(state)) for m, state in states])
    text.copy_rims(Y)


def _sweep(text: TransientBuilder, weights: StepWeights) -> None:
    """Append one step of all cells."""
    (rows, cols), block = text.shape, _Block.of(text, weights)
    places = ir.Declare(
        "int", ((ir.CELL, ir.ROW * cols + B), (ir.PLACE, ir.ROW * text.pitch + B)), fixed=True
    )
    columns = ir.Loop(B, cols, (places, *block.statements()), step=block.columns)
    text.body.append(ir.Loop(ir.ROW, rows, (columns,), step=block.rows))
    if text.template.boundary.constant is None:
        text.body += _rims(text)


@dataclass(frozen=True, slots=True)
class _Block:
    """An unrolled block of columns, from `b` on, in some rows.

    Attributes
    ----------
    text : TransientBuilder
    weights : StepWeights
    rows, columns : int
    gathers : bool
        Whether loaded values are kept and those with equal weights summed before weighting. If not,
        they are added to all sums at once, which takes fewer registers.
    """

    text: TransientBuilder
    weights: StepWeights
    rows: int
    columns: int
    gathers: bool

    @classmethod
    def of(cls, text: TransientBuilder, weights: StepWeights) -> "_Block":
        """Return the block of a template; its width divides the array's."""
        gathers = any(shares_products(taps(text.template.A, m)) for m in range(text.layers))
        vector = text.tables.lanes * text.tables.dtype.itemsize
        pairs = vector >= REGISTERS_FROM and text.shape[0] % 2 == 0 and not gathers
        rows = 2 if pairs else 1
        work = max(1, int(np.count_nonzero(text.template.A))) * rows
        most = max(1, min(BLOCK_COLUMNS, BLOCK_STATEMENTS // work))
        return cls(text, weights, rows, largest_divisor(text.shape[1], most), gathers)

    def statements(self) -> list[ir.Statement]:
        """Return one step of the block."""
        lines: list[ir.Statement] = []
        for column in range(self.columns + 2 * self.text.radius):
            done = column - 2 * self.text.radius
            if column < self.columns:
                lines += [self._begun(*cell, column) for cell in self._cells]
            lines += self._load(column) if self.gathers else self._scatter(column)
            if done >= 0:
                lines += self._gather(done) if self.gathers else []
                lines += [line for at in self._cells for line in self._end(*at, done)]
        return lines

    @property
    def _cells(self) -> list[tuple[int, int]]:
        """Layers and rows of the cells of a column."""
        return [(layer, row) for row in range(self.rows) for layer in range(self.text.layers)]

    @property
    def _reach(self) -> int:
        """The radius of A, at most that of the template."""
        return int(self.text.template.A.shape[-1] // 2)

    def _state(self, layer: int, row: int, column: int) -> ir.Element:
        at = layer * self.text.cells + row * self.text.shape[1] + column
        return X[ir.Integer(at) + ir.CELL]

    def _begun(self, layer: int, row: int, column: int) -> ir.Statement:
        """Return the sum of a cell, initialised with the part not due to neighbours."""
        state, constant = self._state(layer, row, column), constant_drive(self.text)
        driven = (
            SCALED[state.at] if constant is None else self.weights.number(layer, constant[layer])
        )
        return ir.declare(_sum(layer, row, column), driven + self.weights.kept(layer) * state)

    def _scatter(self, column: int) -> list[ir.Statement]:
        """Return the outputs of a column, added to all sums of the block in reach."""
        text, reach, lines = self.text, self._reach, list[ir.Statement]()
        weight_at = {
            (layer, tap.source, tap.row, tap.col): tap.weight
            for layer in range(text.layers)
            for tap in taps(text.template.A, layer)
        }
        cells, around = range(self.columns)[::-1], range(-reach, self.rows + reach)
        for source, row in product(range(text.layers), around):
            adds = [
                ir.add(_sum(layer, k, cell), self.weights.weight(layer, weight_at[key]) * V)
                for k, layer, cell in product(range(self.rows), range(text.layers), cells)
                if (key := (layer, source, row - k, column - text.radius - cell)) in weight_at
            ]
            if adds:
                output = _output_at(text, source, row + text.radius, column)
                lines.append(ir.block(ir.fixed(V, output), *adds))
        return lines

    def _load(self, column: int) -> list[ir.Statement]:
        """Return the loads of a padded column."""
        text, radius, reach = self.text, self.text.radius, self._reach
        around = range(radius - reach, radius + reach + 1)
        return [
            ir.fixed(_loaded(*at, column), _output_at(text, *at, column))
            for at in product(range(text.layers), around)
        ]

    def _gather(self, column: int) -> list[ir.Statement]:
        """Return the sums of a column's cells, grouped by equal weights."""
        radius = self.text.radius

        def output(tap: Tap) -> ir.Name:
            return _loaded(tap.source, radius + tap.row, radius + tap.col + column)

        return [
            ir.add(_sum(layer, 0, column), term)
            for layer in range(self.text.layers)
            for term in weighted_terms(
                taps(self.text.template.A, layer), partial(self.weights.weight, layer), output
            )
        ]

    def _end(self, layer: int, row: int, column: int) -> list[ir.Statement]:
        """Return the statements that turn a cell's finished sum into its new state."""
        text, lines = self.text, list[ir.Statement]()
        new, old = _sum(layer, row, column), self._state(layer, row, column)
        if text.template.output.limited:
            lines.append(ir.Assign(new, ir.clip(new)))
        if text.operands.mask is not None:
            offset = row * text.shape[1] + column
            mask = ir.shifted(text.operands.mask, offset) if offset else text.operands.mask
            lines.append(ir.Assign(new, ir.pick(mask.differs(ir.ZERO), old, new)))
        at = (text.radius + row) * text.pitch + text.radius + column
        place = ir.Integer(layer * text.padded + at) + ir.PLACE
        return [*lines, ir.Assign(old, new), ir.Assign(TO[place], text.output(new))]


def _sum(layer: int, row: int, column: int) -> ir.Name:
    return ir.Name(f"s{layer}_{row}_{column}")


def _output_at(text: TransientBuilder, source: int, row: int, column: int) -> ir.Element:
    """Return the output at a position in the padded block."""
    return FROM[ir.Integer(source * text.padded + row * text.pitch + column) + ir.PLACE]


def _loaded(source: int, row: int, column: int) -> ir.Name:
    return ir.Name(f"v{source}_{row}_{column}")


def _rim_copies(text: TransientBuilder, length: int) -> list[tuple[int, int]]:
    """Return the padded indices of virtual cells of a line, each with the index that it copies."""
    radius = text.radius
    source = line_sources(text.template.boundary, length, radius)
    places = (*range(radius), *range(length + radius, length + 2 * radius))
    return [(place, int(source[place]) + radius) for place in places]


def _rims(text: TransientBuilder) -> list[ir.Statement]:
    """Return the loops that fill the rims: ends of rows, then whole rows above and below.

    A table of indices, as in other sweeps, takes a third longer on the smallest arrays.
    """
    starts = [ir.Integer(layer * text.padded) for layer in range(text.layers)]
    middle = [start + (ir.ROW + text.radius) * text.pitch for start in starts]
    columns, rows = (_rim_copies(text, length) for length in reversed(text.shape))
    sides = [ir.Assign(TO[row + to], TO[row + at]) for row in middle for to, at in columns]

    def whole(layer: int, row: int) -> ir.Element:
        return TO[ir.Integer(layer * text.padded + row * text.pitch) + ir.COL]

    ends = [ir.Assign(whole(m, to), whole(m, at)) for m in range(text.layers) for to, at in rows]
    loops = [ir.Loop(ir.ROW, text.shape[0], tuple(sides))]
    return [*loops, *([ir.Loop(ir.COL, text.pitch, tuple(ends))] if ends else [])]


WIDTHS = (4, 8, 16)
MOST_ROWS = 20
"""Maximum number of row vectors in all layers: more do not fit the registers."""

MOST_STATEMENTS = 700

KNOWN = ("standard", "full-range", "linear")
"""Output functions supported in row form: those that clip outputs or states, and the identity."""

SHARED = 4
"""Number of equal weights from which summing before the product pays: pairs took a tenth longer,
groups of four a tenth less."""


def width(cols: int) -> int | None:
    """Return the width of the vector that holds a row, or None if it is too long."""
    return next((n for n in WIDTHS if n >= cols), None)


def fits_rows(text: TransientBuilder) -> bool:
    """Return whether a single frame's steps can be written with rows as vectors."""
    rows, cols = text.shape
    work = rows * (int(np.count_nonzero(text.template.A)) + 2 * text.radius * text.layers)
    return (
        text.tables.lanes == 1
        and text.tables.vectors
        and width(cols) is not None
        and rows * text.layers <= MOST_ROWS
        and work <= MOST_STATEMENTS
        and text.operands.mask is None
        and text.template.output.name in KNOWN
    )


def row_steps(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append the steps, from and to the states `x`, and return the figures of the run."""
    vector = f"{text.tables.printer.numbers.scalar}{width(text.shape[1])}"
    text.tables.types["rows"] = fill("rows", row=vector)
    weights, note = StepWeights(text, scheme), f"{scheme.count} steps of {scheme.step:g}"
    text.body += [
        ir.Note(f"// {scheme.name}: {note}, the array in registers, a row a vector"),
        *_begin(text, weights),
        ir.Counted(ir.ROUND, 0, scheme.count, None, tuple(_step(text, weights))),
        *_end(text),
    ]
    return fixed_figures(text, scheme)


def _each(text: TransientBuilder) -> list[tuple[int, int]]:
    return [(layer, row) for layer in range(text.layers) for row in range(text.shape[0])]


def _row(array: str, *at: int) -> ir.Name:
    """Return the vector of a row: of states x, outputs y, the drive w or new states s.

    Outputs also have one for each column offset of the neighbourhood.
    """
    return ir.Name(array + "_".join(map(str, at)))


def _begin(text: TransientBuilder, weights: StepWeights) -> list[ir.Statement]:
    """Return the rows of states and of the scaled drive."""
    places = _each(text)
    lines = [ir.declare(_row("x", *at), _gathered(text, X, *at), of="row") for at in places]
    if constant_drive(text) is None:
        scaled = [weights.number(at[0]) * _gathered(text, W, *at) for at in places]
        pairs = zip(places, scaled, strict=True)
        lines += [ir.fixed(_row("w", *at), drive, of="row") for at, drive in pairs]
    return [*lines]


def _gathered(text: TransientBuilder, array: ir.Name, layer: int, row: int) -> ir.Expression:
    cols = text.shape[1]
    start = layer * text.cells + row * cols
    return _vector(text, [array[start + c] for c in range(cols)])


def _vector(text: TransientBuilder, cells: Sequence[ir.Expression]) -> ir.Call:
    """Return a row of cells; unused lanes hold 0."""
    rest = (width(text.shape[1]) or 0) - len(cells)
    return ir.call("(row)", *cells, *(ir.ZERO for _ in range(rest)))


def _step(text: TransientBuilder, weights: StepWeights) -> list[ir.Statement]:
    output, constant, lines = text.template.output, constant_drive(text), list[ir.Statement]()
    for at in _each(text):
        state = _row("x", *at)
        shown = ir.call("clip_row", state) if output.name == "standard" else state
        lines += [ir.fixed(_row("y", *at), shown, of="row"), *_moved(text, *at)]
    for layer, r in _each(text):
        drive: ir.Expression = _row("w", layer, r)
        if constant is not None:
            drive = ir.call("(row)", weights.number(layer, constant[layer]))
        kept = weights.kept(layer) * _row("x", layer, r)
        total = ir.total([drive, kept, *_weighted(text, weights, layer, r)])
        lines.append(ir.declare(_row("s", layer, r), total, of="row"))
    for at in _each(text):
        new = _row("s", *at)
        lines.append(ir.Assign(_row("x", *at), ir.call("clip_row", new) if output.limited else new))
    return lines


def _sources(text: TransientBuilder, count: int) -> NDArray[np.int64]:
    """Return the cell or row that each padded index copies, −1 for none."""
    return line_sources(text.template.boundary, count, text.radius)


def _moved(text: TransientBuilder, layer: int, row: int) -> list[ir.Statement]:
    """Return a row of outputs, shifted by each column offset that has a weight."""
    cols, radius = text.shape[1], text.radius
    source, outputs = _sources(text, cols), _row("y", layer, row)
    columns = distinct(np.argwhere(text.template.A)[:, 3]) - text.template.A.shape[-1] // 2
    lines: list[ir.Statement] = []
    for offset in columns[columns != 0].tolist():
        seen = source[radius + offset : radius + offset + cols].tolist()
        cells = [ir.Component(outputs, at) if at >= 0 else _rim(text) for at in seen]
        seen_row = _row("y", layer, row, radius + offset)
        lines.append(ir.fixed(seen_row, _vector(text, cells), of="row"))
    return lines


def _rim(text: TransientBuilder) -> ir.Number:
    return ir.Number(text.rim_output())


def _weighted(
    text: TransientBuilder, weights: StepWeights, layer: int, row: int
) -> list[ir.Expression]:
    source = _sources(text, text.shape[0])

    def output(tap: Tap) -> ir.Expression:
        at = int(source[text.radius + row + tap.row])
        if at < 0:
            return _rim(text)
        column = [text.radius + tap.col] if tap.col else []
        return _row("y", tap.source, at, *column)

    number = partial(weights.number, layer)
    return weighted_terms(taps(text.template.A, layer), number, output, SHARED)


def _end(text: TransientBuilder) -> list[ir.Statement]:
    """Return the statements that write the rows back."""
    cols = text.shape[1]
    return [
        ir.Assign(X[layer * text.cells + r * cols + c], ir.Component(_row("x", layer, r), c))
        for layer, r in _each(text)
        for c in range(cols)
    ]
