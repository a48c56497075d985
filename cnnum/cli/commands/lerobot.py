"""`cnnum lerobot`: recordings as episodes of a LeRobot data set."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from cnnum.cli.options import completed, json_option, trust_option
from cnnum.cli.output import Output, progress

if TYPE_CHECKING:
    from cnnum.recordings.recording import Recording

Given = TypeVar("Given", str, Path)


@click.command("lerobot")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--fps", type=float, default=30.0, help="Pictures per second (30).")
@click.option(
    "--task",
    "tasks",
    multiple=True,
    help="Task in words; given once for all recordings, or once for each.",
)
@click.option("--robot", default="unknown", help="Type of the robot.")
@click.option(
    "--table",
    "tables",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE.csv",
    help="States and actions of a recording, with columns such as action.grip; once for each.",
)
@click.option(
    "--scene",
    shell_complete=completed("scene", files=True),
    help="Scene to run over each recording, whose events become a feature.",
)
@click.option("--append", is_flag=True, help="Append to the data set that is in FOLDER.")
@trust_option
@json_option
def command(
    files: tuple[Path, ...],
    folder: Path,
    fps: float,
    tasks: tuple[str, ...],
    robot: str,
    tables: tuple[Path, ...],
    scene: str | None,
    append: bool,
    trust: bool,
    as_json: bool,
) -> int:
    """Write recordings to FOLDER as the episodes of a LeRobot data set, layout 3.0.

    FILES are recordings, or folders of them. A row belongs to one camera picture and contains the
    taxel frames since the previous one. Each episode can be read as a recording, as in
    FOLDER/episode-000000. This requires pyarrow.
    """
    from cnnum.drivers.recording_file import load_recording
    from cnnum.recordings.lerobot import Episode, read_states, write_lerobot
    from cnnum.scenes.processing import sources_of

    sources = sources_of(files)
    named = _for_each("--task", tasks or ("touch",), len(sources), once=True)
    stated = _for_each("--table", tables, len(sources)) if tables else ()
    episodes, frames = list[Episode](), 0
    with progress("recordings", len(sources), as_json=as_json) as steps:
        for number, source in enumerate(sources):
            recording = load_recording(source)
            frames += len(recording)
            states = read_states(stated[number]) if stated else {}
            events = _events(recording, scene, trust=trust)
            episodes.append(Episode(recording, named[number], states, events))
            steps.advance()
    rows = write_lerobot(episodes, folder, fps, robot=robot, append=append)
    record = {"folder": str(folder), "episodes": len(episodes), "rows": rows, "frames": frames}
    Output(as_json).record(
        {"kind": "lerobot"} | record,
        f"{len(episodes)} episodes, {rows} rows of {frames} taxel frames in '{folder}'",
    )
    return 0


def _for_each(
    option: str, given: tuple[Given, ...], count: int, *, once: bool = False
) -> tuple[Given, ...]:
    if once and len(given) == 1:
        return given * count
    if len(given) != count:
        raise click.UsageError(
            f"{option} is given {len(given)} times for {count} recordings: give it once for each."
        )
    return given


def _events(recording: "Recording", scene: str | None, *, trust: bool) -> Mapping[str, list[float]]:
    """Return the times of the events of each kind, s after the first frame; none of no scene."""
    if scene is None:
        return {}
    from cnnum.scenes.pipeline import load_scene

    opened = load_scene(scene, recording=recording, trust=trust)
    kinds = [rule.kind for rule in opened.rules]
    ends = [rule.ends for rule in opened.rules if rule.ends]
    times: dict[str, list[float]] = {kind: [] for kind in (*kinds, *ends)}
    begin = float(recording.times[0])
    for event in opened.events():
        times.setdefault(event.kind, []).append(event.time - begin)
    return times
