"""A transient of a batch: NumPy in, compiled functions, NumPy out."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from cnnum.arrays import Shape
from cnnum.engines.forks import LOST, note_threads
from cnnum.engines.numba.compiling import cores
from cnnum.engines.numba.exact_ends import ExactEnd
from cnnum.engines.numba.frames import drive_frames, run_frames
from cnnum.engines.numba.layout import Layout
from cnnum.engines.numba.plans import plan_of
from cnnum.engines.numba.records import Batch, Plan, Real, Reals
from cnnum.graph.nodes import FIGURES, Transient
from cnnum.integrators.solver import Exact, Solver
from cnnum.templating.boundary import Boundary

SPREAD_CELLS = 128 * 128
"""Smallest array whose frame lies on all cores. Below it, the cores wait for each other longer than
they work."""

_CORES = threading.Lock()
"""Numba's simplest pool of threads, the only one on some systems, serves one caller at a time."""

FRAMES_A_THREAD = 8
"""Fewest frames that are worth a thread of their own where they are stepped."""

CELLS_A_THREAD = 512 * 512
"""Fewest cells that are where the end is known: fewer take less than the threads to start."""


@dataclass(frozen=True, slots=True, eq=False)
class TransientRunner:
    """A template on an array, ready to run."""

    operation: Transient
    layout: Layout
    plan: Plan
    end: ExactEnd | None
    dtype: Real

    @classmethod
    def of(
        cls, operation: Transient, shape: Shape, solver: Solver, dtype: Real
    ) -> "TransientRunner":
        """Return the runner of a transient."""
        layout = Layout(shape, operation.template.radius)
        plan = plan_of(operation.template, layout, solver, dtype)
        scheme, end = solver.scheme, None
        if isinstance(scheme, Exact):
            end = ExactEnd.of(operation.template, shape, scheme, dtype)
        return cls(operation, layout, plan, end, dtype)

    def run(
        self,
        arguments: Sequence[Reals],
        batch: int,
        moments: Sequence[float] = (),
        cuts: int = 1,
    ) -> dict[str, Reals]:
        """Return states and outputs (batch, layers, rows, cols), and figures (batch,), by name.

        Parameters
        ----------
        arguments : sequence of (batch or 1, rows or 1, cols or 1) float
        batch : int
        moments : sequence of float
            Times at which a run by steps is looked at on its way: "seen" are the states there
            (times, batch, layers, rows, cols), "marks" steps, settled and error (times, batch, 3).
        cuts : int
            Parts in which a piece of a step of fixed length is taken up to such a time.
        """
        plan = self.plan
        if cuts > 1:
            settings = plan.settings.copy()
            settings["cuts"] = cuts
            plan = plan._replace(settings=settings)
        frames = self._frames(self.operation.by_role(arguments), batch, moments)
        if self.end is not None:
            self._launch(partial(self._reach, self.end, frames), batch)
        self._launch(partial(run_frames, plan, frames), batch)
        figures = dict(zip((*FIGURES, "unfinished"), frames.figures.T, strict=True))
        state, output = self.layout.inner(frames.state), self.layout.inner(frames.output)
        found = {"state": state, "output": output, **figures}
        if len(moments):
            cells = frames.seen.reshape(-1, frames.seen.shape[-1])
            seen = self.layout.inner(cells).reshape(len(moments), *state.shape)
            found |= {"seen": seen, "marks": frames.marks}
        return found

    def ends(
        self, arguments: Sequence[Reals], batch: int, schemes: Sequence[Exact]
    ) -> dict[str, Reals]:
        """Return the ends that are known without a step at several times, as a look has them.

        Parameters
        ----------
        arguments : sequence of (batch or 1, rows or 1, cols or 1) float
        batch : int
        schemes : sequence of Exact
            One a time.
        """
        template, shape = self.operation.template, self.layout.shape
        frames = self._frames(self.operation.by_role(arguments), batch, ())
        drive_frames(self.plan, frames, 0, batch)
        start, drive, pace = map(self.layout.inner, (frames.state, frames.drive, frames.pace))
        states = np.tile(frames.state, (len(schemes), 1))
        seen = self.layout.inner(states).reshape(len(schemes), *start.shape)
        marks = np.zeros((len(schemes), batch, 3))
        with np.errstate(all="ignore"):
            for at, scheme in enumerate(schemes):
                state = start.copy()
                end = ExactEnd.of(template, shape, scheme, self.dtype)
                marks[at, :, 2] = end.reach(state, drive, pace == 0.0)
                seen[at] = state
        self.layout.inner(states)[...] = seen.reshape(-1, *start.shape[1:])
        drives = np.tile(frames.drive, (len(schemes), 1))
        paces = np.tile(frames.pace, (len(schemes), 1)) if len(frames.pace) > 1 else frames.pace
        figures = np.zeros((len(states), len(FIGURES) + 1))
        now = frames._replace(
            state=states, output=np.empty_like(states), drive=drives, pace=paces, figures=figures
        )
        run_frames(self.plan, now, 0, len(states), False)
        marks[:, :, 1] = figures[:, 2].reshape(len(schemes), batch)
        return {"seen": seen, "marks": marks}

    def _reach(self, end: ExactEnd, frames: Batch, start: int, stop: int, spread: bool) -> None:
        """Set states to their known end; whether all is at rest is left to say."""
        drive_frames(self.plan, frames, start, stop)
        own = slice(start, stop)
        pace = frames.pace[own] if len(frames.pace) > 1 else frames.pace
        state, drive, pace = map(self.layout.inner, (frames.state[own], frames.drive[own], pace))
        duration, figures = self.plan.settings[0]["duration"], frames.figures[own]
        figures[:] = [duration, 0.0, 1.0, 0.0, 0.0]
        # overflow is infinite, as it is on every engine
        with np.errstate(all="ignore"):
            figures[:, 3] = end.reach(state, drive, pace == 0.0)

    def _launch(self, run: Callable[[int, int, bool], None], batch: int) -> None:
        note_threads()
        large = self.layout.shape[0] * self.layout.shape[1] >= SPREAD_CELLS
        if large and not LOST.threads:
            with _CORES:
                run(0, batch, True)
            return
        threads = min(cores(), self._worth(batch))
        if threads == 1:
            run(0, batch, False)
            return
        ends = [batch * part // threads for part in range(threads + 1)]
        with ThreadPoolExecutor(threads) as pool:
            for done in [pool.submit(run, start, end, False) for start, end in pairwise(ends)]:
                done.result()

    def _worth(self, batch: int) -> int:
        """Return how many threads a batch is worth."""
        if self.end is None:
            return -(-batch // FRAMES_A_THREAD)
        rows, cols = self.layout.shape
        return max(1, batch * rows * cols // CELLS_A_THREAD)

    def _frames(
        self, given: dict[str, tuple[Reals, ...]], batch: int, moments: Sequence[float]
    ) -> Batch:
        template = self.operation.template
        state = self._start(given, batch)
        previous = given["previous"] if template.delayed is not None else ()
        return Batch(
            state=state,
            output=np.empty_like(state),
            drive=self._drive(given["bias"], batch),
            pace=self._pace(given["mask"], batch),
            inputs=self._rimmed(given["input"], template.input_boundary, batch),
            previous=self._rimmed(previous, template.input_boundary, batch if previous else 0),
            figures=np.zeros((batch, len(FIGURES) + 1)),
            moments=np.array(moments, dtype=np.float64),
            seen=np.zeros((len(moments), *state.shape), state.dtype),
            marks=np.zeros((len(moments), batch, 3)),
        )

    def _start(self, given: dict[str, tuple[Reals, ...]], batch: int) -> Reals:
        template = self.operation.template
        starts = given["state"] or (given["input"] if template.initial == "input" else ())
        rim = template.boundary.constant or 0.0
        state = self.layout.maps(batch, template.layers, rim, self.dtype)
        inner = self.layout.inner(state)
        for layer in range(template.layers):
            inner[:, layer] = starts[layer] if starts else float(template.initial)
        if template.output.limited:
            np.clip(inner, -1.0, 1.0, out=inner)
        return state

    def _drive(self, bias: tuple[Reals, ...], batch: int) -> Reals:
        template = self.operation.template
        drive = self.layout.maps(batch, template.layers, 0.0, self.dtype)
        inner = self.layout.inner(drive)
        inner[:] = template.z[:, np.newaxis, np.newaxis]
        for layer, values in enumerate(bias):
            inner[:, layer] += values
        return drive

    def _pace(self, mask: tuple[Reals, ...], batch: int) -> Reals:
        template = self.operation.template
        pace = self.layout.maps(batch if mask else 1, template.layers, 0.0, self.dtype)
        inner = self.layout.inner(pace)
        inner[:] = (1.0 / template.tau)[:, np.newaxis, np.newaxis]
        for held in mask:
            inner[np.broadcast_to(held[:, np.newaxis] != 0.0, inner.shape)] = 0.0
        return pace

    def _rimmed(self, given: tuple[Reals, ...], boundary: Boundary, batch: int) -> Reals:
        maps = self.layout.maps(batch, len(given), boundary.constant or 0.0, self.dtype)
        inner = self.layout.inner(maps)
        for place, values in enumerate(given):
            inner[:, place] = values
        self.layout.fill_rims(maps, boundary)
        return maps
