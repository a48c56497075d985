"""A transient of a batch: in closed form if possible, else by compiled functions.

Ends known in closed form are computed for a whole batch in NumPy.

A frame gives bit-identical results alone and in any batch: products have a fixed order.
"""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.engines.forks import LOST, note_threads
from cnnum.engines.numba.compiling import ROOM, cores, kept
from cnnum.engines.numba.plans import part_tableaux, plan_of
from cnnum.engines.numba.records import Batch, Layout, Plan, Real, Reals
from cnnum.engines.numba.steps import add, drive_frames, run_frames
from cnnum.graph.nodes import FIGURES, Transient
from cnnum.integrators.closed_forms import (
    Circulant,
    Decay,
    Propagator,
    Separate,
    Spectral,
    evaluate,
    passes_in_fours,
    rounded_gain,
    roundings,
)
from cnnum.integrators.series import Stretch, bounds, followed, grown
from cnnum.integrators.solver import Exact, Solver
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import Network
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False)
class ExactEnd:
    """A scheme without steps in the numbers of the engine.

    Attributes
    ----------
    scheme : Exact
    rounding : float
        Its rounding error, relative to the largest value in it.
    """

    scheme: Exact
    rounding: float

    @classmethod
    def of(cls, template: Template, shape: Shape, scheme: Exact, dtype: Real) -> "ExactEnd":
        """Return the end of a scheme."""
        rounding = float(np.finfo(dtype).eps) * _roundings(template, shape, scheme)
        rounding += scheme.rounding
        if isinstance(scheme, Separate):  # evaluated in float64
            return cls(scheme, rounding)
        # of a dense product column after column
        order: Literal["F", "C"] = "F" if isinstance(scheme, Propagator) else "C"
        parts: dict[str, Any] = {
            field.name: np.array(getattr(scheme, field.name), dtype, order=order)
            for field in fields(scheme)
        }
        return cls(replace(scheme, **parts), rounding)

    def reach(self, state: Reals, drive: Reals, held: Reals) -> Reals:
        """Set states to those at the end; return the error that rounding leaves, (batch,).

        Parameters
        ----------
        state, drive : (batch, layers, rows, cols) float
        held : (batch or 1, layers, rows, cols) bool
            Cells that stay as they are.
        """
        scheme = self.scheme
        if isinstance(scheme, Separate) and scheme.ends:
            state[...] = np.where(held, state, scheme.sums(state, drive))
            return np.zeros(len(state))  # nothing reads it
        largest = np.maximum(_largest(state), _largest(drive))
        if isinstance(scheme, Separate):
            numbers = state.astype(np.float64), drive.astype(np.float64)
            ends, rounded = evaluate(scheme, *numbers, self.rounding)
            end: Reals = ends
            largest = _largest(np.where(held, np.abs(state), rounded))
        else:
            end = _ENDS[type(scheme)](scheme, state, drive)
        if isinstance(scheme, Propagator) and scheme.constant.any():
            largest = np.maximum(largest, 1.0)  # the sum of a rim counts in units of 1
        state[...] = np.where(held, state, end)
        return np.asarray(self.rounding * largest)


def _largest(maps: Reals) -> Floats:
    return np.asarray(np.abs(maps).max(axis=(1, 2, 3)), dtype=np.float64)


def _decayed(scheme: Any, start: Reals, drive: Reals) -> Reals:
    return np.asarray(scheme.reach(start, drive))


def _propagated(scheme: Propagator, start: Reals, drive: Reals) -> Reals:
    batch = len(start)
    ends = np.tile(scheme.constant, (batch, 1))
    for matrix, maps in ((scheme.state, start), (scheme.drive, drive)):
        add_products(np.ascontiguousarray(maps).reshape(batch, -1), matrix.T, ends)
    return ends.reshape(start.shape)


