"""A built plan on an OpenCL device: kernels per lane count, buffers per batch, single frames."""

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import InitVar, dataclass, field
from threading import RLock
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.arrays import FEW, Floats
from cnnum.engines.devices.child import build_failure, run_failure
from cnnum.engines.devices.program_cache import build_program
from cnnum.engines.devices.shared_arrays import SharedArray, shared_array
from cnnum.engines.forks import LOST, refuse_after_fork
from cnnum.engines.notices import refuse_unfinished
from cnnum.engines.opencl.launching import (
    Exchange,
    LaunchRunner,
    PlanKernels,
    Runner,
    WholeRunner,
    exchanges,
)
from cnnum.engines.opencl.lowering.kernel_source import KernelSource, lower
from cnnum.engines.opencl.lowering.storage import Places, Tables
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solvers
from cnnum.safety.values import refuse_beyond

ONE_ITEM = (1,)


@dataclass(slots=True, eq=False)
class OneFrame:
    """A kernel with its own arrays, whose arguments remain set between frames.

    Attributes
    ----------
    queue : CommandQueue
    kernel : Kernel
        Owned by this object: nothing else sets its arguments.
    input, output : SharedArray
    arguments : tuple
        The kernel's arguments except the number of frames and the first-frame flag.
    given : (rows, cols, channels) float
        The part of `input` that is copied to the device.
    places : Places
        Places of the outputs among the returned values. The last value says whether a transient or
        a loop did not finish.
    """

    queue: cl.CommandQueue
    kernel: cl.Kernel
    input: SharedArray
    output: SharedArray
    arguments: tuple[Any, ...]
    given: NDArray[np.floating]
    places: InitVar[Places]
    packed: Floats = field(default_factory=lambda: np.zeros(0))
    _first: bool | None = None
    _places: list[tuple[str, slice | int, tuple[int, ...] | None]] = field(init=False)

    def __post_init__(self, places: Places) -> None:
        self._places = [
            (name, at, shape) if shape else (name, at.start, None)
            for name, (at, shape) in places.items()
        ]

    def run(self, values: NDArray[np.floating], *, first: bool) -> dict[str, Floats]:
        """Run a frame; the outputs are views of `packed`, which is new for every frame.

        Raises
        ------
        MethodError
            If a transient or a loop did not finish.
        NoOpenCLError
            If this process was forked after the engine was made.
        """
        if LOST.opencl:
            refuse_after_fork()
        self.given[...] = values
        self.input.push(self.queue)
        if first is not self._first:
            self.kernel.set_args(*self.arguments, np.int32(1), np.int32(first))
            self._first = first
        try:
            cl.enqueue_nd_range_kernel(self.queue, self.kernel, ONE_ITEM, ONE_ITEM)
            self.output.pull(self.queue)
        except cl.Error as error:
            raise run_failure(error, self.queue) from error
        except BaseException:
            self.queue.finish()  # after Ctrl-C, do not free memory that a kernel still writes to
            raise
        self.packed = packed = self.output.host.astype(np.float64)
        if packed[-1] != 0.0:
            refuse_unfinished(packed[-1:])
        return {
            name: packed[at, ...] if shape is None else packed[at].reshape(shape)
            for name, at, shape in self._places
        }


WIDE_CELLS = 256
"""Largest array, in cells, whose frames are interleaved in vector lanes. Lanes of larger arrays
would no longer fit the cache, so the compiler vectorises along their columns."""

MOST_LANES = 16

LEAST_WIDTH = 4
"""Vector width used if a device reports none: its compiler splits the vectors."""

QUIET = "-w"
"""Suppresses compiler warnings about how vectors of this width are passed to built-ins."""

FLUSH = "-cl-denorms-are-zero"
"""Flushes states that have decayed below 1e-38, or 1e-308 in float64, to 0: on Intel processors,
float64 steps with denormals take 20 to 100 times as long."""


_Site = tuple[int, cl.CommandQueue]
"""Where frames run: the number of frames per work item, and the queue."""


@dataclass(slots=True, eq=False)
class _Built:
    """The kernels of a plan with their constant data."""

    text: KernelSource
    kernels: PlanKernels
    data: cl.Buffer
    runner: Runner
    exchange: Exchange


@dataclass(slots=True, eq=False)
class _Arrays:
    input: SharedArray
    output: SharedArray
    scratch: cl.Buffer

    def arguments(self, memory: SharedArray, data: cl.Buffer) -> tuple[Any, ...]:
        """Return the leading arguments of a plan's kernels."""
        own = (self.input.argument, self.output.argument, memory.argument)
        return (*own, data, self.scratch)


