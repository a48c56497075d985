"""How large arrays come from the host and go back: its own memory is read and written in place.

Kernels convert, on all cores, and look at every number while they have it. The host would take a
sweep for each.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.devices.shared_arrays import SharedArray, shared_array, shares_memory
from cnnum.engines.opencl.lowering.kernel_source import TAKEN
from cnnum.engines.opencl.lowering.storage import Places
from cnnum.engines.opencl.runtime.plan_kernels import PlanKernels

OWN = 2
"""References to a block without an array: its keeper's, and the one that asks."""


@dataclass(slots=True, eq=False)
class KeptBlock:
    """Hands out numbers for results; arrays made of them keep them as long as they live.

    The system clears memory page by page when it is touched for the first time: of results of
    1024×1024 cells that takes longer than to write them.
    """

    _block: Floats | None = None

    def take(self, size: int) -> Floats:
        """Return a number of uninitialised numbers that no other array shares."""
        kept = self._block
        if kept is not None and kept.size == size:
            del kept
            if sys.getrefcount(self._block) <= OWN:
                assert self._block is not None
                return self._block
        self._block = np.empty(size)
        return self._block


PIECES = 32
"""Work items that share an array."""


def exchanges(device: cl.Device) -> bool:
    """Return whether a device reads and writes the host's arrays of doubles where they are."""
    return shares_memory(device) and bool(device.double_fp_config)


@dataclass(slots=True, eq=False)
class Exchange:
    """Carries the maps of a plan.

    Attributes
    ----------
    kernels : PlanKernels
    dtype : dtype
        Of the plan's numbers.
    """

    kernels: PlanKernels
    dtype: np.dtype[np.floating]
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
        batch = math.prod(lead)
        seen = self._unseen(batch)
        counts = [math.prod(array.shape[-3:]) for array in maps]
        size, at = np.int64(sum(counts)), 0
        held: list[cl.Buffer] = []
        for array, count in zip(maps, counts, strict=True):
            given = _as_it_lies(array, lead)
            apart = 0 if given.size == count else count
            buffer = self._buffer(given, cl.mem_flags.READ_ONLY)
            held.append(buffer)
            of = (buffer, np.int64(apart), np.int64(count))
            to = (input.argument, size, np.int64(at), seen.argument)
            self.kernels.launch(f"take_{TAKEN[given.dtype.name]}", (PIECES, batch), *of, *to)
            at += count
        seen.pull(self.kernels.queue)
        return not seen.host.any()

    def give(
        self, output: SharedArray, places: Places, batch: int
    ) -> tuple[dict[str, Floats], bool]:
        """Return results as doubles, and whether all are finite.

        Parameters
        ----------
        output : SharedArray
        places : Places
            Of the results in a frame's numbers.
        batch : int
        """
        seen = self._unseen(batch)
        frames = output.host.reshape(batch, -1)
        size = np.int64(frames.shape[1])
        results: dict[str, Floats] = {}
        numbers: dict[str, slice] = {}
        held: list[cl.Buffer] = []
        for name, (where, shape) in places.items():
            if not shape:
                numbers[name] = where
                continue
            count = math.prod(shape)
            # a block each: who keeps one result does not keep the others
            block = self._results.setdefault(name, KeptBlock()).take(batch * count)
            results[name] = block.reshape(batch, *shape)
            del block
            buffer = self._buffer(results[name], cl.mem_flags.WRITE_ONLY)
            held.append(buffer)
            of = (output.argument, size, np.int64(where.start))
            to = (buffer, np.int64(count), seen.argument)
            self.kernels.launch("give", (PIECES, batch), *of, *to)
            self._let_see(buffer)
        seen.pull(self.kernels.queue)
        read = {name: frames[:, at.start].astype(np.float64) for name, at in numbers.items()}
        finite = all(bool(np.isfinite(each).all()) for each in read.values())
        return results | read, finite and not seen.host.any()

    def _unseen(self, batch: int) -> SharedArray:
        """Return the counts of numbers that are not finite, each 0 as yet."""
        if batch not in self._seen:
            self._seen.clear()
            self._seen[batch] = shared_array(self.kernels.queue, batch * PIECES, self.dtype)
        self._seen[batch].host[:] = 0
        return self._seen[batch]

    def _buffer(self, array: NDArray[np.floating], flags: int) -> cl.Buffer:
        shared = flags | cl.mem_flags.USE_HOST_PTR
        return cl.Buffer(self.kernels.queue.context, shared, hostbuf=array)

    def _let_see(self, buffer: cl.Buffer) -> None:
        """Let the host see writes to its memory: nothing is copied where it is one."""
        queue, all_of_it = self.kernels.queue, (0, (buffer.size,), np.dtype(np.uint8))
        seen, _ = cl.enqueue_map_buffer(
            queue, buffer, cl.map_flags.READ, *all_of_it, is_blocking=False
        )
        seen.base.release(queue)


def _as_it_lies(array: NDArray[np.floating], lead: tuple[int, ...]) -> NDArray[np.floating]:
    """Return the numbers of one frame, or of all of a batch, side by side in memory."""
    alone = array.size == math.prod(array.shape[-3:])
    whole = array if alone else np.broadcast_to(array, (*lead, *array.shape[-3:]))
    plain = whole.dtype if whole.dtype.name in TAKEN else np.dtype(np.float64)
    return np.require(whole, plain.newbyteorder("="), ("C", "A"))
