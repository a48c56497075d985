"""`cnnum demo`: the simulated scene, its events as they come, and a report of it."""

from pathlib import Path

import click

from cnnum.cli.following import follow
from cnnum.cli.options import engine_options, json_option, scene_changes, set_option
from cnnum.cli.output import Output


@click.command("demo")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("cnnum-demo.html"),
    show_default=True,
    help="Where the report goes.",
)
@set_option
@engine_options
@json_option
def command(
    out: Path,
    settings: tuple[str, ...],
    engine: str | None,
    device: str | None,
    precision: str | None,
    as_json: bool,
) -> int:
    """Run the scene that comes with the package, and write an HTML report of it.

    A sphere is pressed on a simulated 8×8 three-axial array, pulled until it slips, twisted and
    released.
    """
    from cnnum.pipeline import load_scene

    if not out.parent.is_dir():
        raise click.UsageError(f"There is no folder '{out.parent}' to write '{out.name}' to.")
    changes = scene_changes(settings, engine, device, precision)
    return follow(load_scene("demo", changes=changes), Output(as_json))
