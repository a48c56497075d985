"""Inputs that the cells of large arrays go on reading, in lanes."""

from cnnum.engines.opencl.row_sums import Seen
from cnnum.engines.opencl.strip_lanes import OWN, lane_text, rim_text, row_layout, size_of
from cnnum.engines.opencl.text import fill, owned
from cnnum.engines.opencl.transients import TransientText


def keep_rows(text: TransientText, seen: Seen) -> None:
    """Append the array of that name, and what brings all rows to their lanes in it, for strips."""
    layout = row_layout(text, seen.boundary)
    text.array(seen.name, size_of(text, layout))
    to = f"{seen.name} + ROW(row)"
    lines = [f"for (int r = 0; r < {text.shape[0]}; ++r) {{", "const int row = r;"]
    lines += fill(
        "lane_row",
        length=layout.vectors,
        width=layout.width,
        last=max(0, layout.vectors - layout.width),
        cols=text.shape[1],
        value=" ".join(seen.values[0]),
        to=to,
    ).splitlines()
    lines += [f"sides({seen.name}, ROW(row));", "}"]
    lines += [f"{side}({seen.name});" for side in ("upper", "lower")]
    source = lane_text(text, layout) + rim_text(text, layout, "", seen.fixed)
    types, kind = text.tables.types, "rows in lanes"
    known = [key for key in types if key.startswith(kind)]
    key = f"{kind} {source}"
    suffix = f"lanes{known.index(key) if key in known else len(known)}"
    types.setdefault(key, owned(source, OWN, suffix))
    text.lines += owned("\n".join(lines), OWN, suffix).splitlines()
