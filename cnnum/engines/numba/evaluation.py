"""Operations of a program on a whole batch: local arithmetic in NumPy, transients compiled.

Maps are (batch, rows, cols), stacks (batch, maps · rows, cols) and numbers (batch, 1, 1). The batch
is 1 where all frames share the value.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.host import local, picked, picks
from cnnum.engines.numba.records import Real, Reals
from cnnum.engines.numba.reductions import products, sums
from cnnum.engines.numba.transients import TransientRunner
from cnnum.graph.nodes import (
    CAPTURED,
    Loop,
    Node,
    Parameter,
    Pick,
    Product,
    Reduce,
    Transient,
)
from cnnum.integrators.solver import Exact

ORDERED: Mapping[str, Callable[[Reals], Floats]] = {"sum": sums}
"""Read-outs whose rounding depends on the order of the cells: NumPy may order a batch otherwise
than a frame."""

Answers = dict[str, Reals]
"""Results of a transient or a loop, by the name in a `Pick`."""


@dataclass(slots=True, eq=False)
class Evaluation:
    """One batch on its way through a schedule.

    Attributes
    ----------
    batch : int
    dtype : dtype
    runners : mapping of int to TransientRunner
        By the index of their node.
    moments : sequence of float
        Times at which the transient of a run is looked at on its way.
    ends : sequence of Exact
        Its schemes up to these times, where an end is known without steps.
    cuts : int
        Parts in which a piece of its fixed steps is taken up to a look.
    seen : dict of str to array
        The findings there, as `TransientRunner.run` has them.
    running : (batch, 1, 1) bool
        Frames whose results count: inside a loop, those that have not stopped.
    unfinished : (batch,) bool
        Frames in which a transient or a loop did not reach its end.
    """

    batch: int
    dtype: Real
    runners: Mapping[int, TransientRunner]
    moments: Sequence[float] = ()
    ends: Sequence[Exact] = ()
    cuts: int = 1
    seen: Answers = field(default_factory=dict[str, Reals])
    running: NDArray[np.bool_] = field(init=False)
    unfinished: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.running = np.ones((self.batch, 1, 1), bool)
        self.unfinished = np.zeros(self.batch, bool)

    def run(
        self,
        nodes: Sequence[Node],
        values: dict[int, Reals],
        dead: Mapping[int, Sequence[int]] | None = None,
    ) -> None:
        """Fill in the values of nodes, in their order; after a node, forget dead values."""
        answers: dict[int, Answers] = {}
        for node in nodes:
            if node.index not in values:
                self._node(node, nodes, values, answers)
            for index in (dead or {}).get(node.index, ()):
                values.pop(index, None)
                answers.pop(index, None)

    def _node(
        self,
        node: Node,
        nodes: Sequence[Node],
        values: dict[int, Reals],
        answers: dict[int, Answers],
    ) -> None:
        operation = node.operation
        if isinstance(operation, Pick):
            value = picked(operation, answers[node.arguments[0].index])
            values[node.index] = np.ascontiguousarray(value, dtype=self.dtype)
            return
        arguments = [values[argument.index] for argument in node.arguments]
        if isinstance(operation, Transient):
            answers[node.index] = self._transient(node, arguments)
        elif isinstance(operation, Loop):
            answer = self._loop(operation, arguments)
            answers[node.index] = answer
            if not picks(node, "finished", nodes):
                self._count(answer["finished"][:, 0, 0] == 0.0)
        else:
            value = _local(operation, arguments)
            values[node.index] = np.ascontiguousarray(value, dtype=self.dtype)

    def _count(self, unfinished: NDArray[np.bool_]) -> None:
        self.unfinished |= unfinished & self.running[:, 0, 0]

    def _transient(self, node: Node, arguments: Sequence[Reals]) -> Answers:
        runner = self.runners[node.index]
        if self.ends:
            self.seen.update(runner.ends(arguments, self.batch, self.ends))
        moments = () if self.ends else self.moments
        answer = runner.run(arguments, self.batch, moments, self.cuts)
        self.seen.update({name: answer.pop(name) for name in ("seen", "marks") if name in answer})
        self._count(answer["unfinished"] != 0.0)
        return answer

    def _loop(self, loop: Loop, arguments: Sequence[Reals]) -> Answers:
        """Run a loop's body on all frames; those that have stopped keep their values."""
        start, *rest = arguments
        count, outside = len(loop.results), self.running
        self.running = outside & np.broadcast_to(start != 0.0, outside.shape)
        carried = [np.broadcast_to(v, (self.batch, *v.shape[1:])) for v in rest[:count]]
        iterations = np.zeros(outside.shape, self.dtype)
        for _ in range(loop.limit):
            if not self.running.any():
                break
            iterations += self.running
            carried, again = self._turn(loop, carried, rest[count:])
            self.running = self.running & again
        finished = ~self.running
        self.running = outside
        answer = {f"carried {place}": value for place, value in enumerate(carried)}
        return answer | {"iterations": iterations, "finished": finished.astype(self.dtype)}

    def _turn(
        self, loop: Loop, carried: Sequence[Reals], captured: Sequence[Reals]
    ) -> tuple[list[Reals], NDArray[np.bool_]]:
        """Run a loop's body once; return the next values, and the frames that go on."""
        values: dict[int, Reals] = {}
        for node in loop.parameters:
            assert isinstance(node.operation, Parameter)
            place = node.operation.place
            values[node.index] = carried[place] if place < CAPTURED else captured[place - CAPTURED]
        self.run(loop.nodes, values)
        becomes = [
            np.where(self.running, values[node.index], was)
            for node, was in zip(loop.results, carried, strict=True)
        ]
        if loop.again is not None:
            return becomes, values[loop.again.index] != 0.0
        changed = np.zeros(self.running.shape, bool)
        for was, now in zip(carried, becomes, strict=True):
            changed |= (was != now).any(axis=(1, 2), keepdims=True)
        return becomes, changed


def _local(operation: object, arguments: Sequence[Reals]) -> Reals:
    if isinstance(operation, Product):
        return _product(operation, arguments)
    if isinstance(operation, Reduce) and operation.function.name in ORDERED:
        cells = arguments[0].reshape(len(arguments[0]), -1)
        return ORDERED[operation.function.name](cells)[:, np.newaxis, np.newaxis]
    return local(operation, arguments)


def _product(operation: Product, arguments: Sequence[Reals]) -> Floats:
    batch, shape = max(len(values) for values in arguments), arguments[0].shape[1:]
    totals = np.tile(operation.constant, (batch, 1))
    for matrix, values in zip(operation.matrices, arguments, strict=True):
        products(np.ascontiguousarray(matrix.T), values.reshape(len(values), -1), totals)
    return totals.reshape(batch, *shape)
