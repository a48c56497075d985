"""`cnnum replay`: a scene's program over a recording."""

from pathlib import Path

import click

from cnnum.cli import following
from cnnum.cli.following import follow
from cnnum.cli.options import (
    Changes,
    force_option,
    frames_option,
    json_option,
    scene_options,
    trust_option,
)
from cnnum.cli.output import COMPILING, Output, busy

RAW = ("count", "V")
"""Units of arrays that nothing is known of: no scene fits all of them."""

DEFAULT = "demo"


@click.command("replay")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--scene",
    help="Scene file or name; required for raw counts, otherwise 'demo' by default.",
)
@click.option(
    "--topic", default="", help="Topic of an MCAP file or a bag that cnnum did not write."
)
@scene_options
@trust_option
@following.save_option
@following.film_option
@following.rerun_option
@frames_option
@click.option(
    "--speed",
    type=click.FloatRange(min=0.0),
    default=0.0,
    help="Pace: 1 is real time, 2 twice as fast; by default as fast as possible.",
)
@click.option(
    "--from",
    "begin",
    type=click.FloatRange(min=0.0),
    help="Report from this time on (s); earlier frames are processed without output.",
)
@click.option("--to", "end", type=click.FloatRange(min=0.0), help="Stop at this time (s).")
@force_option
@json_option
def command(
    file: Path,
    scene: str | None,
    topic: str,
    changes: Changes,
    save: Path | None,
    film: Path | None,
    rerun: str | None,
    frames: int | None,
    speed: float,
    begin: float | None,
    end: float | None,
    trust: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Run the program of a scene over the recording FILE.

    FILE is a recording of `cnnum record`, another file with a layout (see `cnnum layout`), or the
    folder of a uSkin trial. It replaces the array of the scene; program and events stay.

    With --from, earlier frames are processed without being reported, so that rest, tare and
    memories, and therefore forces and events, are the same as in a whole replay.
    """
    following.refuse_unknown(save)
    if begin is not None and end is not None and end < begin:
        raise click.UsageError(f"'--to {end:g}' lies before '--from {begin:g}'.")
    with busy(COMPILING, as_json=as_json):
        from cnnum.drivers.recording_file import array_of
        from cnnum.scenes.pipeline import load_scene

        array = array_of(file, topic)
        if scene is None:
            scene = _usual_scene(file, array, changes)
        loaded = load_scene(scene, changes={"array": array} | changes, trust=trust)
        if speed or begin is not None or end is not None:
            from cnnum.drivers.timing import Paced

            loaded.driver = Paced(loaded.driver, speed, begin, end, keeps_before=True)
    saver = following.saved(save, loaded, force=force)
    filmed = following.filmed(film, loaded, force=force)
    with following.to_rerun(loaded, rerun, force=force) as send:
        watch = following.watching(saver.add, filmed.add, send)
        return follow(
            loaded,
            Output(as_json),
            frames=frames,
            begin=begin or 0.0,
            watch=watch,
            keep=following.kept(saver.write, filmed.write),
        )


def _usual_scene(file: Path, array: dict[str, object], given: dict[str, object]) -> str:
    """Return the scene that fits calibrated recordings; counts fit none without being asked."""
    from cnnum.drivers.registry import open_driver

    options = {key.removeprefix("array."): v for key, v in given.items() if key[:6] == "array."}
    options = {key: value for key, value in (array | options).items() if key != "driver"}
    with open_driver(str(array["driver"]), options) as driver:
        raw = driver.unit in RAW and getattr(driver, "calibration", None) is None
        unit = driver.unit
    if raw:
        raise click.UsageError(
            f"'{file}' contains values in '{unit}', whose physical scale is unknown: choose a "
            "scene for them, as in '--scene uskin_grasp', or write a scene file of your own."
        )
    return DEFAULT
