"""Single-stepping a plan: every operation with what the machine's memories hold after it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats
from cnnum.graph.nodes import Constant, ConstantMap, Loop, Node, Transient
from cnnum.plan import Plan


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
    value : (..., rows, cols) or (...) float
    """

    number: int
    operation: str
    arguments: tuple[int, ...]
    outputs: tuple[str, ...]
    value: Floats


def trace(plan: Plan, frame: ArrayLike) -> Iterator[TraceStep]:
    """Yield each operation of a plan with its result for a frame, or a batch of them.

    The plan is built once more on its engine with every operation's result kept, so what is shown
    is what the device computed; what happens inside a loop shows in the loop's results.

    Raises
    ------
    ArrayError
        If the frame has another shape, or holds NaN or infinity.
    """
    schedule = plan.schedule
    shown = [node for node in schedule.nodes if _has_value(node)]
    kept = {str(node.index): node for node in shown}
    executable = plan.backend.build(replace(schedule, outputs=kept), plan.solvers)
    values = replace(plan, schedule=replace(schedule, outputs=kept), executable=executable)(frame)
    numbers = {node.index: number for number, node in enumerate(shown)}
    for node in shown:
        yield TraceStep(
            number=numbers[node.index],
            operation=_words(node),
            arguments=tuple(numbers[i] for i in _read(node) if i in numbers),
            outputs=tuple(name for name, out in schedule.outputs.items() if out is node),
            value=np.asarray(values[str(node.index)]),
        )


def _has_value(node: Node) -> bool:
    return not isinstance(node.operation, Constant | ConstantMap | Transient | Loop)


def _words(node: Node) -> str:
    sources = [a for a in node.arguments if isinstance(a.operation, Transient | Loop)]
    return f"{sources[0].operation}: {node.operation}" if sources else str(node.operation)


def _read(node: Node) -> list[int]:
    """Return the indices of what a node reads, through the transient or loop it picks from."""
    found: list[int] = []
    for argument in node.arguments:
        through = isinstance(argument.operation, Transient | Loop)
        found += [a.index for a in argument.arguments] if through else [argument.index]
    return found
