"""Skins of one plan, frame by frame: what no skin shares, and one launch for all of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cnnum.errors import CnnumError
from cnnum.frame import Frame
from cnnum.scenes.frame_path import FramePath, FrameResult, Ready
from cnnum.scenes.pipeline import Passage
from cnnum.stream import Abreast


class PathsAbreast:
    """The paths of frames of several skins, which share launches.

    Parameters
    ----------
    passages : sequence of Passage
        Of scenes whose plans are equal.

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
            As of a scene; frames of the others are lost then.
        """
        results: dict[int, FrameResult] = {}
        ready: dict[int, Ready] = {}
        for lane, number, frame in zip(lanes, numbers, frames, strict=True):
            self._passages[lane].begin(number, frame)
            moment = self.paths[lane].prepare(number, frame)
            if isinstance(moment, Ready):
                ready[lane] = moment
            else:
                results[lane] = moment
        running = list(ready)
        if running:
            values = np.stack([ready[lane].values for lane in running])
            sizes = [ready[lane].size for lane in running]
            for lane, outputs in zip(
                running, self._streams.push(running, values, sizes), strict=True
            ):
                path, moment = self.paths[lane], ready[lane]
                results[lane] = (
                    path.refused(moment, outputs)
                    if isinstance(outputs, CnnumError)
                    else path.finish(moment, outputs)
                )
        return [self._passages[lane].end(results[lane]) for lane in lanes]
