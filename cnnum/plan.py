"""A plan: a program that is compiled for an array, and its figures."""

from __future__ import annotations  # signatures that `help` shows as they are written

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum import sharing
from cnnum.arrays import (
    HELD,
    Floats,
    Shape,
    all_finite,
    finite,
    held,
    largest,
    magnitude,
    number_type,
    numbers,
)
from cnnum.engines.backend import Backend, Executable
from cnnum.engines.fallback import FallbackExecutable
from cnnum.errors import ArrayError, FrameError, MethodError, ProgramError
from cnnum.graph.nodes import Transient
from cnnum.graph.schedule import LeftOut, Parts, Schedule, parts_of
from cnnum.graph.tracing import TraceStep, everything_added, everything_kept, trace_steps
from cnnum.integrators.cost import operation_flops, work
from cnnum.integrators.solver import Solvers
from cnnum.stream import Stream
from cnnum.values import OfThisProcess

COSTLIEST = 12
"""Number of operations in a plot."""

HELD_BY_ALL = min(HELD.values())


@dataclass(frozen=True, slots=True)
class Explanation:
    """The operations of a plan for one frame, those it leaves out, and the cost.

    Attributes
    ----------
    program, engine, device, precision : str
    shape : (rows, cols)
    ops : int
        Operations that run, those in bodies of loops and branches counted once.
    ops_most : int
        The same with every loop at its limit; the limits of nested loops multiply.
    parts : Parts
        Templates with and without feedback, local operations and reductions of the program, before
        an engine lowers it.
    launches : int
        Kernel launches per batch.
    channels_read : tuple of str
    maps_read_back : tuple of str
        Wanted outputs that are maps; flags and numbers are not among them.
    transients : tuple of str
        Every template with its method and why it was chosen.
    flops : int
        Arithmetic per frame, bodies counted once; a transient of adaptive steps counts one step.
    flops_most : int
        The same with every loop at its limit.
    bytes_in, bytes_out : int
        Traffic to and from the device per frame.
    private_bytes, local_bytes, scratch_bytes : int
        Private memory of a work item, local memory of a work group, and global memory where the
        array is too large for private memory.
    left_out : tuple of LeftOut
    """

    program: str
    engine: str
    device: str
    precision: str
    shape: Shape
    ops: int
    ops_most: int
    parts: Parts
    launches: int
    channels_read: tuple[str, ...]
    maps_read_back: tuple[str, ...]
    transients: tuple[str, ...]
    flops: int
    flops_most: int
    bytes_in: int
    bytes_out: int
    private_bytes: int
    local_bytes: int
    scratch_bytes: int
    left_out: tuple[LeftOut, ...]

    def __str__(self) -> str:
        lines = [
            f"{self.program} on {self.shape[0]}×{self.shape[1]} cells, {self.engine} "
            f"({self.precision}) on {self.device}",
            f"  {self.ops} operations in {self.launches} launch(es), {self.flops} flops"
            f"{self._most()}, {self.bytes_in} B in, {self.bytes_out} B out a frame; "
            f"{self.private_bytes} B of private, {self.local_bytes} B of local and "
            f"{self.scratch_bytes} B of scratch memory",
            f"  made of {self.parts}",
            f"  reads {', '.join(self.channels_read) or 'no channel'}; "
            f"reads back {', '.join(self.maps_read_back) or 'no map'}",
        ]
        lines += [f"  runs {text}" for text in self.transients]
        lines += [f"  leaves out {x.what}: {x.why}, saves {x.saves}" for x in self.left_out]
        return "\n".join(lines)

    def _most(self) -> str:
        """Return in words the cost of loops at their limits, where there are any."""
        if (self.ops_most, self.flops_most) == (self.ops, self.flops):
            return ""
        return f" (with loops at their limits {self.ops_most} operations, {self.flops_most} flops)"


