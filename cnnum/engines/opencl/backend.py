"""The OpenCL engine: a plan becomes one kernel, generated for its templates and its array."""

import numpy as np
import pyopencl as cl

from cnnum.engines.backend import EngineRecord
from cnnum.engines.devices.listing import partner_of
from cnnum.engines.devices.selection import choose_device
from cnnum.engines.devices.shared_arrays import shares_memory
from cnnum.engines.forks import refuse_after_fork
from cnnum.engines.opencl.executable import OpenCLExecutable
from cnnum.errors import DeviceError
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver, Solvers
from cnnum.templating.template import Template

_TYPES: dict[str, np.dtype[np.floating]] = {
    "float32": np.dtype(np.float32),
    "float64": np.dtype(np.float64),
}


class OpenCLBackend:
    """Holds a device's context and queue, and builds schedules for it."""

    def __init__(self, record: EngineRecord, device: str | None, precision: str) -> None:
        self.record, self.precision = record, precision
        self._device = choose_device(device)
        if self.precision == "float64" and not self._device.double:
            raise DeviceError(
                f"Device '{self._device.label}' has no double precision; use 'float32'."
            )
        self._context = cl.Context([self._device.handle])
        self._queue = cl.CommandQueue(self._context)
        partner = partner_of(self._device.handle)
        self._own = cl.CommandQueue(cl.Context([partner])) if partner else self._queue

    @property
    def device(self) -> str:
        """Description of the device."""
        return self._device.label

    @property
    def in_host_memory(self) -> bool:
        """Whether the device shares the host's memory, as a processor does."""
        return shares_memory(self._device.handle)

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver unchanged: its scheme runs."""
        return solver

    def build(self, schedule: Schedule, solvers: Solvers) -> OpenCLExecutable:
        """Return the schedule ready to run on this device.

        Raises
        ------
        NoOpenCLError
            If this process was forked after the engine was made.
        """
        refuse_after_fork()
        dtype = _TYPES[self.precision]
        lanes = self._device.lanes * 4 // dtype.itemsize if self._device.kind != "GPU" else 1
        near = self._device.near_bytes
        return OpenCLExecutable(
            schedule, solvers, self._queue, self._own, dtype, max(1, lanes), near
        )
