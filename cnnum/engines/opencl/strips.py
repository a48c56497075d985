"""The kernel text of Euler's steps on large arrays: strips of rows, several steps a launch.

Rows of a strip are taken a few at a time, a vector of cells wide: an output that is loaded serves
all the cells of the block that it is a neighbour of.
"""

import re

import numpy as np

from cnnum.engines.opencl.drive import constant_drive
from cnnum.engines.opencl.equal_weights import shares_products, weighted_terms
from cnnum.engines.opencl.parts import Strips
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.text import fill, indented, rename
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import FixedSteps
from cnnum.network import Tap, taps

CACHE_BYTES = 1024 * 1024
"""Of the rows between the first and the last of the steps that follow each other."""

LEVELS = 32
"""Steps a launch, at most: what is missing between strips grows with them. 512×512 cells take four
fifths of the time that they take with 8."""

LEAST_LEVELS = 14
"""Steps a launch even if their rows do not fit the cache: 2048×2048 cells take four fifths of the
time that they take with the 7 whose rows do."""

SHARES = 8
"""Strips that an array can be parted into, at least."""

BLOCK_ROWS = 4

_OWN = re.compile(
    r"\b(vec|ROW|shown|hidden_one|sides|copy_row|fill_row|upper|lower|one_row|more_rows|step|strip)\b"
)
"""Names that the kernel has to itself: a plan may have several."""


def strips_fit(text: TransientText, scheme: FixedSteps) -> bool:
    """Return whether steps of a scheme can be taken strip by strip."""
    template, radius = text.template, text.radius
    even = scheme.last == scheme.step and scheme.count > 0 and not scheme.settle
    simple = template.plain and text.layers == 1 and text.operands.mask is None
    known = template.output.name in ("standard", "linear", "full-range")
    return (
        scheme.tableau.stages == 1
        and even
        and simple
        and known
        and 0 < radius <= BLOCK_ROWS
        and min(text.shape) >= 4 * radius
        and not text.arena.private
    )


def euler_strips(text: TransientText, scheme: FixedSteps) -> None:
    """Append the name that stands for the steps, and keep their kernel with the tables."""
    size = (text.shape[0] + 2 * text.radius) * _layout(text, scheme).pitch
    for array in ("strip_x", "strip_w", "strip_even", "strip_odd"):
        text.array(array, size)
    name = f"advance_{len(text.tables.strips)}"
    text.lines.append(f"{name};")
    text.tables.strips[name] = _strips(text, scheme, name)


def _layout(text: TransientText, scheme: FixedSteps) -> RowLayout:
    width = text.tables.width
    boundary = text.template.boundary
    return RowLayout(text.shape[1], text.radius, width, boundary, _constant(text), scheme.count)


