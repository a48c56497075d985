"""Scheduling of a graph: the operations that the requested outputs depend on, and their cost."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass

import numpy as np

from cnnum.arrays import Shape
from cnnum.errors import ProgramError, name_error
from cnnum.graph.nodes import (
    Apply,
    Constant,
    Graph,
    Input,
    Loop,
    Memory,
    Node,
    Product,
    Read,
    Reduce,
    Transient,
)
from cnnum.templating.network import delays_outputs, reads_outputs, reads_states
from cnnum.templating.template import Template


def step_flops(template: Template, shape: Shape) -> int:
    """Return the arithmetic of one evaluation of dx/dt plus one Euler update.

    Two per tap (multiply, add) and four per cell: −x, /τ, ·dt, +x. The output function is not
    counted.
    """
    taps = int(np.count_nonzero(template.A))
    return (2 * taps + 4 * template.layers) * shape[0] * shape[1]


def node_flops(node: Node, shape: Shape, steps: int = 1) -> int:
    """Return the arithmetic of an operation per frame; a transient counts `steps` steps.

    Zero weights cost nothing: they never reach a kernel.
    """
    cells = shape[0] * shape[1]
    if isinstance(node.operation, Transient):
        template = node.operation.template
        feedforward = 2 * int(np.count_nonzero(template.B)) * cells
        return feedforward + steps * step_flops(template, shape)
    if isinstance(node.operation, Product):
        return 2 * cells * cells * len(node.arguments)
    if isinstance(node.operation, Apply):
        return 1 if node.scalar else cells * node.maps
    return cells * node.arguments[0].maps if isinstance(node.operation, Reduce) else 0


@dataclass(frozen=True, slots=True)
class Parts:
    """How many operations of each kind a program has; those in bodies of loops count once.

    Attributes
    ----------
    feedback, feedforward : int
        Templates whose cells see outputs or states, and those whose cells see inputs alone.
    local : int
        Local arithmetic and logic on maps.
    reductions : int
        Global read-outs: a map becomes one number.
    scalar : int
        Arithmetic and logic on one number per frame.
    """

    feedback: int = 0
    feedforward: int = 0
    local: int = 0
    reductions: int = 0
    scalar: int = 0

    def __str__(self) -> str:
        return (
            f"{self.feedback} templates with feedback and {self.feedforward} without, "
            f"{self.local} local operations, {self.reductions} reductions, "
            f"{self.scalar} operations on numbers"
        )

    def __add__(self, other: "Parts") -> "Parts":
        return Parts(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


def parts_of(nodes: Iterable[Node]) -> Parts:
    """Return the parts of nodes and of the bodies of their loops."""
    parts = Parts()
    for node in nodes:
        match node.operation:
            case Transient() as run:
                fed = has_feedback(run.template)
                parts += Parts(feedback=int(fed), feedforward=int(not fed))
            case Reduce():
                parts += Parts(reductions=1)
            case Apply():
                parts += Parts(scalar=1) if node.scalar else Parts(local=1)
            case Loop() as loop:
                parts += parts_of(loop.nodes)
            case _:
                pass
    return parts


def has_feedback(template: Template) -> bool:
    """Return whether a template's cells see outputs or states, their own but for its decay."""
    return reads_outputs(template) or reads_states(template) or delays_outputs(template)


def everything(nodes: Iterable[Node]) -> Iterator[Node]:
    """Yield the nodes and all that stand in their loops."""
    for node in nodes:
        yield node
        if isinstance(node.operation, Loop):
            yield from everything(node.operation.nodes)


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Something that a program could do and a plan does not.

    Attributes
    ----------
    what, why : str
    bytes : int
        Traffic to or from the device saved per frame.
    flops : int
        Arithmetic saved per frame; for a transient, of one step, for a loop, of one iteration.
    """

    what: str
    why: str
    bytes: int
    flops: int

    @property
    def saves(self) -> str:
        """Description of the saving per frame."""
        parts = [f"{self.bytes} B"] if self.bytes else []
        parts += [f"{self.flops} flops"] if self.flops else []
        return " and ".join(parts) or "a repeated run"


def grouped(left_out: Sequence[LeftOut]) -> list[LeftOut]:
    """Return outputs, channels and templates that are left out for one reason as one row each."""
    result: dict[tuple[str, str], list[LeftOut]] = {}
    for item in left_out:
        kind, _, name = item.what.partition(" ")
        result.setdefault((kind if name and kind.isalpha() else item.what, item.why), []).append(
            item
        )
    return [
        LeftOut(_names(kind, items), why, sum(x.bytes for x in items), sum(x.flops for x in items))
        for (kind, why), items in result.items()
    ]


def _names(kind: str, items: Sequence[LeftOut]) -> str:
    names = dict.fromkeys(item.what.removeprefix(f"{kind} ") for item in items)
    return items[0].what if len(items) == 1 else f"{len(items)} {kind}s: {'; '.join(names)}"


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """The input of an engine's builder.

    Attributes
    ----------
    shape : (rows, cols)
    nodes : tuple of Node
        In the order in which they run; only the needed ones.
    outputs : dict of str to Node
    memories : dict of int to Memory
    channels : tuple of str
        Channels of a frame, in the order of its last axis.
    channels_read : tuple of str
        Those that anything reads; only they travel to the device.
    left_out : tuple of LeftOut
    shared : int
        Operations that were asked for again and run once.
    """

    shape: Shape
    nodes: tuple[Node, ...]
    outputs: dict[str, Node]
    memories: dict[int, Memory]
    channels: tuple[str, ...]
    channels_read: tuple[str, ...]
    left_out: tuple[LeftOut, ...]
    shared: int

    @property
    def cells(self) -> int:
        """Number of cells of the array."""
        return self.shape[0] * self.shape[1]

    def shape_of(self, node: Node) -> tuple[int, ...]:
        """Return the shape of a node's value: (), (rows, cols) or a stack's (maps, rows, cols)."""
        if node.scalar:
            return ()
        return self.shape if node.maps == 1 else (node.maps, *self.shape)

    def size_of(self, node: Node) -> int:
        """Return the number of elements in a node's value."""
        return 1 if node.scalar else node.maps * self.cells

    @property
    def transients(self) -> tuple[Node, ...]:
        """The nodes that run a template, those in loops among them."""
        return tuple(n for n in everything(self.nodes) if isinstance(n.operation, Transient))


