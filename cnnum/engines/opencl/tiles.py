"""The kernel text of Euler's steps on large arrays: tiles in a cache, several steps a launch.

Rows of a tile are taken a few at a time, a vector of columns wide: an output that is loaded serves
all the cells of the block that it is a neighbour of.
"""

import math
from dataclasses import dataclass

import numpy as np

from cnnum.engines.opencl.drive import constant_drive
from cnnum.engines.opencl.text import fill, indented, rename
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import FixedSteps
from cnnum.network import taps

SPLIT = "// from here on in the kernel 'finish'"
"""Line at which a plan's kernel is parted: the steps are launches of their own."""

CACHE_BYTES = 384 * 1024
"""Of a tile's four arrays: they stay in the second-level cache of a core, which others use too."""

TILE_COLUMNS = 256
STEPS = 8
"""Steps a launch, at most: a tile's overlap grows with them, its traffic shrinks, which counts
where the array is larger than the caches."""

SMALL_CELLS = 256 * 256
"""Arrays up to this take twice as many: there a launch costs more than the overlap."""

WHOLE_CELLS = 128 * 128
"""Arrays up to this are one tile and one launch: a launch takes as long as 8 of their steps."""

BLOCK_ROWS = 4
PIECES = 2
VECTOR_BYTES = 64


@dataclass(frozen=True, slots=True)
class Tiling:
    """How a large array's steps are launched.

    Attributes
    ----------
    text : str
        The kernel `advance`.
    scratch : int
        Numbers a work item needs for its tile.
    tiles : int
        Tiles of a frame.
    source, target : int
        Where the states stand in a frame's numbers, and where they go; then the other way.
    steps : tuple of int
        Steps of each launch; an even number of launches, so that the states end at `source`
        (a single one where that is the target too).
    """

    text: str
    scratch: int
    tiles: int
    source: int
    target: int
    steps: tuple[int, ...]


def tiles_fit(text: TransientText, scheme: FixedSteps) -> bool:
    """Return whether steps of a scheme can be taken tile by tile."""
    template, radius = text.template, text.radius
    even = scheme.last == scheme.step and scheme.count > 0 and not scheme.settle
    simple = template.plain and text.layers == 1 and text.operands.mask is None
    known = template.output.name in ("standard", "linear", "full-range")
    return (
        scheme.tableau.stages == 1
        and even
        and simple
        and known
        and 0 < radius <= 3
        and text.tables.splits
        and not text.arena.private
        and text.tables.lanes == 1
    )


def tiled_euler(text: TransientText, scheme: FixedSteps) -> None:
    """Append the place where the steps go, and keep their kernel with the tables."""
    text.array("x2", text.cells)
    text.lines.append(SPLIT)
    text.tables.tiling = _tiling(text, scheme)


