"""Clocks, counts and paces of frames."""

import math
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.driver import Closing, Counters, Driver
from cnnum.frame import Frame, Quality, Truth

PIECE = 0.25
"""s of the device's clock; the earliest arrival of each such piece is kept."""

KEPT = 256
"""Pieces: about a minute."""


class ClockFit:
    """A line through the earliest arrivals: bytes can be late on their way, never early.

    Attributes
    ----------
    drift : float
        Seconds that the host's clock gains on the device's a second; 0 before there is enough.
    """

    def __init__(self) -> None:
        self._pieces: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self.restart()

    def restart(self) -> None:
        """Forget all: the device's clock began anew."""
        self._pieces.clear()
        self._earliest: tuple[float, float] | None = None
        self._begin, self._offset, self.drift = 0.0, math.nan, 0.0

    def add(self, device: float, host: float) -> None:
        """Take in a scan's time on the device's clock and its arrival on the host's, s."""
        late = host - device
        if self._earliest is None:
            self._begin, self._earliest = device, (device, late)
            self._offset = late if math.isnan(self._offset) else self._offset
            return
        if late < self._earliest[1]:
            self._earliest = (device, late)
        if device - self._begin >= PIECE:
            self._pieces.append(self._earliest)
            self._earliest = None
            self._fit()

    def delay(self, device: float, host: float) -> float:
        """Return the s that a scan waited beyond the quickest way; 0 before the first scan."""
        if math.isnan(self._offset):
            return 0.0
        return max(0.0, host - device - self._offset - self.drift * device)

    def _fit(self) -> None:
        times: Floats = np.array([piece[0] for piece in self._pieces])
        late: Floats = np.array([piece[1] for piece in self._pieces])
        if len(times) >= 8:
            away = times - times.mean()
            self.drift = float(away @ late / (away @ away))
        self._offset = float((late - self.drift * times).min())


SAME_TIME = 5e-7
"""s by which a frame may be early and still be the one of that time: times are printed to 1e-6, and
those of the Unix clock are rounded to 2.4e-7."""


class Paced(Closing):
    """Another driver whose frames come at their times.

    Parameters
    ----------
    driver : Driver
    speed : float
        1 is real time, 2 twice as fast; 0 as fast as they are taken.
    begin, end : float or None
        s; frames before and after are left out, those at the times are not. Times are those of the
        frames, less the first's.
    keeps_before : bool
        Whether frames before `begin` come all the same, without their pace.
    """

    def __init__(
        self,
        driver: Driver,
        speed: float = 0.0,
        begin: float | None = None,
        end: float | None = None,
        *,
        keeps_before: bool = False,
    ) -> None:
        self.driver = driver
        self.shape, self.channels = driver.shape, driver.channels
        self.unit, self.rate = driver.unit, driver.rate
        self.calibration = getattr(driver, "calibration", None)
        self.live: bool = getattr(driver, "live", False)
        self._speed, self._begin, self._end = speed, begin or 0.0, end
        self._keeps_before = keeps_before

    @property
    def counters(self) -> Counters:
        """Counts of the driver."""
        return self.driver.counters

    def frames(self) -> Iterator[Frame]:
        """Yield the frames between the two times, each when it is due."""
        first: float | None = None
        started = time.monotonic()
        for frame in self.driver.frames():
            first = frame.time if first is None else first
            at = frame.time - first
            if at < self._begin - SAME_TIME:
                if self._keeps_before:
                    yield frame
                started = time.monotonic()
                continue
            if self._end is not None and at > self._end + SAME_TIME:
                return
            if self._speed:
                due = started + (at - self._begin) / self._speed
                time.sleep(max(0.0, due - time.monotonic()))
            yield frame

    def close(self) -> None:
        """Let go of the driver."""
        self.driver.close()


@dataclass(frozen=True, slots=True)
class Step:
    """The place of a packet after the one before: the number lost, or a repeat."""

    ahead: int
    restarted: bool


def step(before: int, after: int, wrap: int = 1 << 32) -> Step:
    """Compare two sequence numbers modulo `wrap`.

    A number less than half the range ahead has left scans out. One behind means that the device has
    started again, and the loss is unknown.
    """
    ahead = (after - before) % wrap
    return Step(0, True) if ahead >= wrap // 2 else Step(ahead, False)


