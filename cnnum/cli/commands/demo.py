"""`cnnum demo`: the simulated scene, its events as they come, and a report of it."""

from pathlib import Path

import click

from cnnum.cli.following import follow
from cnnum.cli.options import Changes, file_option, force_option, json_option, scene_options
from cnnum.cli.output import Output
from cnnum.cli.progress import COMPILING, busy


@click.command("demo")
@file_option("cnnum-demo.html", "Where the report goes.")
@scene_options
@force_option
@json_option
def command(
    out: Path,
    changes: Changes,
    force: bool,
    as_json: bool,
) -> int:
    """Run the scene that comes with the package, and write an HTML report of it.

    A sphere is pressed on a simulated 8×8 three-axial array, pulled until it slips, twisted and
    released. The report shows the frames, the events, the ground truth, and the operations that the
    plan leaves out. It also shows the error of the templates against their run time.
    """
    with busy(COMPILING, as_json=as_json):
        from cnnum.cli.demo_report import DemoReport
        from cnnum.scenes.pipeline import load_scene

        scene = load_scene("demo", changes=changes)
    with DemoReport(scene, out, force=force, as_json=as_json) as report:
        return follow(scene, Output(as_json), watch=report.add, finish=report.write)
