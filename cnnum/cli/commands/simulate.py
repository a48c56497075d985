"""`cnnum simulate`: a simulated array behind a pseudo-terminal, in any protocol, with faults."""

from contextlib import suppress
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import (
    assignments,
    completed,
    json_option,
    open_source,
    seconds_option,
    setting_option,
    trust_option,
)
from cnnum.cli.output import Output, busy, facts
from cnnum.cli.signals import stoppable

if TYPE_CHECKING:
    from cnnum.frame import Frame

MOST = 60_000
"""Frames of the longest cycle."""


@click.command("simulate")
@click.argument("source", default="simulated", shell_complete=completed("scene", files=True))
@click.option("--pty", is_flag=True, required=True, help="Use a pseudo-terminal as the port.")
@click.option(
    "--protocol", default="open", help="Protocol of the array; 'cnnum devices --arrays' lists them."
)
@click.option(
    "--descriptor",
    type=click.Path(path_type=Path),
    help="TOML file that describes the protocol.",
)
@click.option("--shape", nargs=2, type=click.IntRange(min=1), help="Rows and columns on the wire.")
@click.option(
    "--rate",
    type=click.FloatRange(1, 10_000),
    help="Frames per second; by default those of SOURCE.",
)
@click.option("--axes", type=click.Choice(["force", "as-is"]), default="force",
              help="Send three axes of strain, or the channels of SOURCE.")  # fmt: skip
@click.option("--link", type=click.Path(path_type=Path), help="Fixed name for the port.")
@setting_option("Set an option of SOURCE; may be repeated.")
@seconds_option
@click.option("--drops", type=float, default=0.0, help="Share of packets to drop.")
@click.option(
    "--flips", type=float, default=0.0, help="Share of packets in which one bit is flipped."
)
@click.option("--stall-every", type=float, default=0.0, help="Seconds between pauses.")
@click.option("--stall", type=float, default=0.5, help="Length of a pause in seconds.")
@click.option("--unplug-every", type=float, default=0.0, help="Seconds between unplugs.")
@click.option("--away", type=float, default=0.5, help="Length of an unplug in seconds.")
@click.option("--seed", type=int, default=0, help="Seed of the random faults.")
@trust_option
@json_option
def command(
    source: str,
    pty: bool,
    protocol: str,
    descriptor: Path | None,
    shape: tuple[int, int] | None,
    rate: float | None,
    axes: str,
    link: Path | None,
    settings: tuple[str, ...],
    seconds: float | None,
    drops: float,
    flips: float,
    stall_every: float,
    stall: float,
    unplug_every: float,
    away: float,
    seed: int,
    trust: bool,
    as_json: bool,
) -> int:
    """Simulate the array SOURCE (the name of a driver, or a scene) at a serial port.

    For example, run cnnum simulate --pty --link /tmp/taxels, and then cnnum probe serial --set
    port=/tmp/taxels. The frames repeat until Ctrl-C. The last line counts the scans that were
    sent and those that were damaged.
    """
    from cnnum.drivers.codecs.wire import Asked, described_wire, wire
    from cnnum.drivers.virtual import LineFaults, VirtualArray, VirtualLine

    output = Output(as_json)
    options = Asked(shape=shape)
    known = described_wire(descriptor, options) if descriptor else wire(protocol, options)
    faults = LineFaults(drops, flips, stall_every, stall, unplug_every, away, seed)
    with busy("Simulating the array", as_json=as_json):
        frames, usual = _cycle(source, settings, axes, trust)
    line = VirtualLine(link)
    array = VirtualArray(known, line, frames, rate or usual, faults)
    first = {"kind": "port", "port": str(line.path), "protocol": protocol, "rate_hz": array.rate}
    output.record(first, f"{known.name} at '{line.path}', {array.rate:g} Hz; Ctrl-C ends it")
    stopped, stop = True, Event()
    try:
        with suppress(KeyboardInterrupt), stoppable():
            array.run(stop, seconds)
            stopped = False
    finally:
        line.close()
    counts = asdict(array.counts)
    output.record({"kind": "simulated", **counts})
    output.show(facts([(name, str(count)) for name, count in counts.items()]))
    return 130 if stopped else 0


def _cycle(
    source: str, settings: tuple[str, ...], axes: str, trust: bool
) -> "tuple[list[Frame], float]":
    """Return the frames of a source, as strain where it is wanted and can be had, and its rate."""
    from dataclasses import replace

    from cnnum.scenes.conversion import conversion_for, unit_of

    with open_source(source, assignments(settings), trust=trust) as driver:
        frames, rate = list(islice(driver.frames(), MOST)), driver.rate or 100.0
        if axes == "as-is" or getattr(driver, "calibration", None) is None:
            return frames, rate
        conversion = conversion_for("driver", driver, Path())
        read, unit = conversion.reader(conversion.channels), unit_of(conversion, driver)
    return [
        replace(frame, values=read(frame), channels=conversion.channels, unit=unit)
        for frame in frames
    ], rate
