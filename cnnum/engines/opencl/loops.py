"""The kernel text of a bounded loop: its body runs while any frame of a work item still runs."""

from typing import TYPE_CHECKING

from cnnum.graph.nodes import CAPTURED, Loop, Node, Parameter, Pick

if TYPE_CHECKING:
    from cnnum.engines.opencl.lowering import Lowering


def lower_loop(lowering: "Lowering", node: Node, loop: Loop, picks: list[Node]) -> None:
    """Append a loop and give its picks the names of what it leaves."""
    start, *rest = node.arguments
    count, tag = len(loop.results), f"l{node.index}"
    carried = {place: n for n in loop.parameters if (place := _place(n)) < CAPTURED}
    _begin(lowering, carried, rest)
    for inner in loop.parameters:
        if _place(inner) >= CAPTURED:
            outer = rest[count + _place(inner) - CAPTURED]
            lowering.values.alias(inner, lowering.values.read(outer))
    lowering.body += [
        f"real {tag}_running = {lowering.values.read(start)}, {tag}_count = ZERO;",
        f"for (int {tag} = 0; {tag} < {loop.limit} && ANY_LANE({tag}_running); ++{tag}) {{",
    ]
    outside, lowering.body = lowering.body, []
    lowering.nodes(loop.nodes, kept=(*_kept(loop), *carried.values()))
    _advance(lowering, loop, carried, tag)
    outside += [f"    {line}" for line in lowering.body]
    lowering.body = [*outside, "}"]
    _leave(lowering, carried, picks, tag)


def _place(node: Node) -> int:
    assert isinstance(node.operation, Parameter)
    return node.operation.place


def _kept(loop: Loop) -> tuple[Node, ...]:
    return (*loop.results, *([loop.again] if loop.again is not None else []))


def _begin(lowering: "Lowering", carried: dict[int, Node], initial: list[Node]) -> None:
    """Append the carried values, set to what they are at first."""
    for place, node in carried.items():
        value = lowering.values.read(initial[place])
        if node.scalar:
            name = lowering.values.name_scalar(node)
            lowering.body.append(f"real {name} = {value};")
        else:
            slot = lowering.values.take_slot(node)
            lowering.over_cells([f"{slot}[i] = {value};"], node.maps)


def _advance(lowering: "Lowering", loop: Loop, carried: dict[int, Node], tag: str) -> None:
    """Append the end of a run: carried values move on in the frames that still run."""
    lowering.body.append("real changed = ZERO;")
    numbers = _moves(lowering, loop, {p: n for p, n in carried.items() if n.scalar}, tag)
    for maps in sorted({n.maps for n in carried.values() if not n.scalar}):
        moving = {p: n for p, n in carried.items() if not n.scalar and n.maps == maps}
        lowering.over_cells(_moves(lowering, loop, moving, tag), maps)
    lowering.body += numbers
    again = "changed" if loop.again is None else lowering.values.read(loop.again)
    lowering.body += [f"{tag}_count += {tag}_running;", f"{tag}_running *= {again};"]
    own = {node.index for node in carried.values()}
    for result in {n.index: n for n in _kept(loop)}.values():
        if result.index not in own:
            lowering.values.free_slot(result)


def _moves(lowering: "Lowering", loop: Loop, moving: dict[int, Node], tag: str) -> list[str]:
    """Return statements that move values on; a body may swap them, so all are read first."""
    read = lowering.values.read
    lines = [f"const real to{p} = {read(loop.results[p])};" for p in moving]
    lines += [
        f"changed = fmax(changed, PICK(to{p} != {read(n)}, {tag}_running, ZERO));"
        for p, n in moving.items()
    ]
    lines += [
        f"{read(n)} = PICK({tag}_running != ZERO, to{p}, {read(n)});" for p, n in moving.items()
    ]
    return lines


def _leave(lowering: "Lowering", carried: dict[int, Node], picks: list[Node], tag: str) -> None:
    names = {
        "iterations": f"{tag}_count",
        "finished": f"PICK({tag}_running != ZERO, ZERO, ONE)",
    }
    picked: set[int] = set()
    for pick in picks:
        assert isinstance(pick.operation, Pick)
        if pick.operation.what == "carried":
            picked.add(pick.operation.layer)
            lowering.values.hand_over(carried[pick.operation.layer], pick)
        else:
            lowering.values.alias(pick, names[pick.operation.what])
    for place, node in carried.items():
        if place not in picked:
            lowering.values.free_slot(node)
    if not any(isinstance(p.operation, Pick) and p.operation.what == "finished" for p in picks):
        lowering.body.append(f"unfinished = fmax(unfinished, {tag}_running);")
