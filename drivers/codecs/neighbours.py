"""Scans of protocols without a check, held against those before and after them.

Nothing in such a packet shows that a number was damaged on the way. But a load goes on from scan to
scan, and damage does not: a scan that jumps away from the one before it, where the one after it
goes back, is refused. Only a scan that jumps waits for the next one; all others count at once.
"""

import time
from collections import deque
from dataclasses import replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.codecs.scan import Scan

PART = 16
"""A step below this part of a strong load is never a jump: an error of that size does little."""

TIMES = 4.0
"""A jump is that many times as large as steps usually are; noise of any array stays below it."""

LAST, ENOUGH = 33, 9
"""Steps whose median is the usual one, and those before which nothing is a jump."""


class Neighbours:
    """Passes scans on once they count as good, at most one of them later.

    Scans are compared by the largest step of each channel, and by the steps of the device's clock
    and count where it has them. What is usual is a median, so vibration that goes on for longer
    than half of `LAST` scans is no damage, nor is a number that is always new.

    Parameters
    ----------
    full : float
        What a strong load adds to the number of a taxel.
    """

    def __init__(self, full: float) -> None:
        self._full = full
        self._steps = deque[Floats](maxlen=LAST)
        self._last: Scan | None = None
        self._seen: Scan | None = None
        self._held: Scan | None = None

    def take(self, scan: Scan) -> tuple[list[Scan], int]:
        """Return the scans that count as good now, and how many are refused now."""
        last, seen, self._seen = self._last, self._seen, scan
        if last is None or seen is None or _kind(last) != _kind(scan):
            refused = self.lost()
            self._steps.clear()
            self._last = scan
            return [scan], refused
        # those of refused ones, too: what goes on for long is no damage
        self._steps.append(_step(seen, scan))
        if len(self._steps) < ENOUGH:
            self._last = scan
            return [scan], 0
        passed, refused = list[Scan](), 0
        held, self._held = self._held, None
        if held is not None:
            apart = self._apart(held, scan)
            if apart <= 1.0 or apart < self._apart(last, scan):
                passed.append(held)
                last = held
            else:
                refused = 1
        if self._apart(last, scan) <= 1.0:
            passed.append(scan)
            last = scan
        else:
            self._held = replace(scan, arrived_ns=time.monotonic_ns())
        self._last = last
        return passed, refused

    def lost(self) -> int:
        """Return how many scans wait for one that never comes; they are refused."""
        held, self._held = self._held, None
        return int(held is not None)

    def agree(self, scan: Scan) -> bool:
        """Return whether a scan goes on from the last one, where that says anything."""
        last = self._last
        if last is None or _kind(last) != _kind(scan) or len(self._steps) < ENOUGH:
            return False
        largest = float(self._limits()[2:].max())
        return largest < self._full and self._apart(last, scan) <= 1.0

    def _limits(self) -> Floats:
        usual = TIMES * np.median(np.array(self._steps), axis=0)
        usual[2:] = np.maximum(usual[2:], self._full / PART)
        return usual

    def _apart(self, one: Scan, other: Scan) -> float:
        """Return the largest step between two scans, where 1 is the largest that is no jump."""
        limits = self._limits()
        known = limits > 0.0  # a clock or a count that stands still says nothing
        return float((_step(one, other)[known] / limits[known]).max())


def _kind(scan: Scan) -> tuple[object, ...]:
    return scan.values.shape, scan.channels, scan.unit


def _step(one: Scan, other: Scan) -> Floats:
    """Return how far time, count and each channel go from a scan to another."""
    before, after = (np.asarray(each.values, np.float64) for each in (one, other))
    moved = np.nan_to_num(np.abs(after - before)).max(axis=(0, 1))  # NaN of a lost taxel
    time_us = _ahead(one.time_us, other.time_us, other.time_wrap)
    count = _ahead(one.sequence, other.sequence, other.sequence_wrap)
    return np.array([time_us, count, *moved.tolist()])


def _ahead(one: int | None, other: int | None, wrap: int) -> float:
    if one is None or other is None:
        return 0.0
    return float(abs((other - one + wrap // 2) % wrap - wrap // 2))
