"""Running a plan on a device: its kernels, their launches, and transfers from and to the host.

Large arrays are read from and written to host memory in place. Kernels convert them on all cores
and check every number in the same pass; the host would need one pass for each.
"""

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.devices.program_cache import make_kernel
from cnnum.engines.devices.shared_arrays import SharedArray, shared_array, shares_memory
from cnnum.engines.opencl.lowering.kernel_source import TAKEN
from cnnum.engines.opencl.lowering.storage import Places
from cnnum.kernels.launch_plan import Launch, LaunchPlan, LaunchStep, Rounds, Steps


@dataclass(slots=True, eq=False)
class PlanKernels:
    """Creates each kernel once and launches it. Holds the program, which Intel's runtime needs.

    Attributes
    ----------
    queue : CommandQueue
    program : Program
    """

    queue: cl.CommandQueue
    program: cl.Program
    _made: dict[str, cl.Kernel] = field(default_factory=dict[str, cl.Kernel])

    def __getitem__(self, name: str) -> cl.Kernel:
        if name not in self._made:
            self._made[name] = self.separate(name)
        return self._made[name]

    def separate(self, name: str) -> cl.Kernel:
        """Return a separate kernel object with its own arguments."""
        return make_kernel(self.program, name)

    def launch(self, name: str, items: tuple[int, ...], *arguments: Any) -> None:
        """Launch a kernel in work groups of one; without arguments, those set before remain."""
        kernel = self[name]
        if arguments:
            kernel.set_args(*arguments)
        cl.enqueue_nd_range_kernel(self.queue, kernel, items, (1,) * len(items))


Arguments = Sequence["cl.Buffer | cl.SVM[Any]"]
"""The plan's own arrays, the leading arguments of its kernels; scratch is the last of them."""


