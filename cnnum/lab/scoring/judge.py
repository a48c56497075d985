"""Scores of a trial's reports: found or not, after how much sliding, and false ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2, degrees, nan, remainder, tau

import numpy as np
from scipy.stats import rankdata

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Flags, Trial, first, runs

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


EARLY = 0.1
"""s before a slip from which on a report is no false one."""

GONE = 0.1
"""s after a slip until which a report that begins is no false one."""

NEAR = 0.3e-3
"""m of sliding within which a slip should be reported."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """A trial's reports against its truth.

    Attributes
    ----------
    slides : bool
        Whether the object slips.
    found : bool
        Whether slip is reported at any time while the object slips.
    slid : float, m
        Sliding before that report; NaN without one.
    delay : float, s
        From the onset to that report; NaN without one.
    turned : float, degrees
        Angle from the true to the reported direction; NaN if either is unknown.
    false : int
        Reports of slip that begin where nothing slips.
    twists : int
        Reports of twist that begin where nothing twists.
    seconds : float, s
        How long reports counted.
    """

    slides: bool
    found: bool
    slid: float
    delay: float
    turned: float
    false: int
    twists: int
    seconds: float


def judge(trial: Trial, answers: Mapping[str, Floats], flags: Flags | None = None) -> Verdict:
    """Return the scores of the reports of slip.

    Parameters
    ----------
    trial : Trial
    answers : mapping
        Outputs of the programs, (frames,) each.
    flags : (frames,) bool, optional
        Slip as reported; the program's own unless given.
    """
    said = (answers["gross_slip"] > 0 if flags is None else flags) & trial.scored
    onset = trial.onset
    at = onset + first(said[onset:])
    result = trial.slides and at < len(said)
    twist = (answers["twist"] > 0) & trial.scored if "twist" in answers else said[:0]
    return Verdict(
        slides=trial.slides,
        found=result,
        slid=float(trial.slid[at]) if result else nan,
        delay=(at - onset) / trial.rate if result else nan,
        turned=_turned(trial, answers, at) if result else nan,
        false=sum(not due(trial, start) for start, _ in runs(said)),
        twists=sum(not trial.sense[start:after].any() for start, after in runs(twist)),
        seconds=trial.seconds,
    )


def due(trial: Trial, frame: int) -> bool:
    """Return whether a report may begin at a frame: slip is near, or its truth is not known."""
    before, after = round(GONE * trial.rate), round(EARLY * trial.rate)
    near = slice(max(0, frame - before), frame + after + 1)
    return bool((trial.slips[near] != 0).any() or trial.early[frame])


def _turned(trial: Trial, answers: Mapping[str, Floats], at: int) -> float:
    if trial.direction != trial.direction:
        return nan
    reported = atan2(float(answers["slip_y"][at]), float(answers["slip_x"][at]))
    return abs(degrees(remainder(reported - trial.direction, tau)))


def sense_right(trial: Trial, answers: Mapping[str, Floats]) -> bool:
    """Return whether a twist is reported, in its own sense and no other."""
    said = (answers["twist"] > 0) & trial.scored
    true = trial.sense[trial.sense != 0]
    return bool(said.any() and (answers["twist_sense"][said] == true[0]).all())


SHORTEST = 2
"""Frames of a slip at least; a shorter one may be the camera's noise."""

AROUND = 0.3
"""s around a slip in which a report is of it."""


@dataclass(frozen=True, slots=True)
class Onsets:
    """The slips of a trial against its reports.

    Attributes
    ----------
    slips, found : int
    delays : tuple of float, s
        From each onset that begins without a report to the report of it.
    rows : tuple of int
        The same in rows of the log.
    """

    slips: int
    found: int
    delays: tuple[float, ...]
    rows: tuple[int, ...]


def onsets(trial: Trial, said: Flags) -> Onsets:
    """Match the reports of a trial to its slips."""
    near, slips, result = round(AROUND * trial.rate), 0, 0
    delays, rows = list[float](), list[int]()
    for start, after in runs(trial.scored & (trial.slips == 1)):
        if after - start < SHORTEST:
            continue
        slips += 1
        window = slice(max(0, start - near), after + near)
        result += bool(said[window].any())
        begins = [first for first, _ in runs(said) if window.start <= first < window.stop]
        if begins and not said[window.start]:
            delays.append((begins[0] - start) / trial.rate)
            rows.append(int(trial.rows[begins[0]] - trial.rows[start]))
    return Onsets(slips, result, tuple(delays), tuple(rows))
