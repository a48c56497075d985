"""Euler's steps of linear couplings, as few operations as they can be.

    x⁺ = (1 − h/τ) x + (h/τ) w + Σ (h/τ) a y

Weights come with h/τ in them, and w is scaled once. New outputs go to a second padded array, so
that a step is one sweep. While an output that is loaded is in a register, it is added to all cells
that it is a neighbour of.
"""

from collections.abc import Iterator

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.engines.opencl.transients.builder import COL, ROW, TransientBuilder
from cnnum.engines.opencl.transients.feedforward import W, constant_drive
from cnnum.engines.opencl.transients.fixed_steps import fixed_figures
from cnnum.engines.opencl.transients.initial_state import X
from cnnum.engines.opencl.transients.state_equation import Y
from cnnum.engines.opencl.transients.stencil_sums import shares_products, weighted_terms
from cnnum.engines.opencl.transients.step_control import Figures
from cnnum.integrators.choice import FixedSteps
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Tap, taps

BLOCK_COLUMNS = 10
BLOCK_STATEMENTS = 400
"""Columns and statements of unrolled text: more of it costs compile time and no longer pays."""

REGISTERS_FROM = 64
"""Bytes of a vector from which a processor has 32 registers (AVX-512), enough for two rows' sums.
A sum waits four cycles for each of its products. Two rows side by side have as many sums as the
processor can work on. In one row it must look ahead, and takes a third longer."""

Z, SCALED, FROM, TO = ir.Name("z"), ir.Name("wh"), ir.Name("from"), ir.Name("to")
"""The second array of outputs, the scaled drive, and the outputs before and after a step."""

V, B = ir.Name("v"), ir.Name("b")

SWAP = "real *const swap = from; from = to; to = swap;"


def fuses(text: TransientBuilder, scheme: FixedSteps) -> bool:
    """Return whether steps of a scheme can be written with the step in their weights."""
    even = scheme.last == scheme.step and scheme.count > 0 and not scheme.settle
    return scheme.stages == 1 and text.template.plain and even and text.arena.private


