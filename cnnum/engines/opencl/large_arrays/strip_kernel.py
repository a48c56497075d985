"""The kernel that steps a large array: strips of rows, several stages per launch."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import (
    OWN,
    RowLayout,
    lane_text,
    rim_text,
)
from cnnum.engines.opencl.large_arrays.strip_rows import (
    DRIVE,
    NEW_STATES,
    OUTPUTS,
    SEEN,
    STATES,
    Rows,
)
from cnnum.engines.opencl.text import WIDE_BYTES, fill, indented, owned
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.couplings import constant_drive
from cnnum.kernels.launch_plan import Strips
from cnnum.templating.network import reads_states

_CLIPPED = "(x = -one > x ? -one : x, one < x ? one : x)"

SHOWN = {
    "standard": _CLIPPED,
    "linear": "x",
    "tanh": "tanh(x)",
    "full-range": _CLIPPED,
    "sign": "one - one <= x ? one : -one",
}
"""Outputs of a vector of states `x`, by name; `one` is 1 in every lane."""

_OF_STATES = "_of_states"
"""The suffix of functions that set virtual cells of states."""

_OWN = (
    *OWN,
    "shown", "hidden_one", "show_row", "inwards", "magnitude", "greatest", "outputs_of",
    "states_of", "sides_of_states", "all_sides_of_states", "upper_of_states", "lower_of_states",
    "rims_at_ends", "rims_above", "rims_below", "finding", "one_row", "more_rows", "take_level",
    "strip",
)  # fmt: skip
"""Names to make unique, since a plan may contain several such kernels."""


@dataclass(frozen=True, slots=True)
class StripText:
    """The parts of a kernel that depend on the scheme.

    Attributes
    ----------
    case : str
        Expression that selects the case for level `number`.
    cases : callable
        All cases of rows.
    rest : list of str
        Code that sets further values of a row along with its states.
    findings : int
        Number of results per strip.
    outputs : str
        The expression of the outputs after `level` levels.
    again : list of str
        Code that resets a row to the start of the levels, if any.
    end : str
        Offset of the final states from the initial ones.
    count : str
        Levels that a frame takes of at most `most` after those that are `done`.
    ahead : str
        The expression of the levels before those that a launch counts.
    driven : str
        That of the cells' drive at the level `number`.
    """

    case: str
    cases: Callable[[Rows], list[ir.Case]]
    rest: Sequence[str] = ()
    findings: int = 0
    outputs: str | None = None
    again: Sequence[str] = ()
    end: str = "0"
    count: str = "most"
    ahead: str = "0"
    driven: str = "w"


def strip_kernel(rows: Rows, own: StripText, count: int) -> Strips:
    """Return the kernel that takes `count` levels, and add it to the tables."""
    text, layout, places = rows.text, rows.layout, rows.text.arena.places
    periodic = text.template.boundary.pad_mode == "wrap"
    name = f"advance_{len(text.tables.strips)}"
    names: dict[str, str | int] = {
        **layout.numbers("strips"),
        **rows.numbers(),
        **_virtual_cells(rows),
        **{name: getattr(own, name) for name in ("case", "count", "ahead", "end", "findings")},
        "kernel": name,
        "lanes": lane_text(text, layout),
        "block": rows.high,
        "periodic": int(periodic),
        "x": places[next(iter(rows.offsets))],
        "w": places[DRIVE],
        "outputs_of": own.outputs or rows.by_turns(OUTPUTS),
        "state": places["x"],
        "shown": _shown(text, layout),
        "drive": _drive(rows),
        "rest": indented([*own.rest, *rows.set_held(), *first_states(text)], 5).lstrip(),
        "again": indented(own.again, 5).lstrip(),
        "reads": indented(_reads(text, own.driven), 1),
        "one_row": indented(rows.lines(own.cases(replace(rows, high=1))), 1),
        "more_rows": indented(rows.lines(own.cases(rows)), 1),
    }
    source = owned(fill("strips", **names), _OWN, name)
    text.tables.strips.append(source)
    return Strips(name, source, count, rows.levels, rows.strips, not periodic)


def apart(strips: Strips) -> tuple[ir.StripSteps, Strips, ir.StripSteps]:
    """Return the copy into strips, the levels alone, and the copy out of strips."""
    return (
        ir.StripSteps(replace(strips, count=0, ends=False)),
        replace(strips, begins=False, ends=False),
        ir.StripSteps(replace(strips, count=0, begins=False)),
    )


def first_states(text: TransientBuilder) -> list[str]:
    """Return the code that initialises a row of the states that couplings read."""
    return ["copy_lanes(states_of(x, 0) + p, x + p);"] if reads_states(text.template) else []


def _shown(text: TransientBuilder, layout: RowLayout) -> str:
    """Return the outputs of a vector of states; built-ins of wide vectors are split in halves."""
    name = text.template.output.name
    wide = layout.width * text.tables.dtype.itemsize >= WIDE_BYTES
    return "(vec)(tanh(x.lo), tanh(x.hi))" if wide and name == "tanh" else SHOWN[name]


def _drive(rows: Rows) -> str:
    """Return the statement that sets the scaled w of a row of a layer."""
    constant = constant_drive(rows.text)
    if constant is None:
        return rows.brought(DRIVE, "w", rows.of_layer(rows.scales))
    scaled = [scale * n for scale, n in zip(rows.scales, constant, strict=True)]
    return f"fill_lanes(w + p, {rows.of_layer(scaled)});"


def _reads(text: TransientBuilder, driven: str) -> list[str]:
    """Return the declarations of the arrays of a level, apart from outputs."""
    lines = [f"__global const scalar *const driven = {driven};"]
    if reads_states(text.template):
        lines += [
            f"__global const scalar *const {STATES.text} = states_of(x, number);",
            f"__global scalar *const {NEW_STATES} = states_of(x, number + 1);",
        ]
    return lines


def _virtual_cells(rows: Rows) -> dict[str, str]:
    """Return the kernel text's names that set the treatment of virtual cells."""
    text, layout = rows.text, rows.layout
    seen, fixed = reads_states(text.template), text.template.boundary.constant
    rims = rim_text(text, layout, "", None if fixed is None else text.rim_output())
    padded = {"": "to"}
    if seen:
        rims += rim_text(text, layout, _OF_STATES, fixed)
        padded[_OF_STATES] = "states_of(x, level)"
    calls = {
        "at_ends": [f"all_sides{suffix}({array}, start);" for suffix, array in padded.items()],
        "above": [f"upper{suffix}({array});" for suffix, array in padded.items()],
        "below": [f"lower{suffix}({array});" for suffix, array in padded.items()],
    }
    return {
        "rims": rims,
        "states_of": rows.by_turns(SEEN) if seen else "x",
        **{name: indented(lines, 1).lstrip() for name, lines in calls.items()},
    }
