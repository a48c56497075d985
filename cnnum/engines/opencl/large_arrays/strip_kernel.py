"""The kernel that takes a large array's steps: strips of rows, several stages a launch."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.large_arrays.lane_rows import (
    BLOCK_ROWS,
    OWN,
    inputs_of,
    lane_text,
    row_layout,
    size_of,
)
from cnnum.engines.opencl.large_arrays.strip_boundary import (
    OUTPUTS,
    by_turns,
    first_states,
    padded_arrays,
    reads,
    rim_texts,
)
from cnnum.engines.opencl.large_arrays.strip_rows import HELD, Rows
from cnnum.engines.opencl.text import WIDE_BYTES, fill, indented, owned
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.feedforward import constant_drive
from cnnum.kernels.launch_plan import Strips
from cnnum.templating.reads import moving_inputs

LEVELS = 32
"""Stages of steps a launch, at most: the gap between strips grows with them. Euler's steps
of 512×512 cells take four fifths of the time that they take with 8 (AMD EPYC)."""

LEAST_LEVELS = 8
"""Stages a launch even if their rows do not fit the cache."""

SHARES = 8
"""Strips that an array can be parted into, at least."""

_CLIPPED = "(x = -one > x ? -one : x, one < x ? one : x)"

SHOWN = {
    "standard": _CLIPPED,
    "linear": "x",
    "tanh": "tanh(x)",
    "full-range": _CLIPPED,
    "sign": "one - one <= x ? one : -one",
}
"""Outputs of a vector of states `x`, by name; `one` is 1 in every lane."""

HELD_CELLS = ir.Name("held")
"""The array that is 1 where a mask holds a cell, as cells lie elsewhere."""

DRIVE = "strip_w"
"""The array of the cells' drive."""

_OWN = (
    *OWN,
    "shown", "hidden_one", "show_row", "inwards", "magnitude", "greatest", "outputs_of",
    "states_of", "sides_of_states", "all_sides_of_states", "upper_of_states", "lower_of_states",
    "rims_above", "rims_below", "one_row", "more_rows", "take_level", "strip",
)  # fmt: skip
"""Names that the kernel has to itself: a plan may have several."""


@dataclass(frozen=True, slots=True)
class StripText:
    """The parts of a kernel that depend on the scheme.

    Attributes
    ----------
    case : str
        The expression of the case that is the level `number`.
    cases : callable
        All cases of a number of rows.
    clear : list of str
        Settings of the first strip before all else.
    rest : list of str
        Settings in a row with its states.
    begin : list of str
        Steps of a strip before it takes levels.
    outputs : str
        The expression of the outputs after `level` levels.
    again : list of str
        Steps that take a row back to the begin of the levels, if any.
    end : str
        Where the states are in the end, from where they were.
    count : str
        Levels that a frame takes of at most `most` after those that are `done`.
    ahead : str
        The expression of the levels before those that a launch counts.
    driven : str
        That of the cells' drive at the level `number`.
    """

    case: str
    cases: Callable[[int], list[ir.Case]]
    rest: Sequence[str]
    clear: Sequence[str] = ()
    begin: Sequence[str] = ()
    outputs: str | None = None
    again: Sequence[str] = ()
    end: str = "0"
    count: str = "most"
    ahead: str = "0"
    driven: str = "w"


def strip_rows(text: TransientBuilder, names: tuple[str, ...], scales: tuple[float, ...]) -> Rows:
    """Append arrays that hold all rows, and return the writer of their statements."""
    layout = row_layout(text)
    names = names or OUTPUTS
    if text.operands.mask is not None:
        text.array(HELD_CELLS, text.cells)
        held = ir.pick(text.operands.mask.differs(ir.ZERO), ir.ONE, ir.ZERO)
        text.over_cells([ir.Assign(HELD_CELLS[ir.CELL], held)])
        names = (*names, HELD)
    names = tuple(dict.fromkeys((*names, *padded_arrays(text), DRIVE, *OUTPUTS)))
    for name in names:
        text.array(ir.Name(name), size_of(text, layout))
    first, given = text.arena.places[names[0]], [inputs_of(n) for n in moving_inputs(text.template)]
    offsets: dict[str, int | str] = {
        name: text.arena.places[name] - first for name in (*names, *given)
    }
    return Rows(text, layout, scales, offsets, _levels_of(text, layout, len(offsets)))


