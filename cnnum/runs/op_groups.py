"""Operations of a schedule by the line of the program that asked for them, with their cost."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from cnnum.graph.nodes import Loop, Node, Transient
from cnnum.graph.schedule import Schedule
from cnnum.integrators.cost import FREE, work
from cnnum.integrators.solver import Solver

BYTES = 8
"""Of a number: results are counted as float64, in engines of either precision."""


@dataclass(frozen=True, slots=True)
class OpGroup:
    """Operations that one line of a program asked for.

    Attributes
    ----------
    program : str
        The function, and its module.
    line : int
        Line of the module; 0 where none is known, or for all lines of a function.
    count : int
        Operations, bodies of loops counted once.
    flops : int
        Arithmetic a frame, bodies of loops counted once.
    bytes : int
        Results, as float64.
    live_bytes : int
        Results that wait to be read, of all lines together, at most while these run.
    """

    program: str
    line: int
    count: int
    flops: int
    bytes: int
    live_bytes: int


def op_groups(schedule: Schedule, solvers: dict[int, Solver]) -> tuple[OpGroup, ...]:
    """Return the operations by line, in the order in which the lines first run."""
    live = _live_bytes(schedule)
    found: dict[tuple[str, int], OpGroup] = {}
    for node in schedule.nodes:
        if isinstance(node.operation, FREE):
            continue
        done = work([node], solvers, schedule.shape)
        key = _place(node)
        group = found.get(key, OpGroup(*key, 0, 0, 0, 0))
        found[key] = replace(
            group,
            count=group.count + done.ops,
            flops=group.flops + done.flops,
            bytes=group.bytes + _size(node, schedule),
            live_bytes=max(group.live_bytes, live[node.index]),
        )
    return tuple(found.values())


def by_function(groups: Sequence[OpGroup]) -> tuple[OpGroup, ...]:
    """Return one group a function, the costliest first."""
    found: dict[str, OpGroup] = {}
    for group in groups:
        known = found.get(group.program, OpGroup(group.program, 0, 0, 0, 0, 0))
        found[group.program] = OpGroup(
            group.program,
            0,
            known.count + group.count,
            known.flops + group.flops,
            known.bytes + group.bytes,
            max(known.live_bytes, group.live_bytes),
        )
    return tuple(sorted(found.values(), key=lambda group: -group.flops))


def _place(node: Node) -> tuple[str, int]:
    program, colon, line = node.origin.rpartition(":")
    return (program, int(line)) if colon else (node.origin or "the program itself", 0)


def _size(node: Node, schedule: Schedule) -> int:
    if isinstance(node.operation, Transient | Loop):
        return 0  # other operations pick its results
    return BYTES * (1 if node.scalar else schedule.cells * node.maps)


def _live_bytes(schedule: Schedule) -> dict[int, int]:
    """Return the bytes that wait to be read while each operation runs."""
    last = {node.index: place for place, node in enumerate(schedule.nodes)}
    for place, node in enumerate(schedule.nodes):
        last |= {argument.index: place for argument in node.arguments}
    kept = (*schedule.outputs.values(), *(held.store for held in schedule.memories.values()))
    last |= {node.index: len(schedule.nodes) for node in kept}
    ends: dict[int, list[Node]] = {}
    for node in schedule.nodes:
        ends.setdefault(last[node.index], []).append(node)
    live, found = 0, dict[int, int]()
    for place, node in enumerate(schedule.nodes):
        live += _size(node, schedule)
        found[node.index] = live
        live -= sum(_size(gone, schedule) for gone in ends.get(place, []))
    return found
