"""The kernel text of Euler's steps of a single small frame: each row of the array is one vector.

Neighbours in a row are the same vector with its components moved along, so that nothing is
written to memory, and read back at another place, between the steps.
"""

import numpy as np

from cnnum.engines.opencl.drive import constant_drive
from cnnum.engines.opencl.equal_weights import weighted_terms
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import FixedSteps
from cnnum.templating.network import Tap, taps
from cnnum.templating.output_functions import OutputFunction

WIDTHS = (4, 8, 16)
DIGITS = "0123456789abcdef"
MOST_ROWS = 20
"""Vectors of all layers' rows: more do not fit the registers."""

MOST_STATEMENTS = 700

SHARED = 4
"""Equal weights that are worth a sum before the product: pairs took a tenth longer with it, fours
a tenth less."""


def width(cols: int) -> int | None:
    """Return the vector that holds a row, None where it is too long."""
    return next((n for n in WIDTHS if n >= cols), None)


def fits_rows(text: TransientText, scheme: FixedSteps) -> bool:
    """Return whether a single frame's steps can be written with rows as vectors."""
    rows, cols = text.shape
    work = rows * (int(np.count_nonzero(text.template.A)) + 2 * text.radius * text.layers)
    return (
        text.tables.lanes == 1
        and width(cols) is not None
        and rows * text.layers <= MOST_ROWS
        and work <= MOST_STATEMENTS
        and not scheme.settle
        and text.operands.mask is None
        and _clips(text.template.output) is not None
    )


def _clips(output: OutputFunction) -> bool | None:
    """Return whether f clips, False where f(x) = x, None where it is something else."""
    return {"standard": True, "full-range": True, "linear": False}.get(output.name)


def row_steps(text: TransientText, scheme: FixedSteps) -> None:
    """Append the steps, from and to the states `x`."""
    scalar = "double" if text.tables.dtype == np.float64 else "float"
    vector = width(text.shape[1])
    text.tables.types["rows"] = fill("rows", row=f"{scalar}{vector}")
    with text.aside() as step:
        _step(text, scheme)
    text.lines += fill(
        "row_steps",
        method=scheme.tableau.name,
        count=scheme.count,
        step=f"{scheme.step:g}",
        begin=indented(_begin(text, scheme), 2),
        step_text=indented(step, 3),
        end=indented(_end(text), 2),
    ).splitlines()


def _each(text: TransientText) -> list[tuple[int, int]]:
    return [(layer, row) for layer in range(text.layers) for row in range(text.shape[0])]


def _begin(text: TransientText, scheme: FixedSteps) -> list[str]:
    """Return the rows of states and of the scaled drive."""
    lines = [f"row x{layer}_{r} = {_gathered(text, 'x', layer, r)};" for layer, r in _each(text)]
    if constant_drive(text) is None:
        lines += [
            f"const row w{layer}_{r} = {_number(text, scheme, layer)} * "
            f"{_gathered(text, 'w', layer, r)};"
            for layer, r in _each(text)
        ]
    return lines


def _gathered(text: TransientText, array: str, layer: int, row: int) -> str:
    cols = text.shape[1]
    start = layer * text.cells + row * cols
    parts = [f"{array}[{start + c}]" for c in range(cols)]
    parts += ["ZERO"] * ((width(cols) or 0) - cols)
    return f"(row)({', '.join(parts)})"


def _number(text: TransientText, scheme: FixedSteps, layer: int, factor: float = 1.0) -> str:
    return text.number(factor * scheme.step / float(text.template.tau[layer]))


def _step(text: TransientText, scheme: FixedSteps) -> None:
    output = text.template.output
    for layer, r in _each(text):
        state = f"x{layer}_{r}"
        text.lines.append(f"const row y{layer}_{r} = {_clipped(output, state)};")
        _moved(text, layer, r)
    constant = constant_drive(text)
    for layer, r in _each(text):
        kept = text.number(1.0 - scheme.step / float(text.template.tau[layer]))
        drive = f"w{layer}_{r}"
        if constant is not None:
            drive = f"(row)({_number(text, scheme, layer, constant[layer])})"
        terms = [f"{drive} + {kept} * x{layer}_{r}", *_weighted(text, scheme, layer, r)]
        text.lines.append(f"row s{layer}_{r} = {' + '.join(terms)};")
    for layer, r in _each(text):
        new = f"s{layer}_{r}"
        text.lines.append(f"x{layer}_{r} = {f'clip_row({new})' if output.limited else new};")


def _clipped(output: OutputFunction, state: str) -> str:
    return f"clip_row({state})" if _clips(output) and not output.limited else state


def _columns(text: TransientText) -> set[int]:
    """Return the column offsets that any weight has."""
    places = np.argwhere(text.template.A)
    return {int(place[3]) - text.template.A.shape[-1] // 2 for place in places} - {0}


def _moved(text: TransientText, layer: int, row: int) -> None:
    """Append a row of outputs as each column offset sees it."""
    cols, radius, boundary = text.shape[1], text.radius, text.template.boundary
    if boundary.constant is None:
        source = np.pad(np.arange(cols), radius, mode=boundary.pad_mode)
    else:
        source = np.pad(np.arange(cols), radius, constant_values=-1)
    for offset in sorted(_columns(text)):
        parts = [
            f"y{layer}_{row}.s{DIGITS[at]}" if at >= 0 else _rim(text)
            for at in source[radius + offset : radius + offset + cols].tolist()
        ]
        parts += ["ZERO"] * ((width(cols) or 0) - cols)
        name = f"y{layer}_{row}_{radius + offset}"
        text.lines.append(f"const row {name} = (row)({', '.join(parts)});")


def _rim(text: TransientText) -> str:
    """Return the output of virtual cells of a fixed boundary."""
    value = text.template.output.numpy(np.asarray(text.template.boundary.constant))
    return text.number(float(value))


def _weighted(text: TransientText, scheme: FixedSteps, layer: int, row: int) -> list[str]:
    rows, radius, boundary = text.shape[0], text.radius, text.template.boundary
    if boundary.constant is None:
        source = np.pad(np.arange(rows), radius, mode=boundary.pad_mode)
    else:
        source = np.pad(np.arange(rows), radius, constant_values=-1)

    def output(tap: Tap) -> str:
        at = int(source[radius + row + tap.row])
        name = f"y{tap.source}_{at}" + (f"_{radius + tap.col}" if tap.col else "")
        return name if at >= 0 else _rim(text)

    def number(weight: float) -> str:
        return _number(text, scheme, layer, weight)

    return weighted_terms(taps(text.template.A, layer), number, output, SHARED)


def _end(text: TransientText) -> list[str]:
    """Return the text that writes the rows back."""
    cols = text.shape[1]
    return [
        f"x[{layer * text.cells + r * cols + c}] = x{layer}_{r}.s{DIGITS[c]};"
        for layer, r in _each(text)
        for c in range(cols)
    ]
