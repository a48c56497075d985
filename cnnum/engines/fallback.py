"""A device with an engine of the host behind it, which goes on where the device does not.

A plan whose device is lost, or out of memory, is built once more on the host, and stays there. A
device that is lost serves no other plan of its engine either.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from threading import RLock
from typing import cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.backend import Backend, EngineRecord, Executable, OneFrame
from cnnum.engines.registry import PACKAGED, backend_names, open_backend, record_named
from cnnum.errors import DeviceError, NoOpenCLError, SizeError, name_error, say_once
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver, Solvers
from cnnum.templating.template import Template

Numbers = tuple[NDArray[np.floating], ...]


@dataclass(slots=True, eq=False)
class FallbackBackend:
    """A device's engine, and the one of the host that goes on.

    Attributes
    ----------
    first : Backend
    behind : str
        Name of the host's engine.
    why : str
        Why the device is taken for lost, in words; empty while it is not.
    """

    first: Backend
    behind: str
    why: str = ""
    _host: Backend | None = None
    _turn: RLock = field(default_factory=RLock)

    @property
    def record(self) -> EngineRecord:
        """What the device's engine does."""
        return self.first.record

    @property
    def device(self) -> str:
        """The device in words; that of the host once the first is lost."""
        return f"{self.host().device} ({self.behind})" if self.why else self.first.device

    @property
    def precision(self) -> str:
        """One of "float32" and "float64"."""
        return self.first.precision

    def host(self) -> Backend:
        """Return the host's engine."""
        with self._turn:
            if self._host is None:
                self._host = open_backend(self.behind, None, self.first.precision)
            return self._host

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver with a reason that also names the engine's own method."""
        return self.first.explained(template, solver)

    def build(self, schedule: Schedule, solvers: Solvers) -> Executable:
        """Return the schedule ready to run."""
        executable = FallbackExecutable(self, lambda on: on.build(schedule, solvers))
        executable.open()
        return executable


@dataclass(slots=True, eq=False)
class _Memory:
    """Memories of a number of streams, and the executable whose they are."""

    batch: int
    of: Executable
    numbers: object


