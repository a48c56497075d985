"""Running a plan: as one kernel, or part by part, where loops go on as the frames ask."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyopencl as cl

from cnnum.engines.devices.shared_arrays import SharedArray, shared_array
from cnnum.engines.opencl.runtime.plan_kernels import PlanKernels
from cnnum.kernels.launch_plan import Launch, LaunchPlan, LaunchStep, Rounds, Steps

Arguments = Sequence["cl.Buffer | cl.SVM[Any]"]
"""The plan's own arrays, which come first among the arguments of its kernels: scratch is last."""


@dataclass(slots=True, eq=False)
class WholeRunner:
    """Runs a plan that is one kernel.

    Attributes
    ----------
    kernels : PlanKernels
    lanes : int
        Frames a work item.
    """

    kernels: PlanKernels
    lanes: int
    _items: int = 0

    def bind(self, arguments: Arguments, batch: int, *, first: bool) -> None:
        """Set the kernel's arguments."""
        self.kernels["plan"].set_args(*arguments, np.int32(batch), np.int32(first))
        self._items = -(-batch // self.lanes)

    def run(self) -> None:
        """Launch the kernel."""
        self.kernels.launch("plan", (self._items,))


@dataclass(slots=True, eq=False)
class LaunchRunner:
    """Runs a plan for large arrays in parts.

    Registers, (registers, batch) numbers, and unfinished sums are state that its parts share.

    Attributes
    ----------
    kernels : PlanKernels
    plan : LaunchPlan
    dtype : dtype
    """

    kernels: PlanKernels
    plan: LaunchPlan
    dtype: np.dtype[np.floating]
    _batch: int = 0
    _scratch: "cl.Buffer | cl.SVM[Any]" = field(init=False)
    _registers: SharedArray = field(init=False)
    _partials: cl.Buffer = field(init=False)

    def bind(self, arguments: Arguments, batch: int, *, first: bool) -> None:
        """Set the arguments of all parts."""
        if batch != self._batch:
            queue, partials = self.kernels.queue, max(1, batch * self.plan.partials)
            size = partials * self.dtype.itemsize
            self._registers = shared_array(queue, batch * self.plan.registers, self.dtype)
            self._partials = cl.Buffer(queue.context, cl.mem_flags.READ_WRITE, size)
            self._batch = batch
        self._scratch = arguments[-1]
        shared = (self._registers.argument, self._partials)
        for name in _launched(self.plan.parts):
            self.kernels[name].set_args(*arguments, *shared, np.int32(batch), np.int32(first))

    def run(self) -> None:
        """Launch all parts."""
        self._play(self.plan.parts)

    def _play(self, parts: Iterable[LaunchStep]) -> None:
        for part in parts:
            if isinstance(part, Launch):
                self.kernels.launch(part.kernel, (part.pieces, self._batch))
            elif isinstance(part, Steps):
                self._steps(part)
            else:
                self._repeat(part)

    def _repeat(self, rounds: Rounds) -> None:
        if rounds.flag is not None:
            while self._register(rounds.flag).any():
                self._play(rounds.parts)
            return
        count = rounds.count or 0
        if rounds.bound is not None:
            place, start = rounds.bound
            count = int(self._register(place).max()) - start
        for _ in range(count):
            self._play(rounds.parts)

    def _register(self, place: int) -> np.ndarray[tuple[int, ...], np.dtype[np.floating]]:
        """Return the value of a register in each frame, once all before it is done."""
        self._registers.pull(self.kernels.queue)
        return self._registers.host[place * self._batch : (place + 1) * self._batch]

    def _steps(self, steps: Steps) -> None:
        """Set out, take the levels strip by strip, and bring the states back."""
        strips, levels = steps.strips, self._levels(steps)
        if steps.levels is not None and levels == 0:
            return
        pieces = strips.pieces(self._batch, self.kernels.queue.device.max_compute_units)
        whole = pieces == 1 and strips.alone
        at_once = levels if whole else strips.levels
        if strips.first is not None:
            self._phase(steps, pieces, strips.first)
        for done in range(0, levels, max(1, at_once)):
            count = min(at_once, levels - done)
            self._phase(steps, pieces, 1, done, count)
            if not whole:
                self._phase(steps, pieces, 2, done, count)
        if strips.ends:
            self._phase(steps, pieces, 3)

    def _levels(self, steps: Steps) -> int:
        """Return the levels of the frame that takes most."""
        if steps.levels is None:
            return steps.strips.count
        taken = self._register(steps.levels)
        if steps.guard is not None:
            taken = taken[self._register(steps.guard) != 0]
        return int(taken.max(initial=0))

    def _phase(self, steps: Steps, pieces: int, phase: int, done: int = 0, count: int = 0) -> None:
        guard = -1 if steps.guard is None else steps.guard
        numbers = (guard, self._batch, pieces, phase, done, count)
        arguments = (self._scratch, self._registers.argument, *map(np.int32, numbers))
        self.kernels.launch(steps.strips.kernel, (pieces * self._batch,), *arguments)


Runner = WholeRunner | LaunchRunner
"""Both bind the plan's own arrays, for a number of frames, and run."""


def _launched(parts: Iterable[LaunchStep]) -> Iterator[str]:
    """Yield the kernels of the parts, and of those that are repeated."""
    for part in parts:
        if isinstance(part, Launch):
            yield part.kernel
        elif isinstance(part, Rounds):
            yield from _launched(part.parts)
