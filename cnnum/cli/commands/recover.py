"""`cnnum recover`: a whole recording from the remains of one."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import json_option
from cnnum.cli.output import Output, quantity
from cnnum.errors import CnnumError, RecordingError

if TYPE_CHECKING:
    from cnnum.recordings.reader import Contents


@click.command("recover")
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path), required=False)
@click.option("--force", is_flag=True, help="Replace OUT if it exists.")
@click.option(
    "--budget",
    type=click.FloatRange(min=0.0, min_open=True),
    default=1.0,
    help="Factor by which the usual limits of time, bytes and frames are raised.",
)
@click.option("--topic", default="", help="Topic of a bag, or of an MCAP file from other software.")
@json_option
def command(
    file: Path, out: Path | None, force: bool, budget: float, topic: str, as_json: bool
) -> int:
    """Write all intact chunks of FILE to a complete recording OUT.

    FILE is a truncated or damaged .mcap file, written by `cnnum record` or, with a layout, by other
    software. A bag with a layout also becomes a recording. FILE is not changed. OUT ends in .mcap,
    .npz, .h5 or .csv; by default, it is FILE with the suffix `.recovered.mcap`.
    """
    from cnnum.drivers.recording_file import is_of_others
    from cnnum.recordings.export import export, suffix_of
    from cnnum.recordings.reader import look
    from cnnum.safety.files import beside, refuse_target

    if not file.name:  # "." or "/"
        raise RecordingError(f"'{file}' is a folder, expected a recording.")
    target = beside(file.with_suffix(""), ".recovered.mcap") if out is None else out
    suffix_of(target)
    if target.exists() and file.exists() and target.samefile(file):
        raise RecordingError(f"'{file}' is not replaced: choose another name for OUT.")
    refuse_target(target, error=RecordingError, force=force)
    if topic or is_of_others(file):
        _report(Output(as_json), target, _of_others(file, target, topic, force=force))
        return 0
    _refuse_whole(file)
    contents = look(file, budget)
    export(contents, target, force=force)
    _report(Output(as_json), target, contents)
    return 0


def _refuse_whole(file: Path) -> None:
    """Raise an error for a recording in another format than MCAP that is readable as it is."""
    from cnnum.drivers.recording_file import load_recording

    if file.suffix.lower() == ".mcap" or not file.is_file():
        return
    try:
        held = load_recording(file)
    except CnnumError:
        return  # the remains of a recording under another name
    raise RecordingError(
        f"'{file}' needs no recovery: its {len(held)} frames can be read as they are by every "
        "command and by cnnum.load_recording; Recording.save converts them to another format."
    )


@dataclass(frozen=True, slots=True)
class _Found:
    """What a file of others holds, in the words of `cnnum.recordings.reader.Contents`."""

    path: Path
    frames: int
    gaps: int
    missing: int
    holes: int
    unreadable: int

    @property
    def whole(self) -> bool:
        return not self.unreadable


def _of_others(file: Path, target: Path, topic: str, *, force: bool) -> _Found:
    """Write the frames of an MCAP file or a bag of others."""
    import numpy as np

    from cnnum.drivers.recording_file import load_recording
    from cnnum.recordings.message_topics import holes_in, unreadable_bytes

    held = load_recording(file, topic=topic)
    held.save(target, force=force)
    steps = np.diff(held.sequence)
    holes = holes_in(file)
    missing = int((steps[steps > 1] - 1).sum())
    gaps = int((steps > 1).sum())
    return _Found(file, len(held), gaps, missing, len(holes), unreadable_bytes(holes))


def _report(output: Output, target: Path, contents: "Contents | _Found") -> None:
    size = target.stat().st_size
    gaps = f"{contents.gaps} gaps in their numbers"
    if contents.missing:
        gaps += f" with {contents.missing} scans missing"
    output.record(
        {
            "kind": "recovery",
            "file": str(target),
            "frames": contents.frames,
            "unreadable_bytes": contents.unreadable,
            "damaged_places": contents.holes,
            "gaps": contents.gaps,
            "missing": contents.missing,
            "whole": contents.whole,
            "bytes": size,
        },
        f"{contents.frames} frames in '{target}' ({quantity(size, 'B')}), {gaps}; "
        f"{contents.unreadable} bytes in {contents.holes} places of '{contents.path}' are not "
        "readable",
    )
