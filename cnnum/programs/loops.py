"""Bounded loops and branches inside a program, and local logic by truth table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from numbers import Integral
from typing import cast

from cnnum.errors import ProgramError
from cnnum.graph.nodes import Graph, Loop, Node, Parameter, Pick
from cnnum.graph.schedule import reached
from cnnum.programs.fields import Field, as_field, graph_of
from cnnum.safety.values import expect


def logic(table: str, a: Field, b: Field) -> Field:
    """Return one of the sixteen logic functions of two logic maps or flags.

    Parameters
    ----------
    table : str
        The function's values for (a, b) = (0, 0), (0, 1), (1, 0), (1, 1): "0001" is AND, "0111"
        OR, "0110" XOR, "1110" NAND, "1101" a → b…
    a, b : logic Field

    Raises
    ------
    ProgramError
        If the table is not four digits of 0 and 1, or a or b is not a logic field.
    """
    for name, value, kind in (("table", table, str), ("a", a, Field), ("b", b, Field)):
        expect(name, value, kind, ProgramError)
    if len(table) != 4 or set(table) - {"0", "1"}:
        raise ProgramError(
            f"A logic table must be four digits of 0 and 1, such as '0110', got {table!r:.60}."
        )
    minterms = [~a & ~b, ~a & b, a & ~b, a & b]
    wanted = [term for term, value in zip(minterms, table, strict=True) if value == "1"]
    return reduce(Field.__or__, wanted) if wanted else a & ~a & b  # a map if either is


LONGEST_LOOP = 2**31 - 1
"""Rounds that kernels can count."""

Until = Callable[..., object]
Body = Callable[..., Field | Sequence[Field]]


@dataclass(frozen=True, slots=True)
class Looped:
    """The results of a loop.

    Attributes
    ----------
    values : tuple of Field
        The carried values at the end.
    iterations : Field
        How often the body ran, one number per frame.
    finished : Field
        A flag: the loop ended by itself, not at its limit. A plan that does not read it refuses
        to give the results of a loop that did not finish.
    """

    values: tuple[Field, ...]
    iterations: Field
    finished: Field

    @property
    def value(self) -> Field:
        """The only carried value.

        Raises
        ------
        ProgramError
            If there are several.
        """
        if len(self.values) != 1:
            raise ProgramError(f"The loop carries {len(self.values)} values: take one of .values.")
        return self.values[0]


def loop(body: Body, *values: Field, limit: int, until: Until | None = None) -> Looped:
    """Run a body repeatedly on its own results, at most `limit` times.

    Parameters
    ----------
    body : callable
        Takes the carried fields and returns their next values, one field each. It may read fields
        from outside the loop, but cannot store memories.
    values : Field
        Initial values of the carried fields.
    limit : int
        Maximum number of iterations. A loop that reaches it raises an error unless the program
        reads `Looped.finished`; exported C sets `unfinished` in its answers.
    until : callable, optional
        Takes the new values and returns a flag that ends the loop. By default, the loop ends when
        no carried value changes any more.

    Raises
    ------
    ProgramError
        If the body does not return one field per value, or a map becomes a number.
    """
    graph = graph_of(values).innermost
    start = graph.constant(1.0)
    return _loop(graph, start, body, [as_field(graph, v) for v in values], limit, until)


def branch(flag: Field, body: Body, *values: Field) -> tuple[Field, ...]:
    """Return the results of the body in the frames where a flag holds, and the values elsewhere.

    The body does not run if no frame of a batch needs it.

    Raises
    ------
    ProgramError
        If the flag is not one logic value per frame, or the results of the body do not fit the
        values.
    """
    expect("flag", flag, Field, ProgramError)
    if not (flag.scalar and flag.logic):
        raise ProgramError("A branch needs a flag, one logic value per frame.")
    graph = graph_of((flag, *values)).innermost
    carried = [as_field(graph, value) for value in values]
    looped = _loop(graph, as_field(graph, flag).node, body, carried, 1, _at_once)
    return looped.values


def _at_once(*_: Field) -> float:
    """End a loop after its first run."""
    return 1.0


def _loop(
    graph: Graph,
    start: Node,
    body: Body,
    values: list[Field],
    limit: int,
    until: Until | None,
) -> Looped:
    if not isinstance(limit, Integral) or not 1 <= limit <= LONGEST_LOOP:
        raise ProgramError(
            f"A loop's limit must be a whole number from 1 to {LONGEST_LOOP}, got {limit!r:.60}."
        )
    for name, function in (("body", body), ("until", until)):
        if not (callable(function) or (function is None and name == "until")):
            raise ProgramError(
                f"'{name}' of a loop must be a function of its carried fields, got "
                f"{type(function).__name__}."
            )
    with graph.body() as inner:
        given = [Field(inner, inner.like(v.node, Parameter(k))) for k, v in enumerate(values)]
        results = _results(inner, body(*given), values)
        again = _again(inner, until, results)
    nodes = _thinned(inner, [result.node for result in results], again)
    operation = Loop(nodes, tuple(result.node for result in results), again, int(limit))
    captured = [inner.captured[place] for place in sorted(inner.captured)]
    node = graph.add(operation, start, *(v.node for v in values), *captured)
    return _looped(graph, node, values)


def _again(inner: Graph, until: Until | None, results: list[Field]) -> Node | None:
    if until is None:
        return None
    ends = as_field(inner, until(*results))
    if not ends.scalar:
        raise ProgramError("'until' of a loop must return a flag, one logic value per frame.")
    return (~ends).node if ends.logic else inner.constant(0.0)


def _results(inner: Graph, returned: Field | Sequence[Field], values: list[Field]) -> list[Field]:
    fields = [returned] if isinstance(returned, Field) else returned
    if not isinstance(cast(object, fields), Sequence) or len(fields) != len(values):
        raise ProgramError(
            f"The body of a loop must return its {len(values)} carried value(s), got "
            f"{_in_words(fields)}."
        )
    results = [as_field(inner, item) for item in fields]
    for was, becomes in zip(values, results, strict=True):
        if (was.scalar, was.maps) != (becomes.scalar, becomes.maps):
            raise ProgramError(
                "A carried value of a loop must remain a map, a stack of equally many maps, "
                "or one number."
            )
        if was.logic and not becomes.logic:
            raise ProgramError(
                "A carried value of a loop that begins as a logic value must stay one: begin with "
                "cnnum.where(flag, 1.0, 0.0) for numbers, or return a comparison."
            )
    return results


def _in_words(returned: object) -> str:
    if isinstance(returned, Sequence):
        return str(len(cast("Sequence[object]", returned)))
    return f"one object of the type {type(returned).__name__}"


def _thinned(inner: Graph, results: list[Node], again: Node | None) -> tuple[Node, ...]:
    live = reached(inner, [*results, *([again] if again is not None else [])])
    carried = {n.index for n in inner.nodes if isinstance(n.operation, Parameter)}
    return tuple(node for node in inner.nodes if node.index in live | carried)


def _looped(graph: Graph, node: Node, values: list[Field]) -> Looped:
    carried = tuple(
        Field(graph, graph.like(v.node, Pick("carried", k), node)) for k, v in enumerate(values)
    )
    return Looped(
        carried,
        Field(graph, graph.add(Pick("iterations"), node, scalar=True)),
        Field(graph, graph.add(Pick("finished"), node, scalar=True, logic=True)),
    )
