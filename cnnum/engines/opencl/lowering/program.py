"""From a schedule to the statements of a plan: walks the operations once."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.dense_products import product
from cnnum.engines.opencl.lowering.program_loops import lower_loop
from cnnum.engines.opencl.lowering.read_outs import begun, chained, chains, rounds, step, taken_in
from cnnum.engines.opencl.lowering.storage import Arena, Tables, Values
from cnnum.engines.opencl.transients.builder import Operands, OwnNumbers, TransientBuilder, X
from cnnum.engines.opencl.transients.state_equation import CHANGE
from cnnum.engines.opencl.transients.strategies import Strategy, run, settled_now, strategy_of
from cnnum.graph.nodes import (
    FIGURES,
    Apply,
    FirstFrame,
    Input,
    Loop,
    Node,
    Pick,
    Product,
    Read,
    Reduce,
    Transient,
)
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solvers
from cnnum.kernels.formulas import formula

FRAME, LAST = ir.names("frame last")
"""The first frame of a work item, and the batch's last."""

INPUT, MEMORY, FIRST, IS_FIRST = ir.names("input memory first is_first")
"""Buffers, and whether the frame is the first of its stream: a real, and an int of the host's."""

K = ir.Name("k")

OUTLIVES = -1
"""Last use of a node that outputs, memories or a loop's end still read."""


