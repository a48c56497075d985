"""Sums over neighbourhoods of large arrays outside the steps, by rows that lie in lanes.

A work item takes a few rows: what their cells and those around them give is brought to lanes, so
that every vector of neighbours that is loaded is aligned, and goes no farther than the cache.
"""

from dataclasses import dataclass

from cnnum.boundary import Boundary
from cnnum.engines.opencl.strip_lanes import (
    OWN,
    lane_text,
    lanes_fit,
    rim_text,
    row_layout,
    size_of,
)
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.strip_rows import At, Rows
from cnnum.engines.opencl.text import fill, indented, owned
from cnnum.engines.opencl.transients import TransientText

NEAR_BYTES = 192 * 1024
"""What a work item keeps in lanes, where rows are short enough: it stays in the second cache."""

MOST_BYTES = 1024 * 1024
"""And at most: it lies on a thread's stack."""

LEAST_ROWS, MOST_ROWS = 4, 32
"""Rows of a work item; those above and below them are brought to lanes by others, too."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What cells see of their neighbours.

    Attributes
    ----------
    name : str
        The variable of the kernel.
    values : list of list of str
        Of each layer, or the only one: statements in cell `i` that set `now`.
    boundary : Boundary
    fixed : float or None
        What virtual cells of a fixed boundary hold.
    """

    name: str
    values: list[list[str]]
    boundary: Boundary
    fixed: float | None


def sums_by_lanes(text: TransientText, seen: int) -> bool:
    """Return whether lanes are for sums of so much that is seen: on processors, of large arrays."""
    # a kernel that is a whole plan would have the rows of all its sums on the stack
    if not (text.tables.by_vectors and text.tables.parted and lanes_fit(text)):
        return False
    return seen * _row_bytes(text) * (LEAST_ROWS + 2 * text.radius) <= MOST_BYTES


def near_size(text: TransientText, seen: int) -> tuple[int, int]:
    """Return the rows of a work item that sees so much, and the numbers of each thing seen."""
    room = NEAR_BYTES // (seen * _row_bytes(text)) - 2 * text.radius
    rows = min(MOST_ROWS, max(LEAST_ROWS, room))
    return rows, (rows + 2 * text.radius) * row_layout(text).pitch


def _row_bytes(text: TransientText) -> int:
    return row_layout(text).pitch * text.tables.dtype.itemsize


def sweep_sums(
    text: TransientText, seen: list[Seen], sums: list[list[str]], body: list[str]
) -> None:
    """Append a sweep over all cells that knows sums of what neighbours give.

    Parameters
    ----------
    text : TransientText
    seen : list of Seen
    sums : list of list of str
        Of each layer, statements that add to the sum of a vector of cells.
    body : list of str
        Statements in cell `i`, whose sum of a layer is `line{layer}[c]`. They change nothing that
        other cells see.
    """
    layout, cols = row_layout(text), text.shape[1]
    rows, size = near_size(text, len(seen))
    arrays = [f"scalar *const {one.name} = near + {n * size};" for n, one in enumerate(seen)]
    arrays += [f"scalar line{layer}[{cols}];" for layer in range(len(sums))]
    filled = fill(
        "lane_sweep",
        blocks=-(-text.shape[0] // rows),
        block=rows,
        rows=text.shape[0],
        cols=cols,
        radius=text.radius,
        size=len(seen) * size,
        arrays=indented(arrays, 1),
        seen="\n".join(_row_of(text, one) for one in seen),
        sums="\n".join(_sum_of(text, layout, layer, lines) for layer, lines in enumerate(sums)),
        body=indented(body, 3),
    )
    text.lines += filled.splitlines()


def _row_of(text: TransientText, one: Seen) -> str:
    """Return the text that brings a row, which may be a virtual one, to its lanes."""
    layout, last = row_layout(text, one.boundary), text.shape[0] - 1
    beyond = f"at_row < 0 || at_row > {last}"
    row, fixed = "at_row", ""
    if one.fixed is not None:
        fixed = f"if ({beyond}) {{ fill_row({one.name}, own, {text.number(one.fixed)}); }}"
        row = f"at_row < 0 ? 0 : at_row > {last} ? {last} : at_row"
    elif layout.boundary.pad_mode == "wrap":
        row = f"(at_row + {last + 1}) % {last + 1}"
    else:
        row = f"at_row < 0 ? -1 - at_row : at_row > {last} ? {2 * last + 1} - at_row : at_row"
    lines = [f"{{ const int row = {row};"]
    for layer, value in enumerate(one.values):
        to = f"{one.name} + ROW(own) + {layer * layout.span}"
        lines += _row_text(text, layout, value, to)
        lines.append(f"sides({one.name}, ROW(own) + {layer * layout.span});")
    return _private(text, layout, one.fixed, [*lines, fixed, "}"])


def _sum_of(text: TransientText, layout: RowLayout, layer: int, lines: list[str]) -> str:
    """Return the text that sums what the cells of the row `own` see."""
    filled = fill(
        "lane_sum",
        length=layout.vectors,
        width=layout.width,
        last=max(0, layout.vectors - layout.width),
        sum=At(layer, 0).sum,
        lines=indented(lines, 2),
        to=f"line{layer}",
    )
    return _private(text, layout, None, [filled])


def _row_text(text: TransientText, layout: RowLayout, value: list[str], to: str) -> list[str]:
    return fill(
        "lane_row",
        length=layout.vectors,
        width=layout.width,
        last=max(0, layout.vectors - layout.width),
        cols=text.shape[1],
        value=" ".join(value),
        to=to,
    ).splitlines()


def keep_rows(text: TransientText, seen: Seen) -> None:
    """Append the array of that name, and what brings all rows to their lanes in it, for strips."""
    layout = row_layout(text, seen.boundary)
    text.array(seen.name, size_of(text, layout))
    to = f"{seen.name} + ROW(row)"
    lines = [f"for (int r = 0; r < {text.shape[0]}; ++r) {{", "const int row = r;"]
    lines += _row_text(text, layout, seen.values[0], to)
    lines += [f"sides({seen.name}, ROW(row));", "}"]
    lines += [f"{side}({seen.name});" for side in ("upper", "lower")]
    suffix = _functions(text, layout, seen.fixed, "__global")
    text.lines += owned("\n".join(lines), OWN, suffix).splitlines()


def rows_near(text: TransientText, seen: int, inputs: dict[str, int]) -> Rows:
    """Return rows whose sums see what a sweep does; inputs have places among all of it."""
    _, size = near_size(text, seen)
    apart = {name: place * size for name, place in inputs.items()}
    return Rows(text, row_layout(text), (1.0,) * text.layers, apart, "near")


def _private(text: TransientText, layout: RowLayout, fixed: float | None, lines: list[str]) -> str:
    """Return text that works on a work item's own arrays, by functions of their own."""
    suffix = _functions(text, layout, fixed, "__private")
    own = owned("\n".join(lines), OWN, suffix).replace("__global const vec", "__private const vec")
    return indented(own.splitlines(), 2)


def _functions(text: TransientText, layout: RowLayout, fixed: float | None, space: str) -> str:
    """Keep the functions of rows in lanes with the tables, and return what their names end with."""
    source = lane_text(text, layout) + rim_text(text, layout, "", fixed)
    source = source.replace("__global", space)
    types, kind = text.tables.types, "rows in lanes"
    known = [key for key in types if key.startswith(kind)]
    key = f"{kind} {source}"
    suffix = f"lanes{known.index(key) if key in known else len(known)}"
    types.setdefault(key, owned(source, OWN, suffix))
    return suffix
