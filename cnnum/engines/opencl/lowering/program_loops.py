"""A bounded loop of a program: its body runs while any frame of a work item still runs."""

from typing import TYPE_CHECKING

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import UNFINISHED
from cnnum.graph.nodes import CAPTURED, Loop, Node, Parameter, Pick

if TYPE_CHECKING:
    from cnnum.engines.opencl.lowering.program import Lowering

CHANGED = ir.Name("changed")


def lower_loop(lowering: "Lowering", node: Node, loop: Loop, picks: list[Node]) -> None:
    """Append a loop and give its picks the names of its results."""
    start, *rest = node.arguments
    tag = f"l{node.index}"
    running, count = ir.Name(f"{tag}_running"), ir.Name(f"{tag}_count")
    carried = {place: n for n in loop.parameters if (place := _place(n)) < CAPTURED}
    _begin(lowering, carried, rest)
    for inner in loop.parameters:
        if _place(inner) >= CAPTURED:
            outer = rest[len(loop.results) + _place(inner) - CAPTURED]
            lowering.values.alias(inner, lowering.values.read(outer))
    begun = ((running, lowering.values.read(start)), (count, ir.ZERO))
    lowering.body.append(ir.Declare("real", begun))
    outside, lowering.body = lowering.body, []
    lowering.nodes(loop.nodes, kept=(*_kept(loop), *carried.values()))
    _advance(lowering, loop, carried, running, count)
    rounds = ir.Counted(ir.Name(tag), 0, loop.limit, running, tuple(lowering.body))
    lowering.body = [*outside, rounds]
    _leave(lowering, carried, picks, running, count)


def _place(node: Node) -> int:
    assert isinstance(node.operation, Parameter)
    return node.operation.place


def _kept(loop: Loop) -> tuple[Node, ...]:
    return (*loop.results, *([loop.again] if loop.again is not None else []))


def _begin(lowering: "Lowering", carried: dict[int, Node], initial: list[Node]) -> None:
    """Append the carried values, set to their first values."""
    for place, node in carried.items():
        value = lowering.values.read(initial[place])
        if node.scalar:
            lowering.body.append(ir.declare(lowering.values.name_scalar(node), value))
        else:
            lowering.over_cells([lowering.stored(node, value)], node.maps)


def _advance(
    lowering: "Lowering", loop: Loop, carried: dict[int, Node], running: ir.Name, count: ir.Name
) -> None:
    """Append the end of a run: carried values move on in the frames that still run."""
    lowering.body.append(ir.declare(CHANGED, ir.ZERO))
    numbers = _moves(lowering, loop, {p: n for p, n in carried.items() if n.scalar}, running)
    for maps in sorted({n.maps for n in carried.values() if not n.scalar}):
        moving = {p: n for p, n in carried.items() if not n.scalar and n.maps == maps}
        lowering.over_cells(_moves(lowering, loop, moving, running), maps)
    again = CHANGED if loop.again is None else lowering.values.read(loop.again)
    lowering.body += [*numbers, ir.add(count, running), ir.Assign(running, again, "*=")]
    own = {node.index for node in carried.values()}
    for result in {n.index: n for n in _kept(loop)}.values():
        if result.index not in own:
            lowering.values.free_slot(result)


def _moves(
    lowering: "Lowering", loop: Loop, moving: dict[int, Node], running: ir.Name
) -> list[ir.Statement]:
    """Return statements that move values on; a body may swap them, so all are read first."""
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
    lowering: "Lowering",
    carried: dict[int, Node],
    picks: list[Node],
    running: ir.Name,
    count: ir.Name,
) -> None:
    values = {"iterations": count, "finished": ir.pick(running.differs(ir.ZERO), ir.ZERO, ir.ONE)}
    picked: set[int] = set()
    for node in picks:
        assert isinstance(node.operation, Pick)
        if node.operation.what == "carried":
            picked.add(node.operation.layer)
            lowering.values.hand_over(carried[node.operation.layer], node)
        else:
            lowering.values.alias(node, values[node.operation.what])
    for place, node in carried.items():
        if place not in picked:
            lowering.values.free_slot(node)
    if not any(isinstance(p.operation, Pick) and p.operation.what == "finished" for p in picks):
        lowering.body.append(ir.Assign(UNFINISHED, ir.call("fmax", UNFINISHED, running)))
