"""The graph of an analogic program: interned nodes, so that equal operations are one node."""

import inspect
import itertools
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType

from cnnum.arrays import Shape
from cnnum.graph.elementwise import ElementOp, ReduceOp
from cnnum.graph.nodes import (
    CAPTURED,
    Apply,
    Constant,
    Memory,
    Node,
    Operation,
    Parameter,
    Reduce,
    Transient,
)

_OURS = ("cnnum.graph.", "cnnum.programs.", "cnnum.engine", "cnnum.runs.")
"""Modules of the language itself: the line that is wanted lies outside of them."""

_INNER = frozenset(("<locals>", "<lambda>", "<listcomp>", "<genexpr>", "<dictcomp>", "<setcomp>"))
"""Parts of a name that Python adds: the wanted name is that of the function around them."""


def origin_here() -> str:
    """Return the program's line that asks for an operation now, as "function module:line"."""
    frame: FrameType | None = inspect.currentframe()
    while frame is not None:
        module = str(frame.f_globals.get("__name__", ""))
        if not f"{module}.".startswith(_OURS) and not module.startswith(("cnnum.engine", "numpy")):
            parts = frame.f_code.co_qualname.split(".")
            name = ".".join(part for part in parts if part not in _INNER)
            return f"{name or 'inner'} {module}:{frame.f_lineno}"
        frame = frame.f_back
    return ""


@dataclass(slots=True, eq=False)
class Graph:
    """A program while and after it is traced.

    Attributes
    ----------
    shape : (rows, cols)
    nodes : list of Node
        In an order in which they can run.
    outputs : dict of str to Node
    memories : list of Memory
        By the number that `Read` names.
    shared : int
        How often an operation was asked for that the graph already had.
    parent : Graph or None
        Of a loop's body: the graph that the loop stands in, whose numbers go on here.
    captured : dict
        Of a loop's body: the parent's nodes that it reads, by the number of their parameter.
    traced : Graph or None
        Of the outermost graph: the innermost body that is being traced.
    rate : float or None, Hz
        Frames a second of the streams that it is traced for; None where nothing says.
    timed : bool
        Whether something in it depends on that rate.
    quickest : dict of str to float, Hz
        Highest frequency that an output is made for, where the program says it.
    """

    shape: Shape
    parent: "Graph | None" = None
    captured: "dict[int, Node]" = field(default_factory=dict[int, "Node"])
    traced: "Graph | None" = None
    nodes: list[Node] = field(default_factory=list[Node])
    outputs: dict[str, Node] = field(default_factory=dict[str, Node])
    memories: dict[int, Memory] = field(default_factory=dict[int, Memory])
    shared: int = 0
    rate: float | None = None
    timed: bool = False
    quickest: dict[str, float] = field(default_factory=dict[str, float])
    _numbers: Iterator[int] = field(default_factory=itertools.count)
    _interned: dict[tuple[Operation, tuple[int, ...]], Node] = field(
        default_factory=dict[tuple[Operation, tuple[int, ...]], Node]
    )

    def add(
        self,
        operation: Operation,
        *arguments: Node,
        scalar: bool = False,
        logic: bool = False,
        maps: int = 1,
    ) -> Node:
        """Return the node for an operation, the one that is there if it is there."""
        key = (operation, tuple(argument.index for argument in arguments))
        known = self._interned.get(key)
        if known is not None:
            self.shared += isinstance(operation, Apply | Reduce | Transient)
            return known
        node = Node(next(self._numbers), operation, arguments, scalar, logic, maps, origin_here())
        self.nodes.append(node)
        self._interned[key] = node
        return node

    @property
    def outermost(self) -> "Graph":
        """The graph of the program that it belongs to."""
        return self if self.parent is None else self.parent.outermost

    @property
    def innermost(self) -> "Graph":
        """The body that is being traced, in which a loop stands whatever its values are."""
        return self.outermost.traced or self

    @contextmanager
    def body(self) -> "Generator[Graph]":
        """Yield a graph for the body of a loop in this one, while that is traced."""
        inner, whole = Graph(self.shape, parent=self), self.outermost
        inner._numbers = self._numbers
        outer, whole.traced = whole.traced, inner
        try:
            yield inner
        finally:
            whole.traced = outer

    @property
    def depth(self) -> int:
        """How many loops it stands in."""
        return 0 if self.parent is None else 1 + self.parent.depth

    def capture(self, node: Node, home: "Graph") -> Node:
        """Return the parameter of this body that stands for a node of a graph further out."""
        assert self.parent is not None
        outer = node if home is self.parent else self.parent.capture(node, home)
        places = [place for place, known in self.captured.items() if known is outer]
        place = places[0] if places else CAPTURED + len(self.captured)
        self.captured[place] = outer
        return self.like(node, Parameter(place))

    def like(self, node: Node, operation: Operation, *arguments: Node) -> Node:
        """Return the node of an operation whose values are of another node's kind."""
        return self.add(operation, *arguments, scalar=node.scalar, logic=node.logic, maps=node.maps)

    def apply(self, function: ElementOp, *arguments: Node) -> Node:
        """Return local arithmetic or logic on nodes; scalars stand for the same in every cell.

        Maps are all single ones, or stacks of as many maps.
        """
        scalar = all(argument.scalar for argument in arguments)
        logic = function.logic or (
            function.name == "select" and all(argument.logic for argument in arguments[1:])
        )
        maps = max(argument.maps for argument in arguments)
        return self.add(Apply(function), *arguments, scalar=scalar, logic=logic, maps=maps)

    def reduce(self, function: ReduceOp, argument: Node) -> Node:
        """Return a global read-out of a map, or of all maps of a stack."""
        return self.add(Reduce(function), argument, scalar=True, logic=function.logic)

    def constant(self, value: float) -> Node:
        """Return the node of a number."""
        return self.add(Constant(float(value)), scalar=True)
