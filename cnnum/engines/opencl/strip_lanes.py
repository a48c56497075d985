"""How a transient's rows lie in lanes, and the kernel text that brings them there and back."""

import numpy as np

from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText
from cnnum.templating.boundary import Boundary

BLOCK_ROWS = 4
"""Rows that are taken at once."""

OWN = (
    "vec", "ROW", "between", "turned", "part_of", "keep_lanes", "keep_cells", "to_lanes",
    "from_lanes", "fill_lanes", "copy_lanes", "copy_row", "fill_row",
    "sides", "all_sides", "upper", "lower",
)  # fmt: skip
"""Names that the text has to itself: a plan may have several."""


def lanes_fit(text: TransientText) -> bool:
    """Return whether rows in lanes are for an array: for large ones whose cells have neighbours."""
    return text.radius > 0 and not text.arena.private


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
    beyond = range(-layout.radius, 0) if side < 0 else range(rows, rows + layout.radius)
    if constant is not None:
        return [f"fill_row(y, {row}, {constant});" for row in beyond]
    source = np.pad(np.arange(rows), layout.radius, mode=layout.boundary.pad_mode)
    return [f"copy_row(y, {row}, {source[row + layout.radius]});" for row in beyond]
