"""From a schedule to the text of one kernel that runs all of it, or of its parts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.engines.backend import Solvers
from cnnum.engines.opencl.apart import take_apart
from cnnum.engines.opencl.exchange import exchange_text
from cnnum.engines.opencl.lowering import Lowering
from cnnum.engines.opencl.parts import Parts
from cnnum.engines.opencl.storage import PRIVATE_CELLS, Arena, Tables, Values, placed_name
from cnnum.engines.opencl.text import WIDE_BYTES, fill, indented
from cnnum.graph.nodes import Node
from cnnum.graph.schedule import Schedule

WHOLE_CELLS = 256 * 256
"""Largest array that one work item runs the whole plan for. While other work had one of two cores,
adaptive steps of 256×256 cells took so a third to half of the time that they take in parts, fixed
steps two thirds; of 512×512 fixed steps took as long."""


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
    outputs : dict of str to (slice, shape)
        Where each output stands within a frame's numbers; the last number is `unfinished`.
    scratch : int
        Values of global scratch a work item needs (0: everything is private).
    private : int
        Values in private arrays of a work item at the most (0: they are in scratch).
    parts : Parts or None
        The launches that a large array takes; None where the whole plan is one.
    """

    source: str
    data: NDArray[np.floating]
    output_size: int
    memory_size: int
    outputs: dict[str, tuple[slice, tuple[int, ...]]]
    scratch: int
    private: int
    parts: Parts | None


def lower(schedule: Schedule, solvers: Solvers, tables: Tables) -> KernelText:
    """Return the kernel text of a schedule, with tables that hold nothing yet."""
    lanes, dtype = tables.lanes, tables.dtype
    arena = Arena(private=schedule.cells <= PRIVATE_CELLS)
    size = sum(schedule.size_of(node) for node in schedule.outputs.values()) + 1
    whole = schedule.cells <= WHOLE_CELLS
    tables.parted = not whole
    placed = {} if whole else _placed(schedule)
    # parts of a plan read out their own pieces, and a GPU's private arrays are far
    in_chains = arena.private and whole and tables.by_vectors
    lowering = Lowering(schedule, solvers, tables, arena, Values(tables, placed), in_chains)
    lowering.lower()
    outputs, writes = _write_outputs(lowering)
    arena.keep_all()
    slots = [
        arena.array(f"s{k}", maps * schedule.cells) for k, maps in enumerate(lowering.values.slots)
    ]
    slots += [
        f"__global real *const {placed_name(at)} = output + (size_t)frame * {size} + {at};"
        for at in placed.values()
    ]
    body = [*slots, *lowering.body, *writes]
    parts = None
    texts = dict.fromkeys(strips.text for strips in tables.strips.values())
    own = "\n".join([tables.text, *texts])
    if not whole:
        parts = take_apart("\n".join(body), schedule.shape[0], tables.strips)
        kernels = f"{own}\n{parts.text}\n{exchange_text(dtype)}"
    else:
        alone = {f"{name};": strips.within for name, strips in tables.strips.items()}
        body = [alone.get(line.strip(), line) for line in body]
        if not arena.private:
            body.insert(0, "__global real *const mine = scratch + get_global_id(0) * FRAME_SIZE;")
        kernels = fill("plan", tables=own, body=indented(body, 1))
    return KernelText(
        f"{_prelude(lanes, dtype)}\n#define FRAME_SIZE {arena.size}\n{kernels}",
        tables.buffer(),
        size,
        lowering.memory_size,
        outputs,
        0 if arena.private else arena.size,
        arena.size if arena.private else 0,
        parts,
    )


def _placed(schedule: Schedule) -> dict[int, int]:
    """Return where maps stand among a frame's outputs, by node; of equal outputs, the first."""
    places: dict[int, int] = {}
    at = 0
    for node in schedule.outputs.values():
        if not node.scalar:
            places.setdefault(node.index, at)
        at += schedule.size_of(node)
    return places


def _write_outputs(
    lowering: Lowering,
) -> tuple[dict[str, tuple[slice, tuple[int, ...]]], list[str]]:
    schedule, values = lowering.schedule, lowering.values
    size = sum(schedule.size_of(node) for node in schedule.outputs.values()) + 1
    places: dict[str, tuple[slice, tuple[int, ...]]] = {}
    numbers: list[str] = []
    maps: dict[int, list[str]] = {}

    def write(node: Node, base: str, at: int, stride: int) -> None:
        where, text = f"{base} + {at}", values.read(node)
        if node.scalar:
            numbers.append(f"scatter({where}, frame, last, {stride}, {text});")
            return
        if base == "output" and text == f"{placed_name(at)}[i]":
            return  # it is there
        store = f"scatter({where} + i, frame, last, {stride}, {text});"
        maps.setdefault(schedule.size_of(node), []).append(store)

    at = 0
    for name, node in schedule.outputs.items():
        write(node, "output", at, size)
        after = at + schedule.size_of(node)
        places[name] = slice(at, after), schedule.shape_of(node)
        at = after
    numbers.append(f"scatter(output + {at}, frame, last, {size}, unfinished);")
    for number, memory in schedule.memories.items():
        write(memory.store, "memory", lowering.memory_at[number], lowering.memory_size)
    lines: list[str] = []
    for length, stores in maps.items():
        lines.append(f"for (int i = 0; i < {length}; ++i) {{")
        lines += [*(f"    {store}" for store in stores), "}"]
    return places, [*lines, *numbers]


def _prelude(lanes: int, dtype: np.dtype[np.floating]) -> str:
    double = dtype == np.float64
    scalar, width = ("double" if double else "float"), ("" if lanes == 1 else str(lanes))
    bits = ("long" if double else "int") + width
    mask = "0x7fffffffffffffffL" if double else "0x7fffffff"
    helpers = [fill("functions", real=f"{scalar}{width}", bits=bits, mask=mask)]
    if lanes * dtype.itemsize >= WIDE_BYTES:
        helpers.append(fill("halves"))
    helpers.append(
        fill("many_lanes", bits=bits) if lanes > 1 else fill("one_lane", real=scalar, bits=bits)
    )
    return fill(
        "prelude",
        pragma="#pragma OPENCL EXTENSION cl_khr_fp64 : enable" if double else "",
        scalar=scalar,
        real=f"{scalar}{width}",
        lanes=lanes,
        huge="DBL_MAX" if double else "FLT_MAX",
        lane_helpers="\n".join(helpers),
    )
