"""Linear operations on maps, and chains of them that become one dense product.

Linear operations on maps: the exact answers of templates, and sums of maps.

An affine map of a program's values is kept as one matrix for each value that it reads. The constant
is a map. A linear template without time steps takes such maps to such maps.

A chain is made of templates whose answer is exact without steps, sums, constant multiples and
totals. All that it does to the maps it reads is one matrix for each of them. It is fused where
that takes less arithmetic, and where no output lies between.

Saturation cannot be passed over: a template is in a chain only if its state is an affine map of its
arguments for all numbers. That is so if its output function is linear, or if its cells are
uncoupled and the state is read. An output that saturates ends the chain.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.graph.elementwise import ADD, DIVIDE, MULTIPLY, NEGATE, SUBTRACT, SUM
from cnnum.graph.nodes import (
    Apply,
    Constant,
    ConstantMap,
    Memory,
    Node,
    Operation,
    Pick,
    Product,
    Reduce,
    Transient,
)
from cnnum.graph.schedule import LeftOut, Schedule
from cnnum.integrators.cost import operation_flops
from cnnum.integrators.solver import Linear, Scheme, Solver
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import taps
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """A map as Σ matrix · source + constant, with its cells in row-major order.

    Attributes
    ----------
    parts : dict of int to (cells, cells) float
        Matrix of each source, by the number of the source.
    constant : (cells,) float
    """

    parts: dict[int, Floats]
    constant: Floats

    @classmethod
    def source(cls, number: int, cells: int) -> "Affine":
        """Return a source itself."""
        return cls({number: np.eye(cells)}, np.zeros(cells))

    def of(self, number: int) -> Floats:
        """Return the matrix of a source, which is zero if the source is not read."""
        n = self.constant.size
        return self.parts.get(number, np.zeros((n, n)))


def is_linear(operation: Transient, scheme: Scheme, picks: Sequence[Pick]) -> bool:
    """Return whether a transient's result is an affine map of inputs, states and biases.

    An array whose cells may leave the linear range of the output function is not linear, whatever
    its input. Uncoupled cells are linear, as their states do not depend on outputs.
    """
    if not isinstance(scheme, Linear):
        return False
    if not operation.template.plain or operation.has_mask or operation.has_previous:
        return False
    maps = {"state", "output"} if operation.template.output.linear else {"state"}
    return all(pick.what in maps for pick in picks)


def local(node: Node, arguments: Sequence[Affine], cells: int) -> Affine:
    """Return a sum, a difference, a multiple or the total of affine maps."""
    operation = node.operation
    if isinstance(operation, Constant):
        return Affine({}, np.full(cells, operation.value))
    if isinstance(operation, ConstantMap):
        return Affine({}, operation.values.ravel())
    if isinstance(operation, Reduce):
        return _each(arguments, _total)
    assert isinstance(operation, Apply)
    if operation.function is MULTIPLY:
        fixed, moved = sorted(arguments, key=lambda a: bool(a.parts))
        return _scaled(moved, fixed.constant)
    if operation.function is DIVIDE:
        return _scaled(arguments[0], 1.0 / arguments[1].constant)
    return _each(arguments, lambda *of: operation.function.numpy(*of))


LINEAR = (ADD, SUBTRACT, NEGATE)
"""Local operations that are linear in all they read."""


def is_affine(node: Node, fixed: Sequence[bool]) -> bool:
    """Whether a local operation is linear in its arguments, where some is always the same."""
    operation = node.operation
    if isinstance(operation, Reduce):
        return operation.function is SUM and not node.arguments[0].scalar
    if not isinstance(operation, Apply):
        return isinstance(operation, Constant | ConstantMap)
    if operation.function is MULTIPLY:
        return any(fixed)
    if operation.function is DIVIDE:
        by = node.arguments[1].operation
        return isinstance(by, Constant) and by.value != 0.0
    return operation.function in LINEAR


def _total(value: Floats) -> Floats:
    return np.broadcast_to(value.sum(axis=0), value.shape)


def _each(arguments: Sequence[Affine], function: Callable[..., Floats]) -> Affine:
    numbers = dict.fromkeys(number for a in arguments for number in a.parts)
    parts = {number: np.asarray(function(*(a.of(number) for a in arguments))) for number in numbers}
    return Affine(parts, np.asarray(function(*(a.constant for a in arguments))))


def _scaled(value: Affine, by: Floats) -> Affine:
    parts = {number: part * by[:, np.newaxis] for number, part in value.parts.items()}
    return Affine(parts, value.constant * by)


def states(
    operation: Transient, scheme: Scheme, arguments: Sequence[Affine], shape: Shape
) -> tuple[Affine, ...]:
    """Return the final states of a linear template, one per layer, for affine arguments."""
    assert isinstance(scheme, Linear)
    template, cells = operation.template, shape[0] * shape[1]
    numbers = list(dict.fromkeys(number for a in arguments for number in a.parts))
    # every column of every matrix is a map of its own
    columns = _Given.of(operation, [_columns(a, numbers) for a in arguments], shape)
    moved = _run(template, scheme.still(), columns, shape, still=False)
    constants = [a.constant[np.newaxis] for a in arguments]
    added = _run(template, scheme, _Given.of(operation, constants, shape), shape, still=True)
    result: list[Affine] = []
    for layer in range(template.layers):
        by_source = moved[:, layer].reshape(-1, cells, cells)
        parts = {number: by_source[place].T for place, number in enumerate(numbers)}
        result.append(Affine(parts, added[0, layer].ravel()))
    return tuple(result)


def _columns(value: Affine, numbers: Sequence[int]) -> Floats:
    cells = value.constant.size
    return np.concatenate([np.zeros((0, cells)), *(value.of(number).T for number in numbers)])


@dataclass(frozen=True, slots=True, eq=False)
class _Given:
    """Maps that a template is run on, (batch, maps, rows, cols) by role."""

    batch: int
    roles: dict[str, Floats]

    @classmethod
    def of(cls, operation: Transient, arguments: Sequence[Floats], shape: Shape) -> "_Given":
        roles = {
            role: np.stack(maps, axis=1).reshape(-1, len(maps), *shape)
            for role, maps in operation.by_role(arguments).items()
            if maps
        }
        return cls(len(arguments[0]) if arguments else 1, roles)


def _run(
    template: Template,
    scheme: Linear,
    given: _Given,
    shape: Shape,
    *,
    still: bool,
) -> Floats:
    """Return the states of a batch; constant parts count where `still`."""
    drive = np.zeros((given.batch, template.layers, *shape))
    if "input" in given.roles:
        _add_control(drive, template, given.roles["input"], still=still)
    drive += given.roles.get("bias", 0.0)
    if still:
        drive += template.z[:, np.newaxis, np.newaxis]
    start = _start(template, given.roles, drive.shape, still=still)
    return scheme.reach(start, drive)


def _start(
    template: Template, roles: dict[str, Floats], shape: tuple[int, ...], *, still: bool
) -> Floats:
    if "state" in roles:
        return roles["state"]
    if template.initial == "input":
        return roles["input"]
    return np.full(shape, float(template.initial) if still else 0.0)


def _add_control(drive: Floats, template: Template, maps: Floats, *, still: bool) -> None:
    """Add B∗u."""
    boundary, (rows, cols) = template.input_boundary, drive.shape[-2:]
    radius = template.B.shape[-1] // 2
    padded = _padded(maps, boundary, radius, still=still)
    # the batch lies last: sums of many maps run over neighbours in memory, in a third of the time
    padded = np.moveaxis(padded, 0, -1).copy()
    total, part = (np.zeros((rows, cols, len(drive))) for _ in range(2))
    for layer in range(template.layers):
        total[:] = np.moveaxis(drive[:, layer], 0, -1)
        for tap in taps(template.B, layer):
            top, left = radius + tap.row, radius + tap.col
            seen = padded[tap.source, top : top + rows, left : left + cols]
            total += np.multiply(tap.weight, seen, out=part)
        drive[:, layer] = np.moveaxis(total, -1, 0)


def _padded(maps: Floats, boundary: Boundary, radius: int, *, still: bool) -> Floats:
    width = ((0, 0), (0, 0), (radius, radius), (radius, radius))
    if boundary.pad_mode == "constant":
        edge = float(boundary.constant or 0.0) if still else 0.0
        return np.pad(maps, width, mode="constant", constant_values=edge)
    return np.pad(maps, width, mode=boundary.pad_mode)


FUSED_CELLS = 256
"""Largest array whose chains are fused. The matrices of 16×16 cells take 256 kB each. At 23×23 they
take 1 MB each, and no longer stay in a core's cache."""

