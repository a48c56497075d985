"""A small array's program as one compiled function, generated from the records of its kernel.

The records are those that the OpenCL engine prints as well. LLVM, which comes with Numba, compiles
the function; Numba's own way from Python to LLVM would take minutes for a program of many
templates. The frames of a batch run one after the other through the same instructions, so that a
frame gives the same bits alone and in any batch.
"""

import ctypes
import hashlib
import struct
import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.host import OnHost
from cnnum.engines.notices import refuse_unfinished
from cnnum.engines.numba.compiling import SHELF, cores
from cnnum.engines.numba.evaluation import NumbaExecutable
from cnnum.engines.numba.records import Real, Reals
from cnnum.engines.opencl.lowering.kernel_source import PRIVATE, Statements, statements
from cnnum.engines.opencl.lowering.storage import Tables
from cnnum.graph.schedule import Schedule
from cnnum.integrators.series import Stretch
from cnnum.integrators.solver import Solvers
from cnnum.kernels import llvm

_LLVM: Any = import_module("llvmlite.binding")  # it has no types

FUNCTION = "frames"

FRAMES_A_THREAD = 256
"""Minimum number of frames per thread: fewer take less time than starting a thread."""

HEAD = struct.Struct("<qq")
"""The sizes of both kinds of scratch, stored before the machine code in the cache."""

PARAMETERS = (*[ctypes.c_void_p] * len(llvm.BUFFERS), *[ctypes.c_int64] * 3)


def _machine() -> Any:
    """Return a compiler for this processor."""
    _LLVM.initialize_native_target()
    _LLVM.initialize_native_asmprinter()
    target, (processor, features) = _LLVM.Target.from_default_triple(), _processor()
    # programs of x86 stay where they are put
    where = "static" if target.name.startswith("x86") else "default"
    return target.create_target_machine(
        cpu=processor, features=features, opt=2, reloc=where, codemodel="jitdefault"
    )


def _processor() -> tuple[str, str]:
    """Return the name of this processor and its features."""
    try:
        features = _LLVM.get_host_cpu_features().flatten()
    except RuntimeError:  # LLVM does not know it on some systems
        features = ""
    return str(_LLVM.get_host_cpu_name()), str(features)


def machine_code(text: str) -> bytes:
    """Return the machine code of a module."""
    machine, module = _machine(), _LLVM.parse_assembly(text)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    module.verify()
    tuning = _LLVM.create_pipeline_tuning_options(speed_level=2)
    # loops that are written out take twice as long to compile, and run no faster
    tuning.loop_vectorization, tuning.slp_vectorization, tuning.loop_unrolling = True, True, False
    passes = _LLVM.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(module, passes)
    return bytes(machine.emit_object(module))


@dataclass(frozen=True, slots=True, eq=False)
class PrintedFunction:
    """A compiled function that runs frames.

    Attributes
    ----------
    call : callable
        Takes the addresses of the buffers of `llvm.BUFFERS`, the number of the first frame and of
        the one after the last, and whether these are the first of their streams.
    scratch : (int, int)
        Numbers of both kinds of scratch.
    engine : ExecutionEngine
        The owner of the code.
    """

    call: Any
    scratch: tuple[int, int]
    engine: Any

    @classmethod
    def of(cls, kept: bytes) -> "PrintedFunction":
        """Return the function of an entry of the cache."""
        first, second = HEAD.unpack(kept[: HEAD.size])
        engine = _LLVM.create_mcjit_compiler(_LLVM.parse_assembly(""), _machine())
        engine.add_object_file(_LLVM.ObjectFileRef.from_data(kept[HEAD.size :]))
        engine.finalize_object()
        address = engine.get_function_address(FUNCTION)
        return cls(ctypes.CFUNCTYPE(None, *PARAMETERS)(address), (first, second), engine)

    def rooms(self, dtype: Real) -> tuple[Reals, Reals]:
        """Return the scratch of one thread."""
        first, second = self.scratch
        return np.empty(first, dtype), np.empty(second, dtype)


@dataclass(frozen=True, slots=True, eq=False)
class PrintedMemory:
    """Values of the memories of a batch of streams, frame by frame."""

    numbers: Reals


@dataclass(slots=True, eq=False)
class PrintedFrame:
    """The fast path for single frames of one stream, which allocates nothing but the outputs.

    Attributes
    ----------
    given : (rows, cols, channels) float
    taken : (n,) float
        The last number is not 0 where a transient or a loop did not reach its end.
    function : PrintedFunction
    arguments : tuple of int
        The addresses of its buffers.
    places : list
        Name, place in `taken`, and shape of every output; a number has no shape.
    held : tuple of arrays
        The buffers, which live as long as their addresses are used.
    """

    given: Reals
    taken: Reals
    function: PrintedFunction
    arguments: tuple[int, ...]
    places: Sequence[tuple[str, slice | int, tuple[int, ...] | None]]
    held: tuple[Reals, ...]
    packed: Floats = field(default_factory=lambda: np.zeros(0))

    def run(self, values: NDArray[np.floating], *, first: bool) -> dict[str, Floats]:
        """Run a frame; the outputs are views of `packed`, which is new for every frame.

        Raises
        ------
        MethodError
            If a transient or a loop did not finish.
        """
        self.given[...] = values
        self.function.call(*self.arguments, 0, 1, first)
        self.packed = packed = self.taken.astype(np.float64)
        if packed[-1] != 0.0:
            refuse_unfinished(packed[-1:])
        return {
            name: packed[at, ...] if shape is None else packed[at].reshape(shape)
            for name, at, shape in self.places
        }


