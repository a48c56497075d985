"""The quick way of a single frame: everything that can be done before it comes is done once."""

from dataclasses import InitVar, dataclass, field
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.devices.device_trouble import run_failure
from cnnum.engines.devices.shared_arrays import SharedArray
from cnnum.engines.failures import refuse_unfinished
from cnnum.engines.forks import LOST, refuse_after_fork
from cnnum.engines.opencl.lowering.storage import Places

ONE_ITEM = (1,)


@dataclass(slots=True, eq=False)
class OneFrame:
    """A kernel with its own arrays, whose arguments stay set from one frame to the next.

    Attributes
    ----------
    queue : CommandQueue
    kernel : Kernel
        No other object sets its arguments.
    input, output : SharedArray
    arguments : tuple
        The kernel's, but for the number of frames and whether it is the first.
    given : (rows, cols, channels) float
        The numbers of `input` that travel to the device.
    places : Places
        Of the outputs in the numbers that come back. The last of them says whether a transient or a
        loop did not reach its end.
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
            If a transient or a loop did not reach its end.
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
            self.queue.finish()  # after Ctrl-C no memory is freed that a kernel still writes to
            raise
        self.packed = packed = self.output.host.astype(np.float64)
        if packed[-1] != 0.0:
            refuse_unfinished(packed[-1:])
        return {
            name: packed[at, ...] if shape is None else packed[at].reshape(shape)
            for name, at, shape in self._places
        }
