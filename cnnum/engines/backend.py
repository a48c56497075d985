"""The engine interface: the record of an engine's capabilities, and the protocols it implements."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.errors import NotSupportedError
from cnnum.graph.nodes import Transient
from cnnum.graph.schedule import Schedule
from cnnum.integrators.series import Stretch
from cnnum.integrators.solver import Solver, Solvers
from cnnum.templating.template import Template

if TYPE_CHECKING:
    from cnnum.embedded.emulator import Numbers
    from cnnum.embedded.program import IntegerProgram


class OneFrame(Protocol):
    """The fast path for single frames of one stream."""

    @property
    def packed(self) -> Floats:
        """All output values of the last frame, concatenated."""
        ...

    def run(self, values: NDArray[np.floating], *, first: bool) -> dict[str, Floats]:
        """Run a frame.

        Parameters
        ----------
        values : (rows, cols, channels read) float
        first : bool
            Whether this is the first frame of the stream.

        Returns
        -------
        dict of str to (rows, cols) or () float
            Newly allocated for every frame.

        Raises
        ------
        MethodError
            If a transient did not finish within its maximum number of steps.
        """
        ...


class Executable(Protocol):
    """A compiled schedule, ready to run."""

    @property
    def source(self) -> str:
        """The exact source of the kernels, or a description of the operations."""
        ...

    @property
    def launches(self) -> int:
        """Kernel launches per batch."""
        ...

    @property
    def private_bytes(self) -> int:
        """Bytes of private memory of a work item that runs one frame; 0 if there is no device."""
        ...

    @property
    def local_bytes(self) -> int:
        """Bytes of local memory per work group; 0 if there is no device or none is used."""
        ...

    @property
    def scratch_bytes(self) -> int:
        """Bytes of global working memory per frame, besides its inputs and outputs."""
        ...

    @property
    def strategies(self) -> Mapping[int, str]:
        """Description of how each transient runs, by node; empty if there is only one way."""
        ...

    def new_memory(self, batch: int) -> object:
        """Return cleared memories for a batch of streams, in an engine-specific form."""
        ...

    def held(self, memory: object, batch: int) -> tuple[NDArray[np.floating], ...]:
        """Return the contents of the memories of `batch` streams, for inspection or copying."""
        ...

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Restore the memories from values that `held` returned."""
        ...

    def one(self, memory: object) -> OneFrame | None:
        """Return the fast path for single frames with these memories, or None if there is none."""
        ...

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Run a batch.

        Parameters
        ----------
        frames : (batch, rows, cols, channels read) float
        memory : object
            The object from `new_memory`. It holds the values stored at the end of the previous
            frame, and is updated in place.
        first : bool
            Whether this is the first frame of the streams.

        Returns
        -------
        dict of str to (batch, rows, cols) or (batch,) float

        Raises
        ------
        MethodError
            If a transient did not finish within its maximum number of steps.
        """
        ...

    def run_large(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]
    ) -> tuple[dict[str, Floats], bool] | None:
        """Run a batch of large arrays with cleared memories, on channels not yet checked.

        Parameters
        ----------
        maps : sequence of (..., maps, rows, cols) float
            The channels to read, in order; leading axes broadcast to `lead`.
        lead : tuple of int

        Returns
        -------
        (dict of str to (batch, rows, cols) or (batch,) float, bool), or None
            The outputs, and whether all of them are finite. None if the engine has no such path, or
            if `maps` are not all finite in its precision.

        Raises
        ------
        MethodError
            If a transient did not finish within its maximum number of steps.
        """
        ...


class Looking(Executable, Protocol):
    """An executable whose state can also be sampled during a run."""

    def look(
        self,
        frames: NDArray[np.floating],
        moments: Sequence[float],
        ends: Sequence[Stretch] = (),
        cuts: int = 1,
    ) -> Mapping[str, NDArray[np.floating[Any]]]:
        """Return the states that a run of its only transient passes through.

        Parameters
        ----------
        frames : (batch, rows, cols, channels) float
        moments : sequence of float
            Increasing, none after the end of the run.
        ends : sequence of Stretch
            The stretches that contain these times, if ends are known in closed form.
        cuts : int
            Number of substeps into which a partial fixed step up to a moment is divided.

        Returns
        -------
        mapping
            "seen" (times, batch, layers, rows, cols), and "marks" (times, batch, 3): steps,
            settled, error.
        """
        ...


class Runner(Protocol):
    """Runs frames of one program in fixed-point arithmetic."""

    def run(
        self,
        inputs: Mapping[str, "Numbers"],
        state: dict[str, "Numbers"],
        *,
        first: bool,
        batch: int = 1,
    ) -> dict[str, "Numbers"]:
        """Run one frame of every stream and update the state."""
        ...


Solve = Callable[
    [Transient, dict[str, Floats], Callable[[Floats], Floats] | None], dict[str, Floats]
]
"""Solves a template on one frame of maps by role. A feedback sum over outputs, unless None,
replaces the template's own. Returns the results by name, maps as (layers, rows, cols)."""


