"""Moments of a scene for Foxglove, served or to a file: the one user of its library."""

import json
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import SceneError, missing_extra
from cnnum.live.sink import REACH, Sink
from cnnum.safety.files import written

if TYPE_CHECKING:
    from cnnum.scenes.events import Event
    from cnnum.scenes.frame_path import FrameResult
    from cnnum.scenes.pipeline import Scene

LOAD = {
    "type": "object",
    "title": "cnnum.Load",
    "properties": {"load": {"type": "number", "description": "sum of the normal loads"}},
}
"""Schema of the messages of the whole load for Foxglove, whose plots take any number."""

THINNEST = 0.01
"""Shortest arrow that is drawn, as a part of the strongest so far."""


class FoxgloveSink(Sink):
    """Logs the normal load as a grid, shear as arrows on it, the whole load, and events.

    Row 0 is at the top, a taxel has a side of 1, and the topics have Foxglove's own schemas, so
    that its panels show them.

    Parameters
    ----------
    scene : Scene
    target : str
        A file that ends in .mcap, or the address at which Foxglove finds a server, such as
        "ws://127.0.0.1:8765".
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    SceneError
        If the target is neither, or cannot be written, or no server can begin there.
    MissingExtraError
        If the library is not installed.
    """

    def __init__(self, scene: "Scene", target: str, *, force: bool = False) -> None:
        served, place = target.startswith("ws://"), None
        with suppress(ValueError):  # a port that is no number, half a bracket
            address = urlsplit(target)
            if served and address.hostname:
                place = address.hostname, 8765 if address.port is None else address.port
        if place is None and (served or not target.endswith(".mcap")):
            raise SceneError(
                "'--foxglove' takes a file that ends in .mcap, or an address to serve at such as "
                f"ws://127.0.0.1:8765, got '{target:.80}'."
            )
        try:
            self._foxglove: Any = import_module("foxglove")
            self._messages: Any = import_module("foxglove.messages")
            channels: Any = import_module("foxglove.channels")
        except ImportError:
            raise missing_extra("Foxglove", "foxglove-sdk", "foxglove") from None
        super().__init__(scene)
        self._now = 0
        # what it serves ends with it: it is kept
        self._context = context = self._foxglove.Context()
        if place is None:
            file = self._closing.enter_context(written(Path(target), error=SceneError, force=force))
            self._closing.callback(self._foxglove.open_mcap(file, context=context).close)
        else:
            host, port = place
            how = {"name": self._name, "host": host, "port": port, "context": context}
            try:
                server: Any = self._foxglove.start_server(**how)
            except (OSError, RuntimeError) as error:
                raise SceneError(
                    f"No server can begin at '{target:.80}': {error}; choose another port."
                ) from None
            self._closing.callback(server.stop)
        self._grid = channels.GridChannel("/array/normal", context=context)
        self._scene = channels.SceneUpdateChannel("/array/shear", context=context)
        self._log = channels.LogChannel("/events", context=context)
        self._load = self._foxglove.Channel("/load", schema=LOAD, context=context)

    def _begin(self, moment: "FrameResult") -> None:
        self._now = max(0, round(1e9 * moment.frame.time))

    def _stamp(self) -> Any:
        return self._messages.Timestamp(*divmod(self._now, 10**9))

    def _event(self, event: "Event") -> None:
        log = self._messages.Log(
            timestamp=self._stamp(),
            level=self._messages.LogLevel.Info,
            message=json.dumps(event.record()),
            name=event.kind,
        )
        self._log.log(log, log_time=self._now)

    def _picture(self, loads: Floats) -> None:
        own, (rows, cols) = self._messages, loads.shape[1:]
        normal = np.abs(loads[2]).astype("<f4")
        field = own.PackedElementField(
            name="normal", offset=0, type=own.PackedElementFieldNumericType.Float32
        )
        grid = own.Grid(
            timestamp=self._stamp(),
            frame_id="array",
            pose=_pose(own, 0.0, 0.0, 0.0, 0.0),
            column_count=cols,
            cell_size=own.Vector2(x=1.0, y=1.0),
            row_stride=4 * cols,
            cell_stride=4,
            fields=[field],
            data=normal[::-1].tobytes(),  # its rows go up
        )
        self._grid.log(grid, log_time=self._now)
        entity = own.SceneEntity(
            timestamp=self._stamp(),
            frame_id="array",
            id="shear",
            arrows=[
                own.ArrowPrimitive(
                    pose=_pose(own, x, rows - y, 0.05, np.arctan2(-dy, dx)),
                    shaft_length=0.7 * length,
                    shaft_diameter=0.06,
                    head_length=0.3 * length,
                    head_diameter=0.14,
                    color=own.Color(r=0.1, g=0.3, b=0.9, a=1.0),
                )
                for (x, y), (dx, dy) in zip(*self._arrows(loads), strict=True)
                if (length := float(np.hypot(dx, dy))) > THINNEST * REACH
            ],
        )
        self._scene.log(own.SceneUpdate(entities=[entity]), log_time=self._now)
        self._load.log({"load": float(normal.sum())}, log_time=self._now)


def _pose(messages: Any, x: float, y: float, z: float, turn: float) -> Any:
    """Return a place, and a turn about z from x, rad."""
    return messages.Pose(
        position=messages.Vector3(x=float(x), y=float(y), z=z),
        orientation=messages.Quaternion(
            x=0.0, y=0.0, z=float(np.sin(turn / 2)), w=float(np.cos(turn / 2))
        ),
    )