def _tiling(text: TransientText, scheme: FixedSteps) -> Tiling:
    (rows, cols), radius = text.shape, text.radius
    size = text.tables.dtype.itemsize
    width = VECTOR_BYTES // size
    periodic = text.template.boundary.pad_mode == "wrap"
    whole = text.cells <= WHOLE_CELLS and not periodic
    longest = STEPS if text.cells > SMALL_CELLS else 2 * STEPS
    most = min(longest, (width - radius) // radius)
    steps = (scheme.count,) if whole else _launches(scheme.count, most)
    reach = 0 if whole else max(steps) * radius
    widest = -(-cols // width) * width
    tile_cols = widest if whole else min(TILE_COLUMNS, widest)
    pitch = tile_cols + 3 * width
    halo = reach + radius
    held = CACHE_BYTES // (4 * size * pitch)
    # two pieces at least, so that more than one core has something to do
    tile_rows = max(8, min(-(-rows // PIECES), held - 2 * halo - BLOCK_ROWS))
    tile_rows = rows if whole else tile_rows
    area = (tile_rows + 2 * halo + BLOCK_ROWS) * pitch
    slack = pitch
    across = -(-cols // tile_cols)
    tiles = across * -(-rows // tile_rows)
    names: dict[str, object] = {
        "width": width,
        "bytes": size,
        "shown": _shown(text),
        "rims": indented(_rims(text, pitch), 1),
        "tile_size": 4 * area + 2 * slack,
        "slack": slack,
        "area": area,
        "tiles": tiles,
        "across": across,
        "frame_size": "FRAME_SIZE",
        "tile_rows": tile_rows,
        "tile_cols": tile_cols,
        "rows": rows,
        "cols": cols,
        "radius": radius,
        "periodic": int(periodic),
        "halo": halo,
        "pitch": pitch,
        "margin": width,
        "wrap_row": f"(r + {rows}) % {rows}" if periodic else "r",
        "wrap_col": f"(c + {cols}) % {cols}" if periodic else "c",
        # whole vectors run over a tile's end, where nothing is; around a torus they can not
        "stride": 1 if periodic else width,
        "group": "scalar" if periodic else "vec",
        "drive": _drive(text, scheme, "scalar" if periodic else "vec"),
        "first": _first(text) if periodic else "shown(value)",
        "block": BLOCK_ROWS,
        "step": indented(_step(text, scheme, pitch), 5),
    }
    places = text.arena.places
    source = fill("tiles", **names)
    target = places["x" if whole else "x2"]
    return Tiling(source, 4 * area + 2 * slack, tiles, places["x"], target, steps)


def _launches(count: int, most: int) -> tuple[int, ...]:
    """Return the steps of each launch, an even number of launches."""
    launches = math.ceil(count / max(1, most))
    launches += launches % 2
    return tuple(count * (n + 1) // launches - count * n // launches for n in range(launches))


def _scale(scheme: FixedSteps, text: TransientText, factor: float = 1.0) -> str:
    return text.number(factor * scheme.step / float(text.template.tau[0]))


def _drive(text: TransientText, scheme: FixedSteps, group: str) -> str:
    constant = constant_drive(text)
    if constant is not None:
        return _scale(scheme, text, constant[0]).replace("R(", f"({group})(")
    given = f"*(__global const {group} *)(mine + {text.arena.places['w']} + cell)"
    return f"{_scale(scheme, text)} * {given}".replace("R(", f"({group})(")


def _first(text: TransientText) -> str:
    return rename(text.template.output.opencl, {"x": "value"})


def _shown(text: TransientText) -> str:
    """Return f of a vector of states."""
    if text.template.output.name == "linear":
        return "x"
    return "x < (vec)(-1) ? (vec)(-1) : ((vec)(1) < x ? (vec)(1) : x)"


def _step(text: TransientText, scheme: FixedSteps, pitch: int) -> list[str]:
    """Return the text of one step of a block of rows and a vector of columns."""
    kept = text.number(1.0 - scheme.step / float(text.template.tau[0])).replace("R(", "(vec)(")
    at = [f"{row * pitch} + p" for row in range(BLOCK_ROWS)]
    lines = [
        f"vec s{row} = *(__global const vec *)(w + {place}) + {kept} * "
        f"*(__global const vec *)(x + {place});"
        for row, place in enumerate(at)
    ]
    found = {(tap.row, tap.col): tap.weight for tap in taps(text.template.A, 0)}
    radius = text.radius
    for row in range(-radius, BLOCK_ROWS + radius):
        for col in range(-radius, radius + 1):
            adds = [
                f"s{to} += {_weight(text, scheme, found[row - to, col])} * v;"
                for to in range(BLOCK_ROWS)
                if (row - to, col) in found
            ]
            if adds:
                place = f"{row * pitch + col} + p"
                load = f"const vec v = *(__global const vec *)(from + {place});"
                lines.append(f"{{ {load} {' '.join(adds)} }}")
    for row, place in enumerate(at):
        new = f"shown(s{row})"
        state = new if text.template.output.limited else f"s{row}"
        lines.append(f"*(__global vec *)(x + {place}) = {state};")
        lines.append(f"*(__global vec *)(to + {place}) = {new};")
    return lines


def _weight(text: TransientText, scheme: FixedSteps, weight: float) -> str:
    return _scale(scheme, text, weight).replace("R(", "(vec)(")


def _rims(text: TransientText, pitch: int) -> list[str]:
    """Return the text that fills virtual cells where a tile ends at the array's edge."""
    boundary, radius = text.template.boundary, text.radius
    if boundary.pad_mode == "wrap":
        return []
    lines = ["for (int r = low; r < high; ++r) {"]
    for n in range(radius):
        # the mirror lies between cells: the n-th cell beyond repeats the n-th within
        lines += [
            f"    if (left >= 0) y[r * {pitch} + left - {n + 1}] = "
            f"{_virtual(text, f'y[r * {pitch} + left + {n}]')};",
            f"    if (right >= 0) y[r * {pitch} + right + {n}] = "
            f"{_virtual(text, f'y[r * {pitch} + right - {n + 1}]')};",
        ]
    lines += ["}", f"for (int c = 0; c < {pitch}; ++c) {{"]
    for n in range(radius):
        lines += [
            f"    if (top >= 0) y[(top - {n + 1}) * {pitch} + c] = "
            f"{_virtual(text, f'y[(top + {n}) * {pitch} + c]')};",
            f"    if (bottom >= 0) y[(bottom + {n}) * {pitch} + c] = "
            f"{_virtual(text, f'y[(bottom - {n + 1}) * {pitch} + c]')};",
        ]
    return [*lines, "}"]


def _virtual(text: TransientText, mirrored: str) -> str:
    constant = text.template.boundary.constant
    if constant is None:
        return mirrored
    return text.number(float(text.template.output.numpy(np.asarray(constant))))
