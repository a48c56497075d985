"""A recording at a pace: real time, faster or slower, and from one time to another."""

import time
from collections.abc import Iterator

from cnnum.drivers.driver import Closing, Counters, Driver
from cnnum.frame import Frame

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
