"""The kernel text of Euler's steps of linear couplings, as few operations as they can be.

    x⁺ = (1 − h/τ) x + (h/τ) w + Σ (h/τ) a y

Weights come with h/τ in them, w is scaled once, and new outputs go to a second padded array, so
that a step is one sweep. Every output that is loaded is added to all cells that it is a neighbour
of while it is in a register.
"""

from collections.abc import Iterator

import numpy as np

from cnnum.engines.opencl.drive import constant_drive
from cnnum.engines.opencl.equal_weights import shares_products, weighted_terms
from cnnum.engines.opencl.rows import fits_rows, row_steps
from cnnum.engines.opencl.text import fill, indented, rename
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import FixedSteps
from cnnum.integrators.estimate import LOST
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Tap, taps

BLOCK_COLUMNS = 10
BLOCK_STATEMENTS = 400
"""Columns and statements of unrolled text: more of it costs compile time and no longer pays."""

REGISTERS_FROM = 64
"""Bytes of a vector from which a processor has 32 registers (AVX-512), enough for two rows' sums.
A sum waits four cycles for each of its products: of two rows side by side there are as many sums as
the processor can work on, of one it must look ahead, and takes a third longer."""


def fuses(text: TransientText, scheme: FixedSteps) -> bool:
    """Return whether steps of a scheme can be written in this way."""
    even = scheme.last == scheme.step and scheme.count > 0
    return scheme.tableau.stages == 1 and text.template.plain and even and text.arena.private


def fused_euler(text: TransientText, scheme: FixedSteps) -> dict[str, str]:
    """Append the steps, from and to the states `x`, and return the figures of the run."""
    if fits_rows(text, scheme):
        row_steps(text, scheme)
        return _figures(text, scheme)
    _declare(text, scheme)
    with text.aside() as step:
        if text.tables.lanes > 1:
            _sweep(text, scheme)
        else:
            _two_sweeps(text, scheme)
        if text.template.boundary.constant is None and text.tables.lanes > 1:
            _rim_rows(text)
        elif text.template.boundary.constant is None:
            text.fill_rims("y", text.layers, text.template.boundary, None)
    figures = {
        "method": scheme.tableau.name,
        "count": scheme.count,
        "step": f"{scheme.step:g}",
        "other": "z" if text.tables.lanes > 1 else "y",
    }
    name = "fused_settling" if scheme.settle else "fused_steps"
    if scheme.settle:
        figures["h"] = text.number(scheme.step)
    text.lines += fill(name, step_text=indented(step, 3), **figures).splitlines()
    return _figures(text, scheme)


def _figures(text: TransientText, scheme: FixedSteps) -> dict[str, str]:
    error = text.number(LOST)
    if scheme.settle:
        return {"time": "time", "steps": "steps", "settled": "settled", "error": error}
    time = text.number(text.solver.duration)
    return {"time": time, "steps": text.number(scheme.count), "error": error}


def _declare(text: TransientText, scheme: FixedSteps) -> None:
    """Append the two arrays of outputs and the scaled drive."""
    boundary = text.template.boundary
    names = ("y", "z") if text.tables.lanes > 1 else ("y",)
    for name in names[1:]:
        text.array(name, text.layers * text.padded)
    if boundary.constant is not None:
        value = float(text.template.output.numpy(np.asarray(boundary.constant)))
        for name in names:
            text.fill_rims(name, text.layers, boundary, value)
    if constant_drive(text) is None:
        text.array("wh", text.layers * text.cells)
        text.over_cells(
            [
                f"wh[{text.at(m)}] = {_number(text, scheme, m)} * w[{text.at(m)}];"
                for m in range(text.layers)
            ]
        )
    text.over_grid(
        [
            f"y[{m * text.padded} + p] = {_output(text, f'x[{text.at(m)}]')};"
            for m in range(text.layers)
        ]
    )
    if boundary.constant is None:
        text.fill_rims("y", text.layers, boundary, None)


def _number(text: TransientText, scheme: FixedSteps, layer: int, factor: float = 1.0) -> str:
    """Return a number times h/τ of a layer."""
    return text.number(factor * scheme.step / float(text.template.tau[layer]))


def _output(text: TransientText, state: str) -> str:
    return rename(text.template.output.opencl, {"x": state})


