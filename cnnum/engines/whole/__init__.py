"""Whole numbers as a precision of engines: the program of `cnnum.embedded`, run where an engine is.

The reference engine runs its statements in NumPy, and OpenCL devices the text that is also exported
as C99: both give the same bits.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from cnnum.arrays import Floats
from cnnum.embedded.emulator import Emulator
from cnnum.embedded.formats import Precision, precision_named
from cnnum.embedded.program import IntegerProgram
from cnnum.engines.whole.executable import Runner, WholeExecutable
from cnnum.errors import DeviceError, UnknownNameError
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver, Solvers
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False)
class WholeBackend:
    """An engine that counts in whole numbers.

    Attributes
    ----------
    name, device : str
    kind : Precision
    runner : callable
        Makes the function that runs a program's frames.
    launches : int
        A frame.
    like : (frames, batch, rows, cols, channels) float or None
        Streams whose ranges decide on formats; those of a batch itself unless given.
    """

    name: str
    device: str
    kind: Precision
    runner: Callable[[IntegerProgram], Runner]
    launches: int
    like: Floats | None = None

    @property
    def precision(self) -> str:
        """As the user says it."""
        return self.kind.name

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver as it is: its scheme runs."""
        return solver

    def measuring(self, like: Floats) -> "WholeBackend":
        """Return the engine with ranges measured on other streams."""
        return replace(self, like=like)

    def build(self, schedule: Schedule, solvers: Solvers) -> WholeExecutable:
        """Return the schedule ready to run.

        Raises
        ------
        NotSupportedError
            If something in it has no form in whole numbers.
        """
        return WholeExecutable(schedule, solvers, self.kind, self.runner, self.launches, self.like)


def whole_backend(name: str, device: str | None, precision: str) -> WholeBackend:
    """Return the engine of that name in whole numbers.

    Raises
    ------
    UnknownNameError
        If that engine has no such precision.
    DeviceError
        If its device cannot be had.
    """
    kind = precision_named(precision)
    if name == "reference":
        if device is not None:
            raise DeviceError(f"The reference engine runs on the host, got device={device!r:.60}.")
        return WholeBackend(name, "NumPy on the host", kind, Emulator, 0)
    if name == "opencl":
        from cnnum.engines.whole.device_frames import DeviceFrames, opened

        label, queue = opened(device)
        return WholeBackend(name, label, kind, lambda program: DeviceFrames(program, queue), 1)
    raise UnknownNameError(
        f"The engine '{name}' has no precision {precision!r:.60}: take the engine 'opencl' or "
        "'reference', or precision 'float32' or 'float64'."
    )