@dataclass(slots=True)
class Lowering:
    """Walks a schedule once and collects the plan's statements.

    Read-outs go through the cells one by one, or `in_chains` side by side.
    """

    schedule: Schedule
    solvers: Solvers
    tables: Tables
    arena: Arena
    values: Values
    in_chains: bool
    body: list[ir.Statement] = field(default_factory=list[ir.Statement])
    group: list[Node] = field(default_factory=list[Node])
    grouped: set[int] = field(default_factory=set[int])
    sums: set[int] = field(default_factory=set[int])
    last_use: dict[int, int] = field(default_factory=dict[int, int])
    users: dict[int, list[Node]] = field(default_factory=dict[int, list[Node]])
    memory_at: dict[int, int] = field(default_factory=dict[int, int])
    memory_size: int = 0
    strategies: dict[int, Strategy] = field(default_factory=dict[int, Strategy])

    def lower(self) -> None:
        """Append the statements of all nodes; values that outputs and memories need are kept."""
        self._place_memories()
        kept = [*self.schedule.outputs.values()]
        kept += [memory.store for memory in self.schedule.memories.values()]
        self.nodes(self.schedule.nodes, kept)

    def nodes(self, nodes: tuple[Node, ...], kept: Sequence[Node]) -> None:
        """Append the statements of nodes, in their order; the kept ones outlive them."""
        for node in nodes:
            for argument in node.arguments:
                self.last_use[argument.index] = node.index
        self.last_use.update({node.index: OUTLIVES for node in kept})
        self.users.update({node.index: [] for node in nodes})
        for node in nodes:
            if isinstance(node.operation, Pick):
                self.users[node.arguments[0].index].append(node)
        for node in nodes:
            self._node(node)
        self._flush()

    def over_cells(self, body: Sequence[ir.Statement], maps: int = 1) -> None:
        """Run the body for every cell `i` of a number of maps."""
        if body:
            self.body.append(ir.sweep(ir.CELL, maps * self.schedule.cells, body))

    def stored(self, node: Node, value: ir.Expression) -> ir.Assign:
        """Return the statement that keeps a map's value in cell `i` in an array of its own."""
        return ir.Assign(self.values.take_slot(node)[ir.CELL], value)

    def _place_memories(self) -> None:
        for number, memory in self.schedule.memories.items():
            self.memory_at[number] = self.memory_size
            self.memory_size += self.schedule.size_of(memory.read)

    def _node(self, node: Node) -> None:
        operation = node.operation
        if isinstance(operation, Apply) and node.scalar:
            self._scalar(node, operation)
            return
        if isinstance(operation, Apply | Reduce):
            self._join(node)
            return
        if isinstance(operation, Transient | Loop | Product):
            self._flush()
        if isinstance(operation, Input | Read):
            self._load(node, operation)
        elif isinstance(operation, FirstFrame):
            self.values.alias(node, ir.real(IS_FIRST) if self.tables.split else FIRST)
        elif isinstance(operation, Transient):
            self._transient(node, operation)
        elif isinstance(operation, Loop):
            lower_loop(self, node, operation, self.users[node.index])
        elif isinstance(operation, Product):
            sources = [self.values.read(argument) for argument in node.arguments]
            slot = self.values.take_slot(node)
            self.body += product(self.tables, operation, sources, slot)
        self._free_after(node)

    def _free_after(self, node: Node) -> None:
        for argument in node.arguments:
            if self.last_use.get(argument.index) == node.index:
                self.values.free_slot(argument)

    # local arithmetic: neighbours in the schedule share one loop over the cells

    def _join(self, node: Node) -> None:
        reads_sums = any(argument.index in self.sums for argument in node.arguments)
        if reads_sums or (self.group and _swept(self.group[0]) != _swept(node)):
            self._flush()
        self.group.append(node)
        self.grouped.add(node.index)
        if isinstance(node.operation, Reduce):
            self.sums.add(node.index)

    def _scalar(self, node: Node, operation: Apply) -> None:
        if any(argument.index in self.grouped for argument in node.arguments):
            self._flush()
        arguments = [self.values.read(argument) for argument in node.arguments]
        name = self.values.name_scalar(node)
        self.body.append(ir.fixed(name, _call(operation, arguments)))

    def _flush(self) -> None:
        if not self.group:
            return
        group, self.group, inside = self.group, [], self.grouped
        self.grouped, self.sums = set(), set()
        read_outs = [node for node in group if isinstance(node.operation, Reduce)]
        by_vectors = self.in_chains and self.tables.lanes == 1
        stays = {node.arguments[0].index for node in read_outs} if by_vectors else set[int]()
        loop: list[ir.Statement] = []
        kept: list[tuple[Node, ir.Name]] = []
        for node in group:
            arguments = [self.values.read(argument) for argument in node.arguments]
            if isinstance(node.operation, Reduce):
                if not by_vectors:
                    loop.append(self._step(node, node.operation, arguments[0]))
                continue
            name = ir.Name(f"v{node.index}")
            assert isinstance(node.operation, Apply)
            loop.append(ir.fixed(name, _call(node.operation, arguments)))
            self.values.alias(node, name)
            if self.last_use[node.index] not in inside or node.index in stays:
                kept.append((node, name))
        # only now: within the loop a value is read by its name, before its slot is written
        loop += [self.stored(node, name) for node, name in kept]
        if by_vectors:
            self._sweep_and_read_out(loop, read_outs, _swept(group[0]))
        else:
            self.over_cells(loop, _swept(group[0]))
            self._end(read_outs)
        for node in group:
            self._free_after(node)

    def _sweep_and_read_out(
        self, loop: list[ir.Statement], read_outs: Sequence[Node], maps: int
    ) -> None:
        """Append a loop over the cells, and then the read-outs of the arrays that it leaves."""
        read = {node.arguments[0].index: node.arguments[0] for node in read_outs}
        # maps that lie elsewhere are copied: functions take private arrays
        copied = {n: self.values.read(n) for n in read.values() if self.values.array_of(n) is None}
        loop += [self.stored(n, value) for n, value in copied.items()]
        self.over_cells(loop, maps)
        for node in read_outs:
            self._read_out(node, self.values.array_of(node.arguments[0]), maps)
        for node, value in copied.items():
            self.values.free_slot(node)
            self.values.alias(node, value)

    def _read_out(self, node: Node, array: ir.Name | None, maps: int) -> None:
        assert isinstance(node.operation, Reduce)
        assert array is not None
        cells = self.schedule.cells
        count = maps * cells if self.tables.lanes == 1 else chains(cells)
        name = chained(self.tables, node.operation.function, count, cells)
        self.body.append(ir.fixed(self.values.name_scalar(node), ir.call(name, array)))

    def _step(self, node: Node, operation: Reduce, value: ir.Expression) -> ir.Statement:
        """Return the statement that takes a cell into a read-out, which begins here."""
        function, count = operation.function, chains(self.schedule.cells)
        if self.in_chains and rounds(function):
            slot = self.values.take_slot(node)
            self.body.append(ir.Loop(K, count, (ir.Assign(slot[K], begun(function)),)))
            chain = slot[ir.CELL % count]
            return ir.Assign(chain, step(function, chain, value))
        total = self.values.name_scalar(node)
        self.body.append(ir.declare(total, begun(function)))
        return taken_in(function, total, value)

    def _end(self, read_outs: Sequence[Node]) -> None:
        """Append the ends of chains that run through the cells."""
        for node in read_outs:
            array = self.values.array_of(node)
            if array is not None:
                self._read_out(node, array, 1)
                self.values.free_slot(node)

    # inputs

    def _load(self, node: Node, operation: Input | Read) -> None:
        if isinstance(operation, Input):
            count = len(self.schedule.channels_read)
            place, base = self.schedule.channels_read.index(operation.channel), INPUT
            # large arrays come channel by channel, small ones as frames have them
            at: ir.Expression = ir.CELL * count + place
            if not self.arena.private:
                at = ir.Integer(place * self.schedule.cells) + ir.CELL
            stride = self.schedule.cells * count
        else:
            at, base = ir.Integer(self.memory_at[operation.memory]) + ir.CELL, MEMORY
            stride = self.memory_size
        if node.scalar:
            assert isinstance(operation, Read)
            start = base + self.memory_at[operation.memory]
            value = ir.call("gather", start, FRAME, LAST, stride)
            self.body.append(ir.fixed(self.values.name_scalar(node), value))
            return
        if self._stays(node, operation):
            self.values.alias(node, base[ir.after(ir.Cast("size_t", FRAME) * stride, at)])
            return
        value = ir.call("gather", ir.after(base, at), FRAME, LAST, stride)
        self.over_cells([self.stored(node, value)], node.maps)

    def _stays(self, node: Node, operation: Input | Read) -> bool:
        """Whether a map is read where it is: of one frame a work item, if it stays the same."""
        if isinstance(operation, Input):
            return not self.arena.private
        # memories are written one after the other: one that holds another's past needs a copy
        kept = (memory.store for memory in self.schedule.memories.values())
        return self.tables.lanes == 1 and all(store is not node for store in kept)

    # templates

    def _transient(self, node: Node, operation: Transient) -> None:
        text = TransientBuilder(
            operation.template,
            self.schedule.shape,
            self.solvers[node.index],
            self._operands(node, operation),
            self.arena,
            self.tables,
        )
        if text.operands.own is not None:
            maps = [self.values.array_of(each) for each in node.arguments[-operation.weight_maps :]]
            text.body += text.operands.own.declared([each for each in maps if each], text.cells)
        picks = self.users[node.index]
        scalars = [node for node in picks if node.scalar]
        self.body += [ir.declare(self.values.name_scalar(node)) for node in scalars]
        mark = self.arena.mark()
        strategy = strategy_of(text)
        self.strategies[node.index] = strategy
        figures = run(text, strategy)
        wanted = {node.operation.what for node in picks if isinstance(node.operation, Pick)}
        if "settled" in wanted and "settled" not in figures:
            settled_now(text, strategy)
            figures["settled"] = ir.pick(CHANGE <= ir.ONE, ir.ONE, ir.ZERO)
        text.over_cells([self._pick_map(node, text) for node in picks if not node.scalar])
        text.body += [
            ir.Assign(self.values.variable(node), figures[node.operation.what])
            for node in scalars
            if isinstance(node.operation, Pick) and node.operation.what in FIGURES
        ]
        self.arena.release(mark)
        self.body.append(ir.Block(tuple(text.body)))

    def _operands(self, node: Node, operation: Transient) -> Operands:
        values = [self.values.read(argument) for argument in node.arguments]
        roles = operation.by_role(values)
        mask = roles["mask"][0] if roles["mask"] else None
        weights = operation.weights
        own = OwnNumbers.of(weights, operation.template) if operation.weight_maps else None
        return Operands(roles["input"], roles["previous"], roles["state"], roles["bias"], mask, own)

    def _pick_map(self, node: Node, text: TransientBuilder) -> ir.Statement:
        assert isinstance(node.operation, Pick)
        state = X[text.at(node.operation.layer)]
        shown = node.operation.what != "state"
        return self.stored(node, text.output(state) if shown else state)


def _swept(node: Node) -> int:
    """Return over how many maps an operation goes, be it to one number."""
    return (node.arguments[0] if isinstance(node.operation, Reduce) else node).maps


def _call(operation: Apply, arguments: list[ir.Expression]) -> ir.Expression:
    return formula(operation.function.opencl, **dict(zip("abc", arguments, strict=False)))