def _block(text: TransientText) -> int:
    """Return how many columns are unrolled: a divisor of the columns."""
    cols = text.shape[1]
    taps = max(1, int(np.count_nonzero(text.template.A)))
    most = max(1, min(BLOCK_COLUMNS, BLOCK_STATEMENTS // (taps * _together(text))))
    return max(n for n in range(1, cols + 1) if cols % n == 0 and n <= most)


def _together(text: TransientText) -> int:
    """Return how many rows are swept side by side."""
    vector = text.tables.lanes * text.tables.dtype.itemsize
    fits = vector >= REGISTERS_FROM and text.shape[0] % 2 == 0 and not _gathers(text)
    return 2 if fits else 1


def _gathers(text: TransientText) -> bool:
    """Return whether outputs of equal weights are added up before they are weighted."""
    return any(shares_products(taps(text.template.A, layer)) for layer in range(text.layers))


def _sweep(text: TransientText, scheme: FixedSteps) -> None:
    """Append one step of all cells."""
    rows, cols = text.shape
    block, together = _block(text), _together(text)
    with text.aside() as body:
        _block_of_columns(text, scheme, block, together)
    text.lines.append(f"for (int r = 0; r < {rows}; r += {together}) {{")
    text.lines.append(f"    for (int b = 0; b < {cols}; b += {block}) {{")
    text.lines.append(f"        const int i = r * {cols} + b, p = r * {text.pitch} + b;")
    text.lines += [f"        {line}" for line in body]
    text.lines += ["    }", "}"]
    if text.template.boundary.constant is None:
        text.lines.append(f"for (int r = 0; r < {rows}; ++r) {{")
        text.lines += [f"    {line}" for line in _rim_columns(text, text.template.boundary)]
        text.lines.append("}")


def _block_of_columns(text: TransientText, scheme: FixedSteps, block: int, together: int) -> None:
    """Append one step of the columns `b` to `b + block` of so many rows.

    Where weights are equal, what is loaded is kept and added up before it is weighted, else it is
    added to all sums at once, which takes fewer registers.
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


def _two_sweeps(text: TransientText, scheme: FixedSteps) -> None:
    """Append one step of all cells of a single frame, as loops that compilers vectorise.

    They do where nothing that is written may be what is read, so new outputs wait for a sweep of
    their own, and the arrays are not swapped.
    """
    constant = constant_drive(text)
    body: list[str] = []
    for layer in range(text.layers):
        at = text.at(layer)
        kept = _kept(text, scheme, layer)
        drive = f"wh[{at}]" if constant is None else _number(text, scheme, layer, constant[layer])

        def number(weight: float, to: int = layer) -> str:
            return _number(text, scheme, to, weight)

        terms = weighted_terms(
            taps(text.template.A, layer), number, lambda tap: text.neighbour("y", tap)
        )
        sums = " + ".join([drive, f"{kept} * x[{at}]", *terms])
        body.append(f"{{ real sum = {sums};")
        body += [f"    {line}" for line in _settle(text, scheme, "sum", f"x[{at}]", "")]
        body.append(f"    x[{at}] = sum; }}")
    text.over_grid(body)
    outputs = [
        f"y[{m * text.padded} + p] = {_output(text, f'x[{text.at(m)}]')};"
        for m in range(text.layers)
    ]
    text.over_grid(outputs)


def _state(text: TransientText, layer: int, row: int, column: int) -> str:
    return f"x[{layer * text.cells + row * text.shape[1] + column} + i]"


def _sum(layer: int, row: int, column: int) -> str:
    return f"s{layer}_{row}_{column}"


def _begin(text: TransientText, scheme: FixedSteps, row: int, column: int) -> None:
    """Append the sums of a cell of the block, begun with what does not come from neighbours."""
    constant = constant_drive(text)
    for layer in range(text.layers):
        kept, state = _kept(text, scheme, layer), _state(text, layer, row, column)
        drive = f"wh{state[1:]}"
        if constant is not None:
            drive = _number(text, scheme, layer, constant[layer])
        text.lines.append(f"real {_sum(layer, row, column)} = {drive} + {kept} * {state};")


def _kept(text: TransientText, scheme: FixedSteps, layer: int) -> str:
    """Return what a step leaves of a state."""
    return text.number(1.0 - scheme.step / float(text.template.tau[layer]))


def _scatter(
    text: TransientText, scheme: FixedSteps, column: int, block: int, together: int
) -> None:
    """Append the outputs of a column, each added to all sums of the block that it reaches."""
    feedback = text.template.A
    span = feedback.shape[-1]
    rim = text.radius - span // 2
    for source in range(text.layers):
        for row in range(span + together - 1):
            adds = [
                f"{_sum(to, k, cell)} += {_number(text, scheme, to, float(weight))} * v;"
                for k in range(max(0, row - span + 1), min(together, row + 1))
                for to, cell, weight in _reached(text, feedback[:, source, row - k], column, block)
            ]
            if adds:
                place = source * text.padded + (row + rim) * text.pitch + column
                text.lines.append(f"{{ const real v = from[{place} + p]; {' '.join(adds)} }}")


def _load(text: TransientText, column: int) -> None:
    """Append what is read of a padded column."""
    span, rim = text.template.A.shape[-1], text.radius - text.template.A.shape[-1] // 2
    for source in range(text.layers):
        for row in range(rim, rim + span):
            place = source * text.padded + row * text.pitch + column
            text.lines.append(f"const real {_loaded(source, row, column)} = from[{place} + p];")


def _loaded(source: int, row: int, column: int) -> str:
    return f"v{source}_{row}_{column}"


def _gather(text: TransientText, scheme: FixedSteps, column: int) -> None:
    """Append the sums of a column's cells, equal weights together."""
    for layer in range(text.layers):

        def number(weight: float, to: int = layer) -> str:
            return _number(text, scheme, to, weight)

        def output(tap: Tap) -> str:
            return _loaded(tap.source, text.radius + tap.row, text.radius + tap.col + column)

        terms = weighted_terms(taps(text.template.A, layer), number, output)
        text.lines += [f"{_sum(layer, 0, column)} += {term};" for term in terms]


def _reached(
    text: TransientText, weights: np.ndarray, column: int, block: int
) -> Iterator[tuple[int, int, float]]:
    """Yield (layer, cell of the block, weight) of what an output in a padded column adds to."""
    span, radius = weights.shape[-1], text.radius
    for to in range(text.layers):
        for col in range(span):
            cell = column - radius - (col - span // 2)
            if weights[to, col] and 0 <= cell < block:
                yield to, cell, float(weights[to, col])


def _end(text: TransientText, scheme: FixedSteps, row: int, column: int) -> None:
    """Append what becomes of a cell's finished sums."""
    for layer in range(text.layers):
        new, old = _sum(layer, row, column), _state(text, layer, row, column)
        text.lines += _settle(text, scheme, new, old, f" + {row * text.shape[1] + column}")
        at = (text.radius + row) * text.pitch + text.radius + column
        place = layer * text.padded + at
        text.lines.append(f"{old} = {new}; to[{place} + p] = {_output(text, new)};")


def _settle(text: TransientText, scheme: FixedSteps, new: str, old: str, offset: str) -> list[str]:
    """Return statements that keep a new state within limits, masks and lanes that have settled."""
    lines: list[str] = []
    if text.template.output.limited:
        lines.append(f"{new} = clamp({new}, -ONE, ONE);")
    if text.operands.mask is not None:
        mask = text.operands.mask.replace("[i]", f"[i{offset}]")
        mask = mask.replace("+ i]", f"+ i{offset}]")
        lines.append(f"{new} = PICK({mask} != ZERO, {old}, {new});")
    if scheme.settle:
        rate = text.number(float(text.template.tau.max()) / scheme.step)
        lines.append(f"change = fmax(change, {rate} * fabs({new} - {old}) - {text.scale(old)});")
        lines.append(f"{new} = PICK(running != ZERO, {new}, {old});")
    return lines


def _rim_columns(text: TransientText, boundary: Boundary) -> list[str]:
    """Return statements that fill the rim left and right of row `r`."""
    cols, radius = text.shape[1], text.radius
    source = np.pad(np.arange(cols), radius, mode=boundary.pad_mode)
    places = [*range(radius), *range(cols + radius, cols + 2 * radius)]
    lines: list[str] = []
    for layer in range(text.layers):
        head = f"{layer * text.padded} + (r + {radius}) * {text.pitch}"
        lines += [
            f"to[{head} + {place}] = to[{head} + {int(source[place]) + radius}];"
            for place in places
        ]
    return lines


def _rim_rows(text: TransientText) -> None:
    """Append the rim above and below, copied from whole rows."""
    rows, radius = text.shape[0], text.radius
    source = np.pad(np.arange(rows), radius, mode=text.template.boundary.pad_mode)
    copies = [
        f"to[{layer * text.padded + place * text.pitch} + c] = "
        f"to[{layer * text.padded + (int(source[place]) + radius) * text.pitch} + c];"
        for layer in range(text.layers)
        for place in (*range(radius), *range(rows + radius, rows + 2 * radius))
    ]
    if copies:
        text.lines.append(f"for (int c = 0; c < {text.pitch}; ++c) {{")
        text.lines += [f"    {line}" for line in copies]
        text.lines.append("}")
