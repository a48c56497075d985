"""A bounded loop of a program: its body runs while any frame of a work item still runs."""

from typing import TYPE_CHECKING

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import UNFINISHED
from cnnum.graph.nodes import CAPTURED, Loop, Node, Parameter, Pick

if TYPE_CHECKING:
    from cnnum.engines.opencl.lowering.program import Lowering

CHANGED = ir.Name("changed")

Picks = list[tuple[Node, Pick]]


def lower_loop(lowering: "Lowering", node: Node, loop: Loop, picks: Picks) -> None:
    """Append a loop and give its picks the names of its results."""
    values, tag = lowering.values, f"l{node.index}"
    start, *rest = node.arguments
    running, count = ir.names(f"{tag}_running {tag}_count")
    carried: dict[int, Node] = {}
    for inner in loop.parameters:
        assert isinstance(inner.operation, Parameter)
        if (place := inner.operation.place) < CAPTURED:
            carried[place] = inner
        else:
            values.alias(inner, values.read(rest[len(loop.results) + place - CAPTURED]))
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
    lowering: "Lowering", carried: dict[int, Node], picks: Picks, running: ir.Name, count: ir.Name
) -> None:
    """Give picks the names of results, and give back the arrays of other carried values."""
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
