"""A launch that does nothing, with its copies: the least that any plan can take on a device."""

import numpy as np
import pyopencl as cl

from cnnum.engines.devices.building import build_program
from cnnum.engines.devices.inline import partner_of
from cnnum.engines.devices.selection import choose_device

_TEXT = """
__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void nothing(__global const float *restrict in, __global float *restrict out)
{
}
"""


class EmptyLaunch:
    """Copies bytes in, launches an empty kernel, copies bytes out and waits.

    Parameters
    ----------
    device : str
        Part of the device's name.
    bytes_in, bytes_out : int
    alone : bool
        Launch in the thread that asks, as single frames do, where the device has a partner that
        can.
    """

    def __init__(self, device: str, bytes_in: int, bytes_out: int, *, alone: bool = False) -> None:
        handle = choose_device(device).handle
        context = cl.Context([(partner_of(handle) if alone else None) or handle])
        self._queue = cl.CommandQueue(context)
        self._kernel = cl.Kernel(build_program(context, _TEXT), "nothing")
        self._given = np.zeros(max(bytes_in, 4), np.uint8)
        self._taken = np.zeros(max(bytes_out, 4), np.uint8)
        flags = cl.mem_flags
        self._input = cl.Buffer(context, flags.READ_ONLY, self._given.nbytes)
        self._output = cl.Buffer(context, flags.WRITE_ONLY, self._taken.nbytes)

    def run(self) -> None:
        """Do it once."""
        cl.enqueue_copy(self._queue, self._input, self._given, is_blocking=False)
        self._kernel(self._queue, (1,), (1,), self._input, self._output)
        cl.enqueue_copy(self._queue, self._taken, self._output)
