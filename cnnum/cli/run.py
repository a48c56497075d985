"""`cnnum run`: a scene, its events as they come, and a summary."""

import click

from cnnum.cli.following import follow
from cnnum.cli.options import engine_options, json_option, scene_changes, set_option
from cnnum.cli.output import Output


@click.command("run")
@click.argument("scene")
@set_option
@engine_options
@click.option("--frames", type=click.IntRange(min=1), help="Stop after so many frames.")
@json_option
def command(
    scene: str,
    settings: tuple[str, ...],
    engine: str | None,
    device: str | None,
    precision: str | None,
    frames: int | None,
    as_json: bool,
) -> int:
    """Run SCENE (a TOML file, or the name of a scene of the package) and print its events.

    Ctrl-C ends it with the summary of what was seen.
    """
    from cnnum.pipeline import load_scene

    changes = scene_changes(settings, engine, device, precision)
    return follow(load_scene(scene, changes=changes), Output(as_json), frames=frames)
