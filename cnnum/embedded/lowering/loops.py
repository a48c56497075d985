"""Loops of a program that end where nothing changes, or where a flag of theirs falls."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cnnum.embedded.arithmetic.fixed import Quantity
from cnnum.embedded.ir.expressions import Expression, Name, Whole, call
from cnnum.embedded.ir.primitives import LOGIC
from cnnum.embedded.ir.statements import Array, Fold, Let, Rounds, Set, Statement, Store
from cnnum.embedded.lowering.builder import CELL
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
    running, rounds = f"running{node.index}", f"rounds{node.index}"
    to.body.append(Let(running, _flag(work, start), LOGIC))
    to.body.append(Let(rounds, Whole(0), (0, loop.limit)))
    with work.within() as body:
        again = _round(work, node, carried, rest[len(loop.results) :])
        more = call("add", Name(rounds, (0, loop.limit)), Whole(1))
        to.body.append(Set(rounds, call("minimum", more, Whole(loop.limit))))
        to.body.append(Set(running, again))
    to.body.append(Rounds(running, loop.limit, tuple(body)))
    _picked(work, node, carried, Name(running, LOGIC), Name(rounds, (0, loop.limit)))


def _flag(work: "Lowering", node: Node) -> Expression:
    one = work.numbers[node.index]
    return one.value if one.exact is None else Whole(int(one.exact != 0))


def _carried(work: "Lowering", name: str, start: Node, result: Node) -> Carried:
    """Write the value before the first round."""
    to, logic = work.to, start.logic and result.logic
    if result.scalar:
        form = to.formats.register(name)
        array = Array(name, "work", 0, None if logic else form, logic=logic)
        to.body.append(Let(name, to.stored(work.numbers[start.index], array), array.bounds))
        to.fractions[name] = 0 if array.format is None else array.format.fraction
        return Carried(array, scalar=True)
    form = to.formats.kept(name)
    array = to.array(name, "work", to.cells, form, "carried by a loop", logic=logic)
    known = dict(work.numbers)
    with work.within() as body:
        to.store(array, work.operand(start))
    work.numbers = known
    to.loop(body)
    return Carried(array, scalar=False)


def _round(
    work: "Lowering", node: Node, carried: list[Carried], captured: list[Node]
) -> Expression:
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
    changed = f"changed{node.index}"
    to.body.append(Let(changed, Whole(0), LOGIC))
    _hand_on(inner, loop, carried, changed)
    if loop.again is not None:
        return _flag(inner, loop.again)
    return Name(changed, LOGIC)


def _number(array: Array) -> Quantity:
    fraction = 0 if array.format is None else array.format.fraction
    return Quantity(Name(array.name, array.bounds), fraction)


def _hand_on(inner: "Lowering", loop: Loop, carried: list[Carried], changed: str) -> None:
    """Write the values of the next round; all are read before any is written."""
    to = inner.to
    maps = [(one, n) for one, n in zip(carried, loop.results, strict=True) if not one.scalar]
    numbers = [(one, n) for one, n in zip(carried, loop.results, strict=True) if one.scalar]
    known, last = dict(inner.numbers), list[Statement]()
    for one, result in numbers:
        name = one.array.name
        new = Quantity(to.stored(inner.numbers[result.index], one.array), 0)
        value = to.let(f"new_{name}", new).value
        moved = call("not", call("equal", value, Name(name, one.array.bounds)))
        last += [Set(changed, call("or", Name(changed, LOGIC), moved)), Set(name, value)]
    with inner.within() as body:
        values = [(one.array, inner.operand(result)) for one, result in maps]
        news = [
            (array, to.let(f"new_{array.name}", Quantity(to.stored(one, array), 0)).value)
            for array, one in values
        ]
        for array, value in news:
            moved = call("not", call("equal", value, to.item(array).value))
            to.body += [Fold(changed, "maximum", moved), Store(array.name, CELL, value)]
    inner.numbers = known
    to.loop(body)
    to.body += last


def _picked(
    work: "Lowering", node: Node, carried: list[Carried], running: Name, rounds: Name
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
            work.numbers[user.index] = Quantity(call("not", running))
        else:
            count: Expression = rounds if to.integer else call("to_real", rounds)
            work.numbers[user.index] = Quantity(count)