def reached(graph: Graph, roots: Iterable[Node]) -> set[int]:
    """Return the indices of all nodes that the roots depend on.

    A memory that is read keeps alive the value stored in it. The walk is iterative: a program may
    be deeper than Python's stack.
    """
    seen: set[int] = set()
    stack = list(roots)
    while stack:
        node = stack.pop()
        if node.index in seen:
            continue
        seen.add(node.index)
        stack.extend(node.arguments)
        if isinstance(node.operation, Read):
            stack.append(graph.memories[node.operation.memory].store)
    return seen


def schedule(graph: Graph, channels: Sequence[str], needs: Sequence[str] | None) -> Schedule:
    """Return the operations of the wanted outputs, and those left out with the reason.

    Parameters
    ----------
    graph : Graph
    channels : sequence of str
        Channels of a frame, in the order of its last axis.
    needs : sequence of str or None
        Names of wanted outputs; None wants all.

    Raises
    ------
    UnknownNameError
        If a need is not an output of the program.
    ProgramError
        If it is one text in place of a list.
    """
    if isinstance(needs, str):  # its letters would be taken for names
        raise ProgramError(
            f"'needs' must be a list of outputs, as in [{needs!r:.60}], got a single string."
        )
    try:
        wanted = tuple(dict.fromkeys(graph.outputs if needs is None else needs))
    except TypeError:  # no sequence, or one of lists
        raise name_error("output", needs, graph.outputs) from None
    for name in wanted:
        if name not in graph.outputs:
            raise name_error("output", name, graph.outputs)
    outputs = {name: graph.outputs[name] for name in wanted}
    live = reached(graph, outputs.values())
    nodes = tuple(node for node in graph.nodes if node.index in live)
    read = {node.operation.channel for node in nodes if isinstance(node.operation, Input)}
    memories = {
        number: memory for number, memory in graph.memories.items() if memory.read.index in live
    }
    return Schedule(
        shape=graph.shape,
        nodes=nodes,
        outputs=outputs,
        memories=memories,
        channels=tuple(channels),
        channels_read=tuple(name for name in channels if name in read),
        left_out=_left_out(graph, live, channels, wanted),
        shared=graph.shared,
    )


def _left_out(
    graph: Graph, live: set[int], channels: Sequence[str], wanted: Sequence[str]
) -> tuple[LeftOut, ...]:
    gone = reached(graph, graph.outputs.values()) - live
    dead = [node for node in graph.nodes if node.index in gone]
    unread = {str(n.operation.channel) for n in dead if isinstance(n.operation, Input)}
    unread |= set(channels) - {
        n.operation.channel for n in graph.nodes if isinstance(n.operation, Input)
    }
    rows, cols = graph.shape
    items = [
        LeftOut(f"output {name}", "nothing asked for it", _map_bytes(graph.outputs[name], graph), 0)
        for name in graph.outputs
        if name not in wanted
    ]
    items += [
        LeftOut(f"channel {name}", "no wanted output reads it", 4 * rows * cols, 0)
        for name in channels
        if name in unread
    ]
    items += [
        LeftOut(
            str(node.operation),
            "no wanted output reaches it",
            0,
            sum(node_flops(inner, graph.shape) for inner in everything([node])),
        )
        for node in dead
        if isinstance(node.operation, Transient | Loop)
    ]
    local = [node for node in dead if isinstance(node.operation, Apply | Reduce)]
    if local:
        flops = sum(node_flops(node, graph.shape) for node in local)
        what = f"{len(local)} local and global operations"
        items.append(LeftOut(what, "no wanted output reaches them", 0, flops))
    if graph.shared:
        what = f"{graph.shared} repeated operations"
        items.append(LeftOut(what, "an equal operation is there already", 0, 0))
    return tuple(items)


def _map_bytes(node: Node, graph: Graph) -> int:
    if isinstance(node.operation, Constant):
        return 0
    return 4 if node.scalar else 4 * graph.shape[0] * graph.shape[1]
