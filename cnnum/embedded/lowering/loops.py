"""Loops of a program that end where nothing changes, or where a flag of theirs falls."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cnnum import kernels as ir
from cnnum.embedded.arithmetic.fixed import Quantity
from cnnum.embedded.arithmetic.primitives import LOGIC
from cnnum.embedded.arithmetic.whole import call, opposite
from cnnum.embedded.program import Array
from cnnum.graph.nodes import CAPTURED, Loop, Node, Parameter, Pick

if TYPE_CHECKING:
    from cnnum.embedded.lowering.schedules import Lowering


@dataclass(frozen=True, slots=True)
class Carried:
    """A value that rounds hand on: a map in an array, or a number in a variable.

    Attributes
    ----------
    array : Array
        Of a number: its format, and its name.
    scalar : bool
    """

    array: Array
    scalar: bool


def lower_loop(work: "Lowering", node: Node) -> None:
    """Write a loop; its results that are read become known to the work.

    Raises
    ------
    NotSupportedError
        If something in it has no form in whole numbers.
    """
    loop, to = node.operation, work.to
    assert isinstance(loop, Loop)
    start, *rest = node.arguments
    carried = [
        _carried(work, f"c{node.index}_{k}", one, result)
        for k, (one, result) in enumerate(zip(rest, loop.results, strict=False))
    ]
    running = ir.Name(f"running{node.index}", LOGIC)
    rounds = ir.Name(f"rounds{node.index}", (0, loop.limit))
    to.body += [ir.declare(running, _flag(work, start)), ir.declare(rounds, 0)]
    with to.within() as body:
        again = _round(work, node, carried, rest[len(loop.results) :])
        more = call("add", rounds, ir.Integer(1))
        to.body.append(ir.Assign(rounds, call("minimum", more, ir.Integer(loop.limit))))
        to.body.append(ir.Assign(running, again))
    to.body.append(ir.Counted(ir.ROUND, 0, loop.limit, running, tuple(body)))
    _picked(work, node, carried, running, rounds)


def _flag(work: "Lowering", node: Node) -> ir.Expression:
    one = work.numbers[node.index]
    return one.value if one.exact is None else ir.Integer(int(one.exact != 0))


def _carried(work: "Lowering", name: str, start: Node, result: Node) -> Carried:
    """Write the value before the first round."""
    to, logic = work.to, start.logic and result.logic
    if result.scalar:
        form = to.formats.register(name)
        array = Array(name, "work", 0, None if logic else form, logic=logic)
        begun = to.stored(work.numbers[start.index], array)
        to.body.append(ir.declare(ir.Name(name, array.bounds or begun.bounds), begun))
        to.fractions[name] = 0 if array.format is None else array.format.fraction
        return Carried(array, scalar=True)
    form = to.formats.kept(name)
    array = to.array(name, "work", to.cells, form, "carried by a loop", logic=logic)
    known = dict(work.numbers)
    with to.within() as body:
        to.store(array, work.operand(start))
    work.numbers = known
    to.loop(body)
    return Carried(array, scalar=False)


def _round(
    work: "Lowering", node: Node, carried: list[Carried], captured: list[Node]
) -> ir.Expression:
    """Write a round; return whether another one follows."""
    loop, to = node.operation, work.to
    assert isinstance(loop, Loop)
    results = [*loop.results, *([] if loop.again is None else [loop.again])]
    inner = work.body_of(replace(work.schedule, nodes=loop.nodes, outputs={}, memories={}), results)
    for one in loop.parameters:
        operation = one.operation
        assert isinstance(operation, Parameter)
        if operation.place >= CAPTURED:
            outer = captured[operation.place - CAPTURED]
            if outer.scalar:
                inner.numbers[one.index] = work.numbers[outer.index]
            else:
                inner.maps[one.index] = work.maps[outer.index]
            continue
        known = carried[operation.place]
        if known.scalar:
            inner.numbers[one.index] = _number(known.array)
        else:
            inner.maps[one.index] = known.array
    inner.levelwise()
    changed = ir.Name(f"changed{node.index}", LOGIC)
    to.body.append(ir.declare(changed, 0))
    _hand_on(inner, loop, carried, changed)
    if loop.again is not None:
        return _flag(inner, loop.again)
    return changed


def _number(array: Array) -> Quantity:
    fraction = 0 if array.format is None else array.format.fraction
    return Quantity(ir.Name(array.name, array.bounds), fraction)


def _hand_on(inner: "Lowering", loop: Loop, carried: list[Carried], changed: ir.Name) -> None:
    """Write the values of the next round; all are read before any is written."""
    to = inner.to
    maps = [(one, n) for one, n in zip(carried, loop.results, strict=True) if not one.scalar]
    numbers = [(one, n) for one, n in zip(carried, loop.results, strict=True) if one.scalar]
    known, last = dict(inner.numbers), list[ir.Statement]()
    for one, result in numbers:
        old = ir.Name(one.array.name, one.array.bounds)
        new = Quantity(to.stored(inner.numbers[result.index], one.array), 0)
        value = to.let(f"new_{old.text}", new).value
        moved = opposite(call("equal", value, old))
        last += [ir.Assign(changed, call("or", changed, moved)), ir.Assign(old, value)]
    with to.within() as body:
        values = [(one.array, inner.operand(result)) for one, result in maps]
        news = [
            (array, to.let(f"new_{array.name}", Quantity(to.stored(one, array), 0)).value)
            for array, one in values
        ]
        for array, value in news:
            moved = opposite(call("equal", value, to.item(array).value))
            to.body += [ir.Accumulate(changed, "maximum", moved), to.store_to(array, value)]
    inner.numbers = known
    to.loop(body)
    to.body += last


def _picked(
    work: "Lowering", node: Node, carried: list[Carried], running: ir.Name, rounds: ir.Name
) -> None:
    to = work.to
    for user in work.schedule.nodes:
        pick = user.operation
        if not isinstance(pick, Pick) or user.arguments[0] is not node:
            continue
        if pick.what == "carried":
            one = carried[pick.layer]
            if one.scalar:
                work.numbers[user.index] = _number(one.array)
            else:
                work.maps[user.index] = one.array
        elif pick.what == "finished":
            work.numbers[user.index] = Quantity(opposite(running))
        else:
            count: ir.Expression = rounds if to.integer else call("to_real", rounds)
            work.numbers[user.index] = Quantity(count)