def _through_modes(scheme: Spectral, start: Reals, drive: Reals) -> Reals:
    modes, back = np.zeros_like(start), np.ascontiguousarray(scheme.rows.T)
    into = np.ascontiguousarray(scheme.cols.T)
    for factors, maps in ((scheme.state, start), (scheme.drive, drive)):
        for source in range(maps.shape[1]):
            if factors[:, source].any():
                seen = _both_sides(scheme.rows, maps[:, source], into)
                for to in range(maps.shape[1]):
                    modes[:, to] += factors[to, source] * seen
    ends = [_both_sides(back, modes[:, to], scheme.cols) for to in range(modes.shape[1])]
    return np.stack(ends, axis=1) + scheme.constant


def _around_torus(scheme: Circulant, start: Reals, drive: Reals) -> Reals:
    (batch, layers), cells = drive.shape[:2], drive.shape[2:]
    ends = np.zeros((layers, drive[:, 0].size), drive.dtype)
    by_layer = np.moveaxis(drive, 1, 0)
    for shift in np.ndindex(*cells):
        seen = np.roll(by_layer, shift, axis=(2, 3)).reshape(layers, -1)
        add_products(np.ascontiguousarray(scheme.drive[:, :, *shift]), seen, ends)
    return np.moveaxis(ends.reshape(layers, batch, *cells), 0, 1)


_ENDS: dict[type, Callable[[Any, Reals, Reals], Reals]] = {
    Decay: _decayed,
    Propagator: _propagated,
    Spectral: _through_modes,
    Circulant: _around_torus,
}


def _both_sides(left: Reals, maps: Reals, right: Reals) -> Reals:
    """Return left · map · right of maps (batch, rows, cols); 0 of maps that are."""
    result = np.zeros(maps.shape, maps.dtype)
    for frame, values in enumerate(maps):
        if values.any():
            halfway = np.zeros(values.shape, values.dtype)
            add_products(left, np.ascontiguousarray(values), halfway)
            add_products(halfway, right, result[frame])
    return result


@kept
def add_products(left: Reals, right: Reals, totals: Reals, room: int = ROOM) -> None:
    """Add left · right to totals, (n, m) · (m, k) to (n, k), in one order on every machine.

    The order of summation in libraries depends on their number of threads.
    """
    whole = len(right) - len(right) % 4
    for row in range(len(left)):
        total, weights = totals[row], left[row]
        for at in range(0, whole, 4):
            a, b, c, d = weights[at], weights[at + 1], weights[at + 2], weights[at + 3]
            first, second, third, fourth = right[at], right[at + 1], right[at + 2], right[at + 3]
            for i in range(total.size):
                total[i] += (a * first[i] + b * second[i]) + (c * third[i] + d * fourth[i])
        for at in range(whole, len(right)):
            add(weights[at], right[at], total)


def _roundings(template: Template, shape: Shape, scheme: Exact) -> float:
    """Return a bound on the error of an end, in roundings of the largest value.

    A sum of n rounded products is off by at most n roundings of its largest value.
    """
    if isinstance(scheme, Separate):
        return roundings(template)
    if isinstance(scheme, Decay):
        return float(np.count_nonzero(template.B)) + 4.0
    if isinstance(scheme, Propagator):
        return _of_products(template, scheme)
    if isinstance(scheme, Circulant):
        sums = shape[0] * shape[1] * float(passes_in_fours(template.layers).max())
        # a weight as it is held, its product, its sum of four, and a cell's drive
        return (
            0.5 * max(scheme.gain(range(template.layers)), 1.0) * (sums + 5.0 + _control(template))
        )
    gains = (float(np.abs(part).sum(axis=1).max()) for part in (scheme.state, scheme.drive))
    # modes keep lengths, so that they spread roundings over the cells and do not add them up
    return (2.0 * sum(shape) + 2.0) * max(sum(gains), 1.0)


def _of_products(template: Template, scheme: Propagator) -> float:
    """Return the same of products that are added up as `add_products` does it."""
    sums = passes_in_fours(len(scheme.constant))
    added = float(sums.max(initial=0.0))
    own = 1.0 + 2.0 + 2.0  # the product, its sum of four, and matrix and state as they are held
    control = _control(template)
    later = own + sums
    parts, times = [scheme.drive], [later + control]
    if scheme.state.any():
        parts, times = [scheme.state, *parts], [later + added, *times]
    rim = np.abs(scheme.constant).max(initial=0.0) * (2.0 * added + 2.0)
    return 0.5 * (max(rounded_gain(parts, times), 1.0) + float(rim))


