"""What an engine is: a record of what it can do, and the interfaces of what it opens and builds."""

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
    """The quick way of the single frames of one stream."""

    @property
    def packed(self) -> Floats:
        """All numbers that the last frame gave, one after the other."""
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
            Its own for every frame.

        Raises
        ------
        MethodError
            If a transient did not reach its end within its steps.
        """
        ...


class Executable(Protocol):
    """A schedule that is built and can run."""

    @property
    def source(self) -> str:
        """The exact text of the kernels, or the operations in words."""
        ...

    @property
    def launches(self) -> int:
        """Kernel launches a batch."""
        ...

    @property
    def private_bytes(self) -> int:
        """Private memory of a work item that runs one frame; 0 where there is no such thing."""
        ...

    @property
    def local_bytes(self) -> int:
        """Local memory of a work group; 0 where there is no such thing, or none is used."""
        ...

    @property
    def scratch_bytes(self) -> int:
        """Global memory that one frame works in, apart from its inputs and outputs."""
        ...

    @property
    def strategies(self) -> Mapping[int, str]:
        """How transients run, in words, by their nodes; empty where there is one way alone."""
        ...

    def new_memory(self, batch: int) -> object:
        """Return cleared memories for a batch of streams, in a form of the engine's own."""
        ...

    def held(self, memory: object, batch: int) -> tuple[NDArray[np.floating], ...]:
        """Return the numbers that memories of `batch` streams hold: to look at, or to copy."""
        ...

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Let memories hold a copy of the numbers that `held` gave before."""
        ...

    def one(self, memory: object) -> OneFrame | None:
        """Return the quick way of single frames with these memories; None where there is none."""
        ...

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Run a batch.

        Parameters
        ----------
        frames : (batch, rows, cols, channels read) float
        memory : object
            The object from `new_memory`. It holds the values stored at the end of the frame before,
            and is brought up to date in place.
        first : bool
            Whether this is the first frame of the streams.

        Returns
        -------
        dict of str to (batch, rows, cols) or (batch,) float

        Raises
        ------
        MethodError
            If a transient did not reach its end within its steps.
        """
        ...

    def run_large(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]
    ) -> tuple[dict[str, Floats], bool] | None:
        """Run a batch of large arrays, with cleared memories, on unchecked channels.

        Parameters
        ----------
        maps : sequence of (..., maps, rows, cols) float
            Together the channels read, in their order; leading axes broadcast to `lead`.
        lead : tuple of int

        Returns
        -------
        (dict of str to (batch, rows, cols) or (batch,) float, bool), or None
            And whether all of them are finite. None where there is no such way, or where something
            in `maps` is not finite in the engine's precision.

        Raises
        ------
        MethodError
            If a transient did not reach its end within its steps.
        """
        ...


class Looking(Executable, Protocol):
    """An executable that can also be looked at on its way."""

    def look(
        self,
        frames: NDArray[np.floating],
        moments: Sequence[float],
        ends: Sequence[Stretch] = (),
        cuts: int = 1,
    ) -> Mapping[str, NDArray[np.floating[Any]]]:
        """Return what a run of its only transient passes through.

        Parameters
        ----------
        frames : (batch, rows, cols, channels) float
        moments : sequence of float
            Rising, none after the end of the run.
        ends : sequence of Stretch
            They hold these times, where ends are known without steps.
        cuts : int
            Parts in which a piece of a step of fixed length is taken up to a moment.

        Returns
        -------
        mapping
            "seen" (times, batch, layers, rows, cols), and "marks" (times, batch, 3): steps,
            settled, error.
        """
        ...


class Runner(Protocol):
    """Runs frames of one program in whole numbers."""

    def run(
        self,
        inputs: Mapping[str, "Numbers"],
        state: dict[str, "Numbers"],
        *,
        first: bool,
        batch: int = 1,
    ) -> dict[str, "Numbers"]:
        """Run a frame of every stream and bring the state up to date."""
        ...


Solve = Callable[
    [Transient, dict[str, Floats], Callable[[Floats], Floats] | None], dict[str, Floats]
]
"""Solves a template on one frame of maps by role, with a sum of A over outputs in place of its own
unless that is None; returns its answers by name, maps as (layers, rows, cols)."""


class Analogue(Protocol):
    """A model of an analogue array, which stands between a program and the cells that run it."""

    def refuse(self, template: Template) -> None:
        """Raise NotSupportedError if no such array runs the template."""
        ...

    def answer(
        self, solve: Solve, operation: Transient, maps: dict[str, Floats], shape: Shape
    ) -> dict[str, Floats]:
        """Return the answers of a template on one frame, (layers, rows, cols) maps by role."""
        ...


class Backend(Protocol):
    """An engine that is open: on one device, in one precision."""

    @property
    def record(self) -> "EngineRecord":
        """What the engine does."""
        ...

    @property
    def device(self) -> str:
        """Description of the device."""
        ...

    @property
    def precision(self) -> str:
        """One of "float32", "float64", "q15", "q7" and so on."""
        ...

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver with a reason that also names this engine's own method."""
        ...

    def build(self, schedule: Schedule, solvers: Solvers) -> Executable:
        """Return the schedule ready to run.

        Raises
        ------
        NotSupportedError
            If this engine does not do something in it; the sentence says why.
        """
        ...


@dataclass(frozen=True, slots=True)
class Limit:
    """Something that an engine leaves out.

    Attributes
    ----------
    what, why : str
        As parts of a sentence.
    applies : callable
        Whether a transient and its solver need it.
    """

    what: str
    why: str
    applies: Callable[[Transient, Solver], bool]


@dataclass(frozen=True, slots=True, eq=False)
class EngineRecord:
    """An engine: how it is opened, and what it can do.

    The rest of the package asks these fields and never an engine's name.

    Attributes
    ----------
    name : str
        As the user says it.
    open : callable
        Takes this record, a device's name or None, and a precision; returns a `Backend`.
    precisions : tuple of str
        Real numbers that it counts in, the usual one first.
    whole : callable, optional
        Opens it in whole numbers: takes a device's name or None; returns the device in words, a
        function that makes the `Runner` of a program, and the launches a frame.
    devices : bool
        It runs on devices that are chosen by name and may be lost; others run on the host.
    missing : callable, optional
        Makes the error of a module that cannot be imported.
    stands_in : bool
        It runs any plan of a device in the same precision, so that it can go on where one is lost.
    fuses : bool
        Chains of linear operations are fused before it builds them.
    takes_steps : bool
        It takes the steps of the method that was chosen. Another solves as finely as it can,
        unless a method or a step was asked for.
    implicit : bool
        It takes implicit steps; else these run on an engine of the host that does.
    lanes : bool
        Frames of a batch can have templates of their own, side by side.
    looks : bool
        Its executables are `Looking`; else one of the host looks at times on the way of a run.
    analogue : callable, optional
        Takes this record, and a function that makes the model of an analogue array for each
        program; returns the `Backend` that runs programs on it.
    limits : tuple of Limit
        What it leaves out, and why.
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
        """Raise if a schedule needs something that the engine leaves out.

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
