"""Moments of a scene for Rerun, to a file or to a viewer that runs: the one user of its library."""

import json
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import SceneError, missing_extra
from cnnum.live.hub import Read, planes
from cnnum.safety.files import written_by_name

if TYPE_CHECKING:
    from cnnum.frame import Frame
    from cnnum.scenes.frame_path import FrameResult
    from cnnum.scenes.pipeline import Scene

PICTURES = 60.0
"""Pictures a second of the frames' time, at most; events are all logged."""

REACH = 0.46
"""Length of the strongest arrow so far, in taxels."""


class RerunSink:
    """Logs the normal load as a depth image, shear as arrows, the whole load, and events.

    Parameters
    ----------
    scene : Scene
    target : str
        A file that ends in .rrd, or the address of a viewer ("rerun+http://127.0.0.1:9876/proxy").
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    SceneError
        If the target is neither, or cannot be written.
    MissingExtraError
        If the library is not installed.
    """

    def __init__(self, scene: "Scene", target: str, *, force: bool = False) -> None:
        if not (target.endswith(".rrd") or "://" in target):
            raise SceneError(
                f"'--rerun' takes a file that ends in .rrd, or a viewer's address such as "
                f"rerun+http://127.0.0.1:9876/proxy, got '{target:.80}'."
            )
        try:
            self._rerun: Any = import_module("rerun")
        except ImportError:
            raise missing_extra("Rerun", "rerun-sdk", "rerun") from None
        conversion = scene.conversion
        self._channels = conversion.channels
        self._read: Read = conversion.reader(conversion.channels, checks=False)
        self._due, self._strongest = -np.inf, 0.0
        self._stream = self._rerun.RecordingStream(f"cnnum {scene.spec.name}")
        self._open_files = ExitStack()
        self._open(target, force=force)

    def _open(self, target: str, *, force: bool) -> None:
        if "://" in target:
            self._stream.connect_grpc(target)
            return
        path = Path(target)
        draft = self._open_files.enter_context(written_by_name(path, error=SceneError, force=force))
        try:
            self._stream.save(draft)
        except (OSError, RuntimeError) as error:
            self._open_files.close()
            raise SceneError(
                f"'{target}' cannot be written: {error}; choose a folder that exists."
            ) from None

    def add(self, moment: "FrameResult") -> None:
        """Log a moment."""
        frame, stream = moment.frame, self._stream
        stream.set_time("time", duration=frame.time)
        stream.set_time("frame", sequence=moment.number)
        for event in moment.events:
            stream.log("events", self._rerun.TextLog(json.dumps(event.record())))
        if frame.time >= self._due or frame.time < self._due - 1.0:  # a recording may begin anew
            self._due = frame.time + 1.0 / PICTURES
            self._picture(frame)

    def _picture(self, frame: "Frame") -> None:
        rerun, loads = self._rerun, planes(self._read(frame), self._channels)
        normal = np.abs(loads[2])
        origins, vectors = self._arrows(loads)
        self._stream.log("array/normal", rerun.DepthImage(normal.astype(np.float32)))
        self._stream.log("array/shear", rerun.Arrows2D(origins=origins, vectors=vectors))
        self._stream.log("load", rerun.Scalars(float(normal.sum())))

    def _arrows(self, loads: Floats) -> tuple[Floats, Floats]:
        """Return the places and the arrows of all taxels, (taxels, 2) each, in taxels."""
        rows, cols = loads.shape[1:]
        y, x = np.mgrid[:rows, :cols] + 0.5
        self._strongest = max(self._strongest, float(np.hypot(loads[0], loads[1]).max()))
        vectors = REACH * loads[:2] / (self._strongest or 1.0)
        return np.stack([x, y], -1).reshape(-1, 2), np.moveaxis(vectors, 0, -1).reshape(-1, 2)

    def close(self) -> None:
        """Write the rest, and put the file in its place.

        Raises
        ------
        SceneError
            If it cannot be put there.
        """
        self._stream.disconnect()
        self._open_files.close()

    def __enter__(self) -> Self:
        """Return the sink itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Write the rest."""
        self.close()
