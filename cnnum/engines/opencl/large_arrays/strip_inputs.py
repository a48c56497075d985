"""Inputs that the cells of large arrays go on reading, in lanes."""

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_rows import (
    OWN,
    lane_text,
    rim_text,
    row_layout,
    size_of,
)
from cnnum.engines.opencl.large_arrays.strip_couplings import inputs_of
from cnnum.engines.opencl.text import filled, owned
from cnnum.engines.opencl.transients.builder import NOW, ROW, TransientBuilder


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
