"""`cnnum probe`: the frames that an array sends, and their faults."""

import math
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from cnnum.arrays import Floats
from cnnum.cli.options import (
    assignments,
    completed,
    force_option,
    json_option,
    limited,
    open_source,
    picture_option,
    setting_option,
    trust_option,
)
from cnnum.cli.output import Output, facts, number, progress, quantity
from cnnum.cli.signals import stoppable
from cnnum.frame import Frame, Quality
from cnnum.safety.values import visible
from cnnum.scenes.scene_record import Histogram

if TYPE_CHECKING:
    from cnnum.drivers.driver import Driver


LOUD = 5.0
"""Times the median noise of its channel from which a cell is called noisy."""

NEARER = 1.1
"""Factor by which a cell's median step is corrected by each scan: from any begin, 50 scans lead to
it, and it stays within some 15 %."""

ENOUGH = 50
"""New scans from which a cell that never changed is called dead or stuck."""

Cell = tuple[int, int, str]
"""Row, column, channel."""


@dataclass(slots=True)
class ProbeFigures:
    """Figures over the frames seen so far.

    Attributes
    ----------
    frames : int
        All that arrived, including repeated and bad ones.
    scans : int
        The new and good ones among them, which the figures of cells are based on.
    saturated, repeated, bad : int
        Frames with that flag.
    """

    frames: int = 0
    scans: int = 0
    saturated: int = 0
    repeated: int = 0
    bad: int = 0
    _channels: tuple[str, ...] = ()
    _times: "_Times" = field(default_factory=lambda: _Times())
    _arrivals: "_Times" = field(default_factory=lambda: _Times())
    _first: Floats = field(default_factory=lambda: np.zeros(0))
    _changed: Floats = field(default_factory=lambda: np.zeros(0))
    _before: Floats = field(default_factory=lambda: np.zeros(0))
    _step: Floats = field(default_factory=lambda: np.zeros(0))
    _sum: Floats = field(default_factory=lambda: np.zeros(0))
    _squares: Floats = field(default_factory=lambda: np.zeros(0))
    _low: Floats = field(default_factory=lambda: np.zeros(0))
    _high: Floats = field(default_factory=lambda: np.zeros(0))
    _begun: float = 0.0
    _when: Floats = field(default_factory=lambda: np.zeros(2))  # Σ t, Σ t²
    _drifting: Floats = field(default_factory=lambda: np.zeros(0))  # Σ t (v − first)

    def add(self, frame: Frame) -> None:
        """Take in a frame."""
        self.frames += 1
        self._arrivals.add(time.monotonic())
        self.saturated += bool(frame.quality & Quality.SATURATED)
        self.repeated += frame.repeated
        self.bad += frame.bad
        if frame.repeated or frame.bad:
            return
        if self.scans == 0:
            self._begin(frame)
        self.scans += 1
        self._times.add(frame.time)
        away = frame.values - self._first
        self._changed += away != 0
        self._take_steps(np.abs(away - self._before))
        self._before = away
        self._sum += away
        self._squares += away**2
        self._low, self._high = np.minimum(self._low, away), np.maximum(self._high, away)
        gone = frame.time - self._begun
        self._when += (gone, gone**2)
        self._drifting += gone * away

    def _take_steps(self, steps: Floats) -> None:
        """Correct the median step of each cell (Ma, Muthukrishnan and Sandler 2013, frugal)."""
        nearer = np.where(steps > self._step, self._step * NEARER, self._step / NEARER)
        self._step = np.where(self._step > 0.0, nearer, steps)

    def _begin(self, frame: Frame) -> None:
        self._channels = frame.channels
        self._first = frame.values.copy()
        self._changed = np.zeros_like(self._first)
        self._sum = np.zeros_like(self._first)
        self._before, self._step = np.zeros_like(self._first), np.zeros_like(self._first)
        self._squares = np.zeros_like(self._first)
        self._low, self._high = np.zeros_like(self._first), np.zeros_like(self._first)
        self._drifting = np.zeros_like(self._first)
        self._begun = frame.time

    @property
    def seconds(self) -> float:
        """Time from the first frame to the last by the host's clock, s."""
        return self._arrivals.span

    @property
    def rate(self) -> float:
        """Scans a second by the frames' own times, Hz; 0 where they do not say."""
        return self._times.rate

    @property
    def arrival_rate(self) -> float:
        """Frames a second by the host's clock, Hz."""
        return self._arrivals.rate

    @property
    def jitter(self) -> float:
        """Largest departure of an interval between scans from their median (within 1 %), s."""
        return self._times.jitter

    @property
    def spread(self) -> dict[str, float]:
        """Standard deviation of the median cell, by channel, in the frames' unit."""
        if self.scans < 2:
            return {}
        middle = np.median(self.deviation, axis=(0, 1)).tolist()
        return dict(zip(self._channels, middle, strict=True))

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the last axis."""
        return self._channels

    @property
    def rest(self) -> Floats:
        """Mean of each cell, (rows, cols, channels)."""
        return self._first + self._sum / max(self.scans, 1)

    @property
    def deviation(self) -> Floats:
        """Standard deviation of each cell, (rows, cols, channels)."""
        count = max(self.scans, 1)
        mean = self._sum / count
        return np.sqrt(np.maximum(self._squares / count - mean**2, 0.0))

    @property
    def slope(self) -> Floats:
        """Change of each cell in a minute, by the line that fits best, (rows, cols, channels)."""
        count = max(self.scans, 1)
        spread = float(self._when[1] - self._when[0] ** 2 / count)
        if spread <= 0.0:
            return np.zeros_like(self._first)
        together: Floats = self._drifting - self._when[0] * self._sum / count
        return np.asarray(60.0 * together / spread, dtype=np.float64)

    @property
    def drift(self) -> dict[str, float]:
        """Change of the median cell in a minute, by channel, in the frames' unit."""
        if self.scans < ENOUGH:
            return {}
        middle = np.median(self.slope, axis=(0, 1)).tolist()
        return dict(zip(self._channels, middle, strict=True))

    @property
    def moved(self) -> dict[str, tuple[float, int, int]]:
        """The furthest that a cell of each channel went from its first number, and the cell.

        A push straight down must move the normal most; one to the right shear_x, upwards.
        """
        result: dict[str, tuple[float, int, int]] = {}
        for n, name in enumerate(self._channels if self.scans else ()):
            low, high = self._low[..., n], self._high[..., n]
            far = np.where(-low > high, low, high)
            row, col = np.unravel_index(int(np.abs(far).argmax()), far.shape)
            result[name] = (float(far[row, col]), int(row), int(col))
        return result

    @property
    def noisy(self) -> list[Cell]:
        """Cells whose median step from scan to scan is far above that of their channel.

        A cell that is touched moves far, in a few large steps, and is none of them.
        """
        if self.scans < ENOUGH:
            return []
        middle = np.median(self._step, axis=(0, 1))
        loud = (self._step > LOUD * middle) & (middle > 0)
        return [(int(r), int(c), self._channels[n]) for r, c, n in np.argwhere(loud)]

    @property
    def dead(self) -> list[Cell]:
        """Cells that read 0 all the time."""
        return self._still(zero=True)

    @property
    def stuck(self) -> list[Cell]:
        """Cells that read the same number all the time, and not 0."""
        return self._still(zero=False)

    def _still(self, *, zero: bool) -> list[Cell]:
        if self.scans < ENOUGH:
            return []
        still = (self._changed == 0) & ((self._first == 0) == zero)
        return [(int(r), int(c), self._channels[n]) for r, c, n in np.argwhere(still)]


