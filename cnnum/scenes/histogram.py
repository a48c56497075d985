"""Quantiles of as many numbers as come, in bounded memory."""

import math

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
