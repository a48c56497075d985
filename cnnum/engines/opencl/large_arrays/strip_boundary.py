"""The kernel text of virtual cells around strips, and of padded arrays but outputs."""

from collections.abc import Mapping

import numpy as np

from cnnum.engines.opencl.large_arrays.lane_layout import RowLayout
from cnnum.engines.opencl.large_arrays.lane_rows import rim_text
from cnnum.engines.opencl.large_arrays.strip_couplings import STATES
from cnnum.engines.opencl.large_arrays.strip_rows import NEW_STATES
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.templating.reads import reads_states

OUTPUTS = ("strip_even", "strip_odd")
"""Arrays of outputs after an even and an odd number of levels."""

SEEN = ("strip_states_even", "strip_states_odd")
"""The same of states, where couplings read those of neighbours."""

LATER = "strip_later"
"""The array of the cells' drive once a delay is over."""

_SUFFIX = "_of_states"


def padded_arrays(text: TransientBuilder) -> tuple[str, ...]:
    """Return the arrays that couplings want apart from outputs."""
    seen = SEEN if reads_states(text.template) else ()
    later = (LATER,) if text.has_history else ()
    return (*seen, *later)


def by_turns(offsets: Mapping[str, int | str], names: tuple[str, str]) -> str:
    """Return the expression of one of two arrays after `level` levels."""
    even, odd = (offsets[name] for name in names)
    return f"x + (level & 1 ? {odd} : {even})"


def reads(text: TransientBuilder, driven: str) -> list[str]:
    """Return the declarations of the arrays of a level, apart from outputs."""
    lines = [f"__global const scalar *const driven = {driven};"]
    if reads_states(text.template):
        lines += [
            f"__global const scalar *const {STATES.text} = states_of(x, number);",
            f"__global scalar *const {NEW_STATES} = states_of(x, number + 1);",
        ]
    return lines


def first_states(text: TransientBuilder) -> list[str]:
    """Return the text that sets, for a row, the states that couplings read first."""
    return ["copy_lanes(states_of(x, 0) + p, x + p);"] if reads_states(text.template) else []


def rim_texts(
    text: TransientBuilder, layout: RowLayout, offsets: Mapping[str, int | str]
) -> dict[str, str]:
    """Return the kernel text's names that set the treatment of virtual cells."""
    seen, fixed = reads_states(text.template), text.template.boundary.constant
    shown = None if fixed is None else float(text.template.output.numpy(np.asarray(fixed)))
    rims = rim_text(text, layout, "", shown)
    if seen:
        rims += rim_text(text, layout, _SUFFIX, fixed)

    def of_states(line: str) -> str:
        return line if seen else ""

    start = f"all_sides{_SUFFIX}({NEW_STATES}, start"
    return {
        "rims": rims,
        "states_of": by_turns(offsets, SEEN) if seen else "x",
        "sides_states": of_states(f"{start});"),
        "sides_states_of_block": of_states(f"{start} + r * {layout.pitch});"),
        "sides_states_at_first": of_states(f"all_sides{_SUFFIX}(states_of(x, 0), ROW(r));"),
        "upper_states": of_states(f"upper{_SUFFIX}(states_of(x, level));"),
        "lower_states": of_states(f"lower{_SUFFIX}(states_of(x, level));"),
    }
