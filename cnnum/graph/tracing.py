"""Single-stepping a plan: every operation, with the machine's memories after it."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.graph.nodes import Apply, Constant, ConstantMap, Loop, Node, Read, Transient
from cnnum.graph.schedule import Schedule


@dataclass(frozen=True, slots=True, eq=False)
class TraceStep:
    """One operation of a program and its result.

    Attributes
    ----------
    number : int
        In the order in which operations run.
    operation : str
    arguments : tuple of int
        Numbers of the steps whose results it read.
    outputs : tuple of str
        Names of the program's outputs that it gives.
    stores : tuple of str
        Memories that hold its result until the next frame.
    origin : str
        The line of the program that asked for it, as "function module:line".
    elementwise : bool
        Whether it is local arithmetic or logic, applied to every cell separately.
    template : bool
        Result of the transient of a template.
    value : (..., rows, cols), (..., maps, rows, cols) or (...) float
    """

    number: int
    operation: str
    arguments: tuple[int, ...]
    outputs: tuple[str, ...]
    stores: tuple[str, ...]
    origin: str
    elementwise: bool
    template: bool
    value: Floats


def everything_kept(schedule: Schedule) -> Schedule:
    """Return the schedule with every operation's result as an output, by its index."""
    kept = {str(node.index): node for node in schedule.nodes if _has_value(node)}
    return replace(schedule, outputs=kept)


def everything_added(schedule: Schedule) -> Schedule:
    """Return the schedule with its outputs, and every operation's result besides them."""
    return replace(schedule, outputs={**schedule.outputs, **everything_kept(schedule).outputs})


def trace_steps(schedule: Schedule, values: Mapping[str, Floats]) -> Iterator[TraceStep]:
    """Yield the operations of a schedule with their results.

    Parameters
    ----------
    schedule : Schedule
        As it runs without a trace: its outputs are those shown.
    values : mapping of str to array
        Its schedule from `everything_kept`.
    """
    shown = [node for node in schedule.nodes if _has_value(node)]
    numbers = {node.index: number for number, node in enumerate(shown)}
    memories = _memories(schedule, numbers)
    for node in shown:
        yield TraceStep(
            number=numbers[node.index],
            operation=_words(node, memories),
            arguments=tuple(numbers[i] for i in _read(node) if i in numbers),
            outputs=tuple(name for name, out in schedule.outputs.items() if out is node),
            stores=tuple(
                name for m, name in memories.items() if schedule.memories[m].store is node
            ),
            origin=node.origin,
            elementwise=isinstance(node.operation, Apply),
            template=any(isinstance(a.operation, Transient) for a in node.arguments),
            value=np.asarray(values[str(node.index)]),
        )


def folds(steps: Sequence[TraceStep]) -> dict[int, int]:
    """Return, by the number of each folded step, the number of the step that shows it.

    Local arithmetic is folded if it is neither an output nor stored. Only local arithmetic of its
    own function may read it.
    """
    known = {step.number: step for step in steps}
    reads = Counter(read for step in steps for read in set(step.arguments))
    into: dict[int, int] = {}
    for step in reversed(steps):  # readers first
        for read in step.arguments if step.elementwise else ():
            inner = known[read]
            kept = inner.outputs or inner.stores or not inner.elementwise or reads[read] > 1
            if not kept and function_of(inner) == function_of(step):
                into[read] = into.get(step.number, step.number)
    return into


def function_of(step: TraceStep) -> str:
    """Return "function module" of a step."""
    return step.origin.rpartition(":")[0] or step.origin


def _has_value(node: Node) -> bool:
    return not isinstance(node.operation, Constant | ConstantMap | Transient | Loop)


def _memories(schedule: Schedule, numbers: Mapping[int, int]) -> dict[int, str]:
    """Return the memories' names; one without is called by the step whose result it holds."""
    return {
        number: _given(memory.read) or f"of step {numbers.get(memory.store.index, number)}"
        for number, memory in schedule.memories.items()
    }


def _given(node: Node) -> str:
    return node.operation.name if isinstance(node.operation, Read) else ""


def _words(node: Node, memories: Mapping[int, str]) -> str:
    if isinstance(node.operation, Read):
        return f"memory {memories[node.operation.memory]}"
    sources = [a for a in node.arguments if isinstance(a.operation, Transient | Loop)]
    return f"{sources[0].operation}: {node.operation}" if sources else str(node.operation)


def _read(node: Node) -> list[int]:
    """Return the indices of a node's arguments, through the transient or loop it picks from."""
    result: list[int] = []
    for argument in node.arguments:
        through = isinstance(argument.operation, Transient | Loop)
        result += [a.index for a in argument.arguments] if through else [argument.index]
    return result
