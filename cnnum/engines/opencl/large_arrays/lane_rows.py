"""How a transient's rows lie in lanes, and the kernel text that brings them there and back."""

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.text import fill, filled, indented, owned
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.names import NOW
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
    return RowLayout(*text.shape, text.radius, text.tables.width, ends, text.layers)


def lane_text(text: TransientBuilder, layout: RowLayout) -> str:
    """Return the types and functions of rows in lanes."""
    return fill("lanes", **layout.numbers("lanes"), bytes=text.tables.dtype.itemsize)


def rim_text(text: TransientBuilder, layout: RowLayout, suffix: str, fixed: float | None) -> str:
    """Return the functions that set virtual cells; those of a fixed boundary hold a number."""
    rows, constant = layout.rows, None if fixed is None else text.literal(fixed)
    return fill(
        "strip_rims",
        **layout.numbers("strip_rims"),
        suffix=suffix,
        sides=indented(layout.sides(constant), 1),
        upper=indented(layout.beyond(range(-text.radius, 0), constant), 1),
        lower=indented(layout.beyond(range(rows, rows + text.radius), constant), 1),
    )


def inputs_of(source: int) -> str:
    """Return the name of the array that holds an input in lanes."""
    return f"lane_u{source}"


def keep_rows(text: TransientBuilder, number: int) -> None:
    """Append the array of an input, and the sweep of its rows to their lanes, for strips."""
    boundary = text.template.input_boundary
    layout, array = row_layout(text, boundary), ir.Name(inputs_of(number))
    text.array(array, layout.size)
    source = lane_text(text, layout) + rim_text(text, layout, "", boundary.constant)
    types, kind = text.tables.types, "rows in lanes"
    key = f"{kind} {source}"
    types.setdefault(key, "")
    suffix = f"_lanes{[each for each in types if each.startswith(kind)].index(key)}"
    types[key] = owned(source, OWN, suffix[1:])
    row = filled(
        "lane_row",
        **layout.numbers("lane_row"),
        value=[ir.Assign(NOW, text.operands.inputs[number])],
        to=array,
        suffix=suffix,
    )
    text.body.append(ir.Sweep(ir.ROW, text.shape[0], (row,)))
    text.body += [ir.Verbatim((f"{side}{suffix}(", array, ");")) for side in ("upper", "lower")]
