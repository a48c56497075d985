"""`cnnum check`: whether a recording's orders, signs, unit, rate and taxels are as they say."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from cnnum.cli.options import json_option
from cnnum.cli.output import Output
from cnnum.safety.values import visible

if TYPE_CHECKING:
    from cnnum.drivers.geometry import Positions
    from cnnum.recordings.checking import Finding
    from cnnum.recordings.recording import Recording

FAULTS = 1
"""Exit code where something is wrong."""

SHOWN = 3
"""Other cures of a fault that are shown; `--json` has all."""


@click.command("check")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--topic", default="", help="Topic of an MCAP file or a bag.")
@json_option
def command(recording: Path, topic: str, as_json: bool) -> int:
    """Check order, signs, unit, rate, rest and taxels of RECORDING.

    The recording should contain a press straight down on the middle of the array. For each fault
    the command prints the TOML keys of a layout or a scene that correct it, and exits with 1. Keys
    such as frames.channels belong to a scene; `cnnum run` and `cnnum replay` also accept them with
    --set.
    """
    from cnnum.drivers.recording_file import array_of, load_recording
    from cnnum.drivers.registry import open_driver
    from cnnum.recordings.checking import checked

    output = Output(as_json)
    table = array_of(recording, topic)
    with open_driver(str(table.pop("driver")), table) as driver:
        held = getattr(driver, "recording", None) or load_recording(recording, topic=topic)
        pads = getattr(driver, "pads", None) or 1
        laid_out = getattr(driver, "layout", None) is not None
        positions = getattr(driver, "positions", ())
        pitch = getattr(driver, "pitch", None)
        timed = getattr(driver, "timed", False)
    findings = checked(held, pads, timed=timed)
    if positions:
        findings = [finding for finding in findings if finding.what != "order"]
        findings += [
            remark for remark in checked(_on_grid(held, positions, pitch)) if remark.what == "order"
        ]
    findings = [finding if laid_out else _of_scene(finding) for finding in findings]
    if not as_json:
        click.echo(visible(f"{recording}: {held!r}"))
    for finding in findings:
        cures = [cure for cure in (finding.cure, *finding.others[:SHOWN]) if cure]
        lines = ["; ".join(f"{key} = {_toml(value)}" for key, value in c.items()) for c in cures]
        toml = f"\n       {'or':<8} ".join(lines)
        text = f"{'wrong' if finding.wrong else '     '}  {finding.what:<8} {finding.sentence}"
        output.record(
            {
                "kind": "check",
                "what": finding.what,
                "wrong": finding.wrong,
                "sentence": finding.sentence,
                "cure": dict(finding.cure),
                "others": [dict(other) for other in finding.others],
            },
            visible(f"{text}\n       {'':<8} {toml}" if toml else text),
        )
    return FAULTS if any(finding.wrong for finding in findings) else 0


def _on_grid(recording: "Recording", positions: "Positions", pitch: float | None) -> "Recording":
    """Return a recording of taxels at known places on a grid, for their order."""
    from cnnum.drivers.geometry import Grid
    from cnnum.recordings.recording import Recording

    grid = Grid(positions, recording.shape, pitch)
    values = np.stack([grid.maps(frame) for frame in recording.values])
    facts: dict[str, Any] = {
        "rate": recording.rate,
        "times": recording.times,
        "quality": recording.quality,
    }
    return Recording(values, unit=recording.unit, channels=recording.channels, **facts)


def _of_scene(finding: "Finding") -> "Finding":
    """Return a finding with a cure in keys of a scene, of a recording that has no layout."""
    tables = {"rate": "program.parameters."} | dict.fromkeys(
        ("channels", "order", "flip", "unit", "time_unit"), "frames."
    )
    cure, *others = (
        {f"{tables.get(key, '')}{key}": value for key, value in keys.items()}
        for keys in (finding.cure, *finding.others)
    )
    return replace(finding, cure=cure, others=others)


def _toml(value: object) -> str:
    from cnnum.drivers.own_data.proposed_shape import toml_text

    return toml_text(value)