def _strips(text: TransientText, scheme: FixedSteps, name: str) -> Strips:
    (rows, cols), radius, places = text.shape, text.radius, text.arena.places
    layout, size = _layout(text, scheme), text.tables.dtype.itemsize
    periodic = text.template.boundary.pad_mode == "wrap"
    # strips must not vanish before the last of the steps
    high = rows // (2 * radius * SHARES) - 1
    cached = CACHE_BYTES // (4 * BLOCK_ROWS * layout.pitch * size)
    levels = max(1, min(LEVELS, max(LEAST_LEVELS, cached), high))
    names: dict[str, object] = {
        "kernel": name,
        "width": layout.width,
        "bytes": size,
        "rows": rows,
        "cols": cols,
        "radius": radius,
        "pitch": layout.pitch,
        "head": layout.head,
        "span": layout.vectors * layout.width,
        "pieces": layout.pieces,
        "length": layout.length,
        "step": layout.step,
        "block": BLOCK_ROWS,
        "levels": levels,
        "count": scheme.count,
        "lag": -(-2 * radius // BLOCK_ROWS),
        "periodic": int(periodic),
        "x": places["strip_x"],
        "w": places["strip_w"],
        "even": places["strip_even"],
        "odd": places["strip_odd"],
        "state": places["x"],
        "shown": _shown(text),
        "drive": _drive(text, scheme),
        "first": rename(text.template.output.opencl, {"x": "value"}),
        "sides": indented(layout.sides(), 1),
        "upper": indented(_rows_beyond(text, -1), 1),
        "lower": indented(_rows_beyond(text, 1), 1),
        "one_row": indented(_step(text, scheme, 1), 2),
        "more_rows": indented(_step(text, scheme, BLOCK_ROWS), 2),
    }
    source = _OWN.sub(rf"\1_{name}", fill("strips", **names))
    most = rows // (2 * (levels + 1) * radius)
    return Strips(name, source, scheme.count, levels, max(1, most), not periodic)


def _scale(scheme: FixedSteps, text: TransientText, factor: float = 1.0) -> str:
    return text.number(factor * scheme.step / float(text.template.tau[0]))


def _drive(text: TransientText, scheme: FixedSteps) -> str:
    constant = constant_drive(text)
    if constant is not None:
        return _scale(scheme, text, constant[0])
    return f"{_scale(scheme, text)} * mine[{text.arena.places['w']} + cell]"


def _shown(text: TransientText) -> str:
    """Return f of a vector of states."""
    if text.template.output.name == "linear":
        return "x"
    return "(x = -one > x ? -one : x, one < x ? one : x)"


def _step(text: TransientText, scheme: FixedSteps, block: int) -> list[str]:
    """Return the text of one step of some rows and a vector of cells."""
    kept = text.number(1.0 - scheme.step / float(text.template.tau[0])).replace("R(", "(vec)(")
    at = [f"{row * _layout(text, scheme).pitch} + p" for row in range(block)]
    lines = [
        f"vec s{row} = *(__global const vec *)(w + {place}) + {kept} * "
        f"*(__global const vec *)(x + {place});"
        for row, place in enumerate(at)
    ]
    shares = shares_products(taps(text.template.A, 0))
    lines += _gather(text, scheme, block) if shares else _scatter(text, scheme, block)
    for row, place in enumerate(at):
        new = f"shown(s{row}, one)"
        state = new if text.template.output.limited else f"s{row}"
        lines.append(f"*(__global vec *)(x + {place}) = {state};")
        lines.append(f"*(__global vec *)(to + {place}) = {new};")
    return lines


def _scatter(text: TransientText, scheme: FixedSteps, block: int) -> list[str]:
    """Return the text that adds every output, as it is loaded, to the sums that it is part of."""
    found = {(tap.row, tap.col): tap.weight for tap in taps(text.template.A, 0)}
    radius, lines = text.radius, list[str]()
    for row in range(-radius, block + radius):
        for col in range(-radius, radius + 1):
            adds = [
                f"s{to} += {_weight(text, scheme, found[row - to, col])} * v;"
                for to in range(block)
                if (row - to, col) in found
            ]
            if adds:
                lines.append(
                    f"{{ const vec v = {_load(text, scheme, row, col)}; {' '.join(adds)} }}"
                )
    return lines


def _gather(text: TransientText, scheme: FixedSteps, block: int) -> list[str]:
    """Return the text that loads all outputs, and adds those of equal weights before weighting."""
    found, radius = taps(text.template.A, 0), text.radius
    places = sorted({(to + tap.row, tap.col) for to in range(block) for tap in found})
    lines = [
        f"const vec v{row + radius}_{col + radius} = {_load(text, scheme, row, col)};"
        for row, col in places
    ]
    for to in range(block):

        def output(tap: Tap, to: int = to) -> str:
            return f"v{to + tap.row + radius}_{tap.col + radius}"

        terms = weighted_terms(found, lambda weight: _weight(text, scheme, weight), output)
        lines += [f"s{to} += {term};" for term in terms]
    return lines


def _load(text: TransientText, scheme: FixedSteps, row: int, col: int) -> str:
    layout = _layout(text, scheme)
    return f"*(__global const vec *)(from + {row * layout.pitch + col * layout.step} + p)"


def _weight(text: TransientText, scheme: FixedSteps, weight: float) -> str:
    return _scale(scheme, text, weight).replace("R(", "(vec)(")


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
