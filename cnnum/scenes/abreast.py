"""Skins with a common plan: ordinary frames are checked together and share a launch."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import CnnumError
from cnnum.frame import Frame
from cnnum.scenes.conversion import ReadersAbreast
from cnnum.scenes.dropouts import (
    FINE,
    FOLLOWS,
    JUMP,
    SHOWN,
    SILENT,
    TINY,
    Dropouts,
    Liveness,
)
from cnnum.scenes.frame_path import FramePath, FrameResult, Ready
from cnnum.scenes.pipeline import Passage
from cnnum.scenes.saturation import Mask
from cnnum.stream import Abreast


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
        watched = [
            (path.dropouts, path.liveness)
            for path in self.paths
            if path.dropouts is not None and path.liveness is not None
        ]
        simple = all(path.dead is None and path.grid is None for path in self.paths)
        able = simple and len(watched) == len(self.paths) > 1
        self._calm = Calm(watched) if able else None
        self._readers = ReadersAbreast([path.read for path in self.paths])
        self._limits = np.array([path.range.limit for path in self.paths])
        self._ends = np.array(
            [np.inf if path.saturation is None else path.saturation.limit for path in self.paths]
        )

    def warm_up(self) -> None:
        """Build the kernels of single frames, and of shared launches."""
        self._streams.warm_up()

    def step(
        self, lanes: Sequence[int], numbers: Sequence[int], frames: Sequence[Frame]
    ) -> list[FrameResult]:
        """Return the results of the next frames of some skins.

        Parameters
        ----------
        lanes : sequence of int
            The skins, each once.
        numbers : sequence of int
            Numbers of the frames.
        frames : sequence of Frame

        Raises
        ------
        ArrayError, SceneError, MethodError
            As for a single scene; frames of the others are then lost.
        """
        for lane, number, frame in zip(lanes, numbers, frames, strict=True):
            if self._passages[lane].tares(number, frame):
                self._settle(lane)
                self._passages[lane].tare()
            self._passages[lane].hold_times(frame)
        ready = self._calmly(lanes, numbers, frames)
        results: dict[int, FrameResult] = {}
        for lane, number, frame in zip(lanes, numbers, frames, strict=True):
            if lane not in ready:
                self._settle(lane)
                moment = self.paths[lane].prepare(number, frame)
                if isinstance(moment, Ready):
                    ready[lane] = moment
                else:
                    results[lane] = moment
        running = list(ready)
        if running:
            values = np.stack([ready[lane].values for lane in running])
            sizes = [ready[lane].size for lane in running]
            answers = self._streams.push(running, values, sizes)
            for lane, outputs in zip(running, answers, strict=True):
                path, moment = self.paths[lane], ready[lane]
                if isinstance(outputs, CnnumError):
                    results[lane] = path.refused(moment, outputs)
                else:
                    results[lane] = path.finish(moment, outputs)
        return [self._passages[lane].end(results[lane]) for lane in lanes]

    def _settle(self, lane: int) -> None:
        if self._calm is not None:
            self._calm.settle(lane)

    def _calmly(
        self, lanes: Sequence[int], numbers: Sequence[int], frames: Sequence[Frame]
    ) -> dict[int, Ready]:
        """Return the inputs of the frames that are out of no order."""
        started = time.perf_counter()
        calm, shape = self._calm, self._streams.shape
        places = [
            place
            for place, (lane, frame) in enumerate(zip(lanes, frames, strict=True))
            if not frame.quality
            and frame.shape == shape
            and frame.values.shape == frames[0].values.shape
            and self.paths[lane].idle
        ]
        if calm is None or len(places) < 2:
            return {}
        taken = [frames[place] for place in places]
        at = np.array([lanes[place] for place in places], dtype=np.intp)
        values = np.stack([frame.values for frame in taken])
        times = np.array([frame.time for frame in taken])
        sizes: Floats = np.abs(values).max(axis=(1, 2, 3))
        within = (sizes <= self._limits[at]) & (sizes < self._ends[at])
        if not within.all():
            places, at, values = _kept(places, within), at[within], values[within]
            times, sizes = times[within], sizes[within]
        if not places:
            return {}
        ordinary = calm.look(at, values, times)
        if not ordinary.all():
            places, at = _kept(places, ordinary), at[ordinary]
            values, sizes = values[ordinary], sizes[ordinary]
        if not places:
            return {}
        read = self._readers(at, [frames[place] for place in places], values)
        if self.paths[0].marks:
            read = np.concatenate([read, np.zeros((*read.shape[:-1], 1))], axis=3)
        return {
            lanes[place]: Ready(numbers[place], frames[place], own, size, None, None, (), started)
            for place, own, size in zip(places, read, sizes.tolist(), strict=True)
        }


def _kept(places: Sequence[int], mask: NDArray[np.bool_]) -> list[int]:
    return [place for place, keep in zip(places, mask.tolist(), strict=True) if keep]


class Calm:
    """Frames of several skins in which no taxel is lost or silent, taken in together.

    What `Dropouts.look` and `Liveness.look` keep of such frames lies here in one array for all
    skins. A frame in which anything else may be goes through them, with `settle` before it.

    Parameters
    ----------
    skins : sequence of (Dropouts, Liveness)
        State of skins of one shape, all of whose taxels are checked.
    """

    def __init__(self, skins: Sequence[tuple[Dropouts, Liveness]]) -> None:
        self._skins, self._here = tuple(skins), np.zeros(len(skins), dtype=np.bool_)
        self._raw: Floats = np.zeros(0)

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
        for lane in lanes[~self._here[lanes]].tolist():
            self._take(lane)
        steps = values - self._raw[lanes]
        flat = steps.reshape(len(lanes), -1, values.shape[3])
        squares = np.einsum("nij,nij->nj", flat, flat)
        changed = (steps != 0.0).any(axis=3)
        since = np.where(changed, times[:, np.newaxis, np.newaxis], self._since[lanes])
        cells = values.reshape(len(lanes), -1)
        low, high = self._low[lanes], self._high[lanes]
        calm: Mask = self._here[lanes]
        calm &= (squares <= JUMP**2 * self._power[lanes]).all(axis=1)
        calm &= ((values >= low) & (values <= high)).all(axis=(1, 2, 3))
        calm &= (cells != cells[:, :1]).any(axis=1)
        calm &= times - since.min(axis=(1, 2)) < SILENT
        if calm.all():
            self._go_on(lanes, values, times, squares, changed, since)
        elif calm.any():
            squares, changed, since = squares[calm], changed[calm], since[calm]
            self._go_on(lanes[calm], values[calm], times[calm], squares, changed, since)
        return calm

    def _go_on(
        self,
        lanes: NDArray[np.intp],
        values: Floats,
        times: Floats,
        squares: Floats,
        changed: Mask,
        since: Floats,
    ) -> None:
        """Do what `Dropouts._goes_on` and `Liveness.look` do in such frames."""
        step, period = times - self._before[lanes], self._period[lanes]
        share = np.minimum(1.0, np.maximum(step, 0.0) / FOLLOWS)[:, np.newaxis]
        power, twice = self._power[lanes], 2.0 * changed[0].size
        self._power[lanes] = np.maximum(power + share * (squares / twice - power), TINY**2)
        follows = (step > 0.0) & (step < 2.0 * period)
        moved = period + np.minimum(1.0, step / FOLLOWS) * (step - period)
        self._period[lanes] = np.where(follows, moved, period)
        self._before[lanes] = times
        self._earlier[lanes] = self._raw[lanes]
        self._raw[lanes] = values
        self._frames[lanes] += 1
        self._since[lanes] = since
        self._changes[lanes] += changed
        frames = self._frames[lanes][:, np.newaxis, np.newaxis]
        self._seen[lanes] = np.where(changed, frames, self._seen[lanes])
        due = times - self._span_at[lanes] >= SHOWN
        if due.any():
            self._take_spans(lanes[due], values[due], times[due])

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
        self._low, self._high = (np.zeros((count, 1, 1, channels)) for _ in range(2))
        self._frames = np.zeros(count, dtype=np.int64)
        self._since: Floats = np.zeros((count, *cells))
        self._changes, self._seen = (np.zeros((count, *cells), np.int64) for _ in range(2))
        self._kept: dict[str, NDArray[Any]] = {
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
        for name, value in (drops | lives).items():
            self._kept[name][lane] = value
        self._here[lane] = True

    def settle(self, lane: int) -> None:
        """Give what is kept of a skin back to its own objects."""
        if not self._here[lane]:
            return
        self._here[lane] = False
        for part in self._skins[lane]:
            part.went_on({name: kept[lane].copy() for name, kept in self._kept.items()})
