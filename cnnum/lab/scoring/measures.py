"""A measure: one figure, what it should reach, and over how many cases it was taken."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import Literal

import numpy as np
from scipy.stats import rankdata

from cnnum.arrays import Floats

Rule = Literal["at least", "at most"]


@dataclass(frozen=True, slots=True)
class Measure:
    """One figure.

    Attributes
    ----------
    measure, suite : str
    value : float
        NaN where there was nothing to measure.
    count : int
        Events, episodes, frames or scenes behind it.
    unit : str
    target : float or None
    rule : "at least" or "at most"
        How the value must stand to the target.
    group : str
        What part of the suite it is of; empty for all of it.
    detail : bool
        Whether it can be left out where space is short.
    """

    measure: str
    suite: str
    value: float
    count: int
    unit: str = ""
    target: float | None = None
    rule: Rule = "at least"
    group: str = ""
    detail: bool = False

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached; None without one. What was not measured reaches none."""
        if self.target is None:
            return None
        if self.rule == "at least":
            return self.value >= self.target
        return self.value <= self.target

    def record(self) -> dict[str, object]:
        """Return it as a JSON object."""
        about: dict[str, object] = {"group": self.group} if self.group else {}
        return {
            "measure": self.measure,
            "suite": self.suite,
            "value": self.value,
            "target": self.target,
            "rule": self.rule if self.target is not None else None,
            "reached": self.reached,
            "count": self.count,
            "unit": self.unit,
            **about,
        }


def share(part: float, whole: float) -> float:
    """Return part/whole; NaN of nothing."""
    return part / whole if whole else nan


def quantile(values: Sequence[float], place: float) -> float:
    """Return a quantile; NaN of nothing."""
    return float(np.quantile(values, place)) if values else nan


def auc(scores: Floats, labels: Floats) -> float:
    """Return the area under the ROC curve of a score against labels.

    It is the chance that a score with the label is above one without; ties count half (Mann and
    Whitney). NaN where one of the two is missing.

    Parameters
    ----------
    scores : (n,) float
    labels : (n,) float
        Above 0 with the label.
    """
    with_label = np.asarray(labels) > 0
    high, low = int(with_label.sum()), int((~with_label).sum())
    if not high or not low:
        return nan
    ranks = float(rankdata(scores)[with_label].sum())
    return (ranks - high * (high + 1) / 2) / (high * low)
