"""Skins with a common plan: ordinary frames are checked together and share a launch."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import CnnumError
from cnnum.frame import Frame
from cnnum.scenes.bad_taxels import (
    FINE,
    FOLLOWS,
    JUMP,
    SHOWN,
    SILENT,
    TINY,
    Dropouts,
    Liveness,
    changed_in,
)
from cnnum.scenes.conversion import ReadersAbreast
from cnnum.scenes.events import Event, EventDetector, FlagsAbreast
from cnnum.scenes.frame_path import FramePath, FrameResult, Ready
from cnnum.scenes.pipeline import Passage
from cnnum.scenes.push_watch import WatchesAbreast
from cnnum.scenes.saturation import Mask
from cnnum.scenes.scene_record import place_of
from cnnum.stream import Abreast, Answer


@dataclass(slots=True, eq=False)
class StepAbreast:
    """The results of one frame each of some skins; most are made only when they are asked for.

    Attributes
    ----------
    events : dict of int to tuple of Event
        By skins, of those in which one begins or ends.
    others : dict of int to FrameResult
        Results of frames that went alone.
    lanes : list of int
        Skins whose frames went together.
    numbers : list of int
        Numbers of these frames, in the order of the skins, as are the next two.
    frames : list of Frame
    values : (frames, rows, cols, channels read) float
    outputs : dict of str to (skins, …) float
    seconds : float
        As of `FrameResult`, for all of them.
    """

    events: dict[int, tuple[Event, ...]]
    others: dict[int, FrameResult]
    lanes: list[int]
    numbers: list[int]
    frames: list[Frame]
    values: Floats
    outputs: dict[str, Floats]
    seconds: float = 0.0

    def results(self) -> dict[int, FrameResult]:
        """Return the results of all these skins."""
        made = dict(self.others)
        parts = zip(self.lanes, self.numbers, self.frames, self.values, strict=True)
        for lane, number, frame, values in parts:
            outputs = {name: numbers[lane] for name, numbers in self.outputs.items()}
            events = self.events.get(lane, ())
            made[lane] = FrameResult(number, frame, values, outputs, events, self.seconds)
        return made


class PathsAbreast:
    """The paths of frames of several skins, which share launches.

    A frame without a flag, in which no taxel is lost, silent or at an end of its range, is looked
    at with those of the other skins. Any other one goes the way of a scene alone, to its launch.

    Parameters
    ----------
    passages : sequence of Passage
        Passages of scenes with equal plans.

    Attributes
    ----------
    paths : list of FramePath
    """

    def __init__(self, passages: Sequence[Passage]) -> None:
        plan = passages[0].path.stream.plan
        self._streams = Abreast(plan, len(passages))
        self._passages = list(passages)
        for passage, stream in zip(passages, self._streams.streams, strict=True):
            passage.path = replace(passage.path, stream=stream)
        self.paths: list[FramePath] = [passage.path for passage in passages]
        self._numbers = [0] * len(passages)
        detectors = [path.detector for path in self.paths]
        watched = [
            (path.dropouts, path.liveness)
            for path in self.paths
            if path.dropouts is not None and path.liveness is not None
        ]
        simple = all(path.dead is None and path.grid is None for path in self.paths)
        able = simple and len(watched) == len(self.paths) > 1 and FlagsAbreast.able(detectors)
        self._calm = Calm(watched, detectors) if able else None
        self._shape = (*self._streams.shape, passages[0].channels)
        self._watches = WatchesAbreast([passage.watches for passage in passages])
        self._readers = ReadersAbreast([path.read for path in self.paths])
        self._known_idle = [False] * len(passages)
        self._lanes = list(range(len(passages)))
        self._every = np.arange(len(passages), dtype=np.intp)
        self._limits = np.array([path.range.limit for path in self.paths])
        self._ends = np.array(
            [np.inf if path.saturation is None else path.saturation.limit for path in self.paths]
        )

    def warm_up(self) -> None:
        """Build the kernels of single frames, and of shared launches."""
        self._streams.warm_up()

    def step(self, lanes: Sequence[int], frames: Sequence[Frame]) -> StepAbreast:
        """Take the next frames of some skins to their events, and count them.

        Parameters
        ----------
        lanes : sequence of int
            The skins, each once, in their order.
        frames : sequence of Frame

        Raises
        ------
        ArrayError, SceneError, MethodError
            As for a single scene; frames of the others are then lost.
        """
        if len(self.paths) == 1:
            return self._by_itself(frames[0])
        started = time.perf_counter()
        passages, numbers = self._passages, self._numbers
        frame_of = dict(zip(lanes, frames, strict=True))
        for lane, frame in frame_of.items():
            if passages[lane].due:
                self._begin(lane, frame)
        running, values, sizes = self._calmly(lanes, frames)
        calm, ready, others = len(running), dict[int, Ready](), dict[int, FrameResult]()
        if calm < len(lanes):
            for lane in sorted(frame_of.keys() - running):
                self._settle(lane)
                moment = self.paths[lane].prepare(numbers[lane], frame_of[lane])
                if isinstance(moment, Ready):
                    ready[lane] = moment
                else:
                    others[lane] = passages[lane].end(moment)
        if ready:
            running = [*running, *ready]
            values = np.stack([*values, *(moment.values for moment in ready.values())])
            sizes = [*sizes, *(moment.size for moment in ready.values())]
        outputs, answers = self._streams.push(running, values, sizes)
        for lane in ready.keys() - answers:
            answers[lane] = {name: of[lane] for name, of in outputs.items()}
        if answers:
            kept = [place for place in range(calm) if running[place] not in answers]
            for place, lane in enumerate(running):
                if lane in answers:
                    size, frame = sizes[place], frame_of[lane]
                    own = Ready(numbers[lane], frame, values[place], size, None, None, (), started)
                    others[lane] = self._alone(lane, ready.get(lane, own), answers[lane])
            running, values = [running[place] for place in kept], values[kept]
        lanes, shared = running, [frame_of[lane] for lane in running]
        events = self._together(lanes, shared, values, outputs) if lanes else {}
        seconds = time.perf_counter() - started
        for lane in others:
            self._watches.anew(lane)
            passages[lane].count(others[lane])
        self._count(lanes, shared, 1e6 * seconds)
        step = [numbers[lane] for lane in lanes]
        for lane in frame_of:
            numbers[lane] += 1
        events |= {lane: moment.events for lane, moment in others.items() if moment.events}
        return StepAbreast(events, others, lanes, step, shared, values, outputs, seconds)

    def _count(self, lanes: Sequence[int], frames: Sequence[Frame], micros: float) -> None:
        """Count frames that went together; those that arrived together have waited as long."""
        passages, place, now = self._passages, place_of(micros), time.monotonic_ns()
        arrived, late, late_place = None, math.nan, 0
        for lane, frame in zip(lanes, frames, strict=True):
            if frame.monotonic_ns is None:
                passages[lane].count_good(place, micros)
                continue
            if frame.monotonic_ns != arrived:
                arrived = frame.monotonic_ns
                late = 1e-3 * (now - arrived)
                late_place = place_of(late)
            passages[lane].count_good(place, micros, late_place, late)

    def _by_itself(self, frame: Frame) -> StepAbreast:
        """Take the next frame of the only skin to its events."""
        passage = self._passages[0]
        moment = passage.step(self._numbers[0], frame)
        passage.count(moment)
        self._numbers[0] += 1
        events = {0: moment.events} if moment.events else {}
        return StepAbreast(events, {0: moment}, [], [], [], np.zeros(0), {})

    def _begin(self, lane: int, frame: Frame) -> None:
        """Tare a skin where that is due, and hold the times of its first frames."""
        passage = self._passages[lane]
        if passage.tares(self._numbers[lane], frame):
            self._settle(lane)
            passage.tare()
            self._watches.anew(lane)
        passage.hold_times(frame)

    def _alone(self, lane: int, ready: Ready, answer: Answer) -> FrameResult:
        """Return the result of a frame that no longer goes with those of the others."""
        self._settle(lane)
        path = self.paths[lane]
        if isinstance(answer, CnnumError):
            return self._passages[lane].end(path.refused(ready, answer))
        return self._passages[lane].end(path.finish(ready, answer))

    def _together(
        self, lanes: list[int], frames: list[Frame], values: Floats, outputs: dict[str, Floats]
    ) -> dict[int, tuple[Event, ...]]:
        """Return the events of frames that shared a launch, by their skins."""
        assert self._calm is not None
        at = self._every if len(lanes) == len(self.paths) else np.array(lanes, dtype=np.intp)
        times = np.array([frame.time for frame in frames])
        changed = self._calm.flags.look(at, times, outputs)
        for lane in self._watches.look(lanes, frames, values, times):
            self._passages[lane].ask_tare()
        events = dict[int, tuple[Event, ...]]()
        for lane in changed:
            own = {name: of[lane] for name, of in outputs.items()}
            self._calm.flags.settle(lane)
            now = self.paths[lane].detector.update(
                frames[lanes.index(lane)].time, self._numbers[lane], own
            )
            self._calm.flags.take(lane)
            if now:
                events[lane] = self._passages[lane].marked(now)
        return events

    def _idle(self, lane: int) -> bool:
        """Return `FramePath.idle`, which no frame that goes with others changes."""
        if not self._known_idle[lane]:
            self._known_idle[lane] = self.paths[lane].idle
        return self._known_idle[lane]

    def _settle(self, lane: int) -> None:
        self._known_idle[lane] = False
        if self._calm is not None:
            self._calm.settle(lane)

    def _calmly(
        self, lanes: Sequence[int], frames: Sequence[Frame]
    ) -> tuple[list[int], Floats, list[float]]:
        """Return the skins whose frames are out of no order, and the program's inputs and sizes."""
        calm, shape, idle = self._calm, self._shape, self._idle
        places = [
            place
            for place, (lane, frame) in enumerate(zip(lanes, frames, strict=True))
            if not frame.quality and frame.values.shape == shape and idle(lane)
        ]
        if calm is None or len(places) < 2:
            return [], np.zeros(0), []
        if len(places) < len(lanes):
            lanes, frames = [lanes[place] for place in places], [frames[place] for place in places]
        whole = len(lanes) == len(self.paths)
        at = self._every if whole else np.array(lanes, dtype=np.intp)
        times = np.array([frame.time for frame in frames])
        values = np.concatenate([frame.values for frame in frames]).reshape(-1, *shape)
        sizes: Floats = np.abs(values.reshape(len(at), -1)).max(axis=1)
        # a slice is not copied
        rows = slice(None) if whole else at
        within = (sizes <= self._limits[rows]) & (sizes < self._ends[rows])
        if not within.all():
            at, values, times, sizes = at[within], values[within], times[within], sizes[within]
        ordinary = calm.look(at, values, times)
        if not ordinary.all():
            at, values, sizes = at[ordinary], values[ordinary], sizes[ordinary]
        own: list[int] = self._lanes if len(at) == len(self.paths) else at.tolist()
        if len(own) < len(lanes):
            frame_of = dict(zip(lanes, frames, strict=True))
            frames = [frame_of[lane] for lane in own]
        if not own:
            return [], np.zeros(0), []
        read = self._readers(at, frames, values)
        if self.paths[0].marks:
            read = np.concatenate([read, np.zeros((*read.shape[:-1], 1))], axis=3)
        return own, read, sizes.tolist()