class Analogue(Protocol):
    """A model of an analogue array, between a program and the cells that run it."""

    def refuse(self, template: Template) -> None:
        """Raise NotSupportedError if the array cannot run the template."""
        ...

    def answer(
        self, solve: Solve, operation: Transient, maps: dict[str, Floats], shape: Shape
    ) -> dict[str, Floats]:
        """Return the results of a template on one frame, (layers, rows, cols) maps by role."""
        ...


class Backend(Protocol):
    """An open engine: on one device, in one precision."""

    @property
    def record(self) -> "EngineRecord":
        """Record of the engine's capabilities."""
        ...

    @property
    def device(self) -> str:
        """Description of the device."""
        ...

    @property
    def precision(self) -> str:
        """One of "float32", "float64", "q15", "q7" and so on."""
        ...

    @property
    def in_host_memory(self) -> bool:
        """Whether it is known to compute in the host's memory, so that nothing is transferred."""
        ...

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver, its reason extended by this engine's own method, if any."""
        ...

    def build(self, schedule: Schedule, solvers: Solvers) -> Executable:
        """Return the schedule ready to run.

        Raises
        ------
        NotSupportedError
            If this engine does not support part of it; the message says why.
        """
        ...


@dataclass(frozen=True, slots=True)
class Limit:
    """A feature that an engine does not support.

    Attributes
    ----------
    what, why : str
        The feature and the reason, as parts of a sentence.
    applies : callable
        Whether a transient and its solver need it.
    """

    what: str
    why: str
    applies: Callable[[Transient, Solver], bool]


@dataclass(frozen=True, slots=True, eq=False)
class EngineRecord:
    """An engine: how to open it, and what it can do.

    The rest of the package consults these fields, never an engine's name.

    Attributes
    ----------
    name : str
        Name by which users select it.
    open : callable
        Takes this record, a device's name or None, and a precision; returns a `Backend`.
    precisions : tuple of str
        Supported floating-point precisions, the default first.
    whole : callable, optional
        Opens it in fixed-point arithmetic: takes a device name or None; returns a description of
        the device, a function that makes the `Runner` of a program, and the launches per frame.
    devices : bool
        Whether it runs on devices that are chosen by name and may fail; others run on the host.
    missing : callable, optional
        Makes the error to raise if a module cannot be imported.
    stands_in : bool
        Whether it can take over any plan of a failed device in the same precision.
    fuses : bool
        Whether chains of linear operations are fused before it builds them.
    takes_steps : bool
        Whether it takes the steps of the chosen method. Other engines solve as accurately as they
        can unless a method or a step was requested.
    implicit : bool
        Whether it takes implicit steps; if not, a host engine that does runs them.
    lanes : bool
        Whether each frame of a batch can have its own template.
    looks : bool
        Whether its executables are `Looking`; if not, a host engine samples runs at given times.
    analogue : callable, optional
        Takes this record, and a function that makes the model of an analogue array for each
        program; returns the `Backend` that runs programs on it.
    limits : tuple of Limit
        Unsupported features, and why.
    """

    name: str
    open: Callable[["EngineRecord", str | None, str], Backend]
    precisions: tuple[str, ...] = ("float32", "float64")
    whole: Callable[[str | None], tuple[str, Callable[["IntegerProgram"], Runner], int]] | None = (
        None
    )
    devices: bool = False
    missing: Callable[[ImportError], Exception] | None = None
    stands_in: bool = False
    fuses: bool = True
    takes_steps: bool = True
    implicit: bool = False
    lanes: bool = False
    looks: bool = False
    analogue: Callable[["EngineRecord", Callable[[], Analogue]], Backend] | None = None
    limits: tuple[Limit, ...] = ()

    def refuse_beyond(self, schedule: Schedule, solvers: Solvers) -> None:
        """Raise if a schedule needs a feature that the engine does not support.

        Raises
        ------
        NotSupportedError
            With the reason.
        """
        for node in schedule.transients if self.limits else ():
            assert isinstance(node.operation, Transient)
            solver = solvers[node.index]
            for limit in self.limits:
                if limit.applies(node.operation, solver):
                    raise NotSupportedError(
                        f"The {self.name} engine leaves out {limit.what} ('{solver.method}' for "
                        f"'{node.operation}'): {limit.why}; use another engine."
                    )
