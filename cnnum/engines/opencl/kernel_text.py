"""From a schedule to the text of one kernel that runs all of it."""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.engines.backend import Solvers
from cnnum.engines.opencl.lowering import Lowering
from cnnum.engines.opencl.storage import PRIVATE_CELLS, Arena, Tables, Values
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.tiles import SPLIT, Tiling
from cnnum.graph.nodes import Constant, Input, Node, Pick, Transient
from cnnum.graph.schedule import Schedule

_DECLARES = re.compile(r"\s*(\{|real \w+;|__global real \*const \w+ = .*;)$")
"""Lines before the steps that stand before what comes after them too."""

WIDE_BYTES = 64
"""Vectors from this size on have no built-ins that every compiler can handle."""


@dataclass(frozen=True, slots=True, eq=False)
class KernelText:
    """A plan's kernel and what its buffers hold.

    Attributes
    ----------
    source : str
    data : (n,) float
        Constant numbers.
    output_size, memory_size : int
        Numbers a frame.
    outputs : dict of str to int
        Where each output starts within a frame's numbers; the last number is `unfinished`.
    scratch : int
        Values of global scratch a work item needs (0: everything is private).
    private : int
        Values in private arrays of a work item at the most (0: they are in scratch).
    tiling : Tiling or None
        Launches of their own that take the steps of a large array.
    """

    source: str
    data: NDArray[np.floating]
    output_size: int
    memory_size: int
    outputs: dict[str, int]
    scratch: int
    private: int
    tiling: Tiling | None = None


def lower(
    schedule: Schedule, solvers: Solvers, lanes: int, dtype: np.dtype[np.floating]
) -> KernelText:
    """Return the kernel text of a schedule for `lanes` frames side by side."""
    tables = Tables(dtype, lanes, splits=_one_transient(schedule))
    arena = Arena(private=schedule.cells <= PRIVATE_CELLS)
    lowering = Lowering(schedule, solvers, tables, arena, Values(tables))
    lowering.lower()
    outputs, writes = _write_outputs(lowering)
    arena.keep_all()
    slots = [arena.array(f"s{k}", schedule.cells) for k in range(lowering.values.slots)]
    if not arena.private:
        slots.insert(0, f"__global real *const mine = scratch + get_global_id(0) * {arena.size};")
    size = sum(_numbers(node, schedule) for node in schedule.outputs.values()) + 1
    body = indented([*slots, *lowering.body, *writes], 1)
    source = _prelude(lanes, dtype) + "\n" + _kernels(tables, arena, body)
    return KernelText(
        source,
        tables.buffer(),
        size,
        lowering.memory_size,
        outputs,
        0 if arena.private else arena.size,
        arena.size if arena.private else 0,
        tables.tiling,
    )


def _one_transient(schedule: Schedule) -> bool:
    """Return whether nothing runs but one template, so that its kernel can be parted."""
    parts = [n.operation for n in schedule.nodes]
    alone = all(isinstance(part, Input | Transient | Pick | Constant) for part in parts)
    return alone and len(schedule.transients) == 1


def _kernels(tables: Tables, arena: Arena, body: str) -> str:
    """Return the plan's kernel; or, parted, what comes before the steps, the steps, and the rest.

    The part after the steps begins with the declarations of the part before.
    """
    text = tables.text
    if tables.tiling is None:
        return fill("plan", kernel="plan", tables=text, body=body)
    lines = body.splitlines()
    at = next(n for n, line in enumerate(lines) if line.strip() == SPLIT)
    declared = [line for line in lines[:at] if _DECLARES.match(line)]
    before = "\n".join([*lines[:at], "    }"])
    after = "\n".join([*declared, *lines[at + 1 :]])
    return "\n".join(
        [
            fill("plan", kernel="plan", tables=text, body=before),
            f"#define FRAME_SIZE {arena.size}\n{tables.tiling.text}",
            fill("plan", kernel="finish", tables="", body=after),
        ]
    )


def _numbers(node: Node, schedule: Schedule) -> int:
    return 1 if node.scalar else schedule.cells


def _write_outputs(lowering: Lowering) -> tuple[dict[str, int], list[str]]:
    schedule, values = lowering.schedule, lowering.values
    size = sum(_numbers(node, schedule) for node in schedule.outputs.values()) + 1
    places: dict[str, int] = {}
    lines: list[str] = []
    at = 0
    for name, node in schedule.outputs.items():
        places[name] = at
        lines.append(_scatter(node, "output", at, size, values.read(node), schedule.cells))
        at += _numbers(node, schedule)
    lines.append(f"scatter(output + {at}, frame, last, {size}, unfinished);")
    for number, memory in schedule.memories.items():
        text = values.read(memory.store)
        where, stride = lowering.memory_at[number], lowering.memory_size
        lines.append(_scatter(memory.store, "memory", where, stride, text, schedule.cells))
    return places, lines


def _scatter(node: Node, base: str, at: int, stride: int, text: str, cells: int) -> str:
    if node.scalar:
        return f"scatter({base} + {at}, frame, last, {stride}, {text});"
    store = f"scatter({base} + {at} + i, frame, last, {stride}, {text});"
    return f"for (int i = 0; i < {cells}; ++i) {{ {store} }}"


def _prelude(lanes: int, dtype: np.dtype[np.floating]) -> str:
    double = dtype == np.float64
    scalar, width = ("double" if double else "float"), ("" if lanes == 1 else str(lanes))
    bits = ("long" if double else "int") + width
    mask = "0x7fffffffffffffffL" if double else "0x7fffffff"
    helpers = [fill("functions", real=f"{scalar}{width}", bits=bits, mask=mask)]
    if lanes * dtype.itemsize >= WIDE_BYTES:
        helpers.append(fill("halves"))
    helpers.append(fill("many_lanes", bits=bits) if lanes > 1 else fill("one_lane"))
    return fill(
        "prelude",
        pragma="#pragma OPENCL EXTENSION cl_khr_fp64 : enable" if double else "",
        scalar=scalar,
        real=f"{scalar}{width}",
        lanes=lanes,
        huge="DBL_MAX" if double else "FLT_MAX",
        lane_helpers="\n".join(helpers),
    )
