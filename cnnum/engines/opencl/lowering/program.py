"""Lowering of a schedule to the statements of a plan, in one pass over the operations."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.dense_products import chained, chains, product, step
from cnnum.engines.opencl.lowering.storage import UNFINISHED, Arena, Place, Tables, Values
from cnnum.engines.opencl.transients.builder import Operands, OwnNumbers, TransientBuilder, X
from cnnum.engines.opencl.transients.state_equation import RESTS
from cnnum.engines.opencl.transients.strategies import Strategy, run, settled_now, strategy_of
from cnnum.graph.elementwise import ReduceOp
from cnnum.graph.nodes import (
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
from cnnum.kernels.expressions import formula

CHANGED = ir.Name("changed")

Picks = list[tuple[Node, Pick]]


def lower_loop(lowering: "Lowering", node: Node, loop: Loop, picks: Picks) -> None:
    """Append a loop and bind its picks to the names of its results."""
    values, tag = lowering.values, f"l{node.index}"
    start, *rest = node.arguments
    running, count = ir.names(f"{tag}_running {tag}_count")
    carried = loop.carried
    for number, inner in loop.captured.items():
        values.alias(inner, values.read(rest[len(loop.results) + number]))
    _begin(lowering, carried, rest)
    begun = ((running, values.read(start)), (count, ir.ZERO))
    lowering.body.append(ir.Declare("real", begun))
    outside, lowering.body = lowering.body, []
    results = (*loop.results, *([loop.again] if loop.again is not None else []))
    lowering.nodes(loop.nodes, kept=(*results, *carried.values()))
    _advance(lowering, loop, carried, running, count)
    for result in dict.fromkeys(results):
        if result not in carried.values():
            values.free_slot(result)
    rounds = ir.Counted(ir.Name(tag), 0, loop.limit, running, tuple(lowering.body))
    lowering.body = [*outside, rounds]
    _leave(lowering, carried, picks, running, count)


def _begin(lowering: "Lowering", carried: dict[int, Node], initial: list[Node]) -> None:
    """Append the loop-carried values, set to their initial values."""
    for place, node in carried.items():
        value = lowering.values.read(initial[place])
        if node.scalar:
            lowering.body.append(ir.declare(lowering.values.name_scalar(node), value))
        else:
            lowering.over_cells([lowering.stored(node, value)], node.maps)


def _advance(
    lowering: "Lowering", loop: Loop, carried: dict[int, Node], running: ir.Name, count: ir.Name
) -> None:
    """Append the end of an iteration: carried values advance in frames that are still running."""
    lowering.body.append(ir.declare(CHANGED, ir.ZERO))
    numbers = _moves(lowering, loop, {p: n for p, n in carried.items() if n.scalar}, running)
    for maps in sorted({n.maps for n in carried.values() if not n.scalar}):
        moving = {p: n for p, n in carried.items() if not n.scalar and n.maps == maps}
        lowering.over_cells(_moves(lowering, loop, moving, running), maps)
    again = CHANGED if loop.again is None else lowering.values.read(loop.again)
    lowering.body += [*numbers, ir.add(count, running), ir.Assign(running, again, "*=")]


def _moves(
    lowering: "Lowering", loop: Loop, moving: dict[int, Node], running: ir.Name
) -> list[ir.Statement]:
    """Return statements that advance values; a body may swap them, so all are read first."""
    read = lowering.values.read
    moved = {p: ir.Name(f"to{p}") for p in moving}
    lines: list[ir.Statement] = [ir.fixed(to, read(loop.results[p])) for p, to in moved.items()]
    for p, node in moving.items():
        differs = ir.pick(moved[p].differs(read(node)), running, ir.ZERO)
        lines.append(ir.Accumulate(CHANGED, "fmax", differs))
    for p, node in moving.items():
        value = ir.pick(running.differs(ir.ZERO), moved[p], read(node))
        lines.append(ir.Assign(lowering.values.variable(node), value))
    return lines


def _leave(
    lowering: "Lowering", carried: dict[int, Node], picks: Picks, running: ir.Name, count: ir.Name
) -> None:
    """Bind picks to the names of results, and release the arrays of other carried values."""
    values = {"iterations": count, "finished": ir.pick(running.differs(ir.ZERO), ir.ZERO, ir.ONE)}
    left = dict(carried)
    for node, pick in picks:
        if pick.what == "carried":
            lowering.values.hand_over(carried[pick.layer], node)
            left.pop(pick.layer, None)
        else:
            lowering.values.alias(node, values[pick.what])
    for node in left.values():
        lowering.values.free_slot(node)
    if not any(pick.what == "finished" for _, pick in picks):
        lowering.body.append(ir.Assign(UNFINISHED, ir.call("fmax", UNFINISHED, running)))


FRAME, LAST = ir.names("frame last")
"""The first frame of a work item, and the last of the batch."""

INPUT, MEMORY, FIRST = ir.names("input memory first")
"""Buffers, and the flag for the first frame of a stream."""

K = ir.Name("k")

OUTLIVES = -1
"""Last use of a node that outputs, memories or the end of a loop still read."""


@dataclass(slots=True)
class Lowering:
    """Walks a schedule once and collects the plan's statements.

    Attributes
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    tables : Tables
    arena : Arena
    values : Values
    first : Expression
        Whether the frame is the first of its stream.
    memories : mapping of int to Place
        Places of memories among the numbers of a frame that stay on the device.
    memory_size : int
        Count of these numbers.
    body : list of Statement
    group : list of Node
        Cellwise arithmetic and reductions that share the next loop over the cells.
    last_use : dict of int to int
    picks : dict of int to list of (Node, Pick)
        The results requested of a transient or a loop, by its index.
    strategies : dict of int to Strategy
        Strategies of transients, by index.
    """

    schedule: Schedule
    solvers: Solvers
    tables: Tables
    arena: Arena
    values: Values
    first: ir.Expression
    memories: Mapping[int, Place]
    memory_size: int
    body: list[ir.Statement] = field(default_factory=list[ir.Statement])
    group: list[Node] = field(default_factory=list[Node])
    last_use: dict[int, int] = field(default_factory=dict[int, int])
    picks: defaultdict[int, list[tuple[Node, Pick]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    strategies: dict[int, Strategy] = field(default_factory=dict[int, Strategy])

    @property
    def in_chains(self) -> bool:
        """Whether reductions run in parallel chains rather than cell by cell.

        Not used in plans split into parts, which reduce their own pieces, nor on GPUs, whose
        private arrays are slow.
        """
        return self.arena.private and self.tables.by_vectors

    def lower(self) -> None:
        """Append the statements of all nodes, keeping values that outputs and memories need."""
        kept = [*self.schedule.outputs.values()]
        kept += [memory.store for memory in self.schedule.memories.values()]
        self.nodes(self.schedule.nodes, kept)

    def nodes(self, nodes: tuple[Node, ...], kept: Sequence[Node]) -> None:
        """Append the statements of nodes in order; the `kept` ones outlive them."""
        for node in nodes:
            for argument in node.arguments:
                self.last_use[argument.index] = node.index
            if isinstance(node.operation, Pick):
                self.picks[node.arguments[0].index].append((node, node.operation))
        self.last_use.update({node.index: OUTLIVES for node in kept})
        for node in nodes:
            self._node(node)
        self._flush()

    def over_cells(self, body: Sequence[ir.Statement], maps: int = 1) -> None:
        """Append a loop of the body over every cell `i` of this number of maps."""
        if body:
            self.body.append(ir.sweep(ir.CELL, maps * self.schedule.cells, body))

    def stored(self, node: Node, value: ir.Expression) -> ir.Assign:
        """Return the statement that stores a map's value in cell `i` in its own array."""
        return ir.Assign(self.values.take_slot(node)[ir.CELL], value)

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
            self.values.alias(node, self.first)
        elif isinstance(operation, Transient):
            self._transient(node, operation)
        elif isinstance(operation, Loop):
            lower_loop(self, node, operation, self.picks[node.index])
        elif isinstance(operation, Product):
            sources = [self.values.read(argument) for argument in node.arguments]
            slot = self.values.take_slot(node)
            self.body += product(self.tables, operation, sources, slot)
        self._free_after(node)

    def _free_after(self, node: Node) -> None:
        for argument in node.arguments:
            if self.last_use.get(argument.index) == node.index:
                self.values.free_slot(argument)

    # cellwise arithmetic: consecutive operations share one loop over the cells

    def _join(self, node: Node) -> None:
        waits = (argument for argument in node.arguments if argument in self.group)
        reads_sums = any(isinstance(argument.operation, Reduce) for argument in waits)
        if reads_sums or (self.group and _swept(self.group[0]) != _swept(node)):
            self._flush()
        self.group.append(node)

    def _scalar(self, node: Node, operation: Apply) -> None:
        if any(argument in self.group for argument in node.arguments):
            self._flush()
        arguments = [self.values.read(argument) for argument in node.arguments]
        name = self.values.name_scalar(node)
        self.body.append(ir.fixed(name, _call(operation, arguments)))

    def _flush(self) -> None:
        if not self.group:
            return
        group, self.group = self.group, []
        inside, swept = {node.index for node in group}, _swept(group[0])
        by_vectors = self.in_chains and self.tables.lanes == 1
        read_outs = [node for node in group if isinstance(node.operation, Reduce)]
        # chained reductions follow the loop, on the arrays that it leaves
        sources = [node.arguments[0] for node in read_outs] if by_vectors else []
        loop: list[ir.Statement] = []
        kept: list[tuple[Node, ir.Name]] = []
        for node in group:
            arguments = [self.values.read(argument) for argument in node.arguments]
            if isinstance(node.operation, Apply):
                name = ir.Name(f"v{node.index}")
                loop.append(ir.fixed(name, _call(node.operation, arguments)))
                self.values.alias(node, name)
                if self.last_use[node.index] not in inside or node in sources:
                    kept.append((node, name))
            elif isinstance(node.operation, Reduce) and not by_vectors:
                loop.append(self._step(node, node.operation.function, arguments[0]))
        # only now, because within the loop a value is read by name before its slot is written
        loop += [self.stored(node, name) for node, name in kept]
        # maps stored elsewhere are copied, because functions take private arrays
        copied = {n: self.values.read(n) for n in sources if self.values.array_of(n) is None}
        loop += [self.stored(node, value) for node, value in copied.items()]
        self.over_cells(loop, swept)
        for node in read_outs:
            self._read_out(node, node.arguments[0] if by_vectors else node, swept)
        for node, value in copied.items():
            self.values.free_slot(node)
            self.values.alias(node, value)
        for node in group:
            self._free_after(node)

    def _read_out(self, node: Node, source: Node, maps: int) -> None:
        """Append the end of a chained reduction, and release its own array."""
        array, cells = self.values.array_of(source), self.schedule.cells
        if array is not None and isinstance(node.operation, Reduce):
            count = maps * cells if self.tables.lanes == 1 else chains(cells)
            name = chained(self.tables, node.operation.function, count, cells)
            self.body.append(ir.fixed(self.values.name_scalar(node), ir.call(name, array)))
        self.values.free_slot(node)

    def _step(self, node: Node, function: ReduceOp, value: ir.Expression) -> ir.Statement:
        """Return the statement that adds a cell to a reduction, which begins here."""
        begun = formula(function.start)
        # the order matters only for sums: other reductions return one of the numbers
        if self.in_chains and function.how == "+":
            slot, count = self.values.take_slot(node), chains(self.schedule.cells)
            self.body.append(ir.Loop(K, count, (ir.Assign(slot[K], begun),)))
            chain = slot[ir.CELL % count]
            return ir.Assign(chain, step(function, chain, value))
        total = self.values.name_scalar(node)
        self.body.append(ir.declare(total, begun))
        return ir.Accumulate(total, function.how, value)

    # inputs

    def _load(self, node: Node, operation: Input | Read) -> None:
        cells, read = self.schedule.cells, self.schedule.channels_read
        if isinstance(operation, Input):
            place, base, stride = read.index(operation.channel), INPUT, cells * len(read)
            # large arrays are stored by channel, small ones as in the frame
            at = ir.CELL * len(read) + place
            if not self.arena.private:
                at = ir.Integer(place * cells) + ir.CELL
        else:
            place, base, stride = self.memories[operation.memory][0].start, MEMORY, self.memory_size
            at = ir.Integer(place) + ir.CELL
        if node.scalar:
            value = ir.call("gather", base + place, FRAME, LAST, stride)
            self.body.append(ir.fixed(self.values.name_scalar(node), value))
        elif self._stays(node, operation):
            self.values.alias(node, base[ir.after(ir.Cast("size_t", FRAME) * stride, at)])
        elif self.turns_maps and (base == MEMORY or len(read) == 1):
            array, size = self.values.take_slot(node), self.schedule.size_of(node)
            start = ir.after(base, ir.Integer(place))
            self.body.append(ir.Do(ir.call("gather_map", array, start, FRAME, LAST, stride, size)))
        else:
            value = ir.call("gather", ir.after(base, at), FRAME, LAST, stride)
            self.over_cells([self.stored(node, value)], node.maps)

    @property
    def turns_maps(self) -> bool:
        """Whether maps come into private arrays of vectors, a frame a lane, many numbers a time."""
        return self.tables.lanes > 1 and self.arena.private

    def _stays(self, node: Node, operation: Input | Read) -> bool:
        """Whether a map is read in place: with one frame per work item, if it does not change."""
        if isinstance(operation, Input):
            return not self.arena.private
        # memories are written in sequence: one that holds another's past value needs a copy
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
            held = [
                self.values.array_of(argument)
                for argument in node.arguments[-operation.weight_maps :]
            ]
            text.body += text.operands.own.declared([array for array in held if array], text.cells)
        numbers = [(user, pick) for user, pick in self.picks[node.index] if user.scalar]
        maps = [(user, pick) for user, pick in self.picks[node.index] if not user.scalar]
        self.body += [ir.declare(self.values.name_scalar(user)) for user, _ in numbers]
        top = self.arena.top
        strategy = self.strategies[node.index] = strategy_of(text)
        figures = run(text, strategy)
        if "settled" not in figures and any(pick.what == "settled" for _, pick in numbers):
            settled_now(text, strategy)
            figures["settled"] = ir.pick(RESTS, ir.ONE, ir.ZERO)
        text.over_cells([self._pick_map(user, pick, text) for user, pick in maps])
        text.body += [
            ir.Assign(self.values.variable(user), figures[pick.what]) for user, pick in numbers
        ]
        self.arena.top = top
        self.body.append(ir.Block(tuple(text.body)))

    def _operands(self, node: Node, operation: Transient) -> Operands:
        values = [self.values.read(argument) for argument in node.arguments]
        roles = operation.by_role(values)
        mask = roles["mask"][0] if roles["mask"] else None
        weights = operation.weights
        own = OwnNumbers.of(weights, operation.template) if operation.weight_maps else None
        return Operands(roles["input"], roles["previous"], roles["state"], roles["bias"], mask, own)

    def _pick_map(self, node: Node, pick: Pick, text: TransientBuilder) -> ir.Statement:
        state = X[text.at(pick.layer)]
        return self.stored(node, state if pick.what == "state" else text.output(state))


def _swept(node: Node) -> int:
    """Return the number of maps that an operation covers, even if it reduces them."""
    return (node.arguments[0] if isinstance(node.operation, Reduce) else node).maps


def _call(operation: Apply, arguments: list[ir.Expression]) -> ir.Expression:
    return formula(operation.function.opencl, **dict(zip("abc", arguments, strict=False)))
