"""The kernel of fixed steps on large arrays: strips of rows, several stages of steps a launch."""

import re

import numpy as np

from cnnum.engines.opencl.drive import constant_drive
from cnnum.engines.opencl.parts import Strips
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.strip_rows import StripRows
from cnnum.engines.opencl.strip_stages import Stages, stages_of
from cnnum.engines.opencl.text import fill, indented, rename
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import FixedSteps
from cnnum.integrators.schemes import ExponentialSteps

CACHE_BYTES = 1024 * 1024
"""Of the rows between the first and the last of the levels that follow each other."""

LEVELS = 32
"""Stages of steps a launch, at most: what is missing between strips grows with them. Euler's steps
of 512×512 cells take four fifths of the time that they take with 8."""

LEAST_LEVELS = 14
"""Stages a launch even if their rows do not fit the cache: Euler's steps of 2048×2048 cells take
four fifths of the time that they take with the 7 whose rows do."""

SHARES = 8
"""Strips that an array can be parted into, at least."""

BLOCK_ROWS = 4

_OWN = re.compile(
    r"\b(vec|ROW|shown|hidden_one|sides|copy_row|fill_row|upper|lower|inwards|one_row|more_rows|level|strip)\b"
)
"""Names that the kernel has to itself: a plan may have several."""


def strips_fit(text: TransientText, scheme: FixedSteps | ExponentialSteps) -> bool:
    """Return whether steps of a scheme can be taken strip by strip."""
    template, radius = text.template, text.radius
    even = not isinstance(scheme, FixedSteps) or scheme.last == scheme.step
    simple = template.plain and text.layers == 1 and text.operands.mask is None
    known = template.output.name in ("standard", "linear", "full-range")
    return (
        even
        and scheme.count > 0
        and not scheme.settle
        and simple
        and known
        and 0 < radius <= BLOCK_ROWS
        and min(text.shape) >= 4 * radius
        and not text.arena.private
        and stages_of(scheme, float(template.tau[0])) is not None
    )


def strip_steps(text: TransientText, scheme: FixedSteps | ExponentialSteps) -> None:
    """Append the name that stands for the steps, and keep their kernel with the tables."""
    stages = stages_of(scheme, float(text.template.tau[0]))
    assert stages is not None
    levels = len(stages.stages) * scheme.count
    layout = RowLayout(
        text.shape[1],
        text.radius,
        text.tables.width,
        text.template.boundary,
        _constant(text),
        levels,
    )
    size = (text.shape[0] + 2 * text.radius) * layout.pitch
    for array in (*_arrays(stages), "strip_w", "strip_even", "strip_odd"):
        text.array(array, size)
    name = f"advance_{len(text.tables.strips)}"
    text.lines.append(f"{name};")
    text.tables.strips[name] = _strips(text, stages, layout, name)


def _arrays(stages: Stages) -> list[str]:
    return [f"strip_x{n}" for n in range(stages.arrays)]


def _strips(text: TransientText, stages: Stages, layout: RowLayout, name: str) -> Strips:
    (rows, cols), radius, places = text.shape, text.radius, text.arena.places
    size = text.tables.dtype.itemsize
    periodic = text.template.boundary.pad_mode == "wrap"
    # strips must not vanish before the last of the levels
    high = rows // (2 * radius * SHARES) - 1
    row = (stages.arrays + 3) * layout.pitch * size
    levels = max(1, min(LEVELS, max(LEAST_LEVELS, CACHE_BYTES // (BLOCK_ROWS * row)), high))
    states = [places[array] for array in _arrays(stages)]
    written = StripRows(text, layout, stages, tuple(place - states[0] for place in states))
    names: dict[str, object] = {
        "kernel": name,
        "width": layout.width,
        "bytes": size,
        "rows": rows,
        "cols": cols,
        "radius": radius,
        "pitch": layout.pitch,
        "head": layout.head,
        "pieces": layout.pieces,
        "length": layout.length,
        "step": layout.step,
        "block": BLOCK_ROWS,
        "levels": levels,
        "stages": len(stages.stages),
        "count": layout.levels,
        "lag": -(-2 * radius // BLOCK_ROWS),
        "periodic": int(periodic),
        "x": states[0],
        "w": places["strip_w"],
        "even": places["strip_even"],
        "odd": places["strip_odd"],
        "state": places["x"],
        "shown": _shown(text),
        "drive": _drive(text, stages.scale),
        "first": rename(text.template.output.opencl, {"x": "value"}),
        "sides": indented(layout.sides(), 1),
        "upper": indented(_rows_beyond(text, -1), 1),
        "lower": indented(_rows_beyond(text, 1), 1),
        "one_row": indented(written.cases(1), 1),
        "more_rows": indented(written.cases(BLOCK_ROWS), 1),
    }
    source = _OWN.sub(rf"\1_{name}", fill("strips", **names))
    most = rows // (2 * (levels + 1) * radius)
    return Strips(name, source, layout.levels, levels, max(1, most), not periodic)


def _drive(text: TransientText, scale: float) -> str:
    constant = constant_drive(text)
    if constant is not None:
        return text.number(scale * constant[0])
    return f"{text.number(scale)} * mine[{text.arena.places['w']} + cell]"


def _shown(text: TransientText) -> str:
    """Return f of a vector of states."""
    if text.template.output.name == "linear":
        return "x"
    return "(x = -one > x ? -one : x, one < x ? one : x)"


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
