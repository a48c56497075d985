"""From a schedule to the text of one kernel that runs all of it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cnnum.engines.backend import Solvers
from cnnum.engines.opencl.schemes import run, settled_now
from cnnum.engines.opencl.storage import PRIVATE_CELLS, Arena, Tables, Values
from cnnum.engines.opencl.text import fill, indented, rename
from cnnum.engines.opencl.transients import Operands, TransientText
from cnnum.graph.nodes import (
    FIGURES,
    Apply,
    FirstFrame,
    Input,
    Node,
    Pick,
    Read,
    Reduce,
    Transient,
)
from cnnum.graph.schedule import Schedule


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
    """

    source: str
    data: NDArray[np.floating]
    output_size: int
    memory_size: int
    outputs: dict[str, int]
    scratch: int


@dataclass(slots=True)
class Lowering:
    """Walks a schedule once and writes the kernel's body."""

    schedule: Schedule
    solvers: Solvers
    tables: Tables
    arena: Arena
    values: Values
    body: list[str] = field(default_factory=list[str])
    group: list[Node] = field(default_factory=list[Node])
    last_use: dict[int, int] = field(default_factory=dict[int, int])
    memory_at: dict[int, int] = field(default_factory=dict[int, int])
    memory_size: int = 0

    def lower(self) -> None:
        """Write the text of all nodes, outputs and memories."""
        self._find_last_uses()
        self._place_memories()
        for node in self.schedule.nodes:
            self._node(node)
        self._flush()

    def _find_last_uses(self) -> None:
        for node in self.schedule.nodes:
            for argument in node.arguments:
                self.last_use[argument.index] = node.index
        kept = [*self.schedule.outputs.values()]
        kept += [memory.store for memory in self.schedule.memories.values()]
        for node in kept:
            self.last_use[node.index] = len(self.schedule.nodes) + node.index + 10**9

    def _place_memories(self) -> None:
        for number, memory in self.schedule.memories.items():
            self.memory_at[number] = self.memory_size
            self.memory_size += 1 if memory.read.scalar else self.schedule.cells

    def _node(self, node: Node) -> None:
        operation = node.operation
        if isinstance(operation, Apply | Reduce) and not self._alone(node):
            self._join(node)
            return
        if isinstance(operation, Apply):
            self._scalar(node, operation)
            return
        if isinstance(operation, Input | Read):
            self._load(node, operation)
        elif isinstance(operation, FirstFrame):
            self.values.alias(node, "first")
        elif isinstance(operation, Transient):
            self._flush()
            self._transient(node, operation)
        self._free_after(node)

    def _alone(self, node: Node) -> bool:
        return isinstance(node.operation, Apply) and node.scalar

    def _free_after(self, node: Node) -> None:
        for argument in node.arguments:
            if self.last_use[argument.index] == node.index:
                self.values.free_slot(argument)

    # local arithmetic: neighbours in the schedule share one loop over the cells

    def _join(self, node: Node) -> None:
        reads = {argument.index for argument in node.arguments}
        sums = {item.index for item in self.group if isinstance(item.operation, Reduce)}
        if reads & sums:
            self._flush()
        self.group.append(node)

    def _scalar(self, node: Node, operation: Apply) -> None:
        if {argument.index for argument in node.arguments} & {item.index for item in self.group}:
            self._flush()
        arguments = [self.values.read(argument) for argument in node.arguments]
        name = self.values.name_scalar(node)
        self.body.append(f"const real {name} = {_call(operation, arguments)};")

    def _flush(self) -> None:
        if not self.group:
            return
        group, self.group = self.group, []
        inside = {node.index for node in group}
        loop: list[str] = []
        kept: list[tuple[Node, str]] = []
        for node in group:
            arguments = [self.values.read(argument) for argument in node.arguments]
            if isinstance(node.operation, Reduce):
                total = self.values.name_scalar(node)
                self.body.append(f"real {total} = {node.operation.function.start};")
                step = rename(node.operation.function.step, {"a": arguments[0], "total": total})
                loop.append(f"{total} = {step};")
                continue
            name = f"v{node.index}"
            assert isinstance(node.operation, Apply)
            loop.append(f"const real {name} = {_call(node.operation, arguments)};")
            self.values.alias(node, name)
            if self.last_use[node.index] not in inside:
                kept.append((node, name))
        # only now: within the loop a value is read by its name, before its slot is written
        stored = [self._store(node, name) for node, name in kept]
        self.body.append(f"for (int i = 0; i < {self.schedule.cells}; ++i) {{")
        self.body += [f"    {line}" for line in loop + stored]
        self.body.append("}")
        for node in group:
            self._free_after(node)

    def _store(self, node: Node, name: str) -> str:
        slot = self.values.take_slot(node)
        return f"{slot}[i] = {name};"

    # what comes in

    def _load(self, node: Node, operation: Input | Read) -> None:
        if isinstance(operation, Input):
            count = len(self.schedule.channels_read)
            place, base = self.schedule.channels_read.index(operation.channel), "input"
            at, stride = f"i * {count} + {place}", self.schedule.cells * count
        else:
            at, base = f"{self.memory_at[operation.memory]} + i", "memory"
            stride = self.memory_size
        if node.scalar:
            name = self.values.name_scalar(node)
            text = f"gather({base} + {at.removesuffix(' + i')}, frame, last, {stride})"
            self.body.append(f"const real {name} = {text};")
            return
        slot = self.values.take_slot(node)
        text = f"gather({base} + {at}, frame, last, {stride})"
        self.body.append(
            f"for (int i = 0; i < {self.schedule.cells}; ++i) {{ {slot}[i] = {text}; }}"
        )

    # templates

    def _transient(self, node: Node, operation: Transient) -> None:
        text = TransientText(
            operation.template,
            self.schedule.shape,
            self.solvers[node.index],
            self._operands(node, operation),
            self.arena,
            self.tables,
        )
        picks = [n for n in self.schedule.nodes if n.arguments == (node,)]
        scalars = [pick for pick in picks if pick.scalar]
        self.body += [f"real {self.values.name_scalar(pick)};" for pick in scalars]
        mark = self.arena.mark()
        figures = run(text)
        wanted = {pick.operation.what for pick in picks if isinstance(pick.operation, Pick)}
        if "settled" in wanted and "settled" not in figures:
            settled_now(text)
            figures["settled"] = "PICK(change <= ONE, ONE, ZERO)"
        text.over_cells([self._pick_map(pick, text) for pick in picks if not pick.scalar])
        text.lines += [
            f"{self.values.read(pick)} = {figures[pick.operation.what]};"
            for pick in scalars
            if isinstance(pick.operation, Pick) and pick.operation.what in FIGURES
        ]
        self.arena.release(mark)
        self.body += ["{", *(f"    {line}" for line in text.lines), "}"]

    def _operands(self, node: Node, operation: Transient) -> Operands:
        texts = [self.values.read(argument) for argument in node.arguments]
        roles = operation.by_role(texts)
        mask = roles["mask"][0] if roles["mask"] else None
        return Operands(roles["input"], roles["previous"], roles["state"], roles["bias"], mask)

    def _pick_map(self, pick: Node, text: TransientText) -> str:
        assert isinstance(pick.operation, Pick)
        slot = self.values.take_slot(pick)
        state = f"x[{pick.operation.layer * text.cells} + i]"
        if pick.operation.what == "state":
            return f"{slot}[i] = {state};"
        return f"{slot}[i] = {rename(text.template.output.opencl, {'x': state})};"


def _call(operation: Apply, arguments: list[str]) -> str:
    return rename(operation.function.opencl, dict(zip("abc", arguments, strict=False)))


def lower(
    schedule: Schedule, solvers: Solvers, lanes: int, dtype: np.dtype[np.floating]
) -> KernelText:
    """Return the kernel text of a schedule for `lanes` frames side by side."""
    tables = Tables(dtype)
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
    source = _prelude(lanes, dtype) + "\n" + fill("plan", tables=tables.text, body=body)
    return KernelText(
        source,
        tables.buffer(),
        size,
        lowering.memory_size,
        outputs,
        0 if arena.private else arena.size,
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
    scalar = "double" if double else "float"
    helpers = fill("many_lanes", lanes=lanes) if lanes > 1 else fill("one_lane")
    return fill(
        "prelude",
        pragma="#pragma OPENCL EXTENSION cl_khr_fp64 : enable" if double else "",
        scalar=scalar,
        real=f"{scalar}{lanes}" if lanes > 1 else scalar,
        lanes=lanes,
        huge="DBL_MAX" if double else "FLT_MAX",
        lane_helpers=helpers,
    )
