"""`cnnum probe`: the frames that an array sends, and their faults."""

from contextlib import suppress
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import assignments, json_option
from cnnum.cli.output import Output, facts, number, quantity
from cnnum.cli.progress import progress
from cnnum.cli.signals import stoppable
from cnnum.cli.source import limited, open_source

if TYPE_CHECKING:
    from cnnum.cli.probe_figures import Cell, ProbeFigures
    from cnnum.drivers.driver import Driver

SHOWN = 12
"""Cells that are listed by name; --json has all of them."""


@click.command("probe")
@click.argument("source")
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="An option of the driver."
)
@click.option(
    "--seconds", type=click.FloatRange(min=0, min_open=True), help="Look for so long (5 s)."
)
@click.option("--frames", type=click.IntRange(min=1), help="Look at this number of frames.")
@json_option
def command(
    source: str,
    settings: tuple[str, ...],
    seconds: float | None,
    frames: int | None,
    as_json: bool,
) -> int:
    """Look at the frames of the array SOURCE (a driver's name, or a scene).

    As in: cnnum probe serial --set port=/dev/ttyACM0. Shows the rate, sync losses, bad and
    dropped frames, noise, and cells that never change. Ctrl-C ends it with the figures so far.
    """
    from cnnum.cli.probe_figures import ProbeFigures

    if seconds is None and frames is None:
        seconds = 5.0
    output, figures, stopped = Output(as_json), ProbeFigures(), True
    with open_source(source, assignments(settings)) as driver:
        with suppress(KeyboardInterrupt), stoppable():
            with progress("frames", frames, as_json=as_json) as steps:
                for frame in limited(driver, seconds, frames):
                    figures.add(frame)
                    steps.advance()
            stopped = False
        output.record(_record(source, driver, figures))
        output.show(facts(_facts(source, driver, figures)))
    return 130 if stopped else 0


def _record(source: str, driver: "Driver", figures: "ProbeFigures") -> dict[str, object]:
    counters = driver.counters
    return {
        "kind": "probe",
        "source": source,
        "shape": driver.shape,
        "channels": driver.channels,
        "unit": driver.unit,
        "frames": figures.frames,
        "seconds": round(figures.seconds, 6),
        "rate_hz": round(figures.rate, 4),
        "arrival_hz": round(figures.arrival_rate, 4),
        "jitter_us": round(1e6 * figures.jitter, 1),
        "bad_frames": counters.bad + figures.bad,
        "dropped": counters.dropped,
        "repeated": figures.repeated,
        "saturated": figures.saturated,
        "sync_losses": counters.resyncs,
        "discarded_bytes": counters.discarded,
        "gaps": counters.gaps,
        "spread": figures.spread,
        "dead": figures.dead,
        "stuck": figures.stuck,
    }


def _facts(source: str, driver: "Driver", figures: "ProbeFigures") -> list[tuple[str, str]]:
    counters, (rows, cols) = driver.counters, driver.shape
    spread = ", ".join(f"{name} {number(value)}" for name, value in figures.spread.items())
    return [
        ("array", f"{source}: {rows}×{cols} cells, {', '.join(driver.channels)} in {driver.unit}"),
        ("frames", f"{figures.frames} in {quantity(figures.seconds, 's')}"),
        (
            "rate",
            f"{figures.rate:.2f} Hz by their times, jitter "
            f"{quantity(round(figures.jitter, 9), 's')}; {figures.arrival_rate:.2f} Hz as it came",
        ),
        (
            "lost",
            f"{counters.dropped} dropped, {counters.bad + figures.bad} bad, "
            f"{counters.resyncs} sync losses ({counters.discarded} B), {counters.gaps} gaps",
        ),
        ("flagged", f"{figures.repeated} repeated, {figures.saturated} saturated"),
        (
            "spread",
            f"{spread} {driver.unit} (standard deviation of the median cell)"
            if spread
            else "too few frames",
        ),
        ("dead cells", _cells(figures, figures.dead)),
        ("stuck cells", _cells(figures, figures.stuck)),
    ]


def _cells(figures: "ProbeFigures", cells: "list[Cell]") -> str:
    from cnnum.cli.probe_figures import ENOUGH

    if figures.scans < ENOUGH:
        return f"unknown from {figures.scans} new scans: at least {ENOUGH} are needed"
    shown = ", ".join(f"({row}, {col}) {channel}" for row, col, channel in cells[:SHOWN])
    more = f" and {len(cells) - SHOWN} more" if len(cells) > SHOWN else ""
    return f"{len(cells)}: {shown}{more}" if cells else "none"
