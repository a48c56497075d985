"""The numba engine, for machines without OpenCL.

The program of a small array is compiled as one function, from the same records that the OpenCL
engine prints. Other programs are evaluated operation by operation, and share no neighbourhood code
with other engines: cellwise arithmetic runs in NumPy over a whole batch, transients in compiled
functions. These take any template as lists of taps, so no template needs its own compilation.
"""

import numpy as np

from cnnum.engines.backend import EngineRecord
from cnnum.engines.numba.compiling import cores
from cnnum.engines.numba.evaluation import NumbaExecutable, why_walked
from cnnum.engines.numba.printed import PrintedExecutable
from cnnum.engines.numba.records import Real
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver, Solvers
from cnnum.templating.template import Template

_TYPES: dict[str, Real] = {
    "float32": np.dtype(np.float32),
    "float64": np.dtype(np.float64),
}


class NumbaBackend:
    """Runs on all cores of the host."""

    in_host_memory = True

    def __init__(self, record: EngineRecord, device: None, precision: str) -> None:
        self.record, self.precision = record, precision

    @property
    def device(self) -> str:
        """Description of the device."""
        return f"{cores()} core(s) of the host"

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver unchanged: its scheme runs."""
        return solver

    def build(self, schedule: Schedule, solvers: Solvers) -> NumbaExecutable | PrintedExecutable:
        """Return the schedule ready to run: compiled as one function, or evaluated by operation."""
        if not why_walked(schedule):
            return PrintedExecutable(schedule, solvers, _TYPES[self.precision])
        return NumbaExecutable.of(schedule, solvers, _TYPES[self.precision])