@dataclass(slots=True)
class _Times:
    """Times in their order; only figures of them are kept."""

    first: float = 0.0
    last: float = 0.0
    count: int = 0
    shortest: float = math.inf
    longest: float = -math.inf
    steps: Histogram = field(default_factory=Histogram)

    def add(self, time: float) -> None:
        """Take in the next time, s."""
        if self.count:
            step = time - self.last
            self.steps.add(step)
            self.shortest, self.longest = min(self.shortest, step), max(self.longest, step)
        else:
            self.first = time
        self.last = time
        self.count += 1

    @property
    def span(self) -> float:
        """From the first to the last, s."""
        return self.last - self.first

    @property
    def rate(self) -> float:
        """Intervals a second, Hz; 0 where there is none."""
        return (self.count - 1) / self.span if self.span > 0 else 0.0

    @property
    def jitter(self) -> float:
        """Largest departure of an interval from their median, s; 0 where there is none."""
        if not self.steps.total:
            return 0.0
        median = self.steps.quantile(0.5)
        return max(self.longest - median, median - self.shortest)


SHOWN = 12
"""Cells that are listed by name; --json has all of them."""


@click.command("probe")
@click.argument("source", shell_complete=completed("scene", files=True))
@setting_option("Set an option of the driver; may be repeated.")
@click.option(
    "--seconds", type=click.FloatRange(min=0, min_open=True), help="Seconds to measure (5)."
)
@click.option("--frames", type=click.IntRange(min=1), help="Number of frames to measure.")
@picture_option("--picture", "Draw rest, noise and drift of every cell.")
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
    """Measure the frames of the array SOURCE (the name of a driver, or a scene).

    For example: cnnum probe serial --set port=/dev/ttyACM0. The command shows the rate, sync
    losses, bad and dropped frames, noise, and cells that never change. Ctrl-C ends it early.
    """
    from cnnum.cli.commands.probe import ProbeFigures

    if seconds is None and frames is None:
        seconds = 5.0
    output, figures, stopped = Output(as_json), ProbeFigures(), True
    with open_source(source, assignments(settings), trust=trust) as driver:
        with suppress(KeyboardInterrupt), stoppable():
            with progress("frames", frames, as_json=as_json) as steps:
                for frame in limited(driver.frames(), seconds, frames):
                    figures.add(frame)
                    steps.advance()
            stopped = False
        output.record(_record(source, driver, figures))
        output.show(facts(_facts(source, driver, figures)))
        if picture is not None and figures.scans:
            from cnnum.report.plots import draw

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
            "frames of this protocol cannot be verified: a frame that jumps away from its "
            "neighbours counts as bad, and other damage is not detected",
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
    from cnnum.cli.commands.probe import ENOUGH

    if figures.scans < ENOUGH:
        return f"unknown from {figures.scans} new scans: at least {ENOUGH} are needed"
    shown = ", ".join(f"({row}, {col}) {channel}" for row, col, channel in cells[:SHOWN])
    more = f" and {len(cells) - SHOWN} more" if len(cells) > SHOWN else ""
    return f"{len(cells)}: {shown}{more}" if cells else "none"
