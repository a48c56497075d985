"""Euler's steps of a single small frame: each row of the array is one vector.

Neighbours in a row are the same vector with its components moved along. So nothing is written to
memory, and read back at another place, between the steps.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.arrays import distinct
from cnnum.engines.opencl.text import fill
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.feedforward import constant_drive
from cnnum.engines.opencl.transients.fixed_steps import fixed_figures
from cnnum.engines.opencl.transients.fused_euler import StepWeights
from cnnum.engines.opencl.transients.names import W, X
from cnnum.engines.opencl.transients.stencil_sums import weighted_terms
from cnnum.engines.opencl.transients.step_control import Figures
from cnnum.integrators.schemes import FixedSteps
from cnnum.templating.network import Tap, taps

WIDTHS = (4, 8, 16)
MOST_ROWS = 20
"""Vectors of all layers' rows: more do not fit the registers."""

MOST_STATEMENTS = 700

KNOWN = ("standard", "full-range", "linear")
"""Outputs that clip, be it the states, or show states as they are; others have no form for rows."""

SHARED = 4
"""Equal weights that are worth a sum before the product: pairs took a tenth longer with it, fours
a tenth less."""


def width(cols: int) -> int | None:
    """Return the vector that holds a row, None where it is too long."""
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
    weights, about = StepWeights(text, scheme), f"{scheme.count} steps of {scheme.step:g}"
    text.body += [
        ir.Note(f"// {scheme.name}: {about}, the array in registers, a row a vector"),
        *_begin(text, weights),
        ir.Counted(ir.ROUND, 0, scheme.count, None, tuple(_step(text, weights))),
        *_end(text),
    ]
    return fixed_figures(text, scheme)


def _each(text: TransientBuilder) -> list[tuple[int, int]]:
    return [(layer, row) for layer in range(text.layers) for row in range(text.shape[0])]


def _row(array: str, *at: int) -> ir.Name:
    """Return the vector that holds a row: of states x, outputs y, the drive w or new states s.

    Of outputs there is one, too, as each column of the padded neighbourhood sees them.
    """
    return ir.Name(array + "_".join(map(str, at)))


def _begin(text: TransientBuilder, weights: StepWeights) -> list[ir.Statement]:
    """Return the rows of states and of the scaled drive."""
    each = _each(text)
    lines = [ir.declare(_row("x", *at), _gathered(text, X, *at), of="row") for at in each]
    if constant_drive(text) is None:
        scaled = [weights.number(at[0]) * _gathered(text, W, *at) for at in each]
        pairs = zip(each, scaled, strict=True)
        lines += [ir.fixed(_row("w", *at), drive, of="row") for at, drive in pairs]
    return [*lines]


def _gathered(text: TransientBuilder, array: ir.Name, layer: int, row: int) -> ir.Expression:
    cols = text.shape[1]
    start = layer * text.cells + row * cols
    return _vector(text, [array[start + c] for c in range(cols)])


def _vector(text: TransientBuilder, cells: Sequence[ir.Expression]) -> ir.Call:
    """Return a row of cells; lanes without one hold 0."""
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
    """Return the cell, or row, that each padded place shows; −1 is none."""
    boundary = text.template.boundary
    if boundary.constant is None:
        return np.pad(np.arange(count), text.radius, mode=boundary.pad_mode)
    return np.pad(np.arange(count), text.radius, constant_values=-1)


def _moved(text: TransientBuilder, layer: int, row: int) -> list[ir.Statement]:
    """Return a row of outputs as each column offset that any weight has sees it."""
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
