"""Shares, medians, areas under curves, and flags with hysteresis."""

from collections.abc import Sequence
from math import nan

import numpy as np
from scipy.stats import rankdata

from cnnum.arrays import Floats
from cnnum.lab.scoring.trial import Flags

MINUTES = 10.0
"""Time over which false reports are counted."""


def share(part: float, whole: float) -> float:
    """Return part/whole; NaN of nothing."""
    return part / whole if whole else nan


def median(values: Sequence[float]) -> float:
    """Return the median, the upper of two; NaN of nothing."""
    return sorted(values)[len(values) // 2] if values else nan


def per_ten_minutes(count: float, seconds: float) -> float:
    """Return the number of reports in ten minutes; NaN of no time."""
    return share(count * 60.0 * MINUTES, seconds)


def auc(with_label: Floats, without: Floats) -> float:
    """Return the area under the ROC curve.

    It is the chance that a number with the label is above one without; ties count half (Mann
    and Whitney). NaN where one of the two is missing.
    """
    high, low = len(with_label), len(without)
    if not high or not low:
        return nan
    ranks = float(rankdata(np.concatenate([with_label, without]))[:high].sum())
    return (ranks - high * (high + 1) / 2) / (high * low)


def latched(values: Floats, on: float, off: float, frames: int) -> Flags:
    """Return the flags of a bistable latch: on above a level, off when low for some frames.

    Parameters
    ----------
    values : (frames,) float
    on, off : float
        A value that is not above `off` is low.
    frames : int
        Low frames before the one in which the flag goes off.

    Returns
    -------
    (frames,) bool
    """
    place, high = np.arange(len(values)), values > off
    low_before = place - np.maximum.accumulate(np.where(high, place, -1)) - 1
    goes_on, goes_off = values > on, ~high & (low_before >= frames)
    decided = np.maximum.accumulate(np.where(goes_on | goes_off, place, -1))
    return np.asarray((decided >= 0) & goes_on[decided])
