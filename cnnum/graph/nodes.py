"""The graph of an analogic program: its nodes, each operation once, and what they stand for."""

import inspect
import itertools
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import TypeVar

from cnnum.arrays import Floats, Shape, digest, frozen
from cnnum.graph.elementwise import ElementOp, ReduceOp
from cnnum.templating.batch import stand_ins
from cnnum.templating.template import Duration, Template

Argument = TypeVar("Argument")


@dataclass(frozen=True, slots=True)
class Input:
    """One channel of the frame."""

    channel: str

    def __str__(self) -> str:
        return f"channel {self.channel}"


@dataclass(frozen=True, slots=True)
class FirstFrame:
    """A flag that holds on the first frame of a stream, when memories hold nothing yet."""

    def __str__(self) -> str:
        return "first frame?"


@dataclass(frozen=True, slots=True)
class Constant:
    """The same number in every cell of every frame."""

    value: float

    def __str__(self) -> str:
        return f"{self.value:g}"


@dataclass(frozen=True, slots=True)
class ConstantMap:
    """A map, or a stack of maps, that is the same in every frame; compared by content."""

    content: str
    values: Floats = field(compare=False)

    @classmethod
    def of(cls, values: Floats) -> "ConstantMap":
        """Return the operation for (rows, cols) values; maps of a stack are below each other."""
        return cls(digest(values), frozen(values))

    def __str__(self) -> str:
        return "constant map"


@dataclass(frozen=True, slots=True)
class Apply:
    """Local arithmetic or logic."""

    function: ElementOp

    def __str__(self) -> str:
        return self.function.name


@dataclass(frozen=True, slots=True)
class Reduce:
    """A global read-out: a map becomes one number."""

    function: ReduceOp

    def __str__(self) -> str:
        return f"global {self.function.name}"


@dataclass(frozen=True, slots=True)
class Read:
    """A memory's value at the end of the frame before (0 on the first)."""

    memory: int
    name: str = ""

    def __str__(self) -> str:
        return f"memory {self.name or self.memory}"


@dataclass(frozen=True, slots=True)
class RunSpec:
    """Duration, method and tolerances of a run; None means the default of the template or engine.

    Attributes
    ----------
    duration : float, "settle" or None
        In the unit of the template's τ.
    method : str
        Name of an integration method, or "auto".
    rtol, atol : float
        Requested relative and absolute error of the state.
    dt : float or None
        Fixed step, in the unit of the template's τ.
    settle_limit : float
        Time after which a run to equilibrium gives up and reports so, in time constants of the
        slowest layer.
    force : bool
        Allow a fixed step outside the stability bound; the result is marked.
    estimate : bool
        Also estimate the error of fixed steps, which takes more evaluations of the rates per step.
    """

    duration: Duration | None = None
    method: str = "auto"
    rtol: float = 1e-4
    atol: float = 1e-5
    dt: float | None = None
    settle_limit: float = 1000.0
    force: bool = False
    estimate: bool = False


@dataclass(frozen=True, slots=True)
class Transient:
    """A template's transient.

    Arguments: its inputs, its inputs before the start, state and bias (one per layer), and mask. If
    each frame has its own template, maps follow whose cells hold the frame's numbers.
    """

    template: Template = field(compare=False)
    content: str
    spec: RunSpec
    has_previous: bool
    has_state: bool
    has_bias: bool
    has_mask: bool
    weight_maps: int = 0

    def roles(self) -> tuple[tuple[str, int], ...]:
        """Return the roles of the arguments in their order, and how many maps each takes."""
        inputs, layers = self.template.inputs, self.template.layers
        return (
            ("input", inputs),
            ("previous", inputs if self.has_previous else 0),
            ("state", layers if self.has_state else 0),
            ("bias", layers if self.has_bias else 0),
            ("mask", 1 if self.has_mask else 0),
            ("weights", self.weight_maps),
        )

    @property
    def weights(self) -> tuple[float, ...]:
        """The placeholder values in the template for per-frame weights, in order."""
        return stand_ins(self.template) if self.weight_maps else ()

    def by_role(self, arguments: Sequence[Argument]) -> dict[str, tuple[Argument, ...]]:
        """Return the arguments by role; a role that is not given is an empty tuple."""
        result: dict[str, tuple[Argument, ...]] = {}
        at = 0
        for role, count in self.roles():
            result[role] = tuple(arguments[at : at + count])
            at += count
        return result

    def __str__(self) -> str:
        return f"template {self.template.name}"


