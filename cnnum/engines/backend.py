"""The interface of every engine, and the registry that imports only the wanted one."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.embedded.formats import is_integer
from cnnum.engines.notices import say_once
from cnnum.engines.opencl_advice import how_to_get_opencl
from cnnum.errors import NoOpenCLError, name_error
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver, Solvers
from cnnum.templating.template import Template


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


class Backend(Protocol):
    """An engine behind `cnnum.Engine`."""

    @property
    def name(self) -> str:
        """As the user says it."""
        ...

    @property
    def device(self) -> str:
        """The device in words."""
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


_FACTORIES = {
    "opencl": ("cnnum.engines.opencl", "OpenCLBackend"),
    "numba": ("cnnum.engines.numba", "NumbaBackend"),
    "reference": ("cnnum.engines.reference", "ReferenceBackend"),
}


PRECISIONS = ("float32", "float64", "q15", "q7")
"""Names of precisions that a message offers; those of whole numbers are more."""


def backend_names() -> tuple[str, ...]:
    """Return the names of the engines."""
    return tuple(_FACTORIES)


def open_backend(name: str | None, device: str | None, precision: str | None) -> Backend:
    """Return the engine of that name; without one, "opencl" where a device works, else "numba".

    Raises
    ------
    UnknownNameError
        If there is no such engine, or the precision is no name.
    DeviceError
        If its device cannot be had.
    """
    if not (precision is None or isinstance(cast(object, precision), str)):
        raise name_error("precision", precision, PRECISIONS)
    if name is not None:
        return _opened(name, device, precision)
    try:
        return _opened("opencl", device, precision)
    except NoOpenCLError as error:
        if device is not None:  # who names a device wants no other
            raise
        say_once(f"The numba engine runs because {error.reason}; {error.advice}.")
        return _opened("numba", None, precision)


def _opened(name: str, device: str | None, precision: str | None) -> Backend:
    if not isinstance(cast(object, name), str) or name not in _FACTORIES:
        raise name_error("engine", name, _FACTORIES)
    if is_integer(precision):
        from cnnum.engines.whole import whole_backend

        assert precision is not None
        return _tried(name, lambda: whole_backend(name, device, precision))
    module, factory = _FACTORIES[name]
    return _tried(name, lambda: getattr(import_module(module), factory)(device, precision))


def _tried(name: str, make: Callable[[], Any]) -> Backend:
    try:
        return cast(Backend, make())
    except ImportError as error:
        if name != "opencl":
            raise
        why = f"PyOpenCL cannot be imported ({error})"
        raise NoOpenCLError(why, how_to_get_opencl()) from error