Sources = Mapping[int, frozenset[int]]
"""The linear operations of a schedule, and the outside arguments of each, by index."""


def fuse(schedule: Schedule, solvers: Mapping[int, Solver]) -> Schedule:
    """Return the schedule with chains of linear operations fused where that is cheaper."""
    if schedule.cells > FUSED_CELLS:
        return schedule
    chains = _Chains.of(schedule, solvers)
    chosen = chains.cheapest()
    if not chosen:
        return schedule
    result = _rewritten(schedule, _products(chains, chosen))
    item = LeftOut(
        _what(chains, result),
        f"linear, and nothing reads the values between: fused into {len(chosen)} dense products",
        0,
        chains.flops(frozenset()) - chains.flops(chosen),
    )
    return replace(result, left_out=(*schedule.left_out, item))


def _sources(schedule: Schedule, solvers: Mapping[int, Solver]) -> dict[int, frozenset[int]]:
    """Return the arguments of linear operations, at first hand or through other linear ones."""
    picks: dict[int, list[Pick]] = {}
    for node in schedule.nodes:
        if isinstance(node.operation, Pick):
            picks.setdefault(node.arguments[0].index, []).append(node.operation)
    result: dict[int, frozenset[int]] = {}
    for node in schedule.nodes:
        # a number that is not constant is not worth a matrix
        if any(argument.scalar and argument.index not in result for argument in node.arguments):
            continue
        # nor are stacks, which no transient can read
        if any(operand.maps > 1 for operand in (node, *node.arguments)):
            continue
        operation = node.operation
        if isinstance(operation, Transient):
            scheme = solvers[node.index].scheme
            kept = is_linear(operation, scheme, picks.get(node.index, []))
        elif isinstance(operation, Pick):
            kept = node.arguments[0].index in result
        else:
            kept = is_affine(node, [result.get(a.index) == frozenset() for a in node.arguments])
        if kept:
            reads = (result.get(a.index, frozenset({a.index})) for a in node.arguments)
            result[node.index] = frozenset[int]().union(*reads)
    return result