@dataclass(frozen=True, slots=True)
class Parameter:
    """Inside a loop's body: the value of one of the loop's arguments."""

    place: int

    def __str__(self) -> str:
        return f"loop value {self.place}"


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A bounded loop. Arguments: the flag to start, the carried values, the captures of the body.

    The body runs while its flag `again` holds (without one: while any carried value changes) and
    at most `limit` times; frames of a batch stop on their own.

    Attributes
    ----------
    nodes : tuple of Node
        The body, in the order in which it runs; `Parameter`s are among them.
    results : tuple of Node
        The carried values after the body.
    again : Node or None
        One flag per frame.
    limit : int
    """

    nodes: tuple["Node", ...]
    results: tuple["Node", ...]
    again: "Node | None"
    limit: int

    def __str__(self) -> str:
        return f"loop of at most {self.limit}"

    @property
    def carried(self) -> dict[int, "Node"]:
        """The body's parameters of carried values that anything reads, by the value's number."""
        return {place: node for place, node in self._parameters() if place < CAPTURED}

    @property
    def captured(self) -> dict[int, "Node"]:
        """The body's parameters of captured values that anything reads, by the value's number."""
        return {place - CAPTURED: node for place, node in self._parameters() if place >= CAPTURED}

    def _parameters(self) -> "Iterator[tuple[int, Node]]":
        for node in self.nodes:
            if isinstance(node.operation, Parameter):
                yield node.operation.place, node


@dataclass(frozen=True, slots=True, eq=False)
class Product:
    """The sum of a chain of linear operations: Σ matrix · argument + constant.

    Attributes
    ----------
    matrices : tuple of (cells, cells) float
        One per argument, cells row-major.
    constant : (cells,) float
    """

    matrices: tuple[Floats, ...]
    constant: Floats

    def __str__(self) -> str:
        return f"product with {len(self.matrices)} matrices"


@dataclass(frozen=True, slots=True)
class Pick:
    """One of several answers: of a transient, a layer's output or state, or a figure of its run.

    Of a transient `what` is "output", "state", "time", "steps", "settled" or "error". Of a loop it
    is "carried", "iterations" or "finished".
    """

    what: str
    layer: int = 0

    def __str__(self) -> str:
        return f"{self.what} {self.layer}"


Operation = (
    Input
    | FirstFrame
    | Constant
    | ConstantMap
    | Apply
    | Reduce
    | Read
    | Transient
    | Parameter
    | Loop
    | Product
    | Pick
)

CAPTURED = 1000
"""Parameters of a loop's body from this number on are captured; those below are carried."""

FIGURES = ("time", "steps", "settled", "error")
"""The results of a run that `Pick` can select, with one number per frame."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Node:
    """One operation on the values of other nodes; equal nodes of a graph are the same object.

    Attributes
    ----------
    index : int
        Place in the graph; arguments come before their users.
    scalar : bool
        One number per frame instead of a map.
    logic : bool
        Values are 0 or 1.
    maps : int
        More than one: a stack of maps.
    origin : str
        The line of the program that asked for it first.
    """

    index: int
    operation: Operation
    arguments: tuple["Node", ...]
    scalar: bool
    logic: bool
    maps: int = 1
    origin: str = ""

    def __repr__(self) -> str:
        # arguments by number: written out in full, a shared graph fills the memory
        return f"Node({self.index}: {self.operation} of {[a.index for a in self.arguments]})"


def picks_of(node: Node, nodes: Iterable[Node]) -> list[tuple[Node, Pick]]:
    """Return the nodes among these that read an answer of a transient or a loop."""
    return [
        (user, user.operation)
        for user in nodes
        if isinstance(user.operation, Pick) and user.arguments[0] is node
    ]


@dataclass(frozen=True, slots=True)
class Memory:
    """A local memory that outlives the frame: its first read and its last store."""

    read: Node
    store: Node


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
        Memories, by the number that `Read` names.
    shared : int
        How often an operation was asked for that the graph already had.
    parent : Graph or None
        For a loop's body, the graph that contains the loop; node numbers continue from it.
    captured : dict
        For a loop's body, the parent's nodes that it reads, by parameter number.
    traced : Graph or None
        For the outermost graph, the innermost body that is being traced.
    rate : float or None, Hz
        Frames per second of the streams that it is traced for, or None if unknown.
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
        """Return the node for an operation, reusing an existing one."""
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
        """Nesting depth in loops."""
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
