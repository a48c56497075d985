"""Lowering of a schedule to the source of one kernel, or of several for large arrays."""

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.program import FIRST, FRAME, LAST, MEMORY, Lowering
from cnnum.engines.opencl.lowering.storage import (
    PRIVATE_CELLS,
    UNFINISHED,
    Arena,
    Place,
    Places,
    Tables,
    Values,
)
from cnnum.engines.opencl.text import WIDE_BYTES, fill, indented
from cnnum.graph.nodes import Node
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solvers
from cnnum.kernels.kernel_split import PartKernel, split_kernels
from cnnum.kernels.launch_plan import LaunchPlan
from cnnum.kernels.number_types import NumberType
from cnnum.kernels.printer import OpenCLPrinter

OUTPUT, IS_FIRST = ir.names("output is_first")
"""The result buffer, and the flag for the first frame of a stream."""

Key = TypeVar("Key", str, int)

_MINE = ir.Verbatim(("__global real *const mine = scratch + get_global_id(0) * FRAME_SIZE;",))

PRIVATE_BYTES = 2**20
"""Maximum bytes of private arrays per work item. On a CPU they are on the thread's stack, which on
Linux has at least 2 MiB; exceeding it ends the process."""

WHOLE_CELLS = 256 * 256
"""Largest array, in cells, for which one work item runs the whole plan. Measured with other work on
one of two cores: adaptive steps of 256×256 cells took a third to half of their time in parts, fixed
steps two thirds; for 512×512 cells the times were equal."""


TAKEN = {"float32": "float", "float64": "double"}
"""Number types of host maps that kernels of large arrays read without conversion."""


@dataclass(frozen=True, slots=True)
class Form:
    """The form of a plan's kernels.

    Attributes
    ----------
    name, reason : str
    fits : callable
        Whether a plan with this number of cells can have this form.
    private : bool
        Whether arrays are private to a work item, up to `PRIVATE_BYTES`.
    split : bool
        Whether every sweep is a separate kernel.
    """

    name: str
    reason: str
    fits: Callable[[int], bool]
    private: bool = False
    split: bool = False


PRIVATE = Form(
    "private memory of one work item",
    "arrays of so few cells stay close to it",
    lambda cells: cells <= PRIVATE_CELLS,
    private=True,
)

FORMS = (
    PRIVATE,
    Form(
        "global memory of one work item",
        "more launches cost more than other cores save",
        lambda cells: cells <= WHOLE_CELLS,
    ),
    Form("kernels of many work items", "all cores share each sweep", lambda _: True, split=True),
)
"""In order of preference: the first that fits is used."""


@dataclass(frozen=True, slots=True, eq=False)
class KernelSource:
    """A plan's kernel and the contents of its buffers.

    Attributes
    ----------
    source : str
    data : (n,) float
        Constant numbers.
    output_size, memory_size : int
        Numbers per frame.
    outputs : Places
        Places of the outputs; the last number of a frame, after them, is `unfinished`.
    scratch : int
        Values of global scratch per work item (0: everything is private).
    strategies : mapping of int to str
        Description of how each transient runs, by node.
    private : int
        Values in private arrays of a work item at most (0: they are in scratch).
    parts : LaunchPlan or None
        The launches that a large array takes, or None if the whole plan is one.
    """

    source: str
    data: NDArray[np.floating]
    output_size: int
    memory_size: int
    outputs: Places
    scratch: int
    strategies: Mapping[int, str]
    private: int
    parts: LaunchPlan | None


@dataclass(frozen=True, slots=True)
class Statements:
    """A plan as statement records, from which a printer makes a kernel.

    Attributes
    ----------
    body : tuple of Statement
        Statements that run a frame.
    form : Form
    arena : Arena
    lowering : Lowering
    outputs : Places
    output_size : int
    """

    body: tuple[ir.Statement, ...]
    form: Form
    arena: Arena
    lowering: Lowering
    outputs: Places
    output_size: int

    def source(self, text: str, parts: LaunchPlan | None = None) -> KernelSource:
        """Return the kernel with this source."""
        private, size = self.arena.private, self.arena.size
        return KernelSource(
            text,
            self.lowering.tables.buffer(),
            self.output_size,
            self.lowering.memory_size,
            self.outputs,
            0 if private else size,
            {
                index: f"{strategy.name} in {self.form.name} ({strategy.reason}; "
                f"{self.form.reason})"
                for index, strategy in self.lowering.strategies.items()
            },
            size if private else 0,
            parts,
        )


def statements(schedule: Schedule, solvers: Solvers, tables: Tables, form: Form) -> Statements:
    """Return the records of a schedule; `tables` must be empty."""
    arena = Arena(private=form.private)
    outputs, used = _places(schedule, schedule.outputs)
    size = used + 1  # the last one is `unfinished`
    memories = {number: memory.read for number, memory in schedule.memories.items()}
    values = Values(tables, _among_outputs(schedule, outputs, size) if form.split else {})
    first = ir.real(IS_FIRST) if form.split else FIRST
    places = _places(schedule, memories)
    lowering = Lowering(schedule, solvers, tables, arena, values, first, *places)
    lowering.lower()
    writes = _write_outputs(lowering, outputs, size)
    arena.top = arena.size
    slots = [arena.array(slot.text, maps * schedule.cells) for slot, maps in values.slots.items()]
    body = (*slots, *values.placed.values(), *lowering.body, *writes)
    return Statements(body, form, arena, lowering, outputs, size)


