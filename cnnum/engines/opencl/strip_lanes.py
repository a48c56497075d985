"""How a transient's rows lie in lanes, and the kernel text that brings them there and back."""

from cnnum.boundary import Boundary
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText

BLOCK_ROWS = 4
"""Rows that are taken at once; virtual rows are set with the first and the last of them."""

OWN = (
    "vec", "ROW", "between", "turned", "part_of", "keep_lanes", "keep_cells", "to_lanes",
    "from_lanes", "fill_lanes", "copy_lanes", "copy_row", "fill_row",
    "sides", "all_sides", "upper", "lower",
)  # fmt: skip
"""Names that the text has to itself: a plan may have several."""


def lanes_fit(text: TransientText) -> bool:
    """Return whether an array is large enough for rows in lanes."""
    radius = text.radius
    enough = 0 < radius <= BLOCK_ROWS and min(text.shape) >= 4 * radius
    return enough and not text.arena.private


def row_layout(text: TransientText, boundary: Boundary | None = None) -> RowLayout:
    """Return how rows lie that end at a boundary: that of the states if no other is given."""
    ends = boundary or text.template.boundary
    return RowLayout(text.shape[1], text.radius, text.tables.width, ends, text.layers)


def size_of(text: TransientText, layout: RowLayout) -> int:
    """Return the numbers of an array that holds all rows."""
    return (text.shape[0] + 2 * text.radius) * layout.pitch


def lane_text(text: TransientText, layout: RowLayout) -> str:
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


def rim_text(text: TransientText, layout: RowLayout, suffix: str, fixed: float | None) -> str:
    """Return the functions that set virtual cells; those of a fixed boundary hold a number."""
    constant = None if fixed is None else text.number(fixed)
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
    lines, wraps = list[str](), layout.boundary.pad_mode == "wrap"
    for n in range(layout.radius):
        to, near, far = (-1 - n, n, rows - 1 - n) if side < 0 else (rows + n, rows - 1 - n, n)
        if constant is None:
            lines.append(f"copy_row(y, {to}, {far if wraps else near});")
        else:
            lines.append(f"fill_row(y, {to}, {constant});")
    return lines