@dataclass(slots=True, eq=False)
class OpenCLExecutable:
    """Runs a schedule as one kernel launch per batch, or several launches for large arrays.

    Threads run one at a time, because the plan owns the buffers of a launch.

    Attributes
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    queue : CommandQueue
    own : CommandQueue
        Queue of a device that runs kernels in the calling thread, used for a few small frames;
        `queue` if there is no such device.
    dtype : dtype
    wide_lanes : int
        Frames interleaved in one work item of a large batch.
    near_bytes : int
        Bytes of cache per core that keep up with its arithmetic.
    """

    schedule: Schedule
    solvers: Solvers
    queue: cl.CommandQueue
    own: cl.CommandQueue
    dtype: np.dtype[np.floating]
    wide_lanes: int
    near_bytes: int
    _texts: dict[int, KernelSource] = field(default_factory=dict[int, KernelSource])
    _built: dict[_Site, _Built] = field(default_factory=dict[_Site, _Built])
    _arrays: dict[int, _Arrays] = field(default_factory=dict[int, _Arrays])
    _no_memory: dict[_Site, SharedArray] = field(default_factory=dict[_Site, SharedArray])
    _bound: tuple[object, ...] = ()
    _turn: RLock = field(default_factory=RLock)

    @property
    def launches(self) -> int:
        """Kernel launches per frame, counting one iteration of loops with data-dependent length."""
        parts = self._text(1).parts
        return 1 if parts is None else parts.launches(self.queue.device.max_compute_units)

    @property
    def private_bytes(self) -> int:
        """Bytes of private arrays of a work item that runs one frame."""
        return self._text(1).private * self.dtype.itemsize

    @property
    def local_bytes(self) -> int:
        """Always 0: a work item runs whole frames, or a part that no other work item writes to."""
        return 0

    @property
    def scratch_bytes(self) -> int:
        """Bytes of global working memory per frame, if its array is too large to be private."""
        return self._text(1).scratch * self.dtype.itemsize

    @property
    def source(self) -> str:
        """The exact source of the widest kernel that has run, or that one frame would run."""
        return self._text(max((lanes for lanes, _ in self._built), default=1)).source

    @property
    def strategies(self) -> Mapping[int, str]:
        """Description of how each transient of a single frame runs, by node."""
        return self._text(1).strategies

    def lanes_for(self, batch: int) -> int:
        """Return how many frames of a batch are interleaved in one work item."""
        wide = batch >= self.wide_lanes and self._stays_private(self.wide_lanes)
        return self.wide_lanes if wide else 1

    def _stays_private(self, lanes: int) -> bool:
        """Return whether a work item keeps all arrays of `lanes` frames in private memory."""
        return self.schedule.cells <= WIDE_CELLS and not self._text(lanes).scratch

    def queue_for(self, batch: int) -> cl.CommandQueue:
        """Return the queue on which a batch runs."""
        # one work item keeps one thread busy, and handing it over costs as much as running it
        small = batch * self.schedule.cells <= WIDE_CELLS
        few = small and self.lanes_for(batch) in (1, batch)
        return self.own if few else self.queue

    def new_memory(self, batch: int) -> object:
        """Return cleared memories on the device, shared by all streams if a plan has none."""
        with self._guarded():
            site = lanes, queue = self.lanes_for(batch), self.queue_for(batch)
            size = batch * self._text(lanes).memory_size
            if size:
                return shared_array(queue, size, self.dtype)
            if site not in self._no_memory:
                self._no_memory[site] = shared_array(queue, 0, self.dtype)
            return self._no_memory[site]

    def held(self, memory: object, batch: int) -> tuple[NDArray[np.floating], ...]:
        """Return a host view of the memories."""
        assert isinstance(memory, SharedArray)
        with self._guarded():
            memory.pull(self.queue_for(batch))
            return (memory.host,)

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Restore the memories from a copy of these values."""
        assert isinstance(memory, SharedArray)
        with self._guarded():
            (memory.host[:],) = numbers
            memory.push(self.queue_for(batch))

    def one(self, memory: object) -> OneFrame | None:
        """Return the fast path for single frames of a stream, or None if there is none."""
        assert isinstance(memory, SharedArray)
        with self._guarded():
            if not self._stays_private(1):
                return None
            built = self._build(1)
            arrays = self._new_arrays(1, built)
        kernels, given, taken = built.kernels, arrays.input, arrays.output
        kernel, arguments = kernels.separate("plan"), arrays.arguments(memory, built.data)
        shape = (*self.schedule.shape, len(self.schedule.channels_read))
        numbers = given.host[: math.prod(shape)].reshape(shape)
        places = built.text.outputs
        return OneFrame(kernels.queue, kernel, given, taken, arguments, numbers, places)

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Copy frames to the device, launch once and read the requested outputs."""
        with self._guarded():
            batch = frames.shape[0]
            built, arrays = self._ready(batch)
            queue = built.kernels.queue
            if frames.size:
                # large arrays are copied channel by channel
                given = np.moveaxis(frames, -1, 1) if built.text.scratch else frames
                np.copyto(arrays.input.host.reshape(given.shape), given, casting="same_kind")
                arrays.input.push(queue)
            self._launch(built, arrays, memory, batch, first=first)
            arrays.output.pull(queue)
            result = arrays.output.host.reshape(batch, -1)
            refuse_unfinished(result[:, -1])
            if result.size <= FEW:  # one array for all, as calls take longer than copies
                packed = result.astype(np.float64)
                return {
                    name: packed[:, at].reshape(batch, *shape)
                    for name, (at, shape) in built.text.outputs.items()
                }
            return {
                name: result[:, at].astype(np.float64).reshape(batch, *shape)
                for name, (at, shape) in built.text.outputs.items()
            }

    def run_large(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]
    ) -> tuple[dict[str, Floats], bool] | None:
        """Let kernels access host arrays directly, or return None if the device cannot."""
        with self._guarded():
            if self._text(1).parts is None or not exchanges(self.queue.device):
                return None
            batch = math.prod(lead)
            built, arrays = self._ready(batch)
            if not built.exchange.take(maps, lead, arrays.input):
                return None
            self._launch(built, arrays, self.new_memory(batch), batch, first=True)
            given = built.exchange.give(arrays.output, built.text.outputs, batch)
            refuse_unfinished(arrays.output.host.reshape(batch, -1)[:, -1])
            return given

    @contextmanager
    def _guarded(self) -> Generator[None]:
        """Hold the lock, and translate device failures to errors of this package."""
        refuse_after_fork()  # before a lock that another thread held at the fork
        with self._turn:
            try:
                yield
            except cl.Error as error:
                raise run_failure(error, self.queue) from error
            except BaseException:
                # after Ctrl-C, do not free memory that a kernel still writes to
                self.own.finish()
                self.queue.finish()
                raise

    def _launch(
        self, built: _Built, arrays: _Arrays, memory: object, batch: int, *, first: bool
    ) -> None:
        """Launch the kernels, setting their arguments unless they are unchanged."""
        assert isinstance(memory, SharedArray)
        bound = (built, arrays, memory, batch, first)
        if bound != self._bound:
            built.runner.bind(arrays.arguments(memory, built.data), batch, first=first)
            self._bound = bound
        built.runner.run()

    def _text(self, lanes: int) -> KernelSource:
        if lanes not in self._texts:
            width = max(self.wide_lanes, LEAST_WIDTH)
            by_vectors = self.wide_lanes > 1
            tables = Tables(self.dtype, lanes, width, self.near_bytes, by_vectors)
            self._texts[lanes] = lower(self.schedule, self.solvers, tables)
        return self._texts[lanes]

    def _ready(self, batch: int) -> tuple[_Built, _Arrays]:
        """Return the kernels and arrays for a batch size."""
        built = self._build(batch)
        if batch not in self._arrays:
            self._arrays.clear()  # keep one batch size only: large ones would accumulate
            self._arrays[batch] = self._new_arrays(batch, built)
        return built, self._arrays[batch]

    def _build(self, batch: int) -> _Built:
        """Return the kernels for a batch size."""
        site = lanes, queue = self.lanes_for(batch), self.queue_for(batch)
        if site not in self._built:
            text = self._text(lanes)
            try:
                program = build_program(queue.context, text.source, [QUIET, FLUSH])
            except cl.RuntimeError as error:
                raise build_failure(text.source, error, queue.device) from error
            flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
            data = cl.Buffer(queue.context, flags, hostbuf=text.data)
            kernels = PlanKernels(queue, program)
            runner: Runner = WholeRunner(kernels, lanes)
            if text.parts is not None:
                runner = LaunchRunner(kernels, text.parts, self.dtype)
            exchange = Exchange(kernels, self.dtype)
            self._built[site] = _Built(text, kernels, data, runner, exchange)
        return self._built[site]

    def _new_arrays(self, batch: int, built: _Built) -> _Arrays:
        queue, itemsize = built.kernels.queue, self.dtype.itemsize
        given = batch * self.schedule.cells * len(self.schedule.channels_read)
        taken = batch * built.text.output_size
        # vector reads may extend past the end
        scratch = batch * built.text.scratch + MOST_LANES
        refuse_beyond(
            f"A batch of {batch} frame(s)",
            max(scratch, given, taken) * itemsize,
            queue.device.max_mem_alloc_size,
            "a block of the device",
        )
        return _Arrays(
            shared_array(queue, given, self.dtype),
            shared_array(queue, taken, self.dtype),
            cl.Buffer(queue.context, cl.mem_flags.READ_WRITE, scratch * itemsize),
        )
