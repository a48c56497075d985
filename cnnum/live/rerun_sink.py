"""Moments of a scene for Rerun, to a file or to a viewer that runs: the one user of its library."""

import json
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import SceneError, missing_extra
from cnnum.live.sink import Sink
from cnnum.safety.files import written_by_name

if TYPE_CHECKING:
    from cnnum.scenes.events import Event
    from cnnum.scenes.frame_path import FrameResult
    from cnnum.scenes.pipeline import Scene


class RerunSink(Sink):
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
        super().__init__(scene)
        self._stream = self._rerun.RecordingStream(self._name)
        self._open(target, force=force)
        self._closing.callback(self._stream.disconnect)  # before its file is put in its place

    def _open(self, target: str, *, force: bool) -> None:
        if "://" in target:
            self._stream.connect_grpc(target)
            return
        path = Path(target)
        draft = self._closing.enter_context(written_by_name(path, error=SceneError, force=force))
        try:
            self._stream.save(draft)
        except (OSError, RuntimeError) as error:
            self._closing.close()
            raise SceneError(
                f"'{target}' cannot be written: {error}; choose a folder that exists."
            ) from None

    def _begin(self, moment: "FrameResult") -> None:
        self._stream.set_time("time", duration=moment.frame.time)
        self._stream.set_time("frame", sequence=moment.number)

    def _event(self, event: "Event") -> None:
        self._stream.log("events", self._rerun.TextLog(json.dumps(event.record())))

    def _picture(self, loads: Floats) -> None:
        rerun, normal = self._rerun, np.abs(loads[2])
        origins, vectors = self._arrows(loads)
        self._stream.log("array/normal", rerun.DepthImage(normal.astype(np.float32)))
        self._stream.log("array/shear", rerun.Arrows2D(origins=origins, vectors=vectors))
        self._stream.log("load", rerun.Scalars(float(normal.sum())))
