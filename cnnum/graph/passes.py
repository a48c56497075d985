"""From a graph to the operations that a wanted output or a live memory depends on."""

from collections.abc import Iterable, Sequence

from cnnum.errors import ProgramError, name_error
from cnnum.graph.cost import node_flops
from cnnum.graph.graph import Graph
from cnnum.graph.nodes import Apply, Constant, Input, Loop, Node, Read, Reduce, Transient
from cnnum.graph.schedule import LeftOut, Schedule, everything


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
        raise ProgramError(f"'needs' is a list of outputs, as in [{needs!r:.60}], got one text.")
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
