"""A schedule, walked operation by operation over a whole batch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.backend import Solvers
from cnnum.engines.failures import refuse_unfinished
from cnnum.engines.numba.evaluation import Evaluation
from cnnum.engines.numba.records import Real, Reals
from cnnum.engines.numba.transients import TransientRunner
from cnnum.graph.nodes import FirstFrame, Input, Node, Read, Transient
from cnnum.graph.schedule import Schedule


@dataclass(slots=True, eq=False)
class NumbaMemory:
    """What the memories of a batch of streams hold, by number."""

    values: dict[int, Reals]


@dataclass(frozen=True, slots=True, eq=False)
class NumbaExecutable:
    """Runs local arithmetic in NumPy and transients in compiled functions.

    Attributes
    ----------
    schedule : Schedule
    dtype : dtype
    runners : mapping of int to TransientRunner
        By the index of their node.
    dead : mapping of int to indices
        By node, the values that nothing reads after it.
    """

    schedule: Schedule
    dtype: Real
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
    def launches(self) -> int:
        """There is no device to launch on."""
        return 0

    @property
    def private_bytes(self) -> int:
        """There is no device with private memory."""
        return 0

    @property
    def local_bytes(self) -> int:
        """There is no device with local memory."""
        return 0

    @property
    def scratch_bytes(self) -> int:
        """The host's memory is not counted."""
        return 0

    @property
    def strategies(self) -> Mapping[int, str]:
        """Transients run in one way alone."""
        return {}

    @property
    def source(self) -> str:
        """The operations in words."""
        return "\n".join(
            f"{node.index}: {node.operation} of {[a.index for a in node.arguments]}"
            for node in self.schedule.nodes
        )

    def new_memory(self, batch: int) -> object:
        """Return cleared memories."""
        rows, cols = self.schedule.shape
        return NumbaMemory(
            {
                number: np.zeros(
                    (batch, 1, 1) if memory.read.scalar else (batch, memory.read.maps * rows, cols),
                    self.dtype,
                )
                for number, memory in self.schedule.memories.items()
            }
        )

    def held(self, memory: object, batch: int) -> tuple[NDArray[np.floating], ...]:
        """Return what memories hold."""
        assert isinstance(memory, NumbaMemory)
        return tuple(memory.values.values())

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Let memories hold a copy of these numbers."""
        assert isinstance(memory, NumbaMemory)
        copies = (values.copy() for values in numbers)
        memory.values = dict(zip(memory.values, copies, strict=True))

    def one(self, memory: object) -> None:
        """A single frame goes the way of a batch."""

    def run_large(self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]) -> None:
        """Large arrays go the way of others, and are looked at before."""

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Run every operation on the whole batch."""
        assert isinstance(memory, NumbaMemory)
        batch = len(frames)
        values = self._given(frames, memory, first)
        evaluation = Evaluation(batch, self.dtype, self.runners)
        # what overflows is infinite on every engine; the plan refuses it where it comes out
        with np.errstate(all="ignore"):
            evaluation.run(self.schedule.nodes, values, self.dead)
        refuse_unfinished(evaluation.unfinished)
        for number, kept in self.schedule.memories.items():
            shape = memory.values[number].shape
            memory.values[number] = np.broadcast_to(values[kept.store.index], shape).copy()
        return {
            name: self._output(node, values[node.index], batch)
            for name, node in self.schedule.outputs.items()
        }

    def _given(
        self, frames: NDArray[np.floating], memory: NumbaMemory, first: bool
    ) -> dict[int, Reals]:
        """Return the values of what comes from outside the frame's program."""
        channels = self.schedule.channels_read
        values: dict[int, Reals] = {}
        for node in self.schedule.nodes:
            operation = node.operation
            if isinstance(operation, Input):
                plane = frames[..., channels.index(operation.channel)]
                values[node.index] = np.array(plane, dtype=self.dtype, order="C")
            elif isinstance(operation, Read):
                values[node.index] = memory.values[operation.memory]
            elif isinstance(operation, FirstFrame):
                values[node.index] = np.full((1, 1, 1), first, self.dtype)
        return values

    def _output(self, node: Node, value: Reals, batch: int) -> Floats:
        whole = np.broadcast_to(value, (batch, *value.shape[1:]))
        return whole.reshape(batch, *self.schedule.shape_of(node)).astype(np.float64)


def _dead_after(schedule: Schedule) -> dict[int, list[int]]:
    last = {a.index: node.index for node in schedule.nodes for a in node.arguments}
    kept = {node.index for node in schedule.outputs.values()}
    kept |= {memory.store.index for memory in schedule.memories.values()}
    dead: dict[int, list[int]] = {}
    for value, user in last.items():
        if value not in kept:
            dead.setdefault(user, []).append(value)
    return dead