@dataclass(frozen=True, slots=True, eq=False)
class _Chains:
    """The linear operations of a schedule.

    Attributes
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    sources : mapping of int to set of int
    roots : tuple of Node
        Maps that something else reads, whose product takes less arithmetic than all they are
        made of.
    others : tuple of Node
        Linear operations that something else reads too, and that are not to be fused.
    """

    schedule: Schedule
    solvers: Mapping[int, Solver]
    sources: Sources
    roots: tuple[Node, ...] = ()
    others: tuple[Node, ...] = ()

    @classmethod
    def of(cls, schedule: Schedule, solvers: Mapping[int, Solver]) -> "_Chains":
        """Return the chains of a schedule."""
        result = cls(schedule, solvers, _sources(schedule, solvers))
        roots, others = list[Node](), list[Node]()
        for node in result._read_outside():
            worth = not node.scalar and bool(result.sources[node.index])
            below = result._flops_of(result.below([node])) if worth else 0
            (roots if below > result._dense(node) else others).append(node)
        return replace(result, roots=tuple(roots), others=tuple(others))

    def _read_outside(self) -> list[Node]:
        kept = [*self.schedule.outputs.values()]
        kept += [memory.store for memory in self.schedule.memories.values()]
        for node in self.schedule.nodes:
            if node.index not in self.sources:
                kept += node.arguments
        return list({n.index: n for n in kept if n.index in self.sources}.values())

    def below(self, nodes: Iterable[Node], fused: frozenset[int] = frozenset()) -> dict[int, Node]:
        """Return linear operations that nodes are made of, themselves among them.

        The product stands there without the operations that it is made of.
        """
        seen: dict[int, Node] = {}
        stack = list(nodes)
        while stack:
            node = stack.pop()
            if node.index in self.sources and node.index not in seen and node.index not in fused:
                seen[node.index] = node
                stack += node.arguments
        return seen

    def _flops_of(self, nodes: Mapping[int, Node]) -> int:
        shape = self.schedule.shape
        return sum(operation_flops(n, self.solvers.get(i), shape) for i, n in nodes.items())

    def _dense(self, node: Node) -> int:
        return 2 * self.schedule.cells**2 * len(self.sources[node.index])

    def flops(self, fused: frozenset[int]) -> int:
        """Return the arithmetic of all chains where these roots are fused."""
        left = [node for node in self.roots if node.index not in fused]
        dense = sum(self._dense(node) for node in self.roots if node.index in fused)
        return dense + self._flops_of(self.below([*left, *self.others], fused))

    def cheapest(self) -> frozenset[int]:
        """Return the roots to fuse: all that pay, beginning with all; none where that is less.

        One root at a time is taken in or out as long as that saves arithmetic.
        """
        fused = frozenset(node.index for node in self.roots)
        least, moved = self.flops(fused), True
        while moved:
            moved = False
            for node in self.roots:
                other = fused ^ {node.index}
                if (flops := self.flops(other)) < least:
                    fused, least, moved = other, flops, True
        return fused if least < self.flops(frozenset()) else frozenset()


