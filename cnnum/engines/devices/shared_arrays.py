"""Arrays visible to host and device: shared memory if the device has it, else copies."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class SharedArray:
    """An array shared by host and device.

    Attributes
    ----------
    host : (n,) float
        The array that the host writes before `push`, and reads after `pull`.
    argument : SVM or Buffer
        The argument of a kernel.
    copied : Buffer or None
        None if the memory is the same, so that nothing has to be copied.
    """

    host: NDArray[np.floating]
    argument: "cl.Buffer | cl.SVM[Any]"
    copied: cl.Buffer | None

    def push(self, queue: cl.CommandQueue) -> None:
        """Make the host's writes visible to the device."""
        if self.copied is not None:
            cl.enqueue_copy(queue, self.copied, self.host, is_blocking=False)

    def pull(self, queue: cl.CommandQueue) -> None:
        """Wait for the device, and make its writes visible to the host."""
        if self.copied is None:
            queue.finish()
        else:
            cl.enqueue_copy(queue, self.host, self.copied)


def shares_memory(device: cl.Device) -> bool:
    """Return whether host and device may use the same memory without telling each other.

    OpenCL 2's fine-grained shared virtual memory: PoCL has it on processors.
    """
    try:
        return bool(device.svm_capabilities & cl.device_svm_capabilities.FINE_GRAIN_BUFFER)
    except cl.Error:  # a device of OpenCL 1
        return False


def shared_array(queue: cl.CommandQueue, size: int, dtype: np.dtype[np.floating]) -> SharedArray:
    """Return an array of zeros, with at least one element."""
    context, size = queue.context, max(size, 1)
    if shares_memory(queue.device):
        empty = cast(Callable[..., Any], cl.fsvm_empty)
        # whole vectors at the end may be read, and vectors begin at their own size
        host = cast(NDArray[np.floating], empty(context, (size,), dtype, alignment=64))
        host[:] = 0
        return SharedArray(host, cl.SVM(host), None)
    host = np.zeros(size, dtype)
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    buffer = cl.Buffer(context, flags, hostbuf=host)
    return SharedArray(host, buffer, buffer)
