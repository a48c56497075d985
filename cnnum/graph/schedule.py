"""A schedule: the operations that run for one frame, in order, and those left out."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from cnnum.arrays import Shape
from cnnum.graph.nodes import Loop, Memory, Node, Transient


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
        Traffic to or from the device that is saved a frame.
    flops : int
        Arithmetic that is saved a frame; for a transient, of one step, for a loop, of one round.
    """

    what: str
    why: str
    bytes: int
    flops: int

    @property
    def saves(self) -> str:
        """The saving a frame, in words."""
        parts = [f"{self.bytes} B"] if self.bytes else []
        parts += [f"{self.flops} flops"] if self.flops else []
        return " and ".join(parts) or "a repeated run"


def grouped(left_out: Sequence[LeftOut]) -> list[LeftOut]:
    """Return outputs, channels and templates that are left out for one reason as one row each."""
    found: dict[tuple[str, str], list[LeftOut]] = {}
    for item in left_out:
        kind, _, name = item.what.partition(" ")
        found.setdefault((kind if name and kind.isalpha() else item.what, item.why), []).append(
            item
        )
    return [
        LeftOut(_names(kind, items), why, sum(x.bytes for x in items), sum(x.flops for x in items))
        for (kind, why), items in found.items()
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
        """Return how many numbers a node's value is."""
        return 1 if node.scalar else node.maps * self.cells

    @property
    def transients(self) -> tuple[Node, ...]:
        """The nodes that run a template, those in loops among them."""
        return tuple(n for n in everything(self.nodes) if isinstance(n.operation, Transient))
