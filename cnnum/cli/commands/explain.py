"""`cnnum explain`: why slip and twist are reported at a time of a recording, or are not."""

from pathlib import Path

import click

from cnnum.cli.options import Changes, json_option, scene_options, trust_option
from cnnum.cli.output import COMPILING, Output, busy, table


@click.command("explain")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--at", type=click.FloatRange(min=0.0), required=True, help="Time after the first frame, s."
)
@click.option("--scene", default="slip", help="Scene file or name ('slip').")
@click.option("--topic", default="", help="Topic of an MCAP file or a bag.")
@scene_options
@trust_option
@json_option
def command(
    file: Path, at: float, scene: str, topic: str, changes: Changes, trust: bool, as_json: bool
) -> None:
    """Say why slip and twist are reported at a time of the recording FILE, or are not.

    Every read-out, the level, the margin and what held the strength back most are those of the
    first frame from that time on. Earlier frames are processed as in a replay.
    """
    output = Output(as_json)
    with busy(COMPILING, as_json=as_json):
        from cnnum.drivers.recording_file import array_of
        from cnnum.scenes.pipeline import load_scene

        given = {"array": array_of(file, topic)} | changes
        with load_scene(scene, changes=given, trust=trust) as opened:
            found = opened.explain(at)
    for one in found:
        output.record(one.record())
        made = table(f"Read-out of {one.kind}", ">value")
        for name, value in one.read_outs.items():
            made.add_row(name, f"{value:.4g}")
        output.show(str(one), made)