class FrameClock:
    """Give each scan its place in the run: sequence and time never go back.

    Where a device does not count, the scans that came are counted. Where it has no clock, time is
    that of arrival.

    Attributes
    ----------
    dropped : int
        Scans that the sequence numbers show to be missing.
    repeated : int
        Scans that bore the number of the one before.
    gaps : int
        Restarts and reconnections.
    sent : int or None
        Scans that the device has sent by its numbers, repeats included; None where it does not
        count.
    fit : ClockFit
        The device's clock against the host's.
    """

    def __init__(self) -> None:
        self.dropped = self.repeated = self.gaps = 0
        self.sent: int | None = 0
        self.fit = ClockFit()
        self._last: Scan | None = None
        self._arrived = 0.0
        self._sequence = 0
        self._time_us = 0
        self._broken: float | None = None
        # a clock that is set while frames come must not shuffle them
        self._epoch = time.time_ns() - time.monotonic_ns()

    def broken(self, seconds: float) -> None:
        """Note that the connection was lost, and for how long by the host's clock (s)."""
        if self._last is not None:
            self._broken = (self._broken or 0.0) + seconds

    def frame(self, scan: Scan, arrived_ns: int | None = None) -> Frame:
        """Return the scan's frame; its time counts from the first one.

        Parameters
        ----------
        scan : Scan
        arrived_ns : int, optional
            On the host's monotonic clock; now unless given.
        """
        arrived = scan.arrived_ns or arrived_ns or time.monotonic_ns()
        quality = Quality.SATURATED if scan.saturated else Quality.GOOD
        quality |= self._advance(scan, 1e-9 * arrived)
        if scan.time_us is not None:
            self.fit.add(self._time_us * 1e-6, 1e-9 * arrived)
        return Frame(
            values=np.asarray(scan.values, dtype=np.float64),
            channels=scan.channels,
            unit=scan.unit,
            quality=quality,
            sequence=self._sequence,
            time=self._time_us * 1e-6,
            truth=Truth(dict(scan.extras)) if scan.extras else None,
            monotonic_ns=arrived,
            wall_ns=self._epoch + arrived,
            saturated=scan.at_end if scan.saturated else None,
        )

    def _advance(self, scan: Scan, arrived: float) -> Quality:
        last, self._last = self._last, scan
        before, self._arrived = self._arrived, arrived
        if last is None:
            self._sequence, self.sent = scan.sequence or 0, None if scan.sequence is None else 1
            return Quality.GOOD
        away, self._broken = self._broken, None
        moved = _moved(last, scan)
        elapsed = _elapsed(last, scan, arrived - before)
        timed = scan.time_us is not None
        if moved.restarted or elapsed < 0 or (timed and _began_anew(away, elapsed)):
            return self._restart(away, scan.period_us)
        self._time_us += elapsed
        self.gaps += away is not None
        if scan.sequence is None and away is not None:
            return self._uncounted_gap(away, scan.period_us)
        return self._go_on(moved.ahead)

    def _uncounted_gap(self, away: float, period_us: int) -> Quality:
        """Go on after a break of a device that does not count its scans."""
        self._go_on(max(1, round(away * 1e6 / period_us)) if period_us else 1)
        return Quality.DROPPED_BEFORE

    def _restart(self, away: float | None, period_us: int) -> Quality:
        """Go on after a device that counts anew: by the host's clock, or by one period."""
        self.gaps += 1
        self.fit.restart()
        away_us = round((away or 0.0) * 1e6)
        self._time_us += away_us or period_us
        # scans that its period makes of the time away, the present one among them
        self._go_on(max(1, round(away_us / period_us)) if period_us else 1)
        return Quality.DROPPED_BEFORE

    def _go_on(self, ahead: int) -> Quality:
        """Count the scans up to the present one."""
        self._sequence += ahead
        if self.sent is not None:
            self.sent += max(1, ahead)
        if ahead == 0:
            self.repeated += 1
            return Quality.REPEATED
        self.dropped += ahead - 1
        return Quality.DROPPED_BEFORE if ahead > 1 else Quality.GOOD


def _moved(last: Scan, scan: Scan) -> Step:
    """Return how far the count went on; by one where the device does not count."""
    if last.sequence is None or scan.sequence is None:
        return Step(1, False)
    return step(last.sequence, scan.sequence, scan.sequence_wrap)


def _elapsed(last: Scan, scan: Scan, by_host: float) -> int:
    """Return µs between two scans; below 0 where the device's clock has gone back."""
    if last.time_us is None or scan.time_us is None:
        return max(0, round(1e6 * by_host))
    ahead = (scan.time_us - last.time_us) % scan.time_wrap
    return ahead if ahead < scan.time_wrap // 2 else ahead - scan.time_wrap


def _began_anew(away: float | None, elapsed_us: int) -> bool:
    """Return whether a device that came back has a clock that ran for less than half the time."""
    return away is not None and elapsed_us < 0.5e6 * away