def _control(template: Template) -> float:
    """Return the approximate number of roundings in the drive of a cell."""
    return float(np.count_nonzero(template.B) / template.layers) + 2.0


SPREAD_CELLS = 128 * 128
"""Smallest array whose frame is distributed over all cores. Below it, synchronisation takes longer
than the work."""

_CORES = threading.Lock()
"""Numba's simplest pool of threads, the only one on some systems, serves one caller at a time."""

FRAMES_A_THREAD = 8
"""Minimum number of frames per thread if they take time steps."""

CELLS_A_THREAD = 512 * 512
"""Minimum number of cells per thread if the end is known: fewer take less time than a start."""


@dataclass(frozen=True, slots=True, eq=False)
class TransientRunner:
    """A template on an array, ready to run."""

    operation: Transient
    layout: Layout
    solver: Solver
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
        return cls(operation, layout, solver, plan, end, dtype)

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
        result = {"state": state, "output": output, **figures}
        if len(moments):
            cells = frames.seen.reshape(-1, frames.seen.shape[-1])
            seen = self.layout.inner(cells).reshape(len(moments), *state.shape)
            result |= {"seen": seen, "marks": frames.marks}
        return result

    def ends(
        self, arguments: Sequence[Reals], batch: int, stretches: Sequence[Stretch]
    ) -> dict[str, Reals]:
        """Return the ends that are known without a step at several times, as a look has them.

        Parameters
        ----------
        arguments : sequence of (batch or 1, rows or 1, cols or 1) float
        batch : int
        stretches : sequence of Stretch
            Of all times, in their order.
        """
        count = sum(1 + len(stretch.later) for stretch in stretches)
        frames = self._frames(self.operation.by_role(arguments), batch, ())
        drive_frames(self.plan, frames, 0, batch)
        start, drive, pace = map(self.layout.inner, (frames.state, frames.drive, frames.pace))
        states = np.tile(frames.state, (count, 1))
        seen = self.layout.inner(states).reshape(count, *start.shape)
        marks, at = np.zeros((count, batch, 3)), 0
        with np.errstate(all="ignore"):
            for stretch in stretches:
                own = slice(at, at + 1 + len(stretch.later))
                self._along(stretch, seen[own], marks[own, :, 2], drive, pace == 0.0)
                at = own.stop
        self.layout.inner(states)[...] = seen.reshape(-1, *start.shape[1:])
        drives = np.tile(frames.drive, (count, 1))
        paces = np.tile(frames.pace, (count, 1)) if len(frames.pace) > 1 else frames.pace
        figures = np.zeros((len(states), len(FIGURES) + 1))
        now = frames._replace(
            state=states, output=np.empty_like(states), drive=drives, pace=paces, figures=figures
        )
        run_frames(self.plan, now, 0, len(states), False)
        marks[:, :, 1] = figures[:, 2].reshape(count, batch)
        return {"seen": seen, "marks": marks}

    def _along(
        self, stretch: Stretch, seen: Reals, errors: Floats, drive: Reals, held: Reals
    ) -> None:
        """Set states, which are those of the start, and errors to those at a stretch's times."""
        template, shape = self.operation.template, self.layout.shape
        end = ExactEnd.of(template, shape, stretch.scheme, self.dtype)
        errors[0] = end.reach(seen[0], drive, held)
        if not stretch.later:
            return
        numbers = seen[0].astype(np.float64), drive.astype(np.float64)
        states, rounded = followed(Network(template, shape), *numbers, stretch.later)
        seen[1:] = states
        # what is off then, and the roundings of the drive, grow no faster than states part
        eps, since = float(np.finfo(self.dtype).eps), np.array(stretch.later)[:, np.newaxis]
        driven = eps * _control(template) * _largest(drive) / float(template.tau.min())
        begun, along = grown(bounds(template)[1], since)
        sizes = np.abs(states).max(axis=(2, 3, 4))
        errors[1:] = begun * errors[0] + along * driven + rounded + eps * sizes

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
        """Return the number of threads to use for a batch."""
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
            parts=part_tableaux(template, self.solver, moments),
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
