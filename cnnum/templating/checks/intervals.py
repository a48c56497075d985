"""Confidence intervals of shares that were counted."""

import math

DEVIATIONS = 1.959963984540054
"""Standard deviations on both sides of the mean of a normal number that hold 95 % of it."""


def wilson(hits: int, draws: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927), which holds for 0 hits and for all too.

    Parameters
    ----------
    hits, draws : int
        How often it was so, of how many.
    """
    squared = DEVIATIONS**2 / draws
    share = hits / draws
    middle = (share + squared / 2.0) / (1.0 + squared)
    half = math.sqrt(squared * (share * (1.0 - share) + squared / 4.0)) / (1.0 + squared)
    return max(0.0, middle - half), min(1.0, middle + half)
