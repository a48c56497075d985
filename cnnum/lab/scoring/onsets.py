"""Reports in real trials: which begin where a slip does, and which where nothing slips."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.scoring.judge import judge
from cnnum.lab.scoring.judged_programs import Answers, reports, shipped_level
from cnnum.lab.scoring.levels import LEVELS
from cnnum.lab.scoring.measures import median, per_ten_minutes, share
from cnnum.lab.scoring.table import Column, Row, Table
from cnnum.lab.scoring.trial import Flags, Trial, runs

SHORTEST = 2
"""Frames of a slip at least; a shorter one may be the camera's noise."""

AROUND = 0.3
"""s around a slip in which a report is of it."""

ROWS, QUIET = 10.0, 0.25
"""Aims: rows between the onset of a slip and its report; share of trials without slip that have
a report."""

COLUMNS = (
    Column("group", "object"),
    Column("trials", "trials"),
    Column("quiet", "without slip"),
    Column("quiet_reported", "of them reported"),
    Column("quiet_share", "share", 2, most=QUIET),
    Column("slips", "slips"),
    Column("found", "found"),
    Column("delay_s", "delay, s"),
    Column("rows", "rows off", 0, most=ROWS),
    Column("false", "false / 10 min", 1),
)
NOTE = (
    "Slips of two frames or more, found by a report within 0.3 s of them. Delay and rows off: "
    "medians, of slips that begin while none is reported. False: reports that begin where the "
    "object is known to be still."
)


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
    near, slips, found = round(AROUND * trial.rate), 0, 0
    delays, rows = list[float](), list[int]()
    for start, after in runs(trial.scored & (trial.slips == 1)):
        if after - start < SHORTEST:
            continue
        slips += 1
        window = slice(max(0, start - near), after + near)
        found += bool(said[window].any())
        begins = [first for first, _ in runs(said) if window.start <= first < window.stop]
        if begins and not said[window.start]:
            delays.append((begins[0] - start) / trial.rate)
            rows.append(int(trial.rows[begins[0]] - trial.rows[start]))
    return Onsets(slips, found, tuple(delays), tuple(rows))


def report_table(groups: Mapping[str, tuple[Sequence[Trial], Sequence[Answers]]]) -> Table:
    """Return one row a group of trials."""
    rows = [_row(name, *group) for name, group in groups.items()]
    return Table("reports", "Reports in real recordings", NOTE, COLUMNS, rows)


def recorded_levels(trials: Sequence[Trial], answers: Sequence[Answers]) -> Table:
    """Return one row a level, all trials together."""
    rows: list[Row] = []
    for level in sorted({*LEVELS, shipped_level()}):
        said = [
            {**a, "gross_slip": reports(a["slip_strength"], level, t.rate).astype(np.float64)}
            for t, a in zip(trials, answers, strict=True)
        ]
        rows.append({**_row("", trials, said), "group": level})
    columns = (Column("group", "level"), *(replace(column, most=None) for column in COLUMNS[1:]))
    return Table("recorded-levels", "Level against real reports", NOTE, columns, rows)


def _row(name: str, trials: Sequence[Trial], answers: Sequence[Mapping[str, Floats]]) -> Row:
    said = [(a["gross_slip"] > 0) & t.scored for t, a in zip(trials, answers, strict=True)]
    quiet = [flags for trial, flags in zip(trials, said, strict=True) if not trial.slides]
    reported = sum(bool(flags.any()) for flags in quiet)
    all_onsets = [onsets(trial, flags) for trial, flags in zip(trials, said, strict=True)]
    verdicts = [judge(t, a, f) for t, a, f in zip(trials, answers, said, strict=True)]
    return {
        "group": name,
        "trials": len(trials),
        "quiet": len(quiet),
        "quiet_reported": reported,
        "quiet_share": share(reported, len(quiet)),
        "slips": sum(one.slips for one in all_onsets),
        "found": sum(one.found for one in all_onsets),
        "delay_s": median([delay for one in all_onsets for delay in one.delays]),
        "rows": median([float(abs(r)) for one in all_onsets for r in one.rows]),
        "false": per_ten_minutes(
            sum(one.false for one in verdicts), sum(one.seconds for one in verdicts)
        ),
    }


TRIAL_COLUMNS = (
    Column("trial", "trial"),
    Column("labelled", "slip by label, rows"),
    Column("reported", "reported, rows"),
)


def trial_table(trials: Sequence[Trial], answers: Sequence[Answers]) -> Table:
    """Return the labels and reports of each trial, in rows of its log."""
    rows: list[Row] = [
        {
            "trial": trial.name,
            "labelled": _spans(trial, trial.slips == 1),
            "reported": _spans(trial, answer["gross_slip"] > 0),
        }
        for trial, answer in zip(trials, answers, strict=True)
    ]
    note = "Until the object is lost."
    return Table("uskin", "The labelled uSkin trials", note, TRIAL_COLUMNS, rows)


def _spans(trial: Trial, flags: Flags) -> str:
    spans = runs(flags & trial.scored)
    text = ", ".join(f"{trial.rows[a]}–{trial.rows[b - 1]}" for a, b in spans)
    return text or "none"
