"""Moments of a scene for programs of others."""

from contextlib import ExitStack
from typing import TYPE_CHECKING, Self

import numpy as np

from cnnum.arrays import Floats
from cnnum.live.hub import Read, planes

if TYPE_CHECKING:
    from cnnum.scenes.events import Event
    from cnnum.scenes.frame_path import FrameResult
    from cnnum.scenes.pipeline import Scene

PICTURES = 60.0
"""Pictures a second of the frames' time, at most; events are all sent."""

REACH = 0.46
"""Length of the strongest arrow so far, in taxels."""


class Sink:
    """Sends every event of a scene, and pictures of its loads as often as eyes can see.

    Parameters
    ----------
    scene : Scene
    """

    def __init__(self, scene: "Scene") -> None:
        conversion = scene.conversion
        self._channels = conversion.channels
        self._read: Read = conversion.reader(conversion.channels, checks=False)
        self._due, self._strongest = -np.inf, 0.0
        self._name = f"cnnum {scene.spec.name}"
        self._closing = ExitStack()

    def add(self, moment: "FrameResult") -> None:
        """Send a moment."""
        frame = moment.frame
        self._begin(moment)
        for event in moment.events:
            self._event(event)
        if frame.time >= self._due or frame.time < self._due - 1.0:  # a recording may begin anew
            self._due = frame.time + 1.0 / PICTURES
            self._picture(planes(self._read(frame), self._channels))

    def _begin(self, moment: "FrameResult") -> None:
        """Take in the time of a moment."""

    def _event(self, event: "Event") -> None:
        raise NotImplementedError

    def _picture(self, loads: Floats) -> None:
        """Send the loads, (3, rows, cols), as `planes` returns them."""
        raise NotImplementedError

    def _arrows(self, loads: Floats) -> tuple[Floats, Floats]:
        """Return the places and the arrows of all taxels, (taxels, 2) each, in taxels."""
        rows, cols = loads.shape[1:]
        y, x = np.mgrid[:rows, :cols] + 0.5
        self._strongest = max(self._strongest, float(np.hypot(loads[0], loads[1]).max()))
        vectors = REACH * loads[:2] / (self._strongest or 1.0)
        return np.stack([x, y], -1).reshape(-1, 2), np.moveaxis(vectors, 0, -1).reshape(-1, 2)

    def close(self) -> None:
        """Send the rest, and put a file in its place.

        Raises
        ------
        SceneError
            If it cannot be put there.
        """
        self._closing.close()

    def __enter__(self) -> Self:
        """Return the sink itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Send the rest."""
        self.close()
