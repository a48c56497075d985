"""The summary of a scene: frames by outcome, and their times."""

import math
from dataclasses import dataclass

from cnnum.drivers.driver import Counters

LEAST, MOST = 1e-9, 1e6
PER_DECADE = 232
"""Bins: each is 1 % wider than the one before."""


class Histogram:
    """Counts positive numbers in bins 1 % wide, from 1e-9 to 1e6; those beyond in the end bins.

    A quantile is the mean of the numbers in its bin. So it is within 1 % of the exact one, and
    exact where all numbers of the bin are equal.
    """

    __slots__ = ("_counts", "_sums", "total")

    def __init__(self) -> None:
        bins = math.ceil(PER_DECADE * math.log10(MOST / LEAST)) + 1
        self._counts = [0] * bins
        self._sums = [0.0] * bins
        self.total = 0

    def add(self, value: float) -> None:
        """Count a number."""
        place = int(PER_DECADE * math.log10(min(max(LEAST, value), MOST) / LEAST))
        self._counts[place] += 1
        self._sums[place] += value
        self.total += 1

    def quantile(self, share: float) -> float:
        """Return the number that this share of all is not above; 0 where there is none."""
        rank, seen = max(1, math.ceil(share * self.total)), 0
        for count, total in zip(self._counts, self._sums, strict=True):
            seen += count
            if seen >= rank:
                return total / count
        return 0.0


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of a scene: ``sent == handed_on + dropped + skipped + refused``.

    Attributes
    ----------
    frames : int
        Frames that the driver delivered, including bad and repeated ones but not those that ran
        silently before the requested part.
    handed_on : int
        Frames on which the program ran.
    refused : int
        Bad frames that were skipped: flagged by the driver, out of range, or unusable for the
        program.
    repeated : int
        Repeated scans.
    counters : Counters
        Counters of the driver.
    saturated : int
        Frames with a taxel at an end of its range because of a load: loads in them are lower
        bounds.
    masked : int
        Frames with a taxel that had dropped out and was continued from its neighbours.
    dropouts : int
        Times that a taxel has dropped out.
    longest_gap : float
        Longest time in s between two frames on which the program ran, with a bad or lost frame
        between them; 0 if there was none.
    p50_us, p99_us : float
        Time from a frame in host memory to its events, µs, within 1 %.
    arrival_p50_us, arrival_p99_us : float or None
        Time from the arrival of a frame at its port to its events, µs; None if none just arrived.
    before : int
        Frames that ran silently before the requested part.
    """

    frames: int
    handed_on: int
    refused: int
    repeated: int
    counters: Counters
    longest_gap: float
    p50_us: float
    p99_us: float
    arrival_p50_us: float | None = None
    arrival_p99_us: float | None = None
    before: int = 0
    saturated: int = 0
    masked: int = 0
    dropouts: int = 0

    @property
    def bad_frames(self) -> int:
        """Refused frames, and packets or rows that the driver found damaged."""
        return self.refused + self.counters.bad

    @property
    def dropped(self) -> int:
        """Scans that were lost on the way, including damaged packets."""
        return self.counters.dropped

    @property
    def skipped(self) -> int:
        """Scans that were not wanted: older ones, repeats, those before and after the part."""
        cut_off = self.frames - self.handed_on - self.refused - self.repeated
        return self.counters.skipped + self.repeated + cut_off + self.counters.waiting + self.before

    @property
    def sent(self) -> int:
        """Scans that the array has sent according to its numbers, or otherwise those that came."""
        sent = self.counters.sent
        if sent is not None:
            return sent
        return self.before + self.frames + self.dropped + self.counters.skipped
