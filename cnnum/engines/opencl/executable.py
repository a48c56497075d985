"""A built plan on an OpenCL device: kernels by number of lanes, buffers by batch."""

from dataclasses import dataclass, field

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.backend import Solvers
from cnnum.engines.failures import refuse_unfinished
from cnnum.engines.opencl.kernel_text import KernelText, lower
from cnnum.errors import NotSupportedError
from cnnum.graph.schedule import Schedule

WIDE_CELLS = 256
"""Largest array whose frames lie side by side in lanes; the compiler vectorises along the
columns of larger ones, whose lanes would no longer fit the cache."""

QUIET = ["-w"]
"""Compilers warn of how vectors of this width are handed to built-in functions, which is theirs."""


@dataclass(slots=True, eq=False)
class _Kernel:
    text: KernelText
    kernel: cl.Kernel
    data: cl.Buffer


@dataclass(slots=True, eq=False)
class _Buffers:
    input: cl.Buffer
    output: cl.Buffer
    scratch: cl.Buffer
    result: NDArray[np.floating]


@dataclass(slots=True, eq=False)
class OpenCLExecutable:
    """Runs a schedule as one kernel launch a batch."""

    schedule: Schedule
    solvers: Solvers
    queue: cl.CommandQueue
    dtype: np.dtype[np.floating]
    wide_lanes: int
    _kernels: dict[int, _Kernel] = field(default_factory=dict[int, _Kernel])
    _buffers: dict[int, _Buffers] = field(default_factory=dict[int, _Buffers])

    @property
    def launches(self) -> int:
        """Kernel launches a batch."""
        return 1

    @property
    def source(self) -> str:
        """The exact text that was built, the widest kernel that has run (or would for a frame)."""
        return self._kernel(max(self._kernels, default=1)).text.source

    def lanes_for(self, batch: int) -> int:
        """Return how many frames of a batch lie side by side in one work item."""
        wide = batch >= self.wide_lanes and self.schedule.cells <= WIDE_CELLS
        return self.wide_lanes if wide else 1

    def new_memory(self, batch: int) -> object:
        """Return cleared memories on the device."""
        size = max(1, batch * self._kernel(self.lanes_for(batch)).text.memory_size)
        zeros = np.zeros(size, self.dtype)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        return cl.Buffer(self.queue.context, flags, hostbuf=zeros)

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Copy frames in, launch once, copy what is wanted out."""
        assert isinstance(memory, cl.Buffer)
        batch = frames.shape[0]
        lanes = self.lanes_for(batch)
        built, buffers = self._kernel(lanes), self._buffers_for(batch, lanes)
        packed = np.ascontiguousarray(frames, dtype=self.dtype)
        if packed.size:
            cl.enqueue_copy(self.queue, buffers.input, packed, is_blocking=False)
        built.kernel(
            self.queue,
            (-(-batch // lanes),),
            (1,),
            buffers.input,
            buffers.output,
            memory,
            built.data,
            buffers.scratch,
            np.int32(batch),
            np.int32(first),
        )
        cl.enqueue_copy(self.queue, buffers.result, buffers.output)
        return self._unpack(built.text, buffers.result)

    def _unpack(self, text: KernelText, result: NDArray[np.floating]) -> dict[str, Floats]:
        refuse_unfinished(result[:, -1])
        outputs: dict[str, Floats] = {}
        for name, at in text.outputs.items():
            if self.schedule.outputs[name].scalar:
                outputs[name] = result[:, at].astype(np.float64)
            else:
                block = result[:, at : at + self.schedule.cells].astype(np.float64)
                outputs[name] = block.reshape(-1, *self.schedule.shape)
        return outputs

    def _kernel(self, lanes: int) -> _Kernel:
        if lanes not in self._kernels:
            text = lower(self.schedule, self.solvers, lanes, self.dtype)
            context = self.queue.context
            try:
                program = cl.Program(context, text.source).build(options=QUIET)
            except cl.RuntimeError as error:
                raise NotSupportedError(f"The OpenCL compiler refused a plan: {error}") from error
            flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
            data = cl.Buffer(context, flags, hostbuf=text.data)
            self._kernels[lanes] = _Kernel(text, cl.Kernel(program, "plan"), data)
        return self._kernels[lanes]

    def _buffers_for(self, batch: int, lanes: int) -> _Buffers:
        if batch not in self._buffers:
            text, width = self._kernel(lanes).text, self.dtype.itemsize
            cells_read = self.schedule.cells * len(self.schedule.channels_read)
            context, flags = self.queue.context, cl.mem_flags
            self._buffers.clear()  # one batch size at a time: large ones would pile up
            self._buffers[batch] = _Buffers(
                cl.Buffer(context, flags.READ_ONLY, max(1, batch * cells_read) * width),
                cl.Buffer(context, flags.WRITE_ONLY, batch * text.output_size * width),
                cl.Buffer(context, flags.READ_WRITE, max(1, batch * text.scratch) * width),
                np.empty((batch, text.output_size), self.dtype),
            )
        return self._buffers[batch]
