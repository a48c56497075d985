"""Skins with a common plan: ordinary frames are checked together and share a launch."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.errors import CnnumError
from cnnum.frame import Frame
from cnnum.scenes.conversion import ReadersAbreast
from cnnum.scenes.dropouts import Calm
from cnnum.scenes.frame_path import FramePath, FrameResult, Ready
from cnnum.scenes.pipeline import Passage
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