class Calm:
    """Frames of several skins in which no taxel is lost or silent, taken in together.

    What `Dropouts.look` and `Liveness.look` keep of such frames lies here in one array for all
    skins. A frame in which anything else may be goes through them, with `settle` before it.

    Parameters
    ----------
    skins : sequence of (Dropouts, Liveness)
        State of skins of one shape, all of whose taxels are checked.
    detectors : sequence of EventDetector

    Attributes
    ----------
    flags : FlagsAbreast
        Of the skins whose last frame was in order.
    """

    def __init__(
        self,
        skins: Sequence[tuple[Dropouts, Liveness]],
        detectors: Sequence[EventDetector],
    ) -> None:
        self._skins, self._here = tuple(skins), np.zeros(len(skins), dtype=np.bool_)
        self.flags = FlagsAbreast(detectors)
        self._all_here = False
        empty: Floats = np.zeros(0)
        self._raw = self._earlier = self._rest = self._power = self._span = empty
        self._before = self._period = self._span_at = self._low = self._high = empty
        self._limited = True
        self._steps, self._times = 0, np.zeros(0)  # that are only counted yet, and of the last one

    def look(self, lanes: NDArray[np.intp], values: Floats, times: Floats) -> Mask:
        """Take in the frames in which all goes on, and return which ones these are.

        Parameters
        ----------
        lanes : (frames,) int
            Skins, each once.
        values : (frames, rows, cols, channels) float
        times : (frames,) float, s
        """
        if len(self._raw) == 0:
            self._make(values.shape[1:])
        if not self._all_here:
            self._catch_up()
            for lane in lanes[~self._here[lanes]].tolist():
                self._take(lane)
            self._all_here = bool(self._here.all())
        if self._all_here and len(lanes) == len(self._here) and self._all_change(values, times):
            return np.ones(len(lanes), dtype=np.bool_)
        self._catch_up()
        # a slice is not copied
        rows = slice(None) if len(lanes) == len(self._here) else lanes
        steps = values - self._raw[rows]
        squares = _squares(steps)
        changed = changed_in(values, self._raw[rows])
        calm: Mask = np.asarray((squares <= JUMP**2 * self._power[rows]).all(axis=1))
        calm &= self._here[rows]
        if self._limited:
            low, high = self._low[rows], self._high[rows]
            calm &= ((values >= low) & (values <= high)).all(axis=(1, 2, 3))
        since = np.broadcast_to(times[:, np.newaxis, np.newaxis], changed.shape)
        if not changed.all():  # a skin all of whose readings change is alive
            since = np.where(changed, since, self._since[rows])
            cells = values.reshape(len(lanes), -1)
            calm &= (cells != cells[:, :1]).any(axis=1)
            calm &= times - since.min(axis=(1, 2)) < SILENT
        if calm.all():
            self._go_on(rows, values, times, squares, changed, since)
        elif calm.any():
            squares, changed, since = squares[calm], changed[calm], since[calm]
            self._go_on(lanes[calm], values[calm], times[calm], squares, changed, since)
        return calm

    def _all_change(self, values: Floats, times: Floats) -> bool:
        """Take in frames of all skins in which every reading changes and none jumps, or none.

        Nearly all steps of skins with noise end here, so what they add up is only counted.
        """
        steps = values - self._raw
        squares = _squares(steps)
        jumps = squares > JUMP**2 * self._power
        if jumps.any() or not changed_in(values, self._raw).all():
            return False
        if self._limited and not ((values >= self._low) & (values <= self._high)).all():
            return False
        self._follow(slice(None), times, squares, values[0, :, :, 0].size)
        self._earlier, self._raw = self._raw, values
        self._steps, self._times = self._steps + 1, times
        due = times - self._span_at >= SHOWN
        if due.any():
            self._take_spans(np.flatnonzero(due), values[due], times[due])
        return True

    def _catch_up(self) -> None:
        """Do what is left of the steps in which every reading has changed."""
        if not self._steps:
            return
        self._frames += self._steps
        self._changes += self._steps
        self._since[:] = self._times[:, np.newaxis, np.newaxis]
        self._seen[:] = self._frames[:, np.newaxis, np.newaxis]
        self._steps = 0

    def _follow(
        self, lanes: NDArray[np.intp] | slice, times: Floats, squares: Floats, cells: int
    ) -> None:
        """Follow the noise and the time from frame to frame."""
        step, period = times - self._before[lanes], self._period[lanes]
        share = np.minimum(1.0, np.maximum(step, 0.0) / FOLLOWS)
        power = self._power[lanes]
        power = power + share[:, np.newaxis] * (squares / (2.0 * cells) - power)
        self._power[lanes] = np.maximum(power, TINY**2)
        follows = (step > 0.0) & (step < 2.0 * period)
        moved = period + np.minimum(1.0, step / FOLLOWS) * (step - period)
        self._period[lanes] = np.where(follows, moved, period)
        self._before[lanes] = times

    def _go_on(
        self,
        lanes: NDArray[np.intp] | slice,
        values: Floats,
        times: Floats,
        squares: Floats,
        changed: Mask,
        since: Floats,
    ) -> None:
        """Do what `Dropouts._goes_on` and `Liveness.look` do in such frames."""
        self._follow(lanes, times, squares, changed[0].size)
        self._earlier[lanes] = self._raw[lanes]
        self._raw[lanes] = values
        self._frames[lanes] += 1
        self._since[lanes] = since
        self._changes[lanes] += changed
        frames = self._frames[lanes][:, np.newaxis, np.newaxis]
        self._seen[lanes] = np.where(changed, frames, self._seen[lanes])
        due = times - self._span_at[lanes] >= SHOWN
        if due.any():
            own = np.arange(len(self._here))[lanes]
            self._take_spans(own[due], values[due], times[due])

    def _take_spans(self, lanes: NDArray[np.intp], values: Floats, times: Floats) -> None:
        """Do what `Dropouts._take_span` does."""
        away = values - self._rest[lanes]
        span = self._span[lanes]
        span[:, 0] = np.minimum(span[:, 0], away.min(axis=(1, 2)))
        span[:, 1] = np.maximum(span[:, 1], away.max(axis=(1, 2)))
        self._span[lanes] = span
        least = np.square(FINE * np.abs(span).max(axis=1))
        self._power[lanes] = np.maximum(self._power[lanes], least)
        self._span_at[lanes] = times

    def _make(self, shape: tuple[int, ...]) -> None:
        count, cells, channels = len(self._skins), shape[:2], shape[2]
        self._raw, self._earlier, self._rest = (np.zeros((count, *shape)) for _ in range(3))
        self._power, self._span = np.ones((count, channels)), np.zeros((count, 2, channels))
        self._before, self._period, self._span_at = (np.zeros(count) for _ in range(3))
        self._low, self._high = (np.full((count, 1, 1, channels), end) for end in (-np.inf, np.inf))
        self._frames = np.zeros(count, dtype=np.int64)
        self._since: Floats = np.zeros((count, *cells))
        self._changes, self._seen = (np.zeros((count, *cells), np.int64) for _ in range(2))

    @property
    def _kept(self) -> dict[str, NDArray[Any]]:
        return {
            "raw": self._raw, "earlier": self._earlier, "rest": self._rest,
            "power": self._power, "span": self._span, "before": self._before,
            "period": self._period, "span_at": self._span_at, "low": self._low,
            "high": self._high, "frames": self._frames, "since": self._since,
            "changes": self._changes, "seen": self._seen,
        }  # fmt: skip

    def _take(self, lane: int) -> None:
        """Take what the skin's own objects keep, if the last frame was in order."""
        drops, lives = (part.calm() for part in self._skins[lane])
        if drops is None or lives is None or not np.array_equal(drops["raw"], lives["raw"]):
            return
        kept = self._kept
        for name, value in (drops | lives).items():
            kept[name][lane] = value
        self._here[lane] = True
        self._limited = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())
        self.flags.take(lane)

    def settle(self, lane: int) -> None:
        """Give what is kept of a skin back to its own objects."""
        if not self._here[lane]:
            return
        self._catch_up()
        self._here[lane] = self._all_here = False
        self.flags.settle(lane)
        for part in self._skins[lane]:
            part.went_on({name: kept[lane].copy() for name, kept in self._kept.items()})


def _squares(steps: Floats) -> Floats:
    """Return the sums of squares over all taxels, (frames, channels)."""
    flat = steps.reshape(len(steps), -1, steps.shape[3])
    return np.asarray(np.einsum("nij,nij->nj", flat, flat))