def _in_form(schedule: Schedule, solvers: Solvers, tables: Tables) -> Statements:
    """Return the records of a schedule in the first form that fits."""
    forms = [form for form in FORMS if form.fits(schedule.cells)]
    plans = (statements(schedule, solvers, deepcopy(tables), form) for form in forms)
    most = PRIVATE_BYTES // (tables.lanes * tables.dtype.itemsize)
    return next(plan for plan in plans if plan.arena.size <= most or not plan.form.private)


def lower(schedule: Schedule, solvers: Solvers, tables: Tables) -> KernelSource:
    """Return the kernel source of a schedule; `tables` must be empty."""
    plan, parts = _in_form(schedule, solvers, tables), None
    tables = plan.lowering.tables
    body, form, arena = list(plan.body), plan.form, plan.arena
    own = "\n".join([tables.text, *dict.fromkeys(tables.strips)])
    if form.split:
        body.insert(0, ir.declare(UNFINISHED, ir.ZERO))
        parts, split = split_kernels(body, schedule.shape[0])
        texts = [_part(kernel, tables.printer) for kernel in split]
        kernels = "\n".join([own, *texts, *_exchange(tables.printer.numbers)])
    else:
        if not arena.private:
            body.insert(0, _MINE)
        kernels = fill("plan", tables=own, body="\n".join(tables.printer.lines(body, 1)))
    prelude = _prelude(tables.lanes, tables.printer.numbers)
    return plan.source(f"{prelude}\n#define FRAME_SIZE {arena.size}\n{kernels}", parts)


def _part(kernel: PartKernel, printer: OpenCLPrinter) -> str:
    """Return the source of a kernel with many work items."""
    body = indented(printer.lines(kernel.body), 1)
    return fill("part", note=kernel.note, kernel=kernel.name, body=body)


def _exchange(numbers: NumberType) -> list[str]:
    """Return the kernels that read and write host maps, for a device with doubles."""
    names = {"bits": numbers.bits, "mask": numbers.mask, "infinite": numbers.infinite}
    takes = [fill("take", given=given, **names) for given in TAKEN.values()]
    return [*takes, fill("give", **names)]


def _places(schedule: Schedule, nodes: Mapping[Key, Node]) -> tuple[dict[Key, Place], int]:
    """Return the places of node values among a frame's numbers, and their total count."""
    places: dict[Key, Place] = {}
    at = 0
    for key, node in nodes.items():
        begin, at = at, at + schedule.size_of(node)
        places[key] = slice(begin, at), schedule.shape_of(node)
    return places, at


def _among_outputs(schedule: Schedule, outputs: Places, size: int) -> dict[int, ir.Array]:
    """Return the maps that are written directly to the place of an output, the first if several."""
    frame, result = OUTPUT + ir.Cast("size_t", FRAME) * size, dict[int, ir.Array]()
    for name, node in schedule.outputs.items():
        at = outputs[name][0].start
        if not node.scalar:
            array = ir.Array(_placed_name(at), schedule.cells, frame + at)
            result.setdefault(node.index, array)
    return result


def _placed_name(at: int) -> ir.Name:
    return ir.Name(f"out{at}")


def _write_outputs(lowering: Lowering, places: Places, size: int) -> list[ir.Statement]:
    """Return the statements that write outputs and the new values of memories."""
    schedule, values = lowering.schedule, lowering.values
    numbers: list[ir.Statement] = []
    maps: dict[int, list[ir.Statement]] = {}

    def scattered(start: ir.Expression, stride: int, value: ir.Expression) -> ir.Do:
        return ir.Do(ir.call("scatter", start, FRAME, LAST, stride, value))

    def write(node: Node, base: ir.Name, at: int, stride: int) -> None:
        value, array = values.read(node), values.array_of(node)
        if node.scalar:
            numbers.append(scattered(base + at, stride, value))
        elif lowering.turns_maps and array is not None:
            size = schedule.size_of(node)
            numbers.append(
                ir.Do(ir.call("scatter_map", base + at, FRAME, LAST, stride, array, size))
            )
        elif base != OUTPUT or value != _placed_name(at)[ir.CELL]:  # it may already be there
            store = scattered(base + at + ir.CELL, stride, value)
            maps.setdefault(schedule.size_of(node), []).append(store)

    for name, node in schedule.outputs.items():
        write(node, OUTPUT, places[name][0].start, size)
    numbers.append(scattered(OUTPUT + (size - 1), size, UNFINISHED))
    for number, memory in schedule.memories.items():
        write(memory.store, MEMORY, lowering.memories[number][0].start, lowering.memory_size)
    return [*(ir.sweep(ir.CELL, length, stores) for length, stores in maps.items()), *numbers]


def _prelude(lanes: int, numbers: NumberType) -> str:
    width = "" if lanes == 1 else str(lanes)
    scalar, bits = numbers.scalar, numbers.bits + width
    helpers = [fill("functions", real=f"{scalar}{width}", bits=bits, mask=numbers.mask)]
    if lanes * numbers.dtype.itemsize >= WIDE_BYTES:
        helpers.append(fill("halves"))
    helpers.append(
        fill("many_lanes", bits=bits) if lanes > 1 else fill("one_lane", real=scalar, bits=bits)
    )
    return fill(
        "prelude",
        pragma=numbers.pragma,
        scalar=scalar,
        real=f"{scalar}{width}",
        lanes=lanes,
        huge=numbers.huge,
        lane_helpers="\n".join(helpers),
    )
