"""Frames and events of a scene as messages of ROS 2: the one user of `rclpy`."""

import json
from array import array
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from cnnum.errors import SceneError
from cnnum.live.sink import Sink

if TYPE_CHECKING:
    from cnnum.scenes.frame_path import FrameResult
    from cnnum.scenes.pipeline import Scene

WAITING = 100
"""Messages that wait for a subscriber of ROS, at most."""


class RosSink(Sink):
    """Publishes frames and events as messages that every installation of ROS 2 has.

    `NAME/taxels` has the loads of a frame as a `sensor_msgs/msg/Image` with a number of 64 bits for
    each axis of a taxel ("64FC3"). `NAME/events` has an event as a `std_msgs/msg/String`: the JSON
    of `cnnum run --json`, with the "stamp" of its frame in ns. Stamps are the ROS time of the first
    frame, and what the clock of the frames has counted since.

    Parameters
    ----------
    scene : Scene
    name : str
        Of the node.

    Raises
    ------
    SceneError
        If ROS 2 is not there, or refuses the name.
    """

    def __init__(self, scene: "Scene", name: str) -> None:
        try:
            rclpy: Any = import_module("rclpy")
            image: Any = import_module("sensor_msgs.msg").Image
            text: Any = import_module("std_msgs.msg").String
        except ImportError:
            raise SceneError(
                "ROS 2 is not there: 'rclpy' comes with it, not from the package index. Run this "
                "with the Python of ROS 2, in a shell that has sourced its setup."
            ) from None
        super().__init__(scene)
        self._image, self._text = image, text
        self._since: tuple[int, float] | None = None
        context = rclpy.Context()
        try:
            rclpy.init(context=context)
            self._closing.callback(context.try_shutdown)
            self._node: Any = rclpy.create_node(name, context=context)
            self._closing.callback(self._node.destroy_node)
            self._taxels = self._node.create_publisher(image, f"{name}/taxels", WAITING)
            self._events = self._node.create_publisher(text, f"{name}/events", WAITING)
        except Exception as error:  # rclpy's own, for a name or settings that it does not take
            self._closing.close()
            raise SceneError(f"ROS 2 makes no node '{name:.80}': {error}") from None

    def add(self, moment: "FrameResult") -> None:
        """Publish a frame and its events."""
        frame = moment.frame
        if self._since is None:
            self._since = self._node.get_clock().now().nanoseconds, frame.time
        begin, first = self._since
        stamp = max(0, begin + round(1e9 * (frame.time - first)))
        values = np.asarray(self._read(frame), "<f8")
        rows, cols, axes = values.shape
        message = self._image(
            height=rows,
            width=cols,
            encoding=f"64FC{axes}",
            is_bigendian=0,
            step=8 * cols * axes,
            data=array("B", values.tobytes()),
        )
        message.header.frame_id = "array"
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        self._taxels.publish(message)
        for event in moment.events:
            self._events.publish(self._text(data=json.dumps(event.record() | {"stamp": stamp})))
