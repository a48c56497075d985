"""Scores of a trial's reports: found or not, after how much sliding, and false ones."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import atan2, degrees, nan, remainder, tau

from cnnum.arrays import Floats
from cnnum.lab.scoring.trial import Flags, Trial, first, runs

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
        Of the reported direction against the true one; NaN if either is not known.
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
    found = trial.slides and at < len(said)
    twist = (answers["twist"] > 0) & trial.scored if "twist" in answers else said[:0]
    return Verdict(
        slides=trial.slides,
        found=found,
        slid=float(trial.slid[at]) if found else nan,
        delay=(at - onset) / trial.rate if found else nan,
        turned=_turned(trial, answers, at) if found else nan,
        false=sum(not _due(trial, start) for start, _ in runs(said)),
        twists=sum(not trial.sense[start:after].any() for start, after in runs(twist)),
        seconds=trial.seconds,
    )


def _due(trial: Trial, frame: int) -> bool:
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
