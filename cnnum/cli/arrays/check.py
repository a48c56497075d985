"""`cnnum check`: whether a recording's orders, signs, unit, rate and taxels are as they say."""

from pathlib import Path

import click

from cnnum.cli.options import json_option
from cnnum.cli.output import Output
from cnnum.safety.names import visible

FAULTS = 1
"""Exit code where something is wrong."""


@click.command("check")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--topic", default="", help="Topic of an MCAP file or a bag.")
@json_option
def command(recording: Path, topic: str, as_json: bool) -> int:
    """Check order, signs, unit, rate, rest and taxels of RECORDING.

    The recording should contain a press straight down on the middle of the array. For each fault
    the command prints the TOML keys of a layout or a scene that correct it, and exits with 1.
    """
    from cnnum.drivers.recording_file import array_of, load_recording
    from cnnum.drivers.registry import open_driver
    from cnnum.recordings.checking import checked

    output = Output(as_json)
    held = load_recording(recording, topic=topic)
    table = array_of(recording, topic)
    with open_driver(str(table.pop("driver")), table) as driver:
        pads = getattr(driver, "pads", None) or 1
    findings = checked(held, pads)
    if not as_json:
        click.echo(visible(f"{recording}: {held!r}"))
    for one in findings:
        toml = "; ".join(f"{key} = {_toml(value)}" for key, value in one.cure.items())
        text = f"{'wrong' if one.wrong else '     '}  {one.what:<8} {one.sentence}"
        output.record(
            {
                "kind": "check",
                "what": one.what,
                "wrong": one.wrong,
                "sentence": one.sentence,
                "cure": dict(one.cure),
            },
            visible(f"{text}\n       {'':<8} {toml}" if toml else text),
        )
    return FAULTS if any(one.wrong for one in findings) else 0


def _toml(value: object) -> str:
    from cnnum.drivers.own_data.proposal import toml_text

    return toml_text(value)
