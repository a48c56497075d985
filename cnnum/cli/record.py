"""`cnnum record`: an array's frames to a file."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import assignments, json_option
from cnnum.cli.output import Output, quantity
from cnnum.cli.progress import progress
from cnnum.cli.signals import stoppable, undisturbed
from cnnum.cli.source import limited, open_source
from cnnum.errors import RecordingError

if TYPE_CHECKING:
    from cnnum.cli.recorders import Recorder
    from cnnum.drivers.driver import Driver


@click.command("record")
@click.argument("source")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="An option of the driver."
)
@click.option("--seconds", type=click.FloatRange(min=0, min_open=True), help="Stop after so long.")
@click.option("--frames", type=click.IntRange(min=1), help="Stop after so many frames.")
@click.option("--force", is_flag=True, help="Replace FILE if it is there.")
@json_option
def command(
    source: str,
    file: Path,
    settings: tuple[str, ...],
    seconds: float | None,
    frames: int | None,
    force: bool,
    as_json: bool,
) -> int:
    """Record the frames of the array SOURCE (a driver's name, or a scene) to FILE.

    FILE ends in .npz (for `cnnum replay`; the array's calibration goes along) or .csv (for
    other programs). It appears when the recording ends: by itself, by Ctrl-C, or because the
    array went away; what came until then is in it.
    """
    from cnnum.cli.recorders import open_recorder

    if file.exists() and not force:
        raise RecordingError(f"'{file}' is there already: choose another name, or give --force.")
    with open_source(source, assignments(settings)) as driver:
        recorder = open_recorder(file)
        count, stopped = 0, True
        try:
            with suppress(KeyboardInterrupt), stoppable() as stop:
                with progress("frames", frames, as_json=as_json) as steps:
                    for frame in limited(driver, seconds, frames):
                        with stop.shield():  # half a frame would spoil the file
                            recorder.add(frame)
                            count += 1
                        steps.advance()
                stopped = False
        finally:
            _end(recorder, driver, count)
            if count:  # also where the array went away: what is in the file is told
                _report(Output(as_json), file, driver, count)
        if not count:
            raise RecordingError(f"Nothing was recorded to '{file}': no frame came.")
    return 130 if stopped else 0


def _end(recorder: "Recorder", driver: "Driver", count: int) -> None:
    with undisturbed():
        try:
            if count:
                recorder.finish(driver)
        finally:
            recorder.discard()


def _report(output: Output, file: Path, driver: "Driver", count: int) -> None:
    counters, size = driver.counters, file.stat().st_size
    output.record(
        {
            "kind": "recording",
            "file": str(file),
            "frames": count,
            "bad_frames": counters.bad,
            "dropped": counters.dropped,
            "repeated": counters.repeated,
            "gaps": counters.gaps,
            "bytes": size,
        },
        f"{count} frames in '{file}' ({quantity(size, 'B')}); {counters.bad} bad, "
        f"{counters.dropped} dropped, {counters.repeated} repeated",
    )