@dataclass(eq=False)
class PrintedExecutable(OnHost):
    """Runs a schedule of a small array as one function.

    Attributes
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    dtype : dtype
    """

    schedule: Schedule
    solvers: Solvers
    dtype: Real

    # threads may share this: what two of them make at once is the same

    @cached_property
    def _plan(self) -> Statements:
        tables = Tables(self.dtype, 1, 1, 0, by_vectors=False, vectors=False)
        return statements(self.schedule, self.solvers, tables, PRIVATE)

    @cached_property
    def _printed(self) -> tuple[str, tuple[int, int]]:
        printer = llvm.LLVMPrinter(self.dtype, self._plan.lowering.tables.places)
        return printer.function(FUNCTION, self._plan.body), (printer.scratch[0], printer.scratch[1])

    @cached_property
    def _function(self) -> PrintedFunction:
        """The function, compiled or from the cache."""
        tables = {
            name: places.tolist() for name, places in self._plan.lowering.tables.places.items()
        }
        compiler = (version("llvmlite"), *_processor(), self.dtype.name)
        printer = zlib.crc32(Path(llvm.__file__).read_bytes())
        key = repr((compiler, printer, tables, self._plan.body))
        name = hashlib.sha256(key.encode()).hexdigest()[:32]
        kept = SHELF.get(name)
        if kept is None:
            text, scratch = self._printed
            kept = HEAD.pack(*scratch) + machine_code(text)
            SHELF.put(name, kept)
        return PrintedFunction.of(kept)

    @cached_property
    def _data(self) -> Reals:
        return self._plan.lowering.tables.buffer()

    @property
    def source(self) -> str:
        """The exact LLVM intermediate code that was compiled."""
        return self._printed[0]

    @property
    def launches(self) -> int:
        """There is no device to launch on."""
        return 0

    @property
    def scratch_bytes(self) -> int:
        """Memory that one frame works in."""
        return sum(self._printed[1]) * self.dtype.itemsize

    @property
    def strategies(self) -> Mapping[int, str]:
        """How each transient runs, in words, by its node."""
        return {
            index: f"{strategy.name} in one compiled function of a frame ({strategy.reason})"
            for index, strategy in self._plan.lowering.strategies.items()
        }

    def new_memory(self, batch: int) -> object:
        """Return cleared memories."""
        size = batch * self._plan.lowering.memory_size
        return PrintedMemory(np.zeros(size, self.dtype))

    def held(self, memory: object, batch: int) -> tuple[Reals, ...]:
        """Return the values of memories."""
        assert isinstance(memory, PrintedMemory)
        return (memory.numbers,)

    def restore(self, memory: object, numbers: Sequence[Reals], batch: int) -> None:
        """Let memories hold a copy of these numbers."""
        assert isinstance(memory, PrintedMemory)
        (memory.numbers[:],) = numbers

    def one(self, memory: object) -> PrintedFrame:
        """Return the fast path for single frames."""
        assert isinstance(memory, PrintedMemory)
        given = np.zeros((*self.schedule.shape, len(self.schedule.channels_read)), self.dtype)
        taken, function = np.zeros(self._plan.output_size, self.dtype), self._function
        held = (given, taken, memory.numbers, self._data, *function.rooms(self.dtype))
        places = [
            (name, at, shape) if shape else (name, at.start, None)
            for name, (at, shape) in self._plan.outputs.items()
        ]
        addresses = tuple(array.ctypes.data for array in held)
        return PrintedFrame(given, taken, function, addresses, places, held)

    def run(self, frames: Reals, memory: object, *, first: bool) -> dict[str, Floats]:
        """Run the function on every frame, distributed over all cores if there are many."""
        assert isinstance(memory, PrintedMemory)
        batch, size = len(frames), self._plan.output_size
        given = np.ascontiguousarray(frames, dtype=self.dtype)
        taken = np.empty((batch, size), self.dtype)
        buffers = (given, taken, memory.numbers, self._data)
        function = self._function

        def part(begin: int, end: int) -> None:
            rooms = function.rooms(self.dtype)
            addresses = (array.ctypes.data for array in (*buffers, *rooms))
            function.call(*addresses, begin, end, first)

        threads = max(1, min(cores(), batch // FRAMES_A_THREAD))
        if threads == 1:
            part(0, batch)
        else:
            ends = [batch * number // threads for number in range(threads + 1)]
            with ThreadPoolExecutor(threads) as pool:
                for done in [pool.submit(part, *both) for both in pairwise(ends)]:
                    done.result()
        refuse_unfinished(taken[:, -1])
        return {
            name: taken[:, at].astype(np.float64).reshape(batch, *shape)
            for name, (at, shape) in self._plan.outputs.items()
        }

    def look(
        self,
        frames: Reals,
        moments: Sequence[float],
        ends: Sequence[Stretch] = (),
        cuts: int = 1,
    ) -> dict[str, Reals]:
        """Return the findings at times of a run, as `NumbaExecutable.look` does."""
        walk = NumbaExecutable.of(self.schedule, self.solvers, self.dtype)
        return walk.look(frames, moments, ends, cuts)
