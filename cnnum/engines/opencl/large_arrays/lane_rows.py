"""How a transient's rows lie in lanes, and the kernel text that brings them there and back."""

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.text import fill, filled, indented, owned
from cnnum.engines.opencl.transients.builder import NOW, ROW, TransientBuilder
from cnnum.templating.boundary import Boundary

BLOCK_ROWS = 4
"""Rows that are taken at once."""

OWN = (
    "vec", "ROW", "between", "turned", "part_of", "keep_lanes", "keep_cells", "to_lanes",
    "from_lanes", "fill_lanes", "copy_lanes", "copy_row", "fill_row",
    "sides", "all_sides", "upper", "lower",
)  # fmt: skip
"""Names that the text has to itself: a plan may have several."""


def lanes_fit(text: TransientBuilder) -> bool:
    """Return whether rows in lanes are for an array: for large ones whose cells have neighbours."""
    return text.radius > 0 and not text.arena.private


def row_layout(text: TransientBuilder, boundary: Boundary | None = None) -> RowLayout:
    """Return how rows lie that end at a boundary: that of the states if no other is given."""
    ends = boundary or text.template.boundary
    return RowLayout(text.shape[1], text.radius, text.tables.width, ends, text.layers)


def size_of(text: TransientBuilder, layout: RowLayout) -> int:
    """Return the numbers of an array that holds all rows."""
    return (text.shape[0] + 2 * text.radius) * layout.pitch


def lane_text(text: TransientBuilder, layout: RowLayout) -> str:
    """Return the types and functions of rows in lanes."""
    return fill(
        "lanes",
        width=layout.width,
        bytes=text.tables.dtype.itemsize,
        radius=text.radius,
        pitch=layout.pitch,
        head=layout.head,
        length=layout.vectors,
        last=max(0, layout.vectors - layout.width),
        cols=text.shape[1],
        turned=indented(layout.turned(), 1),
    )


def rim_text(text: TransientBuilder, layout: RowLayout, suffix: str, fixed: float | None) -> str:
    """Return the functions that set virtual cells; those of a fixed boundary hold a number."""
    constant = None if fixed is None else text.literal(fixed)
    return fill(
        "strip_rims",
        suffix=suffix,
        layers=layout.layers,
        span=layout.span,
        sides=indented(layout.sides(constant), 1),
        upper=indented(_rows_beyond(text.shape[0], layout, -1, constant), 1),
        lower=indented(_rows_beyond(text.shape[0], layout, 1, constant), 1),
    )


def _rows_beyond(rows: int, layout: RowLayout, side: int, constant: str | None) -> list[str]:
    """Return the text that sets the virtual rows above (-1) or below (1) the array."""
    beyond = range(-layout.radius, 0) if side < 0 else range(rows, rows + layout.radius)
    if constant is not None:
        return [f"fill_row(y, {row}, {constant});" for row in beyond]
    source = np.pad(np.arange(rows), layout.radius, mode=layout.boundary.pad_mode)
    return [f"copy_row(y, {row}, {source[row + layout.radius]});" for row in beyond]


def inputs_of(source: int) -> str:
    """Return the name of the array that holds an input in lanes."""
    return f"lane_u{source}"


def keep_rows(text: TransientBuilder, number: int) -> None:
    """Append the array of an input, and the sweep of its rows to their lanes, for strips."""
    boundary = text.template.input_boundary
    layout, array = row_layout(text, boundary), ir.Name(inputs_of(number))
    text.array(array, size_of(text, layout))
    source = lane_text(text, layout) + rim_text(text, layout, "", boundary.constant)
    types, kind = text.tables.types, "rows in lanes"
    known = [key for key in types if key.startswith(kind)]
    key = f"{kind} {source}"
    suffix = f"_lanes{known.index(key) if key in known else len(known)}"
    types.setdefault(key, owned(source, OWN, suffix[1:]))
    row = filled(
        "lane_row",
        length=layout.vectors,
        width=layout.width,
        last=max(0, layout.vectors - layout.width),
        cols=text.shape[1],
        value=[ir.Assign(NOW, text.operands.inputs[number])],
        to=array,
        place=f"ROW{suffix}(row)",
        vec=f"vec{suffix}",
        keep_lanes=f"keep_lanes{suffix}",
    )
    sides = ir.Verbatim((f"sides{suffix}(", array, f", ROW{suffix}(row));"))
    each = (ir.Verbatim(("const int row = r;",)), row, sides)
    text.body.append(ir.Sweep(ROW, text.shape[0], each))
    text.body += [ir.Verbatim((f"{side}{suffix}(", array, ");")) for side in ("upper", "lower")]
