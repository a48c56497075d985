"""Evaluation of a schedule, operation by operation over a whole batch.

Cellwise arithmetic runs in NumPy, transients in compiled functions.

Maps are (batch, rows, cols), stacks (batch, maps · rows, cols) and numbers (batch, 1, 1). The batch
is 1 where all frames share the value.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.host import HostExecutable, HostMemory, local, picked, picks
from cnnum.engines.notices import refuse_unfinished
from cnnum.engines.numba.compiling import ROOM, kept
from cnnum.engines.numba.records import Real, Reals
from cnnum.engines.numba.transients import TransientRunner
from cnnum.engines.opencl.lowering.storage import PRIVATE_CELLS
from cnnum.graph.nodes import (
    Apply,
    Loop,
    Node,
    Pick,
    Product,
    Reduce,
    Transient,
)
from cnnum.graph.schedule import Schedule
from cnnum.integrators.series import Stretch
from cnnum.integrators.solver import Solvers


@kept
def sums(values: Reals, room: int = ROOM) -> Floats:
    """Return the sum of every row of (batch, cells), cell by cell in float64."""
    totals = np.zeros(len(values))
    for row in range(len(values)):
        for value in values[row]:
            totals[row] += value
    return totals


@kept
def products(columns: Floats, values: Reals, totals: Floats, room: int = ROOM) -> None:
    """Add matrix · values to every row of totals, column by column in float64.

    Parameters
    ----------
    columns : (cells, cells) float64
        The matrix, transposed: each row holds one column.
    values : (batch or 1, cells) float
    totals : (batch, cells) float64
        Changed in place.
    """
    for row in range(len(totals)):
        given = values[min(row, len(values) - 1)]
        for cell in range(len(given)):
            totals[row] += columns[cell] * np.float64(given[cell])


ORDERED: Mapping[str, Callable[[Reals], Floats]] = {"sum": sums}
"""Reductions whose rounding depends on the order of the cells: NumPy may sum a batch in a different
order than a single frame."""

Answers = dict[str, Reals]
"""Results of a transient or a loop, by the name in a `Pick`."""


@dataclass(slots=True, eq=False)
class Evaluation:
    """The evaluation of a schedule for one batch.

    Attributes
    ----------
    batch : int
    dtype : dtype
    runners : mapping of int to TransientRunner
        By the index of their node.
    moments : sequence of float
        Times at which the transient of a run is looked at on its way.
    ends : sequence of Stretch
        The stretches that contain these times, if ends are known in closed form.
    cuts : int
        Parts in which a piece of its fixed steps is taken up to a look.
    seen : dict of str to array
        The findings there, as `TransientRunner.run` has them.
    running : (batch, 1, 1) bool
        Active frames: inside a loop, those that have not stopped.
    unfinished : (batch,) bool
        Frames in which a transient or a loop did not finish.
    """

    batch: int
    dtype: Real
    runners: Mapping[int, TransientRunner]
    moments: Sequence[float] = ()
    ends: Sequence[Stretch] = ()
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
        """Run a loop's body on all frames; stopped frames keep their values."""
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
        values = {node.index: carried[place] for place, node in loop.carried.items()}
        values |= {node.index: captured[number] for number, node in loop.captured.items()}
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


def why_walked(schedule: Schedule) -> str:
    """Return why a schedule is evaluated operation by operation; empty if it is compiled whole."""
    if schedule.cells > PRIVATE_CELLS:
        return f"an array of more than {PRIVATE_CELLS} cells is shared by all cores"
    done = (Apply, Reduce, Product, Loop, Transient)
    if sum(isinstance(node.operation, done) for node in schedule.nodes) <= 1:
        return "a template alone needs no compiler of its own"
    return ""


@dataclass(frozen=True, slots=True, eq=False)
class NumbaExecutable(HostExecutable):
    """Runs local arithmetic in NumPy and transients in compiled functions.

    Attributes
    ----------
    runners : mapping of int to TransientRunner
        By the index of their node.
    dead : mapping of int to indices
        By node, the values that nothing reads after it.
    """

    runners: Mapping[int, TransientRunner]
    dead: Mapping[int, Sequence[int]]

    @classmethod
    def of(cls, schedule: Schedule, solvers: Solvers, dtype: Real) -> "NumbaExecutable":
        """Return the executable of a schedule."""
        runners = {
            node.index: TransientRunner.of(
                node.operation, schedule.shape, solvers[node.index], dtype
            )
            for node in schedule.transients
            if isinstance(node.operation, Transient)
        }
        return cls(schedule, dtype, runners, _dead_after(schedule))

    @property
    def strategies(self) -> Mapping[int, str]:
        """How transients run, in words, by their nodes."""
        how = f"a walk over the operations ({why_walked(self.schedule)})"
        return dict.fromkeys(self.runners, how)

    def evaluate(self, values: dict[int, Reals], batch: int) -> None:
        """Fill in the values of all nodes, and forget those that nothing reads any more."""
        evaluation = Evaluation(batch, self.dtype, self.runners)
        # overflow is infinite on every engine; the plan refuses it where it comes out
        with np.errstate(all="ignore"):
            evaluation.run(self.schedule.nodes, values, self.dead)
        refuse_unfinished(evaluation.unfinished)

    def look(
        self,
        frames: Reals,
        moments: Sequence[float],
        ends: Sequence[Stretch] = (),
        cuts: int = 1,
    ) -> dict[str, Reals]:
        """Return the findings at times of a run, whose only transient this is.

        Parameters
        ----------
        frames : (batch, rows, cols, channels) float
        moments : sequence of float
            Rising, none after the end.
        ends : sequence of Stretch
            The stretches that contain these times, if ends are known in closed form.
        cuts : int
            Parts in which a piece of a step of fixed length is taken up to a look.

        Returns
        -------
        dict
            "seen" (times, batch, layers, rows, cols), and "marks" (times, batch, 3): steps,
            settled, error.
        """
        memory = self.new_memory(len(frames))
        assert isinstance(memory, HostMemory)
        values = self._given(frames, memory, first=True)
        evaluation = Evaluation(len(frames), self.dtype, self.runners, moments, ends, cuts)
        with np.errstate(all="ignore"):
            evaluation.run(self.schedule.nodes, values, self.dead)
        refuse_unfinished(evaluation.unfinished)
        return evaluation.seen


def _dead_after(schedule: Schedule) -> dict[int, list[int]]:
    last = {a.index: node.index for node in schedule.nodes for a in node.arguments}
    kept = {node.index for node in schedule.outputs.values()}
    kept |= {memory.store.index for memory in schedule.memories.values()}
    dead: dict[int, list[int]] = {}
    for value, user in last.items():
        if value not in kept:
            dead.setdefault(user, []).append(value)
    return dead
