"""`cnnum lerobot`: a recording in the layout of LeRobot's data sets."""

from pathlib import Path

import click

from cnnum.cli.options import json_option
from cnnum.cli.output import Output


@click.command("lerobot")
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--fps", type=float, default=30.0, help="Pictures per second (30).")
@click.option("--task", default="touch", help="The task, in words.")
@click.option("--robot", default="unknown", help="Type of the robot.")
@json_option
def command(file: Path, folder: Path, fps: float, task: str, robot: str, as_json: bool) -> int:
    """Write the recording FILE to a new FOLDER in LeRobot's layout, version 2.1.

    Each row is the time of a picture and contains the taxel frames since the previous one. This
    requires pyarrow.
    """
    from cnnum.drivers.recording_file import load_recording
    from cnnum.recordings.lerobot import write_lerobot

    recording = load_recording(file)
    rows = write_lerobot(recording, folder, fps, task=task, robot=robot)
    Output(as_json).record(
        {"kind": "lerobot", "folder": str(folder), "rows": rows, "frames": len(recording)},
        f"{rows} rows of {len(recording)} taxel frames in '{folder}'",
    )
    return 0
