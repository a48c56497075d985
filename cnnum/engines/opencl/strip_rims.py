"""The kernel text of virtual cells around strips, and of what is padded by them beside outputs."""

from collections.abc import Mapping

import numpy as np

from cnnum.engines.opencl.drive import has_history
from cnnum.engines.opencl.rates import pads_states
from cnnum.engines.opencl.strip_couplings import STATES, inputs_of
from cnnum.engines.opencl.strip_lanes import rim_text
from cnnum.engines.opencl.strip_layout import RowLayout
from cnnum.engines.opencl.strip_rows import NEW_STATES
from cnnum.engines.opencl.text import indented
from cnnum.engines.opencl.transients import TransientText

OUTPUTS = ("strip_even", "strip_odd")
"""Arrays of outputs after an even and an odd number of levels."""

SEEN = ("strip_states_even", "strip_states_odd")
"""The same of states, where couplings read those of neighbours."""

LATER = "strip_later"
"""The array of what drives the cells once a delay is over."""

_SUFFIX = "_of_states"


def padded_arrays(text: TransientText) -> tuple[str, ...]:
    """Return the arrays that couplings want beside outputs."""
    seen = SEEN if pads_states(text) else ()
    later = (LATER,) if has_history(text) else ()
    return (*seen, *later, *(inputs_of(n) for n in _inputs_read(text)))


def _inputs_read(text: TransientText) -> list[int]:
    """Return the inputs that the cells go on reading."""
    moving = [coupling for coupling in text.template.nonlinear if not coupling.static]
    found = {coupling.source for coupling in moving if coupling.neighbour == "u"}
    return sorted(found | {c.centre_source for c in moving if c.centre == "u"})


def by_turns(apart: Mapping[str, int], names: tuple[str, str]) -> str:
    """Return the expression of one of two arrays after `level` levels."""
    even, odd = (apart[name] for name in names)
    return f"x + (level & 1 ? {odd} : {even})"


def reads(text: TransientText, driven: str) -> list[str]:
    """Return the declarations of what a level reads and writes, beside outputs."""
    lines = [f"__global const scalar *const driven = {driven};"]
    if pads_states(text):
        lines += [
            f"__global const scalar *const {STATES} = states_of(x, number);",
            f"__global scalar *const {NEW_STATES} = states_of(x, number + 1);",
        ]
    return lines


def first_states(text: TransientText) -> list[str]:
    """Return the text that sets, for a row, the states that couplings read first."""
    return ["copy_lanes(states_of(x, 0) + p, x + p);"] if pads_states(text) else []


def rim_texts(text: TransientText, layout: RowLayout, apart: Mapping[str, int]) -> dict[str, str]:
    """Return the kernel text's names that say what is done about virtual cells."""
    seen, fixed = pads_states(text), text.template.boundary.constant
    shown = None if fixed is None else float(text.template.output.numpy(np.asarray(fixed)))
    rims = rim_text(text, layout, "", shown)
    if seen:
        rims += rim_text(text, layout, _SUFFIX, fixed)

    def of_states(line: str) -> str:
        return line if seen else ""

    start = f"all_sides{_SUFFIX}({NEW_STATES}, start"
    return {
        "rims": rims,
        "states_of": by_turns(apart, SEEN) if seen else "x",
        "sides_states": of_states(f"{start});"),
        "sides_states_of_block": of_states(f"{start} + r * {layout.pitch});"),
        "sides_states_at_first": of_states(f"all_sides{_SUFFIX}(states_of(x, 0), ROW(r));"),
        "upper_states": of_states(f"upper{_SUFFIX}(states_of(x, level));"),
        "lower_states": of_states(f"lower{_SUFFIX}(states_of(x, level));"),
        "inputs": indented(_inputs(text, layout, apart), 2),
    }


def _inputs(text: TransientText, layout: RowLayout, apart: Mapping[str, int]) -> list[str]:
    """Return the text that brings a strip's rows of inputs, and those beyond, to their lanes."""
    found, radius = _inputs_read(text), text.radius
    if not found:
        return []
    at = f"(r + {radius}) * {text.pitch}"
    return [
        f"const int high = begin == 0 ? -{radius} : begin;",
        f"const int low = end == {text.shape[0]} ? end + {radius} : end;",
        "for (int r = high; phase == 0 && r < low; ++r) {",
        *(
            f"    padded_to_lanes(x + {apart[inputs_of(n)]} + ROW(r) - {layout.head}, "
            f"mine + {text.arena.places['u'] + n * text.padded} + {at});"
            for n in found
        ),
        "}",
    ]
