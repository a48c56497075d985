"""The kernel that takes a large array's steps: strips of rows, several stages a launch."""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.engines.opencl.drive import constant_drive
from cnnum.engines.opencl.parts import Strips
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.strip_rows import HELD
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText

LEVELS = 32
"""Stages of steps a launch, at most: what is missing between strips grows with them. Euler's steps
of 512×512 cells take four fifths of the time that they take with 8 (AMD EPYC)."""

LEAST_LEVELS = 8
"""Stages a launch even if their rows do not fit the cache."""

SHARES = 8
"""Strips that an array can be parted into, at least."""

BLOCK_ROWS = 4

_CLIPPED = "(x = -one > x ? -one : x, one < x ? one : x)"

SHOWN = {
    "standard": _CLIPPED,
    "linear": "x",
    "tanh": "tanh(x)",
    "full-range": _CLIPPED,
    "sign": "one - one <= x ? one : -one",
}
"""Outputs of a vector of states `x`, by name; `one` is 1 in every lane."""

_OWN = re.compile(
    r"\b(vec|ROW|shown|hidden_one|sides|all_sides|copy_row|fill_row|turned|part_of|to_lanes|from_lanes|fill_lanes|copy_lanes|show_row|upper|lower|inwards|magnitude|greatest|one_row|more_rows|level|strip)\b"
)
"""Names that the kernel has to itself: a plan may have several."""


@dataclass(frozen=True, slots=True)
class StripText:
    """What is a scheme's own in the kernel.

    Attributes
    ----------
    scales : tuple of float
        What the drive of each layer comes with.
    case : str
        The expression of the case that is the level `number`.
    cases : callable
        The text of all cases of so many rows.
    clear : list of str
        What the first strip sets before all else.
    rest : list of str
        What is set in a row with its states.
    begin : list of str
        What a strip does before it takes levels.
    again : list of str
        What takes a row back to where levels began, if anything ever does.
    end : str
        Where the states are in the end, from where they were.
    count : str
        Levels that a frame takes of at most `most` after those that are `done`.
    """

    scales: tuple[float, ...]
    case: str
    cases: Callable[[int], list[str]]
    clear: list[str]
    rest: list[str]
    begin: list[str]
    again: tuple[str, ...] = ()
    end: str = "0"
    count: str = "most"


def row_layout(text: TransientText) -> RowLayout:
    """Return how rows lie."""
    boundary, lanes = text.template.boundary, text.tables.width
    constant = _constant(text)
    return RowLayout(text.shape[1], text.radius, lanes, boundary, constant, text.layers)


def declare(text: TransientText, layout: RowLayout, names: tuple[str, ...]) -> dict[str, int]:
    """Append arrays that hold all rows, and return how far each is from the first."""
    size = (text.shape[0] + 2 * text.radius) * layout.pitch
    if text.operands.mask is not None:
        text.array("held", text.cells)
        text.over_cells([f"held[i] = PICK({text.operands.mask} != ZERO, ONE, ZERO);"])
        names = (*names, HELD)
    for name in (*names, "strip_w", "strip_even", "strip_odd"):
        text.array(name, size)
    return {name: text.arena.places[name] - text.arena.places[names[0]] for name in names}


def levels_of(text: TransientText, layout: RowLayout, arrays: int) -> tuple[int, int]:
    """Return the stages a launch, and the strips that are then high enough, of so many arrays."""
    rows, radius = text.shape[0], text.radius
    # strips must not vanish before the last of the levels
    high = rows // (2 * radius * SHARES) - 1
    masks = int(text.operands.mask is not None)
    row = (arrays + masks + 3) * layout.pitch * text.tables.dtype.itemsize
    near = text.tables.near_bytes // (BLOCK_ROWS * row)
    levels = max(1, min(LEVELS, max(LEAST_LEVELS, near), high))
    return levels, max(1, rows // (2 * (levels + 1) * radius))


def strip_kernel(
    text: TransientText,
    own: StripText,
    layout: RowLayout,
    first: str,
    size: tuple[int, int],
    count: int,
) -> Strips:
    """Return the kernel that takes `count` levels of states in the array `first`."""
    (rows, cols), radius, places = text.shape, text.radius, text.arena.places
    periodic = text.template.boundary.pad_mode == "wrap"
    name = f"advance_{len(text.tables.strips)}"
    names: dict[str, object] = {
        "kernel": name,
        "width": layout.width,
        "bytes": text.tables.dtype.itemsize,
        "rows": rows,
        "cols": cols,
        "cells": text.cells,
        "layers": text.layers,
        "span": layout.span,
        "radius": radius,
        "pitch": layout.pitch,
        "head": layout.head,
        "length": layout.vectors,
        "last": max(0, layout.vectors - layout.width),
        "block": BLOCK_ROWS,
        "levels": size[0],
        "case": own.case,
        "count": own.count,
        "lag": -(-2 * radius // BLOCK_ROWS),
        "periodic": int(periodic),
        "x": places[first],
        "w": places["strip_w"],
        "even": places["strip_even"],
        "odd": places["strip_odd"],
        "state": places["x"],
        "shown": SHOWN[text.template.output.name],
        "drive": _drive(text, own.scales),
        "clear": indented(own.clear, 3),
        "rest": indented(own.rest, 5).lstrip(),
        "again": indented(list(own.again), 5).lstrip(),
        "begin": indented(own.begin, 2),
        "end": own.end,
        "turned": indented(layout.turned(), 1),
        "sides": indented(layout.sides(), 1),
        "upper": indented(_rows_beyond(text, -1), 1),
        "lower": indented(_rows_beyond(text, 1), 1),
        "one_row": indented(own.cases(1), 1),
        "more_rows": indented(own.cases(BLOCK_ROWS), 1),
    }
    source = _OWN.sub(rf"\1_{name}", fill("strips", **names))
    return Strips(name, source, count, size[0], size[1], not periodic)


def _drive(text: TransientText, scales: tuple[float, ...]) -> str:
    """Return the statement that sets the scaled w of a row of a layer."""
    constant = constant_drive(text)
    if constant is None:
        scale = _of_layer([text.number(scale) for scale in scales])
        return f"to_lanes(w + p, mine + {text.arena.places['w']} + cell, {scale});"
    each = zip(scales, constant, strict=True)
    return f"fill_lanes(w + p, {_of_layer([text.number(scale * n) for scale, n in each])});"


def _of_layer(numbers: list[str]) -> str:
    """Return the expression of the number of the layer at hand."""
    if len(set(numbers)) == 1:
        return numbers[0]
    *others, last = numbers
    picks = "".join(f"layer == {layer} ? {number} : " for layer, number in enumerate(others))
    return f"({picks}{last})"


def _rows_beyond(text: TransientText, side: int) -> list[str]:
    """Return the text that sets the virtual rows above (-1) or below (1) the array."""
    rows, mode = text.shape[0], text.template.boundary.pad_mode
    constant, lines = _constant(text), list[str]()
    for n in range(text.radius):
        to, near, far = (-1 - n, n, rows - 1 - n) if side < 0 else (rows + n, rows - 1 - n, n)
        if constant is None:
            lines.append(f"copy_row(y, {to}, {far if mode == 'wrap' else near});")
        else:
            lines.append(f"fill_row(y, {to}, {constant});")
    return lines


def _constant(text: TransientText) -> str | None:
    """Return the output of virtual cells of a fixed boundary."""
    constant = text.template.boundary.constant
    if constant is None:
        return None
    return text.number(float(text.template.output.numpy(np.asarray(constant))))