@dataclass(slots=True, eq=False)
class WholeRunner:
    """Runs a plan that is one kernel.

    Attributes
    ----------
    kernels : PlanKernels
    lanes : int
        Frames per work item.
    """

    kernels: PlanKernels
    lanes: int
    _items: int = 0

    def bind(self, arguments: Arguments, batch: int, *, first: bool) -> None:
        """Set the kernel's arguments."""
        self.kernels["plan"].set_args(*arguments, np.int32(batch), np.int32(first))
        self._items = -(-batch // self.lanes)

    def run(self) -> None:
        """Launch the kernel."""
        self.kernels.launch("plan", (self._items,))


ROUNDS_PER_ROUND_AHEAD, MOST_AHEAD = 16, 7
"""Rounds after which one more is launched before the host asks whether any frame goes on: in a
round that no frame needs, kernels return at once, as they do for single frames that have ended."""


@dataclass(slots=True, eq=False)
class LaunchRunner:
    """Runs a plan for large arrays in parts.

    The parts share registers, shaped (registers, batch), and incomplete sums.

    Attributes
    ----------
    kernels : PlanKernels
    plan : LaunchPlan
    dtype : dtype
    """

    kernels: PlanKernels
    plan: LaunchPlan
    dtype: np.dtype[np.floating]
    _batch: int = 0
    _scratch: "cl.Buffer | cl.SVM[Any]" = field(init=False)
    _registers: SharedArray = field(init=False)
    _partials: cl.Buffer = field(init=False)

    def bind(self, arguments: Arguments, batch: int, *, first: bool) -> None:
        """Set the arguments of all parts."""
        if batch != self._batch:
            queue, partials = self.kernels.queue, max(1, batch * self.plan.partials)
            size = partials * self.dtype.itemsize
            self._registers = shared_array(queue, batch * self.plan.registers, self.dtype)
            self._partials = cl.Buffer(queue.context, cl.mem_flags.READ_WRITE, size)
            self._batch = batch
        self._scratch = arguments[-1]
        shared = (self._registers.argument, self._partials)
        for name in _launched(self.plan.parts):
            self.kernels[name].set_args(*arguments, *shared, np.int32(batch), np.int32(first))

    def run(self) -> None:
        """Launch all parts."""
        self._play(self.plan.parts)

    def _play(self, parts: Iterable[LaunchStep]) -> None:
        for part in parts:
            if isinstance(part, Launch):
                self.kernels.launch(part.kernel, (part.pieces, self._batch))
            elif isinstance(part, Steps):
                self._steps(part)
            else:
                self._repeat(part)

    def _repeat(self, rounds: Rounds) -> None:
        if rounds.flag is not None:
            played = 0
            while self._register(rounds.flag).any():
                ahead = 1 + min(played // ROUNDS_PER_ROUND_AHEAD, MOST_AHEAD)
                for _ in range(ahead):
                    self._play(rounds.parts)
                played += ahead
            return
        count = rounds.count or 0
        if rounds.bound is not None:
            place, start = rounds.bound
            count = int(self._register(place).max()) - start
        for _ in range(count):
            self._play(rounds.parts)

    def _register(self, place: int) -> np.ndarray[tuple[int, ...], np.dtype[np.floating]]:
        """Return the value of a register in each frame, once all previous launches are done."""
        self._registers.pull(self.kernels.queue)
        return self._registers.host[place * self._batch : (place + 1) * self._batch]

    def _steps(self, steps: Steps) -> None:
        """Load the states, run the levels strip by strip, and store the states back."""
        strips, levels = steps.strips, self._levels(steps)
        if steps.levels is not None and levels == 0:
            return
        pieces = strips.pieces(self._batch, self.kernels.queue.device.max_compute_units)
        whole = pieces == 1 and strips.alone
        at_once = levels if whole else strips.levels
        if strips.first is not None:
            self._phase(steps, pieces, strips.first)
        for done in range(0, levels, max(1, at_once)):
            count = min(at_once, levels - done)
            self._phase(steps, pieces, 1, done, count)
            if not whole:
                self._phase(steps, pieces, 2, done, count)
        if strips.ends:
            self._phase(steps, pieces, 3)

    def _levels(self, steps: Steps) -> int:
        """Return the largest number of levels of any frame."""
        if steps.levels is None:
            return steps.strips.count
        taken = self._register(steps.levels)
        if steps.guard is not None:
            taken = taken[self._register(steps.guard) != 0]
        return int(taken.max(initial=0))

    def _phase(self, steps: Steps, pieces: int, phase: int, done: int = 0, count: int = 0) -> None:
        guard = -1 if steps.guard is None else steps.guard
        numbers = (guard, self._batch, pieces, phase, done, count)
        arguments = (self._scratch, self._registers.argument, *map(np.int32, numbers))
        self.kernels.launch(steps.strips.kernel, (pieces * self._batch,), *arguments)


Runner = WholeRunner | LaunchRunner
"""Both bind the plan's own arrays for a batch size, and run."""


def _launched(parts: Iterable[LaunchStep]) -> Iterator[str]:
    """Yield the kernels of the parts, including repeated ones."""
    for part in parts:
        if isinstance(part, Launch):
            yield part.kernel
        elif isinstance(part, Rounds):
            yield from _launched(part.parts)


OWN = 2
"""Reference count of a block that no array uses: its owner's, and the query's."""


@dataclass(slots=True, eq=False)
class KeptBlock:
    """Allocates memory for results, reused once no array refers to it.

    The operating system clears new memory page by page on first touch, which for results of
    1024×1024 cells takes longer than writing them.
    """

    _block: Floats | None = None

    def take(self, size: int) -> Floats:
        """Return an uninitialised array of this size that shares memory with no other."""
        kept = self._block
        if kept is not None and kept.size == size:
            del kept
            if sys.getrefcount(self._block) <= OWN:
                assert self._block is not None
                return self._block
        self._block = np.empty(size)
        return self._block


PIECES = 32
"""Work items among which an array is divided."""


def exchanges(device: cl.Device) -> bool:
    """Return whether a device can access host arrays of doubles in place."""
    return shares_memory(device) and bool(device.double_fp_config)


@dataclass(slots=True, eq=False)
class Exchange:
    """Transfers the maps of a plan.

    Attributes
    ----------
    kernels : PlanKernels
    dtype : dtype
        Data type of the plan's numbers.
    """

    kernels: PlanKernels
    dtype: np.dtype[np.floating]
    _seen: dict[int, SharedArray] = field(default_factory=dict[int, SharedArray])
    _results: dict[str, KeptBlock] = field(default_factory=dict[str, KeptBlock])

    def take(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...], input: SharedArray
    ) -> bool:
        """Copy maps to the device, interleaved in each frame; return whether all are finite.

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
            Places of the results among a frame's numbers.
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
            # one block per result, so that keeping one does not keep the others alive
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
        finite = all(bool(np.isfinite(values).all()) for values in read.values())
        return results | read, finite and not seen.host.any()

    def _unseen(self, batch: int) -> SharedArray:
        """Return the counters of non-finite numbers, initialised to 0."""
        if batch not in self._seen:
            self._seen.clear()
            self._seen[batch] = shared_array(self.kernels.queue, batch * PIECES, self.dtype)
        self._seen[batch].host[:] = 0
        return self._seen[batch]

    def _buffer(self, array: NDArray[np.floating], flags: int) -> cl.Buffer:
        shared = flags | cl.mem_flags.USE_HOST_PTR
        return cl.Buffer(self.kernels.queue.context, shared, hostbuf=array)

    def _let_see(self, buffer: cl.Buffer) -> None:
        """Make writes visible to the host; nothing is copied if the memory is shared."""
        queue, all_of_it = self.kernels.queue, (0, (buffer.size,), np.dtype(np.uint8))
        seen, _ = cl.enqueue_map_buffer(
            queue, buffer, cl.map_flags.READ, *all_of_it, is_blocking=False
        )
        seen.base.release(queue)


def _as_it_lies(array: NDArray[np.floating], lead: tuple[int, ...]) -> NDArray[np.floating]:
    """Return the numbers of one frame, or of a whole batch, contiguous in memory."""
    alone = array.size == math.prod(array.shape[-3:])
    whole = array if alone else np.broadcast_to(array, (*lead, *array.shape[-3:]))
    plain = whole.dtype if whole.dtype.name in TAKEN else np.dtype(np.float64)
    return np.require(whole, plain.newbyteorder("="), ("C", "A"))
