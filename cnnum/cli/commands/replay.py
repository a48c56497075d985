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
    usual_scene,
)
from cnnum.cli.output import COMPILING, Output, busy


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
@following.foxglove_option
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
    foxglove: str | None,
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
            scene = usual_scene(file, array, changes, "demo")
        loaded = load_scene(scene, changes={"array": array} | changes, trust=trust)
        if speed or begin is not None or end is not None:
            from cnnum.drivers.timing import Paced

            loaded.driver = Paced(loaded.driver, speed, begin, end, keeps_before=True)
    saver = following.saved(save, loaded, force=force)
    filmed = following.filmed(film, loaded, force=force)
    with following.to_viewers(loaded, rerun=rerun, foxglove=foxglove, force=force) as send:
        watch = following.watching(saver.add, filmed.add, send)
        return follow(
            loaded,
            Output(as_json),
            frames=frames,
            begin=begin or 0.0,
            watch=watch,
            keep=following.kept(saver.write, filmed.write),
        )
