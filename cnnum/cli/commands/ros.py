"""`cnnum ros`: a node of ROS 2 that publishes the frames and events of a scene."""

import click

from cnnum.cli.following import follow
from cnnum.cli.options import (
    Changes,
    completed,
    frames_option,
    json_option,
    scene_options,
    trust_option,
)
from cnnum.cli.output import COMPILING, Output, busy


@click.command("ros")
@click.argument("scene", shell_complete=completed("scene", files=True))
@click.option("--name", default="cnnum", show_default=True, help="Name of the node.")
@click.option(
    "--speed",
    type=click.FloatRange(min=0.0, min_open=True),
    default=1.0,
    help="Pace of a recorded or simulated array: 1 is real time.",
)
@scene_options
@trust_option
@frames_option
@json_option
def command(
    scene: str,
    name: str,
    speed: float,
    changes: Changes,
    frames: int | None,
    trust: bool,
    as_json: bool,
) -> int:
    """Run SCENE and publish its frames and events in ROS 2.

    NAME/taxels is a sensor_msgs/msg/Image with one float of 64 bits per axis of a taxel, and
    NAME/events a std_msgs/msg/String with the JSON of 'cnnum run --json'. This requires 'rclpy',
    which comes with ROS 2.
    """
    with busy(COMPILING, as_json=as_json):
        from cnnum.drivers.timing import Paced
        from cnnum.live.ros_sink import RosSink
        from cnnum.scenes.pipeline import load_scene

        loaded = load_scene(scene, changes=changes, trust=trust)
        if not getattr(loaded.driver, "live", False):
            loaded.driver = Paced(loaded.driver, speed, None, None)
    with RosSink(loaded, name) as sink:
        return follow(loaded, Output(as_json), frames=frames, watch=sink.add)
