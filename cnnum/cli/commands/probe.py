"""`cnnum probe`: the frames that an array sends, and their faults."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import (
    assignments,
    completed,
    force_option,
    json_option,
    setting_option,
    target_option,
    trust_option,
)
from cnnum.cli.output import Output, facts, number, quantity
from cnnum.cli.progress import progress
from cnnum.cli.signals import stoppable
from cnnum.cli.source import limited, open_source
from cnnum.safety.names import visible

if TYPE_CHECKING:
    from cnnum.cli.probe_figures import Cell, ProbeFigures
    from cnnum.drivers.driver import Driver

SHOWN = 12
"""Cells that are listed by name; --json has all of them."""


@click.command("probe")
@click.argument("source", shell_complete=completed("scene", files=True))
@setting_option("An option of the driver.")
@click.option(
    "--seconds", type=click.FloatRange(min=0, min_open=True), help="Look for so long (5 s)."
)
@click.option("--frames", type=click.IntRange(min=1), help="Look at this number of frames.")
@target_option("--picture", "FILE.png", "Draw rest, noise and drift of every cell.")
@force_option
@trust_option
@json_option
def command(
    source: str,
    settings: tuple[str, ...],
    seconds: float | None,
    frames: int | None,
    picture: Path | None,
    trust: bool,
    force: bool,
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
    with open_source(source, assignments(settings), trust=trust) as driver:
        with suppress(KeyboardInterrupt), stoppable():
            with progress("frames", frames, as_json=as_json) as steps:
                for frame in limited(driver, seconds, frames):
                    figures.add(frame)
                    steps.advance()
            stopped = False
        output.record(_record(source, driver, figures))
        output.show(facts(_facts(source, driver, figures)))
        if picture is not None and figures.scans:
            from cnnum.report.probe_picture import draw

            marks = [cell[:2] for cell in (*figures.dead, *figures.stuck, *figures.noisy)]
            maps = {"rest": figures.rest, "noise": figures.deviation, "drift a min": figures.slope}
            draw(picture, maps, figures.channels, driver.unit, marks, force=force)
            click.echo(visible(f"Written: {picture}"), err=as_json)
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
        "noisy": figures.noisy,
        "drift_per_min": figures.drift,
        "moved": {
            name: {"by": by, "where": (row, col)} for name, (by, row, col) in figures.moved.items()
        },
        "clock_drift_ppm": _clock_drift(driver),
        "verified": getattr(driver, "verified", None),
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
        *_unverified(driver),
        ("flagged", f"{figures.repeated} repeated, {figures.saturated} saturated"),
        (
            "spread",
            f"{spread} {driver.unit} (standard deviation of the median cell)"
            if spread
            else "too few frames",
        ),
        ("drift", _drift(driver, figures)),
        ("moved", _moved(driver, figures)),
        ("dead cells", _cells(figures, figures.dead)),
        ("stuck cells", _cells(figures, figures.stuck)),
        ("noisy cells", _cells(figures, figures.noisy)),
    ]


def _unverified(driver: "Driver") -> list[tuple[str, str]]:
    """Return a row where the protocol has no check: what counts as good is not known to be."""
    if getattr(driver, "verified", True):
        return []
    return [
        (
            "check",
            "frames of this protocol cannot be verified: one that jumps away from its neighbours "
            "counts as bad, other damage goes unseen",
        )
    ]


def _clock_drift(driver: "Driver") -> float | None:
    """Return parts in a million that the host's clock gains on the device's, where both are."""
    clock = getattr(driver, "clock", None)
    return None if clock is None else round(1e6 * clock.drift, 1)


def _drift(driver: "Driver", figures: "ProbeFigures") -> str:
    parts = [f"{name} {number(value)}" for name, value in figures.drift.items()]
    said = f"{', '.join(parts)} {driver.unit} a minute (median cell)" if parts else "too few frames"
    clock = _clock_drift(driver)
    return said if clock is None else f"{said}; the clocks {clock:g} ppm"


def _moved(driver: "Driver", figures: "ProbeFigures") -> str:
    parts = [
        f"{name} {number(by)} at ({row}, {col})" for name, (by, row, col) in figures.moved.items()
    ]
    return f"{', '.join(parts)} ({driver.unit}, the furthest of any cell)"


def _cells(figures: "ProbeFigures", cells: "list[Cell]") -> str:
    from cnnum.cli.probe_figures import ENOUGH

    if figures.scans < ENOUGH:
        return f"unknown from {figures.scans} new scans: at least {ENOUGH} are needed"
    shown = ", ".join(f"({row}, {col}) {channel}" for row, col, channel in cells[:SHOWN])
    more = f" and {len(cells) - SHOWN} more" if len(cells) > SHOWN else ""
    return f"{len(cells)}: {shown}{more}" if cells else "none"
