"""A built plan on an OpenCL device: kernels by number of lanes, buffers by batch."""

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import RLock

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.devices.building import build_program
from cnnum.engines.devices.device_trouble import build_failure, run_failure
from cnnum.engines.devices.shared_arrays import SharedArray, shared_array, shares_memory
from cnnum.engines.failures import refuse_unfinished
from cnnum.engines.forks import refuse_after_fork
from cnnum.engines.opencl.lowering.kernel_source import KernelSource, lower
from cnnum.engines.opencl.lowering.storage import Tables
from cnnum.engines.opencl.runtime.host_exchange import Exchange, exchanges
from cnnum.engines.opencl.runtime.launch_runner import LaunchArrays, LaunchRunner
from cnnum.engines.opencl.runtime.single_frame import OneFrame
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solvers
from cnnum.safety.memory import refuse_beyond

WIDE_CELLS = 256
"""Largest array whose frames lie side by side in lanes; the compiler vectorises along the
columns of larger ones, whose lanes would no longer fit the cache."""

MOST_LANES = 16

LEAST_WIDTH = 4
"""Cells side by side in a vector where a device says that it has none: its compiler splits them."""

QUIET = "-w"
"""Compilers warn of how vectors of this width are handed to built-in functions, which is theirs."""

FLUSH = "-cl-denorms-are-zero"
"""A state that has decayed below 1e-38, or 1e-308 in float64, is 0, and costs no more than others:
on Intel's processors steps of float64 between denormals take 20 to 100 times as long."""


@contextmanager
def _finished(queue: cl.CommandQueue) -> Generator[None]:
    """Wait for the queue after Ctrl-C, so that no memory is freed that a kernel still writes to."""
    try:
        yield
    except BaseException:
        queue.finish()
        raise


@dataclass(slots=True, eq=False)
class _Built:
    """A kernel that is the whole plan, or its parts; the program is kept, or Intel's is lost."""

    text: KernelSource
    program: cl.Program
    data: cl.Buffer
    kernel: cl.Kernel | None
    parted: LaunchRunner | None
    exchange: Exchange


@dataclass(slots=True, eq=False)
class _Arrays:
    input: SharedArray
    output: SharedArray
    scratch: cl.Buffer
    between: LaunchArrays | None


