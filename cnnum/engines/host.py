"""The part of an executable that host engines share: memories, input channels and outputs."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.backend import OneFrame
from cnnum.graph.nodes import (
    Apply,
    Constant,
    ConstantMap,
    FirstFrame,
    Input,
    Node,
    Pick,
    Read,
    Reduce,
    picks_of,
)
from cnnum.graph.schedule import Schedule

Values = NDArray[np.floating[Any]]


@dataclass(slots=True, eq=False)
class HostMemory:
    """Values of the memories of a batch of streams, by index."""

    values: dict[int, Values]


class OnHost:
    """An executable without a device: no device memory, and one path for all frames."""

    __slots__ = ()

    @property
    def private_bytes(self) -> int:
        """Always 0: the host has no private memory."""
        return 0

    @property
    def local_bytes(self) -> int:
        """Always 0: the host has no local memory."""
        return 0

    @property
    def strategies(self) -> Mapping[int, str]:
        """Always empty: transients run in only one way."""
        return {}

    def one(self, memory: object) -> OneFrame | None:
        """Return None: a single frame runs like a batch."""
        return None

    def run_large(self, maps: Sequence[Values], lead: tuple[int, ...]) -> None:
        """Return None: large arrays run like others, on channels checked beforehand."""
        return


@dataclass(frozen=True, slots=True, eq=False)
class HostExecutable(OnHost, ABC):
    """Walks a schedule operation by operation over a whole batch.

    Maps are (batch, rows, cols), stacks (batch, maps · rows, cols) and numbers (batch, 1, 1).

    Attributes
    ----------
    schedule : Schedule
    dtype : dtype
        Data type of the engine's values.
    """

    schedule: Schedule
    dtype: np.dtype[np.floating[Any]]

    @abstractmethod
    def evaluate(self, values: dict[int, Values], batch: int) -> None:
        """Compute the values of all nodes; those from outside the program are already present.

        Raises
        ------
        MethodError
            If a transient or a loop does not finish.
        """

    @property
    def launches(self) -> int:
        """Always 0: there is no device to launch on."""
        return 0

    @property
    def scratch_bytes(self) -> int:
        """Always 0: host memory is not counted."""
        return 0

    @property
    def source(self) -> str:
        """Return a description of the operations."""
        return "\n".join(
            f"{node.index}: {node.operation} of {[a.index for a in node.arguments]}"
            for node in self.schedule.nodes
        )

    def new_memory(self, batch: int) -> object:
        """Return cleared memories."""
        rows, cols = self.schedule.shape
        return HostMemory(
            {
                number: np.zeros(
                    (batch, 1, 1) if memory.read.scalar else (batch, memory.read.maps * rows, cols),
                    self.dtype,
                )
                for number, memory in self.schedule.memories.items()
            }
        )

    def held(self, memory: object, batch: int) -> tuple[Values, ...]:
        """Return the values of memories."""
        assert isinstance(memory, HostMemory)
        return tuple(memory.values.values())

    def restore(self, memory: object, numbers: Sequence[Values], batch: int) -> None:
        """Restore the memories from a copy of these values."""
        assert isinstance(memory, HostMemory)
        copies = (values.copy() for values in numbers)
        memory.values = dict(zip(memory.values, copies, strict=True))

    def run(self, frames: Values, memory: object, *, first: bool) -> dict[str, Floats]:
        """Run every operation on the whole batch."""
        assert isinstance(memory, HostMemory)
        batch = len(frames)
        values = self._given(frames, memory, first)
        self.evaluate(values, batch)
        for number, kept in self.schedule.memories.items():
            shape = memory.values[number].shape
            memory.values[number] = np.broadcast_to(values[kept.store.index], shape).copy()
        return {
            name: self._output(node, values[node.index], batch)
            for name, node in self.schedule.outputs.items()
        }

    def _given(self, frames: Values, memory: HostMemory, first: bool) -> dict[int, Values]:
        """Return the values that enter the frame's program from outside."""
        channels = self.schedule.channels_read
        values: dict[int, Values] = {}
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

    def _output(self, node: Node, value: Values, batch: int) -> Floats:
        whole = np.broadcast_to(value, (batch, *value.shape[1:]))
        return whole.reshape(batch, *self.schedule.shape_of(node)).astype(np.float64)


def local(operation: object, arguments: Sequence[Values]) -> Values:
    """Return the value of a constant, cellwise arithmetic or a read-out."""
    if isinstance(operation, Constant):
        return np.full((1, 1, 1), operation.value)
    if isinstance(operation, ConstantMap):
        return operation.values[np.newaxis]
    if isinstance(operation, Apply):
        return operation.function.numpy(*arguments)
    assert isinstance(operation, Reduce)
    reduced = operation.function.numpy(arguments[0].astype(np.float64, copy=False))
    return np.asarray(reduced)[:, np.newaxis, np.newaxis]


def picks(node: Node, what: str, nodes: Sequence[Node]) -> bool:
    """Return whether any of `nodes` reads this result of a transient or a loop."""
    return any(pick.what == what for _, pick in picks_of(node, nodes))


def picked(operation: Pick, answer: Mapping[str, Values]) -> Values:
    """Return the selected result of a transient or a loop as a separate value."""
    if operation.what in ("output", "state"):
        return answer[operation.what][:, operation.layer]
    if operation.what == "carried":
        return answer[f"carried {operation.layer}"]
    figure = answer[operation.what]
    return figure if figure.ndim == 3 else figure[:, np.newaxis, np.newaxis]
