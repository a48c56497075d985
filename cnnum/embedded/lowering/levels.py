"""In which order a schedule's operations run: numbers, templates, and one loop over cells a level.

Local operations and read-outs of a level share a loop, so that most values never leave a register.
Values that another loop, a template, a memory or an output needs are stored.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from cnnum.graph.nodes import Apply, Loop, Memory, Node, Parameter, Pick, Reduce, Transient


@dataclass(slots=True, eq=False)
class Level:
    """The operations of one level.

    Attributes
    ----------
    numbers : list of Node
    stages : list of Node
        Transients and loops of the program.
    cells : list of Node
        Local operations and read-outs of maps.
    """

    numbers: list[Node] = field(default_factory=list[Node])
    stages: list[Node] = field(default_factory=list[Node])
    cells: list[Node] = field(default_factory=list[Node])


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Operations by level.

    Attributes
    ----------
    levels : list of Level
    at : dict of int to int
        The level of each node.
    stored : set of int
        Local operations whose map another place needs.
    last : dict of int to int
        The level at which a map is read for the last time.
    """

    levels: list[Level]
    at: dict[int, int]
    stored: set[int]
    last: dict[int, int]


def is_local(node: Node) -> bool:
    """Return whether a node's map is made cell by cell."""
    return isinstance(node.operation, Apply) and not node.scalar


def levels_of(nodes: Iterable[Node], outputs: Iterable[Node], memories: Iterable[Memory]) -> Levels:
    """Return the levels of nodes that are in an order in which they can run."""
    at: dict[int, int] = {}
    levels: list[Level] = []
    stored = {n.index for n in [*outputs, *(m.store for m in memories)] if is_local(n)}
    last: dict[int, int] = {}
    for node in nodes:
        place = max((_after(node, one, at) for one in node.arguments), default=0)
        at[node.index] = place
        while len(levels) <= place:
            levels.append(Level())
        _file(node, levels[place])
        for one in node.arguments:
            last[one.index] = max(place, last.get(one.index, 0))
            apart = isinstance(node.operation, Transient | Loop) or at[one.index] < place
            if is_local(one) and apart:
                stored.add(one.index)
    return Levels(levels, at, stored, last)


def _after(node: Node, argument: Node, at: dict[int, int]) -> int:
    """Return the level from which a node can run, by one argument."""
    known = at.get(argument.index, 0)
    if isinstance(argument.operation, Reduce):
        return known + 1
    staged = isinstance(node.operation, Transient | Loop)
    if staged and is_local(argument):
        return known + 1
    # a number that a template leaves is there before the next level's numbers
    if node.scalar and not isinstance(node.operation, Reduce | Pick) and _staged(argument):
        return known + 1
    return known


def _staged(node: Node) -> bool:
    return isinstance(node.operation, Pick) and node.scalar


def _file(node: Node, level: Level) -> None:
    operation = node.operation
    if isinstance(operation, Transient | Loop):
        level.stages.append(node)
    elif isinstance(operation, Reduce) or is_local(node):
        level.cells.append(node)
    elif node.scalar and not isinstance(operation, Parameter | Pick):  # a stage leaves its picks
        level.numbers.append(node)
