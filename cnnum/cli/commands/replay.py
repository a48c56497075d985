"""`cnnum replay`: a scene's program over a recording."""

from pathlib import Path

import click

from cnnum.cli.following import follow
from cnnum.cli.options import engine_options, json_option, scene_changes, set_option
from cnnum.cli.output import Output
from cnnum.errors import RecordingError
from cnnum.safety.reading import names_something

FILES = {".mcap": "mcap", ".npz": "npz"}
"""Suffix of a recording to its driver."""


@click.command("replay")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--scene", default="demo", show_default=True, help="What to look for, and how.")
@set_option
@engine_options
@click.option("--frames", type=click.IntRange(min=1), help="Stop after so many frames.")
@json_option
def command(
    file: Path,
    scene: str,
    settings: tuple[str, ...],
    engine: str | None,
    device: str | None,
    precision: str | None,
    frames: int | None,
    as_json: bool,
) -> int:
    """Run a scene's program over the recording FILE, as fast as it goes.

    FILE is what `cnnum record` wrote (.mcap or .npz), or the folder of a uSkin trial. Only the
    array of the scene is replaced: its program and what it wants stay.
    """
    from cnnum.scenes.pipeline import load_scene

    changes = {"array": _array(file)} | scene_changes(settings, engine, device, precision)
    return follow(load_scene(scene, changes=changes), Output(as_json), frames=frames)


def _array(file: Path) -> dict[str, object]:
    """Return the table of a scene that reads this recording."""
    expected = "expected a .mcap or .npz file, or a folder."
    if not names_something(file):
        raise RecordingError(f"There is no recording '{file}': {expected}")
    # a relative path in a scene starts from the scene's folder, not from the working one
    path = str(file.absolute())
    if file.is_dir():
        return {"driver": "uskin-csv", "path": path}
    suffix = file.suffix.lower()
    if suffix not in FILES:
        raise RecordingError(f"'{file}' is no recording: {expected}")
    return {"driver": FILES[suffix], "path": path}