def _levels_of(text: TransientBuilder, layout: RowLayout, arrays: int) -> tuple[int, int]:
    """Return the stages a launch, and the strips high enough for that, by the number of arrays."""
    rows, radius = text.shape[0], text.radius
    # strips must not vanish before the last of the levels
    high = rows // (2 * radius * SHARES) - 1
    near = text.tables.near_bytes // (
        BLOCK_ROWS * arrays * layout.pitch * text.tables.dtype.itemsize
    )
    levels = max(1, min(LEVELS, max(LEAST_LEVELS, near), high))
    return levels, max(1, rows // (2 * (levels + 1) * radius))


def _shown(text: TransientBuilder, layout: RowLayout) -> str:
    """Return the outputs of a vector of states; built-ins of wide vectors go by halves."""
    name = text.template.output.name
    wide = layout.width * text.tables.dtype.itemsize >= WIDE_BYTES
    return "(vec)(tanh(x.lo), tanh(x.hi))" if wide and name == "tanh" else SHOWN[name]


def strip_kernel(rows: Rows, own: StripText, count: int) -> Strips:
    """Return the kernel that takes `count` levels, and keep it with the tables."""
    text, layout = rows.text, rows.layout
    (height, cols), radius, places = text.shape, text.radius, text.arena.places
    first, *_ = rows.offsets
    periodic = text.template.boundary.pad_mode == "wrap"
    name = f"advance_{len(text.tables.strips)}"
    names: dict[str, str | int] = {
        "kernel": name,
        "lanes": lane_text(text, layout),
        "width": layout.width,
        "rows": height,
        "cols": cols,
        "cells": text.cells,
        "layers": text.layers,
        "span": layout.span,
        "radius": radius,
        "rim": min(radius, height),
        "pitch": layout.pitch,
        "length": layout.vectors,
        "block": BLOCK_ROWS,
        "levels": rows.size[0],
        "case": own.case,
        "count": own.count,
        "ahead": own.ahead,
        "lag": -(-2 * radius // BLOCK_ROWS),
        "periodic": int(periodic),
        "x": places[first],
        "w": places[DRIVE],
        "outputs_of": own.outputs or by_turns(rows.offsets, OUTPUTS),
        "state": places["x"],
        "shown": _shown(text, layout),
        "drive": _drive(text, rows.scales),
        "clear": indented(own.clear, 3),
        "rest": indented([*own.rest, *first_states(text)], 5).lstrip(),
        "again": indented(own.again, 5).lstrip(),
        "begin": indented(own.begin, 2),
        "end": own.end,
        "reads": indented(reads(text, own.driven), 1),
        "one_row": indented(rows.printer.lines(own.cases(1)), 1),
        "more_rows": indented(rows.printer.lines(own.cases(BLOCK_ROWS)), 1),
        **rim_texts(text, layout, rows.offsets),
    }
    source = owned(fill("strips", **names), _OWN, name)
    text.tables.strips.append(source)
    return Strips(name, source, count, *rows.size, not periodic)


def _drive(text: TransientBuilder, scales: tuple[float, ...]) -> str:
    """Return the statements that set the scaled w of a row of a layer."""
    constant = constant_drive(text)
    if constant is None:
        scale = of_layer(text, scales)
        return f"to_lanes(w + p, mine + {text.arena.places['w']} + cell, {scale});"
    each = zip(scales, constant, strict=True)
    return f"fill_lanes(w + p, {of_layer(text, [scale * n for scale, n in each])});"


def of_layer(text: TransientBuilder, values: Iterable[float]) -> str:
    """Return the expression of the number of the layer at hand."""
    numbers = [text.literal(value) for value in values]
    if len(set(numbers)) == 1:
        return numbers[0]
    *others, last = numbers
    picks = "".join(f"layer == {layer} ? {number} : " for layer, number in enumerate(others))
    return f"({picks}{last})"
