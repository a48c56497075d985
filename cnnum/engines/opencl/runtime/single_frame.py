"""The quick way of a single frame: everything that can be done before it comes is done once."""

from collections.abc import Mapping

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.devices.device_trouble import run_failure
from cnnum.engines.devices.shared_arrays import SharedArray
from cnnum.engines.failures import refuse_unfinished
from cnnum.engines.forks import LOST, refuse_after_fork

ONE_ITEM = (1,)


class OneFrame:
    """A kernel with its own arrays, whose arguments stay set from one frame to the next.

    Parameters
    ----------
    queue : CommandQueue
    kernel : Kernel
        No other object sets its arguments.
    input, output, memory : SharedArray
    data, scratch : Buffer
    shape : (rows, cols, channels read)
    places : mapping of str to (slice, shape)
        Where each output stands in the numbers that come back; the last of them says whether a
        transient or a loop did not reach its end.
    """

    __slots__ = (
        "_arguments",
        "_first",
        "_given",
        "_input",
        "_kernel",
        "_output",
        "_places",
        "_queue",
        "_taken",
        "packed",
    )

    def __init__(
        self,
        queue: cl.CommandQueue,
        kernel: cl.Kernel,
        input: SharedArray,
        output: SharedArray,
        memory: SharedArray,
        data: cl.Buffer,
        scratch: cl.Buffer,
        shape: tuple[int, int, int],
        places: Mapping[str, tuple[slice, tuple[int, ...]]],
    ) -> None:
        self._queue, self._kernel = queue, kernel
        self._input, self._output = input, output
        size = shape[0] * shape[1] * shape[2]
        self._given = input.host[:size].reshape(shape)
        self._taken = output.host
        self._arguments = (input.argument, output.argument, memory.argument, data, scratch)
        self._first: bool | None = None
        self._places = [
            (name, at, shape) if shape else (name, at.start, None)
            for name, (at, shape) in places.items()
        ]
        self.packed: Floats = np.zeros(len(self._taken))

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows, columns and channels that travel to the device."""
        return self._given.shape

    def run(self, values: NDArray[np.floating], *, first: bool) -> dict[str, Floats]:
        """Run a frame; the outputs are views of `packed`, which is new for every frame.

        Raises
        ------
        MethodError
            If a transient or a loop did not reach its end.
        NoOpenCLError
            If this process was forked after the engine was made.
        """
        if LOST.opencl:
            refuse_after_fork()
        self._given[...] = values
        self._input.push(self._queue)
        if first is not self._first:
            self._kernel.set_args(*self._arguments, np.int32(1), np.int32(first))
            self._first = first
        try:
            cl.enqueue_nd_range_kernel(self._queue, self._kernel, ONE_ITEM, ONE_ITEM)
            self._output.pull(self._queue)
        except cl.Error as error:
            raise run_failure(error, self._queue) from error
        except BaseException:
            self._queue.finish()  # after Ctrl-C no memory is freed that a kernel still writes to
            raise
        self.packed = packed = self._taken.astype(np.float64)
        if packed[-1] != 0.0:
            refuse_unfinished(packed[-1:])
        return {
            name: packed[at, ...] if shape is None else packed[at].reshape(shape)
            for name, at, shape in self._places
        }
