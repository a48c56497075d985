"""`cnnum explain`: why slip and twist are reported at a time of a recording, or are not."""

from pathlib import Path

import click

from cnnum.cli.options import (
    Changes,
    force_option,
    json_option,
    picture_option,
    scene_options,
    trust_option,
    usual_scene,
)
from cnnum.cli.output import COMPILING, Output, busy, table

AROUND = 1.0
"""s before and after the frame in the picture."""


@click.command("explain")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--at", type=click.FloatRange(min=0.0), required=True, help="Time after the first frame, s."
)
@click.option(
    "--scene",
    help="Scene file or name; required for raw counts, otherwise 'slip' by default.",
)
@click.option("--topic", default="", help="Topic of an MCAP file or a bag.")
@picture_option("--out", "Draw every read-out from 1 s before to 1 s after.")
@scene_options
@trust_option
@force_option
@json_option
def command(
    file: Path,
    at: float,
    scene: str | None,
    topic: str,
    out: Path | None,
    changes: Changes,
    trust: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Explain why slip and twist are reported, or not, at a time of the recording FILE.

    The command prints every read-out, the level, the margin and what lowered the strength most, for
    the first frame at or after that time. Earlier frames are processed as in a replay.
    """
    output = Output(as_json)
    with busy(COMPILING, as_json=as_json):
        from cnnum.drivers.recording_file import array_of
        from cnnum.scenes.pipeline import load_scene

        array = array_of(file, topic)
        if scene is None:
            scene = usual_scene(file, array, changes, "slip")
        given = {"array": array} | changes
        with load_scene(scene, changes=given, trust=trust) as opened:
            moments = opened.explain(at)
            if out is not None:
                from cnnum.report.read_outs import draw_explained

                around = opened.explain_between(max(0.0, at - AROUND), at + AROUND)
                draw_explained(out, around, moments[0].time, force=force)
    for moment in moments:
        output.record(moment.record())
        values = table(f"Read-out of {moment.kind}", ">value")
        for name, value in moment.read_outs.items():
            values.add_row(name, f"{value:.4g}")
        output.show(str(moment), values)
    if out is not None:
        output.record({"kind": "picture", "file": str(out)}, f"The picture is in '{out}'.")
