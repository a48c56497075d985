"""Running a plan for large arrays: its parts one after the other, loops as the frames ask."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyopencl as cl

from cnnum.engines.devices.shared_arrays import SharedArray, shared_array, shares_memory
from cnnum.kernels.launch_plan import Launch, LaunchPlan, LaunchStep, Rounds, Steps


@dataclass(slots=True, eq=False)
class LaunchArrays:
    """The shared state of the parts of a batch.

    Attributes
    ----------
    registers : SharedArray
        (registers, batch) numbers.
    partials : Buffer
    """

    registers: SharedArray
    partials: cl.Buffer


@dataclass(slots=True, eq=False)
class LaunchRunner:
    """The kernels of a plan's parts.

    Attributes
    ----------
    queue : CommandQueue
    program : Program
    parts : LaunchPlan
    dtype : dtype
    """

    queue: cl.CommandQueue
    program: cl.Program
    parts: LaunchPlan
    dtype: np.dtype[np.floating]
    _kernels: dict[str, cl.Kernel] = field(default_factory=dict[str, cl.Kernel])

    def new_arrays(self, batch: int) -> LaunchArrays:
        """Return the needs of a number of frames."""
        context, share = self.queue.context, shares_memory(self.queue.device)
        size = max(1, batch * self.parts.partials) * self.dtype.itemsize
        return LaunchArrays(
            shared_array(context, batch * self.parts.registers, self.dtype, share=share),
            cl.Buffer(context, cl.mem_flags.READ_WRITE, size),
        )

    def bind(
        self,
        before: "Sequence[cl.Buffer | cl.SVM[Any]]",
        arrays: LaunchArrays,
        batch: int,
        *,
        first: bool,
    ) -> None:
        """Set the arguments of all parts; before them come the plan's own arrays."""
        own = (arrays.registers.argument, arrays.partials, np.int32(batch), np.int32(first))
        for part in everything(self.parts.parts):
            if isinstance(part, Launch):
                self.kernel(part.kernel).set_args(*before, *own)

    def run(self, scratch: cl.Buffer, arrays: LaunchArrays, batch: int) -> None:
        """Launch all parts."""
        _Run(self, scratch, arrays, batch).play(self.parts.parts)

    def kernel(self, name: str) -> cl.Kernel:
        """Return a kernel of the plan."""
        if name not in self._kernels:
            self._kernels[name] = cl.Kernel(self.program, name)
        return self._kernels[name]


def everything(parts: tuple[LaunchStep, ...]) -> list[LaunchStep]:
    """Return the parts and all that are repeated."""
    found: list[LaunchStep] = []
    for part in parts:
        found += everything(part.parts) if isinstance(part, Rounds) else [part]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    plan: LaunchRunner
    scratch: cl.Buffer
    arrays: LaunchArrays
    batch: int

    def play(self, parts: tuple[LaunchStep, ...]) -> None:
        for part in parts:
            if isinstance(part, Launch):
                kernel = self.plan.kernel(part.kernel)
                size = (part.pieces, self.batch)
                cl.enqueue_nd_range_kernel(self.plan.queue, kernel, size, (1, 1))
            elif isinstance(part, Steps):
                self._steps(part)
            else:
                self._rounds(part)

    def _rounds(self, rounds: Rounds) -> None:
        if rounds.flag is not None:
            while self._register(rounds.flag).any():
                self.play(rounds.parts)
            return
        count = rounds.count or 0
        if rounds.bound is not None:
            place, start = rounds.bound
            count = int(self._register(place).max()) - start
        for _ in range(count):
            self.play(rounds.parts)

    def _register(self, place: int) -> np.ndarray[tuple[int, ...], np.dtype[np.floating]]:
        """Return the value of a register in each frame, once all before it is done."""
        self.arrays.registers.pull(self.plan.queue)
        return self.arrays.registers.host[place * self.batch : (place + 1) * self.batch]

    def _steps(self, steps: Steps) -> None:
        """Set out, take the levels strip by strip, and bring the states back."""
        strips = steps.strips
        pieces = strips.pieces(self.batch, self.plan.queue.device.max_compute_units)
        whole = pieces == 1 and strips.alone
        levels = self._levels(steps)
        at_once = levels if whole else strips.levels
        if steps.levels is not None and levels == 0:
            return
        if strips.first is not None:
            self._phase(steps, pieces, strips.first, 0, 0)
        for done in range(0, levels, max(1, at_once)):
            count = min(at_once, levels - done)
            self._phase(steps, pieces, 1, done, count)
            if not whole:
                self._phase(steps, pieces, 2, done, count)
        if strips.ends:
            self._phase(steps, pieces, 3, 0, 0)

    def _levels(self, steps: Steps) -> int:
        """Return the levels of the frame that takes most."""
        if steps.levels is None:
            return steps.strips.count
        taken = self._register(steps.levels)
        if steps.guard is not None:
            taken = taken[self._register(steps.guard) != 0]
        return int(taken.max(initial=0))

    def _phase(self, steps: Steps, pieces: int, phase: int, done: int, count: int) -> None:
        kernel = self.plan.kernel(steps.strips.kernel)
        guard = -1 if steps.guard is None else steps.guard
        numbers = (guard, self.batch, pieces, phase, done, count)
        registers = self.arrays.registers.argument
        kernel.set_args(self.scratch, registers, *(np.int32(n) for n in numbers))
        cl.enqueue_nd_range_kernel(self.plan.queue, kernel, (pieces * self.batch,), (1,))