def fused_euler(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append the steps, from and to the states `x`, and return the figures of the run."""
    _declare(text, scheme)
    with text.aside() as step:
        _sweep(text, scheme)
    text.body += [
        ir.Note(f"// {scheme.name}: {scheme.count} steps of {scheme.step:g}, each one sweep"),
        ir.Verbatim(("real *from = y, *to = z;",)),
        ir.Counted(ir.ROUND, 0, scheme.count, None, (*step, ir.Verbatim((SWAP,)))),
    ]
    return fixed_figures(text, scheme.count, settle=False)


def _declare(text: TransientBuilder, scheme: FixedSteps) -> None:
    """Append the second array of outputs, the first values of both, and the scaled drive."""
    text.body += _own_numbers(text, scheme)
    boundary = text.template.boundary
    text.array(Z, text.layers * text.padded)
    if boundary.constant is not None:
        value = float(text.template.output.numpy(np.asarray(boundary.constant)))
        for name in (Y, Z):
            text.fill_rims(name, text.layers, boundary, value)
    if constant_drive(text) is None:
        text.array(SCALED, text.states)
        scaled = [
            ir.Assign(SCALED[text.at(m)], _number(text, scheme, m) * W[text.at(m)])
            for m in range(text.layers)
        ]
        text.over_cells(scaled)
    states = enumerate(text.each(X))
    text.over_grid([ir.Assign(Y[text.padded_at(m)], text.output(state)) for m, state in states])
    if boundary.constant is None:
        text.fill_rims(Y, text.layers, boundary, None)


def _own_numbers(text: TransientBuilder, scheme: FixedSteps) -> list[ir.Statement]:
    """Return statements that scale frames' own numbers: h/τ, 1 − h/τ, and each weight."""
    lines: list[ir.Statement] = []
    for layer in range(text.layers if text.operands.own else 0):
        move, kept = _move(layer), ir.Name(f"kept_{layer}")
        lines += [
            ir.fixed(move, ir.Number(scheme.move(layer, 1.0)) * text.rate(layer)),
            ir.fixed(kept, ir.ONE - move),
        ]
        own = [text.number(tap.weight) for tap in taps(text.template.A, layer)]
        lines += [ir.fixed(_scaled(name), move * name) for name in own if isinstance(name, ir.Name)]
    return lines


def _move(layer: int) -> ir.Name:
    return ir.Name(f"move_{layer}")


def _scaled(weight: ir.Name) -> ir.Name:
    return ir.Name(f"{weight.text}_h")


def _number(
    text: TransientBuilder, scheme: FixedSteps, layer: int, factor: float = 1.0
) -> ir.Expression:
    """Return a number times h/τ of a layer."""
    if text.operands.own is not None:
        return ir.Number(factor) * _move(layer)
    return ir.Number(factor * scheme.move(layer, float(text.template.tau[layer])))


def _weight(text: TransientBuilder, scheme: FixedSteps, layer: int, weight: float) -> ir.Expression:
    """Return a weight times h/τ of a layer."""
    own = text.number(weight)
    return _scaled(own) if isinstance(own, ir.Name) else _number(text, scheme, layer, weight)


def _block(text: TransientBuilder) -> int:
    """Return how many columns are unrolled: a divisor of the columns."""
    cols = text.shape[1]
    taps = max(1, int(np.count_nonzero(text.template.A)))
    most = max(1, min(BLOCK_COLUMNS, BLOCK_STATEMENTS // (taps * _together(text))))
    return max(n for n in range(1, cols + 1) if cols % n == 0 and n <= most)


def _together(text: TransientBuilder) -> int:
    """Return how many rows are swept side by side."""
    vector = text.tables.lanes * text.tables.dtype.itemsize
    fits = vector >= REGISTERS_FROM and text.shape[0] % 2 == 0 and not _gathers(text)
    return 2 if fits else 1


def _gathers(text: TransientBuilder) -> bool:
    """Return whether outputs of equal weights are added up before they are weighted."""
    return any(shares_products(taps(text.template.A, layer)) for layer in range(text.layers))


def _sweep(text: TransientBuilder, scheme: FixedSteps) -> None:
    """Append one step of all cells."""
    rows, cols = text.shape
    block, together = _block(text), _together(text)
    places = ir.Declare(
        "int", ((ir.CELL, ROW * cols + B), (ir.PLACE, ROW * text.pitch + B)), fixed=True
    )
    with text.aside() as body:
        _block_of_columns(text, scheme, block, together)
    columns = ir.Loop(B, cols, (places, *body), step=block)
    text.body.append(ir.Loop(ROW, rows, (columns,), step=together))
    if text.template.boundary.constant is None:
        text.body.append(ir.Loop(ROW, rows, tuple(_rim_columns(text, text.template.boundary))))
        _rim_rows(text)


def _block_of_columns(
    text: TransientBuilder, scheme: FixedSteps, block: int, together: int
) -> None:
    """Append one step of the columns `b` to `b + block` of a number of rows.

    Where weights are equal, loaded values are kept and added up before they are weighted. Else they
    are added to all sums at once, which takes fewer registers.
    """
    gathers = _gathers(text)
    for column in range(block + 2 * text.radius):
        done = column - 2 * text.radius
        if column < block:
            for row in range(together):
                _begin(text, scheme, row, column)
        if gathers:
            _load(text, column)
        else:
            _scatter(text, scheme, column, block, together)
        if gathers and done >= 0:
            _gather(text, scheme, done)
        if done >= 0:
            for row in range(together):
                _end(text, scheme, row, done)


def _driven(
    text: TransientBuilder, scheme: FixedSteps, layer: int, state: ir.Element
) -> ir.Expression:
    """Return the scaled drive of a cell, by its state."""
    constant = constant_drive(text)
    if constant is None:
        return SCALED[state.at]
    return _number(text, scheme, layer, constant[layer])


def _state(text: TransientBuilder, layer: int, row: int, column: int) -> ir.Element:
    return X[ir.Integer(layer * text.cells + row * text.shape[1] + column) + ir.CELL]


def _sum(layer: int, row: int, column: int) -> ir.Name:
    return ir.Name(f"s{layer}_{row}_{column}")


def _begin(text: TransientBuilder, scheme: FixedSteps, row: int, column: int) -> None:
    """Append the sums of a cell of the block, begun with the part that is not neighbours'."""
    for layer in range(text.layers):
        state = _state(text, layer, row, column)
        begun = _driven(text, scheme, layer, state) + _kept(text, scheme, layer) * state
        text.body.append(ir.declare(_sum(layer, row, column), begun))


def _kept(text: TransientBuilder, scheme: FixedSteps, layer: int) -> ir.Expression:
    """Return the share of a state that a step leaves."""
    if text.operands.own is not None:
        return ir.Name(f"kept_{layer}")
    return ir.Number(1.0 - scheme.move(layer, float(text.template.tau[layer])))


def _scatter(
    text: TransientBuilder, scheme: FixedSteps, column: int, block: int, together: int
) -> None:
    """Append the outputs of a column, each added to all sums of the block that it reaches."""
    feedback = text.template.A
    span = feedback.shape[-1]
    for source in range(text.layers):
        for row in range(span + together - 1):
            adds = [
                ir.add(_sum(to, k, cell), _weight(text, scheme, to, float(weight)) * V)
                for k in range(max(0, row - span + 1), min(together, row + 1))
                for to, cell, weight in _reached(text, feedback[:, source, row - k], column, block)
            ]
            if adds:
                output = _output_at(text, source, row + text.radius - span // 2, column)
                text.body.append(ir.Block((ir.fixed(V, output), *adds)))


def _output_at(text: TransientBuilder, source: int, row: int, column: int) -> ir.Element:
    """Return the output at a place of the padded block."""
    return FROM[ir.Integer(source * text.padded + row * text.pitch + column) + ir.PLACE]


def _load(text: TransientBuilder, column: int) -> None:
    """Append the loads of a padded column."""
    span, rim = text.template.A.shape[-1], text.radius - text.template.A.shape[-1] // 2
    for source in range(text.layers):
        for row in range(rim, rim + span):
            output = _output_at(text, source, row, column)
            text.body.append(ir.fixed(_loaded(source, row, column), output))


def _loaded(source: int, row: int, column: int) -> ir.Name:
    return ir.Name(f"v{source}_{row}_{column}")


def _gather(text: TransientBuilder, scheme: FixedSteps, column: int) -> None:
    """Append the sums of a column's cells, equal weights together."""
    for layer in range(text.layers):

        def number(weight: float, to: int = layer) -> ir.Expression:
            return _weight(text, scheme, to, weight)

        def output(tap: Tap) -> ir.Name:
            return _loaded(tap.source, text.radius + tap.row, text.radius + tap.col + column)

        terms = weighted_terms(taps(text.template.A, layer), number, output)
        text.body += [ir.add(_sum(layer, 0, column), term) for term in terms]


def _reached(
    text: TransientBuilder, weights: Floats, column: int, block: int
) -> Iterator[tuple[int, int, float]]:
    """Yield (layer, cell of the block, weight) of each sum that takes an output of a column."""
    span, radius = weights.shape[-1], text.radius
    for to in range(text.layers):
        for col in range(span):
            cell = column - radius - (col - span // 2)
            if weights[to, col] and 0 <= cell < block:
                yield to, cell, float(weights[to, col])


def _end(text: TransientBuilder, scheme: FixedSteps, row: int, column: int) -> None:
    """Append the statements that turn a cell's finished sums into its new state."""
    for layer in range(text.layers):
        new, old = _sum(layer, row, column), _state(text, layer, row, column)
        if text.template.output.limited:
            text.body.append(ir.Assign(new, ir.clip(new)))
        if text.operands.mask is not None:
            offset = row * text.shape[1] + column
            mask = ir.shifted(text.operands.mask, offset) if offset else text.operands.mask
            text.body.append(ir.Assign(new, ir.pick(mask.differs(ir.ZERO), old, new)))
        at = (text.radius + row) * text.pitch + text.radius + column
        place = ir.Integer(layer * text.padded + at) + ir.PLACE
        text.body += [ir.Assign(old, new), ir.Assign(TO[place], text.output(new))]


def _rim_columns(text: TransientBuilder, boundary: Boundary) -> list[ir.Statement]:
    """Return statements that fill the rim left and right of row `r`."""
    cols, radius = text.shape[1], text.radius
    source = np.pad(np.arange(cols), radius, mode=boundary.pad_mode)
    places = [*range(radius), *range(cols + radius, cols + 2 * radius)]
    lines: list[ir.Statement] = []
    for layer in range(text.layers):
        head = ir.Integer(layer * text.padded) + (ROW + radius) * text.pitch
        lines += [
            ir.Assign(TO[head + place], TO[head + (int(source[place]) + radius)])
            for place in places
        ]
    return lines


def _rim_rows(text: TransientBuilder) -> None:
    """Append the rim above and below, copied from whole rows."""
    rows, radius = text.shape[0], text.radius
    source = np.pad(np.arange(rows), radius, mode=text.template.boundary.pad_mode)

    def at(layer: int, row: int) -> ir.Element:
        return TO[ir.Integer(layer * text.padded + row * text.pitch) + COL]

    copies = [
        ir.Assign(at(layer, place), at(layer, int(source[place]) + radius))
        for layer in range(text.layers)
        for place in (*range(radius), *range(rows + radius, rows + 2 * radius))
    ]
    if copies:
        text.body.append(ir.Loop(COL, text.pitch, tuple(copies)))
