"""`cnnum record`: an array's frames to a file."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import (
    assignments,
    completed,
    frames_option,
    json_option,
    seconds_option,
    setting_option,
    trust_option,
)
from cnnum.cli.output import Output, quantity
from cnnum.cli.progress import progress
from cnnum.cli.signals import stoppable, undisturbed
from cnnum.cli.source import limited, open_source
from cnnum.errors import RecordingError

if TYPE_CHECKING:
    from cnnum.cli.commands.recorders import Outcome
    from cnnum.drivers.driver import Driver


@click.command("record")
@click.argument("source", shell_complete=completed("scene", files=True))
@click.argument("file", type=click.Path(path_type=Path))
@setting_option("An option of the driver.")
@seconds_option
@frames_option
@click.option("--force", is_flag=True, help="Replace FILE if it is there.")
@click.option("--raw/--no-raw", default=True, help="Keep the port's bytes, too (.mcap only).")
@trust_option
@json_option
def command(
    source: str,
    file: Path,
    settings: tuple[str, ...],
    seconds: float | None,
    frames: int | None,
    force: bool,
    raw: bool,
    trust: bool,
    as_json: bool,
) -> int:
    """Record the frames of the array SOURCE (a driver's name, or a scene) to FILE.

    FILE ends in .mcap (also for Foxglove), .npz (NumPy), .h5 (HDF5) or .csv. Frames are on the disk
    within a second; `cnnum recover` makes a whole file of one that was cut off. It ends by itself,
    by Ctrl-C, or because the array went away.
    """
    from cnnum.cli.commands.recorders import Recorder
    from cnnum.cli.source import scene_text
    from cnnum.recordings.export import suffix_of

    suffix_of(file)  # before the array is opened
    with open_source(source, assignments(settings), trust=trust) as driver:
        scene, stopped = scene_text(source), True
        recorder = Recorder(file, driver, force=force, scene=scene, raw=raw)
        try:
            with suppress(KeyboardInterrupt), stoppable() as stop:
                with progress("frames", frames, as_json=as_json) as steps:
                    for frame in limited(driver, seconds, frames):
                        with stop.shield():  # half a frame would spoil the file
                            recorder.add(frame)
                        steps.advance()
                stopped = False
        finally:
            with undisturbed():
                outcome = recorder.finish()
            if outcome.frames:  # also where the array went away: the kept frames are counted
                _report(Output(as_json), outcome, driver)
            if outcome.problem:
                raise RecordingError(outcome.problem)
        if not outcome.frames:
            raise RecordingError(f"Nothing was recorded to '{file}': no frame came.")
    return 130 if stopped else 0


def _report(output: Output, outcome: "Outcome", driver: "Driver") -> None:
    counters, size = driver.counters, outcome.file.stat().st_size
    output.record(
        {
            "kind": "recording",
            "file": str(outcome.file),
            "frames": outcome.frames,
            "lost": outcome.lost,
            "bad_frames": counters.bad,
            "dropped": counters.dropped,
            "repeated": counters.repeated,
            "gaps": counters.gaps,
            "bytes": size,
        },
        f"{outcome.frames} frames in '{outcome.file}' ({quantity(size, 'B')}); {counters.bad} bad, "
        f"{counters.dropped} dropped, {counters.repeated} repeated",
    )
