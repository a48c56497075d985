"""How large arrays come from the host and go back: its own memory is read and written in place.

Kernels convert, on all cores, and look at every number while they have it. The host would take a
sweep for each.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.devices.shared_arrays import SharedArray, shared_array, shares_memory
from cnnum.engines.opencl.runtime.result_blocks import KeptBlock
from cnnum.engines.opencl.text import fill
from cnnum.kernels.number_types import NumberType

PIECES = 32
"""Work items that share an array."""

TAKEN = {"float32": "float", "float64": "double"}
"""Number types that are read as they are; other numbers are converted first."""

Places = Mapping[str, tuple[slice, tuple[int, ...]]]


def exchange_text(numbers: NumberType) -> str:
    """Return the kernels' text, for a device that has doubles."""
    names = {"bits": numbers.bits, "mask": numbers.mask, "infinite": numbers.infinite}
    takes = [fill("take", given=given, **names) for given in TAKEN.values()]
    return "\n".join([*takes, fill("give", **names)])


def exchanges(device: cl.Device) -> bool:
    """Return whether a device reads and writes the host's arrays of doubles where they are."""
    return shares_memory(device) and bool(device.double_fp_config)


@dataclass(slots=True, eq=False)
class Exchange:
    """Carries the maps of a plan.

    Attributes
    ----------
    queue : CommandQueue
    program : Program
        The plan's.
    dtype : dtype
        Of its numbers.
    """

    queue: cl.CommandQueue
    program: cl.Program
    dtype: np.dtype[np.floating]
    _kernels: dict[str, cl.Kernel] = field(default_factory=dict[str, cl.Kernel])
    _seen: dict[int, SharedArray] = field(default_factory=dict[int, SharedArray])
    _results: dict[str, KeptBlock] = field(default_factory=dict[str, KeptBlock])

    def take(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...], input: SharedArray
    ) -> bool:
        """Bring maps to the device, side by side in each frame; return whether all are finite.

        Parameters
        ----------
        maps : sequence of (..., maps, rows, cols) float
            Leading axes broadcast to `lead`.
        lead : tuple of int
        input : SharedArray
        """
        batch, seen = math.prod(lead), self._unseen(math.prod(lead))
        size, at = sum(math.prod(array.shape[-3:]) for array in maps), 0
        held: list[object] = []
        for array in maps:
            count = math.prod(array.shape[-3:])
            given = _as_it_lies(array, lead)
            apart = 0 if given.size == count else count
            buffer = self._buffer(given, cl.mem_flags.READ_ONLY)
            held.append(buffer)
            numbers = (np.int64(apart), np.int64(count))
            to = (input.argument, np.int64(size), np.int64(at), seen.argument)
            self._launch(f"take_{TAKEN[given.dtype.name]}", batch, (buffer, *numbers, *to))
            at += count
        seen.pull(self.queue)
        return not seen.host.any()

    def give(
        self, output: SharedArray, size: int, places: Places, batch: int
    ) -> tuple[dict[str, Floats], bool]:
        """Return results as doubles, and whether all are finite.

        Parameters
        ----------
        output : SharedArray
        size : int
            Its numbers a frame.
        places : mapping of str to (slice, shape)
            Where each result stands in them.
        batch : int
        """
        seen = self._unseen(batch)
        maps = {name: place for name, place in places.items() if place[1]}
        results: dict[str, Floats] = {}
        held: list[cl.Buffer] = []
        for name, (where, shape) in maps.items():
            count = math.prod(shape)
            # a block each: who keeps one result does not keep the others
            block = self._results.setdefault(name, KeptBlock()).take(batch * count)
            results[name] = block.reshape(batch, *shape)
            del block
            buffer = self._buffer(results[name], cl.mem_flags.WRITE_ONLY)
            held.append(buffer)
            of = (output.argument, np.int64(size), np.int64(where.start))
            self._launch("give", batch, (*of, buffer, np.int64(count), seen.argument))
        for buffer in held:
            self._let_see(buffer)
        seen.pull(self.queue)
        frames = output.host.reshape(batch, size)
        numbers = {
            name: frames[:, where.start].astype(np.float64)
            for name, (where, shape) in places.items()
            if not shape
        }
        finite = all(bool(np.isfinite(each).all()) for each in numbers.values())
        return results | numbers, finite and not seen.host.any()

    def _unseen(self, batch: int) -> SharedArray:
        """Return the counts of numbers that are not finite, each 0 as yet."""
        if batch not in self._seen:
            self._seen.clear()
            size = batch * PIECES
            self._seen[batch] = shared_array(self.queue.context, size, self.dtype, share=True)
        self._seen[batch].host[:] = 0
        return self._seen[batch]

    def _buffer(self, array: NDArray[np.floating], flags: int) -> cl.Buffer:
        return cl.Buffer(self.queue.context, flags | cl.mem_flags.USE_HOST_PTR, hostbuf=array)

    def _let_see(self, buffer: cl.Buffer) -> None:
        """Let the host see writes to its memory: nothing is copied where it is one."""
        size = buffer.size
        seen, _ = cl.enqueue_map_buffer(
            self.queue, buffer, cl.map_flags.READ, 0, (size,), np.dtype(np.uint8), is_blocking=False
        )
        seen.base.release(self.queue)

    def _launch(self, name: str, batch: int, arguments: tuple[Any, ...]) -> None:
        if name not in self._kernels:
            self._kernels[name] = cl.Kernel(self.program, name)
        self._kernels[name].set_args(*arguments)
        cl.enqueue_nd_range_kernel(self.queue, self._kernels[name], (PIECES, batch), (1, 1))


def _as_it_lies(array: NDArray[np.floating], lead: tuple[int, ...]) -> NDArray[np.floating]:
    """Return the numbers of one frame, or of all of a batch, side by side in memory."""
    alone = array.size == math.prod(array.shape[-3:])
    whole = array if alone else np.broadcast_to(array, (*lead, *array.shape[-3:]))
    plain = whole.dtype if whole.dtype.name in TAKEN else np.dtype(np.float64)
    return np.require(whole, plain.newbyteorder("="), ("C", "A"))