@dataclass(slots=True, eq=False)
class FallbackExecutable:
    """A schedule on a device, or on the host.

    Attributes
    ----------
    backend : FallbackBackend
    make : callable
        Builds the schedule on an engine.
    why : str
        Why it runs on the host; empty while it does not.
    """

    backend: FallbackBackend
    make: Callable[[Backend], Executable]
    why: str = ""
    _now: Executable | None = None
    _turn: RLock = field(default_factory=RLock)

    def open(self) -> Executable:
        """Return the executable that runs, built on the device unless that is lost."""
        with self._turn:
            if self.backend.why and not self.why:
                self.why, self._now = self.backend.why, None
            if self._now is None:
                self._now = self._built()
            return self._now

    def _built(self) -> Executable:
        if not self.why:
            try:
                return self.make(self.backend.first)
            except (DeviceError, SizeError) as error:
                self._note(error)
        return self.make(self.backend.host())

    def _note(self, error: Exception) -> None:
        cause = str(error).rpartition(": ")[0] or str(error)  # without the advice
        self.why = f"on the {self.backend.behind} engine, as {cause[0].lower()}{cause[1:]}"
        if isinstance(error, DeviceError):
            self.backend.why = self.why
        say_once(f"The {self.backend.behind} engine goes on, as {cause[0].lower()}{cause[1:]}.")

    def fall(self, error: Exception, failed: Executable) -> Executable:
        """Return the executable that goes on after an error; raise it where there is none."""
        with self._turn:
            if self._now is failed:
                if self.why:
                    raise error
                self._note(error)
                self._now = None
            return self.open()

    @property
    def source(self) -> str:
        """The exact text of the kernels, or the operations in words."""
        return self.open().source

    @property
    def launches(self) -> int:
        """Kernel launches a batch."""
        return self.open().launches

    @property
    def private_bytes(self) -> int:
        """Private memory of a work item that runs one frame."""
        return self.open().private_bytes

    @property
    def local_bytes(self) -> int:
        """Local memory of a work group."""
        return self.open().local_bytes

    @property
    def scratch_bytes(self) -> int:
        """Global memory that one frame works in."""
        return self.open().scratch_bytes

    @property
    def strategies(self) -> Mapping[int, str]:
        """How transients run, in words, by their nodes."""
        return self.open().strategies

    def new_memory(self, batch: int) -> _Memory:
        """Return cleared memories for a batch of streams."""
        now = self.open()
        try:
            return _Memory(batch, now, now.new_memory(batch))
        except (DeviceError, SizeError) as error:
            now = self.fall(error, now)
            return _Memory(batch, now, now.new_memory(batch))

    def held(self, memory: object, batch: int) -> Numbers:
        """Return the numbers that memories of `batch` streams hold."""
        assert isinstance(memory, _Memory)
        try:
            return memory.of.held(memory.numbers, batch)
        except (DeviceError, SizeError) as error:
            self._anew(memory, self.fall(error, memory.of))
            return memory.of.held(memory.numbers, batch)

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Let memories hold a copy of numbers; those of the device are cleared on the host."""
        assert isinstance(memory, _Memory)
        fits = [own.shape for own in self.held(memory, batch)] == [own.shape for own in numbers]
        if fits:
            memory.of.restore(memory.numbers, numbers, batch)
        else:
            self._anew(memory, memory.of)

    def _anew(self, memory: _Memory, now: Executable) -> None:
        memory.of, memory.numbers = now, now.new_memory(memory.batch)

    def one(self, memory: object) -> OneFrame | None:
        """Return the quick way of single frames with these memories."""
        assert isinstance(memory, _Memory)
        try:
            quick = memory.of.one(memory.numbers)
        except (DeviceError, SizeError) as error:
            self._anew(memory, self.fall(error, memory.of))
            quick = memory.of.one(memory.numbers)
        return None if quick is None else _FallbackFrame(self, memory, quick)

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Run a batch; memories of a device that fails begin anew on the host."""
        assert isinstance(memory, _Memory)
        if (now := self.open()) is not memory.of:
            self._anew(memory, now)
            first = True
        try:
            return memory.of.run(frames, memory.numbers, first=first)
        except (DeviceError, SizeError) as error:
            self._anew(memory, self.fall(error, memory.of))
            return memory.of.run(frames, memory.numbers, first=True)

    def run_large(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]
    ) -> tuple[dict[str, Floats], bool] | None:
        """Run a batch of large arrays, with cleared memories, on unchecked channels."""
        now = self.open()
        try:
            return now.run_large(maps, lead)
        except (DeviceError, SizeError) as error:
            return self.fall(error, now).run_large(maps, lead)


@dataclass(slots=True, eq=False)
class _FallbackFrame:
    """The quick way of single frames, and the slower one of the host."""

    executable: FallbackExecutable
    memory: _Memory
    quick: OneFrame
    packed: Floats = field(default_factory=lambda: np.zeros(0))

    def run(self, values: NDArray[np.floating], *, first: bool) -> dict[str, Floats]:
        """Run a frame; memories of a device that fails begin anew on the host."""
        executable, memory = self.executable, self.memory
        if not executable.why and not executable.backend.why:
            try:
                outputs = self.quick.run(values, first=first)
            except (DeviceError, SizeError) as error:
                executable.fall(error, memory.of)
            else:
                self.packed = self.quick.packed
                return outputs
        ran = executable.run(values[np.newaxis], memory, first=first)
        outputs = {name: value[0] for name, value in ran.items()}
        self.packed = np.concatenate([np.ravel(value) for value in outputs.values()])
        return outputs


def opened(
    name: str | None, device: str | None, precision: str | None, fallback: str | None
) -> Backend:
    """Return an engine, with another behind it where one is named.

    Raises
    ------
    UnknownNameError
        If there is no such engine, or none of that name to fall back to.
    DeviceError
        If its device cannot be had; with a fallback, unless there is no OpenCL.
    """
    if fallback is None:
        return open_backend(name, device, precision)
    able = tuple(record.name for record in PACKAGED.values() if record.stands_in)
    known = isinstance(cast(object, fallback), str) and fallback in backend_names()
    if not known or not record_named(fallback).stands_in:
        raise name_error("fallback", fallback, able)
    try:
        first = open_backend(name, device, precision)
    except NoOpenCLError as error:
        say_once(f"The {fallback} engine runs because {error.reason}; {error.advice}.")
        return open_backend(fallback, None, precision)
    if not first.record.devices:
        return first  # the host is not lost
    backend = FallbackBackend(first, fallback)
    backend.host()  # refuses a precision that it does not have
    return backend