@dataclass(slots=True, eq=False)
class OpenCLExecutable:
    """Runs a schedule as one kernel launch a batch; large arrays as a row of launches.

    Threads take turns: the buffers of a launch belong to the plan.

    Attributes
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    queue : CommandQueue
    dtype : dtype
    wide_lanes : int
        Frames that lie side by side in one work item of a large batch.
    near_bytes : int
        Cache of a core that keeps up with its arithmetic.
    own : CommandQueue or None
        Of a device that runs kernels in the thread that asks: few small frames go there.
    """

    schedule: Schedule
    solvers: Solvers
    queue: cl.CommandQueue
    dtype: np.dtype[np.floating]
    wide_lanes: int
    near_bytes: int
    own: cl.CommandQueue | None = None
    _texts: dict[int, KernelSource] = field(default_factory=dict[int, KernelSource])
    _kernels: dict[tuple[int, bool], _Built] = field(default_factory=dict[tuple[int, bool], _Built])
    _arrays: dict[int, _Arrays] = field(default_factory=dict[int, _Arrays])
    _no_memory: dict[bool, SharedArray] = field(default_factory=dict[bool, SharedArray])
    _bound: tuple[object, ...] = ()
    _turn: RLock = field(default_factory=RLock)

    @property
    def launches(self) -> int:
        """Kernel launches a frame; of loops that frames end by themselves, one round counts."""
        parts = self._text(1).parts if self.schedule.cells > WIDE_CELLS else None
        return 1 if parts is None else parts.launches(self.queue.device.max_compute_units)

    @property
    def private_bytes(self) -> int:
        """Private memory of a work item that runs one frame, in arrays."""
        return self._text(1).private * self.dtype.itemsize

    @property
    def local_bytes(self) -> int:
        """None: a work item runs whole frames, or a piece that no other one writes to."""
        return 0

    @property
    def scratch_bytes(self) -> int:
        """Global memory that one frame works in where its array is too large to be private."""
        return self._text(1).scratch * self.dtype.itemsize

    @property
    def source(self) -> str:
        """The exact text that was built, the widest kernel that has run (or would for a frame)."""
        return self._text(max((lanes for lanes, _ in self._kernels), default=1)).source

    @property
    def strategies(self) -> Mapping[int, str]:
        """How each transient of a single frame runs, in words, by its node."""
        return self._text(1).strategies

    def lanes_for(self, batch: int) -> int:
        """Return how many frames of a batch lie side by side in one work item."""
        wide = batch >= self.wide_lanes and self.schedule.cells <= WIDE_CELLS
        return self.wide_lanes if wide else 1

    def new_memory(self, batch: int) -> object:
        """Return cleared memories on the device; the same for all where a plan has none."""
        refuse_after_fork()  # before a lock that another thread held then
        with self._guarded():
            size = batch * self._text(self.lanes_for(batch)).memory_size
            queue = self.queue_for(batch)
            if size:
                return self._array(size, queue)
            alone = queue is self.own
            if alone not in self._no_memory:
                self._no_memory[alone] = self._array(0, queue)
            return self._no_memory[alone]

    def queue_for(self, batch: int) -> cl.CommandQueue:
        """Return the place of a number of frames."""
        alone = self.lanes_for(batch) == 1 and batch * self.schedule.cells <= WIDE_CELLS
        return self.own if alone and self.own is not None else self.queue

    def held(self, memory: object, batch: int) -> tuple[NDArray[np.floating], ...]:
        """Return the values of memories, as the host sees it."""
        assert isinstance(memory, SharedArray)
        with self._guarded():
            memory.pull(self.queue_for(batch))
            return (memory.host,)

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Let memories hold a copy of these numbers."""
        assert isinstance(memory, SharedArray)
        with self._guarded():
            (memory.host[:],) = numbers
            memory.push(self.queue_for(batch))

    def one(self, memory: object) -> OneFrame | None:
        """Return the quick way for the single frames of a stream; None where there is none."""
        assert isinstance(memory, SharedArray)
        refuse_after_fork()
        if self.schedule.cells > WIDE_CELLS:
            return None
        with self._guarded():
            queue, built = self.queue_for(1), self._kernel(1, alone=True)
            arrays, schedule = self._new_arrays(1, built, queue), self.schedule
        kernel, given, taken = cl.Kernel(built.program, "plan"), arrays.input, arrays.output
        buffers = (given.argument, taken.argument, memory.argument, built.data, arrays.scratch)
        shape = (*schedule.shape, len(schedule.channels_read))
        return OneFrame(queue, kernel, given, taken, buffers, shape, built.text.outputs)

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Hand frames over, launch once, read the wanted outputs."""
        assert isinstance(memory, SharedArray)
        refuse_after_fork()
        with self._guarded():
            batch = frames.shape[0]
            lanes, queue = self.lanes_for(batch), self.queue_for(batch)
            built = self._kernel(lanes, alone=queue is self.own)
            arrays = self._arrays_for(batch, built)
            if frames.size:
                # large arrays go channel by channel
                given = np.moveaxis(frames, -1, 1) if built.text.scratch else frames
                np.copyto(arrays.input.host.reshape(given.shape), given, casting="same_kind")
                arrays.input.push(queue)
            self._bind(built, arrays, memory, batch, first=first)
            with _finished(queue):
                if built.kernel is not None:
                    cl.enqueue_nd_range_kernel(queue, built.kernel, (-(-batch // lanes),), (1,))
                elif built.parted is not None and arrays.between is not None:
                    built.parted.run(arrays.scratch, arrays.between, batch)
                arrays.output.pull(queue)
            result = arrays.output.host.reshape(batch, -1)
            refuse_unfinished(result[:, -1])
            return {
                name: result[:, at].astype(np.float64).reshape(batch, *shape)
                for name, (at, shape) in built.text.outputs.items()
            }

    def run_large(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]
    ) -> tuple[dict[str, Floats], bool] | None:
        """Let kernels read and write the host's arrays where the device can, None elsewhere."""
        refuse_after_fork()
        with self._guarded():
            if self._text(1).parts is None or not exchanges(self.queue.device):
                return None
            built, batch = self._kernel(1, alone=False), math.prod(lead)
            arrays = self._arrays_for(batch, built)
            assert built.parted is not None
            assert arrays.between is not None
            with _finished(self.queue):
                if not built.exchange.take(maps, lead, arrays.input):
                    return None
                memory = self.new_memory(batch)
                assert isinstance(memory, SharedArray)
                self._bind(built, arrays, memory, batch, first=True)
                built.parted.run(arrays.scratch, arrays.between, batch)
                text = built.text
                given = built.exchange.give(arrays.output, text.output_size, text.outputs, batch)
            refuse_unfinished(arrays.output.host.reshape(batch, -1)[:, -1])
            return given

    @contextmanager
    def _guarded(self) -> Generator[None]:
        """Take a turn; trouble with the device is an error of this package."""
        with self._turn:
            try:
                yield
            except cl.Error as error:
                raise run_failure(error, self.queue) from error

    def _bind(
        self, built: _Built, arrays: _Arrays, memory: SharedArray, batch: int, *, first: bool
    ) -> None:
        """Set the kernels' arguments, unless they are the same as before."""
        bound = (built, arrays, memory, batch, first)
        if len(self._bound) == len(bound) and all(
            a is b for a, b in zip(bound, self._bound, strict=True)
        ):
            return
        given = (arrays.input.argument, arrays.output.argument, memory.argument, built.data)
        if built.kernel is not None:
            built.kernel.set_args(*given, arrays.scratch, np.int32(batch), np.int32(first))
        elif built.parted is not None and arrays.between is not None:
            built.parted.bind((*given, arrays.scratch), arrays.between, batch, first=first)
        self._bound = bound

    def _text(self, lanes: int) -> KernelSource:
        if lanes not in self._texts:
            width = max(self.wide_lanes, LEAST_WIDTH)
            by_vectors = self.wide_lanes > 1
            tables = Tables(self.dtype, lanes, width, self.near_bytes, by_vectors)
            self._texts[lanes] = lower(self.schedule, self.solvers, tables)
        return self._texts[lanes]

    def _kernel(self, lanes: int, *, alone: bool) -> _Built:
        """Return the kernels for a number of frames side by side, or for few small ones."""
        key = (lanes, alone and self.own is not None)
        if key not in self._kernels:
            queue = self.own if key[1] and self.own else self.queue
            self._kernels[key] = self._build(self._text(lanes), queue)
        return self._kernels[key]

    def _build(self, text: KernelSource, queue: cl.CommandQueue) -> _Built:
        try:
            program = build_program(queue.context, text.source, [QUIET, FLUSH])
        except cl.RuntimeError as error:
            raise build_failure(text.source, error, queue.device) from error
        flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
        data = cl.Buffer(queue.context, flags, hostbuf=text.data)
        exchange = Exchange(queue, program, self.dtype)
        if text.parts is None:
            return _Built(text, program, data, cl.Kernel(program, "plan"), None, exchange)
        parted = LaunchRunner(queue, program, text.parts, self.dtype)
        return _Built(text, program, data, None, parted, exchange)

    def _arrays_for(self, batch: int, built: _Built) -> _Arrays:
        if batch not in self._arrays:
            self._arrays.clear()  # one batch size at a time: large ones would pile up
            self._arrays[batch] = self._new_arrays(batch, built, self.queue_for(batch))
        return self._arrays[batch]

    def _new_arrays(self, batch: int, built: _Built, queue: cl.CommandQueue) -> _Arrays:
        cells_read = self.schedule.cells * len(self.schedule.channels_read)
        # a vector may be read over the end
        scratch = batch * built.text.scratch + MOST_LANES
        largest = max(scratch, batch * max(cells_read, built.text.output_size))
        refuse_beyond(
            f"A batch of {batch} frame(s)",
            largest * self.dtype.itemsize,
            queue.device.max_mem_alloc_size,
            "a block of the device",
        )
        return _Arrays(
            self._array(batch * cells_read, queue),
            self._array(batch * built.text.output_size, queue),
            cl.Buffer(queue.context, cl.mem_flags.READ_WRITE, scratch * self.dtype.itemsize),
            None if built.parted is None else built.parted.new_arrays(batch),
        )

    def _array(self, size: int, queue: cl.CommandQueue) -> SharedArray:
        share = shares_memory(queue.device)
        return shared_array(queue.context, size, self.dtype, share=share)
