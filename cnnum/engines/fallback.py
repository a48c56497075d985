"""A device engine with a host engine as fallback, which takes over if the device fails.

A plan whose device fails or runs out of memory is rebuilt on the host, and stays there. Once a
device has failed, no other plan of its engine uses it either.
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
    """A device engine, and the host engine that takes over.

    Attributes
    ----------
    first : Backend
    behind : str
        Name of the engine on the host that takes over.
    why : str
        Why the device counts as failed; empty while it works.
    """

    first: Backend
    behind: str
    why: str = ""
    _host: Backend | None = None
    _turn: RLock = field(default_factory=RLock)

    @property
    def record(self) -> EngineRecord:
        """Record of the device engine's capabilities."""
        return self.first.record

    @property
    def device(self) -> str:
        """Description of the device, or of the host once the device has failed."""
        return f"{self.host().device} ({self.behind})" if self.why else self.first.device

    @property
    def precision(self) -> str:
        """One of "float32" and "float64"."""
        return self.first.precision

    @property
    def in_host_memory(self) -> bool:
        """Whether the device computes in the host's memory."""
        return self.first.in_host_memory

    def host(self) -> Backend:
        """Return the host's engine."""
        with self._turn:
            if self._host is None:
                self._host = open_backend(self.behind, None, self.first.precision)
            return self._host

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver, its reason extended by the engine's own method, if any."""
        return self.first.explained(template, solver)

    def build(self, schedule: Schedule, solvers: Solvers) -> Executable:
        """Return the schedule ready to run."""
        executable = FallbackExecutable(self, lambda on: on.build(schedule, solvers))
        executable.open()
        return executable


@dataclass(slots=True, eq=False)
class _Memory:
    """Memories of several streams, and the executable they belong to."""

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
        Why it runs on the host; empty while it runs on the device.
    """

    backend: FallbackBackend
    make: Callable[[Backend], Executable]
    why: str = ""
    _now: Executable | None = None
    _turn: RLock = field(default_factory=RLock)

    def open(self) -> Executable:
        """Return the executable to run, built on the device unless that has failed."""
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
        """Return the executable that takes over after an error; re-raise it if there is none."""
        with self._turn:
            if self._now is failed:
                if self.why:
                    raise error
                self._note(error)
                self._now = None
            return self.open()

    @property
    def source(self) -> str:
        """The exact source of the kernels, or a description of the operations."""
        return self.open().source

    @property
    def launches(self) -> int:
        """Kernel launches per batch."""
        return self.open().launches

    @property
    def private_bytes(self) -> int:
        """Bytes of private memory of a work item that runs one frame."""
        return self.open().private_bytes

    @property
    def local_bytes(self) -> int:
        """Bytes of local memory per work group."""
        return self.open().local_bytes

    @property
    def scratch_bytes(self) -> int:
        """Bytes of global working memory per frame."""
        return self.open().scratch_bytes

    @property
    def strategies(self) -> Mapping[int, str]:
        """Description of how each transient runs, by node."""
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
        """Return the contents of the memories of `batch` streams."""
        assert isinstance(memory, _Memory)
        try:
            return memory.of.held(memory.numbers, batch)
        except (DeviceError, SizeError) as error:
            self._anew(memory, self.fall(error, memory.of))
            return memory.of.held(memory.numbers, batch)

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Restore the memories from a copy of values; memories of a failed device start cleared."""
        assert isinstance(memory, _Memory)
        fits = [own.shape for own in self.held(memory, batch)] == [own.shape for own in numbers]
        if fits:
            memory.of.restore(memory.numbers, numbers, batch)
        else:
            self._anew(memory, memory.of)

    def _anew(self, memory: _Memory, now: Executable) -> None:
        memory.of, memory.numbers = now, now.new_memory(memory.batch)

    def one(self, memory: object) -> OneFrame | None:
        """Return the fast path for single frames with these memories."""
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
        """Run a batch; if the device fails, memories start cleared on the host."""
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
        """Run a batch of large arrays with cleared memories, on channels not yet checked."""
        now = self.open()
        try:
            return now.run_large(maps, lead)
        except (DeviceError, SizeError) as error:
            return self.fall(error, now).run_large(maps, lead)


@dataclass(slots=True, eq=False)
class _FallbackFrame:
    """The fast path for single frames, and the slower one on the host."""

    executable: FallbackExecutable
    memory: _Memory
    quick: OneFrame
    packed: Floats = field(default_factory=lambda: np.zeros(0))

    def run(self, values: NDArray[np.floating], *, first: bool) -> dict[str, Floats]:
        """Run a frame; if the device fails, memories start cleared on the host."""
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
    """Open an engine, with a fallback engine if one is named.

    Raises
    ------
    UnknownNameError
        If there is no such engine or fallback engine.
    DeviceError
        If its device is not available; with a fallback, only if OpenCL itself is present.
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
        return first  # the host does not fail
    backend = FallbackBackend(first, fallback)
    backend.host()  # raises for an unsupported precision
    return backend