def _products(chains: _Chains, chosen: frozenset[int]) -> dict[int, Node]:
    """Return the product that stands for each chosen root."""
    schedule, cells = chains.schedule, chains.schedule.cells
    nodes = {node.index: node for node in schedule.nodes}
    inside = chains.below(nodes[index] for index in chosen)
    last = {a.index: index for index in sorted(inside) for a in inside[index].arguments}
    values: dict[int, tuple[Affine, ...]] = {}
    result: dict[int, Node] = {}
    for index in sorted(inside):
        node = inside[index]
        values[index] = _value(node, values, chains, cells)
        if index in chosen:
            result[index] = _product(node, values[index][0], chains, nodes)
        for argument in node.arguments:  # matrices are large
            if last[argument.index] == index:
                values.pop(argument.index, None)
    return result


def _value(
    node: Node, values: Mapping[int, tuple[Affine, ...]], chains: _Chains, cells: int
) -> tuple[Affine, ...]:
    """Return the affine map of a node; of a template, that of every layer."""
    operation = node.operation
    if isinstance(operation, Pick):
        return (values[node.arguments[0].index][operation.layer],)
    arguments = [
        values[a.index][0] if a.index in values else Affine.source(a.index, cells)
        for a in node.arguments
    ]
    if isinstance(operation, Transient):
        scheme = chains.solvers[node.index].scheme
        return states(operation, scheme, arguments, chains.schedule.shape)
    return (local(node, arguments, cells),)


def _product(node: Node, value: Affine, chains: _Chains, nodes: Mapping[int, Node]) -> Node:
    parts = {number: matrix for number, matrix in value.parts.items() if matrix.any()}
    operation: Operation = Product(tuple(parts.values()), value.constant)
    if not parts:  # all arguments cancel
        operation = ConstantMap.of(value.constant.reshape(chains.schedule.shape))
    read = tuple(nodes[n] for n in parts)
    return Node(node.index, operation, read, scalar=False, logic=False, origin=node.origin)


def _rewritten(schedule: Schedule, products: Mapping[int, Node]) -> Schedule:
    """Return the schedule with products in the place of nodes, and without unread ones."""
    new: dict[int, Node] = {}
    for node in schedule.nodes:
        moved = products.get(node.index, node)
        arguments = tuple(new[argument.index] for argument in moved.arguments)
        new[node.index] = replace(moved, arguments=arguments)
    outputs = {name: new[node.index] for name, node in schedule.outputs.items()}
    memories = {
        number: Memory(new[memory.read.index], new[memory.store.index])
        for number, memory in schedule.memories.items()
    }
    stack = [*outputs.values(), *(n for m in memories.values() for n in (m.read, m.store))]
    live = set[int]()
    while stack:
        node = stack.pop()
        if node.index not in live:
            live.add(node.index)
            stack += node.arguments
    nodes = tuple(node for node in new.values() if node.index in live)
    return replace(schedule, nodes=nodes, outputs=outputs, memories=memories)


def _what(chains: _Chains, fused: Schedule) -> str:
    """Return in words the operations that no longer run."""
    left = {node.index for node in fused.nodes}
    gone = [n.operation for n in chains.schedule.nodes if n.index not in left]
    names = Counter(str(operation) for operation in gone if isinstance(operation, Transient))
    others = sum(not isinstance(operation, Transient | Pick) for operation in gone)
    parts = [f"{count} × {name}" for name, count in names.items()]
    return ", ".join([*parts, f"{others} local and global operations"])
