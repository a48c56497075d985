"""Fixed-point precisions of engines: programs of `cnnum.embedded`, run by an engine.

The reference engine runs its statements in NumPy, OpenCL devices run the code that is also exported
as C99; both give bit-identical results.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from cnnum.arrays import Floats, finite
from cnnum.embedded.emulator import Emulator
from cnnum.embedded.formats import Precision, precision_named
from cnnum.embedded.program import IntegerProgram
from cnnum.engines.backend import Backend, EngineRecord, Runner
from cnnum.engines.fixed_point.executable import FixedPointExecutable
from cnnum.errors import ArrayError, DeviceError, ProgramError, UnknownNameError
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver, Solvers
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False)
class FixedPointBackend:
    """An engine in fixed-point arithmetic.

    Attributes
    ----------
    record : EngineRecord
        Of the engine.
    device : str
    kind : Precision
    runner : callable
        Makes the function that runs a program's frames.
    launches : int
        Kernel launches per frame.
    like : (frames, batch, rows, cols, channels) float or None
        Streams whose ranges determine the formats; by default those of the batch itself.
    """

    record: EngineRecord
    device: str
    kind: Precision
    runner: Callable[[IntegerProgram], Runner]
    launches: int
    like: Floats | None = None

    @property
    def in_host_memory(self) -> bool:
        """Not known of its runner."""
        return False

    @property
    def precision(self) -> str:
        """As the user says it."""
        return self.kind.name

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver as it is: its scheme runs."""
        return solver

    def measuring(self, like: Floats) -> "FixedPointBackend":
        """Return the engine, with ranges measured on other streams."""
        return replace(self, like=like)

    def build(self, schedule: Schedule, solvers: Solvers) -> FixedPointExecutable:
        """Return the schedule ready to run.

        Raises
        ------
        NotSupportedError
            If part of it has no fixed-point form.
        """
        return FixedPointExecutable(
            schedule, solvers, self.kind, self.runner, self.launches, self.like
        )


def fixed_point_backend(
    record: EngineRecord, device: str | None, precision: str, able: Sequence[str]
) -> FixedPointBackend:
    """Open an engine in fixed-point arithmetic.

    Parameters
    ----------
    record : EngineRecord
    device : str or None
    precision : str
    able : sequence of str
        Engines with fixed-point arithmetic, for the error message if this one has none.

    Raises
    ------
    UnknownNameError
        If the engine has no such precision.
    DeviceError
        If its device is not available.
    """
    kind = precision_named(precision)
    if record.whole is None:
        raise UnknownNameError(
            f"The engine '{record.name}' has no precision {precision!r:.60}: use the engine "
            f"{' or '.join(map(repr, able))}, or precision "
            f"{' or '.join(map(repr, record.precisions))}."
        )
    if device is not None and not record.devices:
        raise DeviceError(f"The {record.name} engine runs on the host, got device={device!r:.60}.")
    label, runner, launches = record.whole(device)
    return FixedPointBackend(record, label, kind, runner, launches)


def emulated(device: None) -> tuple[str, Callable[[IntegerProgram], Runner], int]:
    """Return a description of the host, a function that makes a program's runner, and launches."""
    return "NumPy on the host", Emulator, 0


if TYPE_CHECKING:
    from collections.abc import Sequence


def measuring(backend: Backend, like: ArrayLike, trailing: "Sequence[int]") -> Backend:
    """Return an engine that measures ranges on given streams.

    Parameters
    ----------
    backend : Backend
    like : (frames, ..., rows, cols, channels) float
    trailing : (rows, cols, channels)

    Raises
    ------
    ProgramError
        If the engine uses floating point.
    ArrayError
        If the streams have another shape or no frames.
    """
    if not isinstance(backend, FixedPointBackend):
        raise ProgramError(
            f"'like' is for whole numbers, but this engine uses {backend.precision}: leave it out, "
            "or use precision='q15'."
        )
    frames = finite("like", like)
    if frames.ndim < 4 or frames.shape[-3:] != tuple(trailing) or not frames.size:
        rows, cols, channels = trailing
        raise ArrayError(
            f"'like' must have the shape (frames, ..., {rows}, {cols}, {channels}), got "
            f"{frames.shape}."
        )
    return backend.measuring(frames.reshape(len(frames), -1, *frames.shape[-3:]))