_FOR_USERS = (
    *("program", "engine", "device", "precision", "schedule", "source"),
    *("explain", "plot", "stream", "trace", "warm_up"),
)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Plan(OfThisProcess):
    """A compiled program, which is called with a frame or a batch of frames.

    Attributes
    ----------
    program, engine, device, precision : str
    schedule : Schedule
        The program's operations.
    built : Schedule
        The schedule that actually runs, in which chains of linear operations may be fused.
    solvers : mapping of int to Solver
        How each transient runs.
    executable : Executable
    backend : Backend
        The back end that built the plan, and can build it again for a trace.
    rate : float or None, Hz
        Frame rate of the plan's streams; None if it is not known.
    at_rate : callable or None
        Compiles the program for a given rate, if the program depends on a rate that is not known.
    """

    program: str
    engine: str
    device: str
    precision: str
    schedule: Schedule
    built: Schedule
    solvers: Solvers
    executable: Executable
    backend: Backend
    rate: float | None = None
    at_rate: Callable[[float], Plan] | None = None

    def __repr__(self) -> str:
        rows, cols = self.schedule.shape
        return (
            f"Plan({self.program} on {rows}×{cols} cells, {self.engine} {self.precision}: "
            f"{', '.join(self.schedule.outputs)})"
        )

    def __dir__(self) -> list[str]:
        """Return what a prompt offers a user; all else serves the rooms that run plans."""
        return [*_FOR_USERS, *(name for name in object.__dir__(self) if name.startswith("__"))]

    def _elsewhere(self) -> str:
        return f"pickle the program '{self.program}', and compile it there by engine.compile"

    def _repr_html_(self) -> str:
        head, *rest = str(self.explain()).splitlines()
        pairs = [(name, text) for name, _, text in (line.strip().partition(" ") for line in rest)]
        return sharing.facts(head, pairs)

    def plot(self, ax: object = None) -> object:
        """Draw the arithmetic of the costliest operations, and return the axes."""
        from cnnum import sharing

        costs = [
            (operation_flops(n, self.solvers.get(n.index), self.schedule.shape), n)
            for n in self.built.nodes
        ]
        costs.sort(key=lambda cost: -cost[0])
        named = {f"{n.operation} ({n.index})": float(flops) for flops, n in costs[:COSTLIEST]}
        return sharing.bars(named, ax, "flops a frame")

    @property
    def source(self) -> str:
        """The exact source text of the kernels."""
        return self.executable.source

    @property
    def fallen(self) -> str:
        """Reason why the plan runs on the host instead of its device; empty if it does not."""
        executable = self.executable
        return executable.why if isinstance(executable, FallbackExecutable) else ""

    def __call__(self, frame: ArrayLike) -> dict[str, Floats]:
        """Run the program on a frame, or on a batch of independent frames.

        Parameters
        ----------
        frame : (..., rows, cols, channels) float
            Leading axes are a batch. The channels are those the plan was compiled for. A single
            channel may come without its axis.

        Returns
        -------
        dict of str to (..., rows, cols) or (...) float
            Maps and numbers by name; flags are 0 or 1.

        Raises
        ------
        ArrayError
            If the frame has another shape, holds NaN or infinity, or a number that the precision
            does not hold.
        MethodError
            If a transient does not reach its end.
        """
        return self.run_finite(self.looked_at(frame)[0])

    def run_finite(self, frame: NDArray[np.floating]) -> dict[str, Floats]:
        """Run the program on a frame or a batch that is known to be finite.

        Parameters and errors are those of a call.
        """
        frames, lead = self.read(frame)
        memory = self.executable.new_memory(len(frames))
        return self._run(frames, lead, memory, first=True)

    def run_large(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]
    ) -> dict[str, Floats] | None:
        """Run the program on unchecked channels; errors are those of a call.

        Parameters
        ----------
        maps : sequence of (..., maps, rows, cols) float
            All channels in order, split into one or more arrays.
        lead : tuple of int
            Leading axes to which all channels broadcast.

        Returns
        -------
        dict of str to (..., rows, cols) or (...) float, or None
            None if the engine cannot check the numbers itself, or finds numbers that are not finite
            in its precision.
        """
        if 0 in lead or self.schedule.channels_read != self.schedule.channels:
            return None
        ran = self.executable.run_large(maps, lead)
        if ran is None:
            return None
        outputs, all_finite = ran
        if not all_finite:
            self.refuse_infinite(outputs)
        return {n: values.reshape((*lead, *values.shape[1:])) for n, values in outputs.items()}

    def stream(self, batch: Sequence[int] = (), *, rate: float | None = None) -> Stream:
        """Return a stream, which keeps memories from frame to frame.

        Parameters
        ----------
        batch : sequence of int
            Leading axes of the arrays that are streamed together.
        rate : float, optional
            Frame rate in Hz, for a program that has times and is not bound to a rate.

        Raises
        ------
        ProgramError
            If the program depends on a rate that is not known, or is bound to another one.
        """
        if self.at_rate is not None:
            if rate is None:
                raise ProgramError(
                    f"Program '{self.program}' contains times in seconds, but the frame rate "
                    "of the stream is not known: pass the rate of your array as "
                    "plan.stream(rate=100.0), or compile "
                    f"cnnum.get_program('{self.program}').bind(rate=100.0)."
                )
            return self.at_rate(rate).stream(batch)
        if rate is not None and self.rate is not None and rate != self.rate:
            raise ProgramError(
                f"The plan of '{self.program}' is for {self.rate:g} frames per second, got a "
                f"stream of {rate:g}: compile the program for that rate."
            )
        return Stream(self, tuple(batch))

    def warm_up(self) -> None:
        """Build the kernels by running an empty frame, so that the first frame is not slower."""
        read = len(self.schedule.channels_read)
        empty = np.zeros((*self.schedule.shape, read))
        # the result of an empty frame is of no use, and its loops may not end
        with suppress(MethodError, ArrayError):
            stream = Stream(self, ())
            stream.push_read(empty)
            stream.push_read(empty)

    def looked_at(self, frame: ArrayLike) -> tuple[Floats, float]:
        """Check that frames are finite in the precision, and return them with a channel axis.

        Returns
        -------
        frames : (..., rows, cols, channels) float
        bound : float
            Bound on the magnitudes of the frames.

        Raises
        ------
        ArrayError
            If the frames do not consist of real, finite numbers.
        FrameError
            If a number is too large for the precision.
        """
        array, channels = numbers("frame", frame), self.schedule.channels
        size = magnitude(array)
        if not size <= HELD_BY_ALL:
            size = _largest_held(array, self.precision)
        shape = self.schedule.shape
        if len(channels) == 1 and array.shape[-2:] == shape and array.shape[-3:] != (*shape, 1):
            array = array[..., np.newaxis]
        return array, size

    def read(self, array: NDArray[np.floating]) -> tuple[NDArray[np.floating], tuple[int, ...]]:
        """Return the channels read, (batch, rows, cols, channels), and the leading axes."""
        lead, channels = array.shape[:-3], self.schedule.channels
        if array.shape[-3:] != (*self.schedule.shape, len(channels)):
            raise self.misshapen("(..., ", channels, array.shape)
        frames = array.reshape(-1, *array.shape[-3:]) if lead else array[np.newaxis]
        if len(frames) == 0:
            raise ArrayError("A batch needs at least one frame, got none.")
        read = self.schedule.channels_read
        if len(read) == len(channels):
            return frames, lead
        return frames[..., [channels.index(name) for name in read]], lead

    def misshapen(
        self, opening: str, channels: Sequence[str], shape: tuple[int, ...]
    ) -> ArrayError:
        """Return the error for a frame whose shape differs from the plan's."""
        rows, cols = self.schedule.shape
        names = f"the channels {', '.join(channels)}" if channels else "no channel"
        return ArrayError(
            f"A frame for this plan has the shape {opening}{rows}, {cols}, {len(channels)}) with "
            f"{names}, got {shape}."
        )

    def _run(
        self, frames: NDArray[np.floating], lead: tuple[int, ...], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        outputs = self.executable.run(frames, memory, first=first)
        self.refuse_infinite(outputs)
        return {
            name: values.reshape((*lead, *values.shape[1:])) for name, values in outputs.items()
        }

    def refuse_infinite(self, outputs: dict[str, Floats]) -> None:
        """Raise FrameError if an output of a frame is not finite."""
        for name, values in outputs.items():
            if not all_finite(values):
                raise FrameError(
                    f"Output '{name}' of program '{self.program}' is not finite: the values of "
                    "the frame are too large for it."
                )

    def trace(self, frame: ArrayLike) -> Iterator[TraceStep]:
        """Yield each operation with its result for a frame, or a batch of frames.

        The plan is built again on its engine with every result kept, so the values are those of the
        device. Operations inside a loop are not shown, only the results of the loop.

        Raises
        ------
        ArrayError
            If the frame has another shape, or holds NaN or infinity.
        """
        return trace_steps(self.schedule, self.keeping_everything()(frame))

    def keeping_everything(self, *, beside: bool = False) -> Plan:
        """Return the plan built again with the result of every operation as an output.

        Parameters
        ----------
        beside : bool
            Whether the plan's own outputs stay, too.
        """
        kept = (everything_added if beside else everything_kept)(self.schedule)
        return replace(self, schedule=kept).unfused()

    def unfused(self) -> Plan:
        """Return the same plan with every operation separate, for comparison."""
        executable = self.backend.build(self.schedule, self.solvers)
        return replace(self, built=self.schedule, executable=executable)

    def explain(self) -> Explanation:
        """Return the operations that run, those that are left out with the reason, and the cost."""
        schedule, cells = self.built, self.built.cells
        done = work(schedule.nodes, self.solvers, schedule.shape)
        maps = tuple(name for name, node in schedule.outputs.items() if not node.scalar)
        numbers = len(schedule.outputs) - len(maps)
        width = np.dtype(number_type(self.precision)).itemsize
        return Explanation(
            program=self.program,
            engine=self.engine,
            device=f"{self.device}; {self.fallen}" if self.fallen else self.device,
            precision=self.precision,
            shape=schedule.shape,
            ops=done.ops,
            ops_most=done.ops_most,
            parts=parts_of(self.schedule.nodes),
            launches=self.executable.launches,
            channels_read=schedule.channels_read,
            maps_read_back=maps,
            transients=tuple(self._transients()),
            flops=done.flops,
            flops_most=done.flops_most,
            bytes_in=width * cells * len(schedule.channels_read),
            bytes_out=width * (cells * len(maps) + numbers),
            private_bytes=self.executable.private_bytes,
            local_bytes=self.executable.local_bytes,
            scratch_bytes=self.executable.scratch_bytes,
            left_out=schedule.left_out,
        )

    def _transients(self) -> list[str]:
        texts: list[str] = []
        for node in self.built.transients:
            assert isinstance(node.operation, Transient)
            solver = self.solvers[node.index]
            name = node.operation.template.name
            text = f"template {name} by {solver.method} ({solver.reason})"
            how = self.executable.strategies.get(node.index)
            texts.append(text if how is None else f"{text}, as {how}")
        return texts


def _largest_held(array: Floats, precision: str) -> float:
    """Return the largest magnitude in an array; refuse one that the precision does not hold."""
    size = largest(finite("frame", array))
    if size > held(precision):
        raise FrameError(
            f"A frame in {precision} can hold numbers up to {held(precision):.3g}, got "
            f"{size:.3g}: leave out that frame, or scale its values."
        )
    return size
