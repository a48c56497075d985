"""The suites, put together: a request becomes tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Flags, Trial, runs
from cnnum.engine import Engine
from cnnum.errors import SceneError
from cnnum.lab.scoring.families.catalogue import FAMILIES, HANDS
from cnnum.lab.scoring.family_tables import drawn, played, tables
from cnnum.lab.scoring.hands import BUMPS, arrays_table, hands_table
from cnnum.lab.scoring.judge import judge, median, onsets, per_ten_minutes, share
from cnnum.lab.scoring.left_out import GRID, choices, left_out_table
from cnnum.lab.scoring.levels import LEVELS, level_table
from cnnum.lab.scoring.recorded import flat_folders, uskin_folders
from cnnum.lab.scoring.recordings import Recorded, read, score_table, turn_table
from cnnum.lab.scoring.subjects import Answers, Subject, reports, shipped_level
from cnnum.lab.scoring.table import Column, Row, Table
from cnnum.programs import Program

NO_PROGRAMS: Mapping[str, Program] = MappingProxyType({})

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
    Column("twists", "twists / 10 min still", 1),
)
NOTE = (
    "Slips of two frames or more, found by a report within 0.3 s of them. Delay and rows off: "
    "medians, of slips that begin while none is reported. False: reports that begin where the "
    "object is known to be still. Twists: reports of twist there, in ten minutes of it."
)


def report_table(groups: Mapping[str, tuple[Sequence[Trial], Sequence[Answers]]]) -> Table:
    """Return one row a group of trials."""
    rows = [_row(name, *group) for name, group in groups.items()]
    return Table("reports", "Reports in real recordings", NOTE, COLUMNS, rows)


def recorded_levels(trials: Sequence[Trial], answers: Sequence[Answers]) -> Table:
    """Return one row per level, all trials together."""
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
        "slips": sum(family_onsets.slips for family_onsets in all_onsets),
        "found": sum(family_onsets.found for family_onsets in all_onsets),
        "delay_s": median(
            [delay for family_onsets in all_onsets for delay in family_onsets.delays]
        ),
        "rows": median([float(abs(r)) for family_onsets in all_onsets for r in family_onsets.rows]),
        "false": per_ten_minutes(
            sum(verdict.false for verdict in verdicts), sum(verdict.seconds for verdict in verdicts)
        ),
        "twists": _twists(trials, answers),
    }


def _twists(trials: Sequence[Trial], answers: Sequence[Mapping[str, Floats]]) -> float:
    """Return the reports of twist in ten minutes in which the object is known to be still."""
    if not all("twist" in answer for answer in answers):
        return float("nan")
    count, seconds = 0, 0.0
    for trial, answer in zip(trials, answers, strict=True):
        still = trial.scored & (trial.slips == 0)
        count += sum(bool(still[start]) for start, _ in runs(answer["twist"] > 0))
        seconds += float(still.sum()) / trial.rate
    return per_ten_minutes(count, seconds)


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


SUITES = ("families", "hands", "recordings")

QUICK, USUAL = 1, 20
"""Scenes of every family."""

SCORING = 1_000_000
"""First seed of the scoring set. Seeds below are for tuning: whoever sets a constant of a program
by looking at results looks at those, and never at these."""

Advance = Callable[[str], object]


@dataclass(frozen=True, slots=True)
class Request:
    """A request for scores.

    Attributes
    ----------
    suites : tuple of str
    count, seed : int
        Scenes of every family, and the seed of the first one.
    leave_one_out : bool
        Whether constants are chosen without each family in turn.
    recordings : Path, optional
        Folder of the data sets.
    objects : tuple of str, optional
        Of the flat data set; all but those held back unless given.
    programs : mapping
        One's own programs, by the one of the library that each is judged instead of.
    """

    suites: tuple[str, ...]
    count: int = USUAL
    seed: int = SCORING
    leave_one_out: bool = False
    recordings: Path | None = None
    objects: tuple[str, ...] | None = None
    programs: Mapping[str, Program] = field(default_factory=dict[str, Program])

    def __post_init__(self) -> None:
        if "recordings" in self.suites and self.recordings is None:
            raise SceneError(
                "The suite 'recordings' needs real trials: set CNNUM_RECORDINGS to the folder "
                "that has them."
            )
        if self.leave_one_out and self.programs:
            raise SceneError(
                "Constants can be chosen only for the packaged slip program: leave out "
                "--leave-one-out, or your own program."
            )

    @property
    def steps(self) -> int:
        """Number of times that progress is reported."""
        count = 0
        if "families" in self.suites:
            count += len(FAMILIES) + len(GRID) * self.leave_one_out
        if "hands" in self.suites:
            count += len(HANDS) + 1
        if {"hands", "recordings"} & {*self.suites} and self.recordings is not None:
            count += len(flat_folders(self.recordings, self.objects))
            count += len(uskin_folders(self.recordings))
        return count


@dataclass(frozen=True, slots=True)
class Gathered:
    """Scenes that are drawn and trials that are read, as far as it has come.

    Attributes
    ----------
    families, hands : dict of str to list of Trial
    recorded : (list of Trial, list of Trial)
        Of the flat data set, and of uSkin.
    """

    families: dict[str, list[Trial]] = field(default_factory=dict[str, list[Trial]])
    hands: dict[str, list[Trial]] = field(default_factory=dict[str, list[Trial]])
    recorded: tuple[list[Trial], list[Trial]] = field(
        default_factory=lambda: (list[Trial](), list[Trial]())
    )

    def tables(self, engine: Engine, programs: Mapping[str, Program] = NO_PROGRAMS) -> list[Table]:
        """Return the figures of each family and trial that is there, none over all of them."""
        both = Subject(engine, programs=programs)
        made = tables(played(both, self.families)) if self.families else []
        made += [hands_table(engine, self.hands, {})] if self.hands else []
        flat, uskin = self.recorded
        groups = dict[str, tuple[Sequence[Trial], Sequence[Answers]]]()
        subject = Subject(engine, twists=False, programs=programs)
        if flat:
            groups |= _grouped(flat, subject.play(flat))
        if uskin:
            groups["uSkin trials"] = (uskin, subject.play(uskin))
        made += [report_table(groups)] if groups else []
        return [table for table in made if table.rows]


def score(
    request: Request, engine: Engine, advance: Advance = str, gathered: Gathered | None = None
) -> list[Table]:
    """Return the tables of everything that is asked for.

    Parameters
    ----------
    request : Request
    engine : Engine
    advance : callable
        Called with the name of each finished trial.
    gathered : Gathered, optional
        Takes in the scenes and trials as they come: a stopped run has its figures from them.

    Raises
    ------
    CnnumError
        From a scene, a trial or the device.
    """
    made, gathered = list[Table](), gathered or Gathered()
    if "families" in request.suites:
        made += _families(request, engine, advance, gathered)
    if "recordings" in request.suites and request.recordings is not None:
        made += _recordings(request, request.recordings, engine, advance, gathered)
    if "hands" in request.suites:
        made += _hands(request, engine, advance, gathered)
    return made


def _families(
    request: Request, engine: Engine, advance: Advance, gathered: Gathered
) -> list[Table]:
    trials = drawn(request.count, request.seed, advance, gathered.families)
    scenes = played(Subject(engine, programs=request.programs), trials)
    made = [*tables(scenes), level_table(scenes)]
    if request.leave_one_out:
        made.append(left_out_table(choices(engine, trials, advance)))
    return made


def _hands(request: Request, engine: Engine, advance: Advance, gathered: Gathered) -> list[Table]:
    families = (*HANDS, BUMPS)
    trials = drawn(request.count, request.seed, advance, gathered.hands, families)
    recorded = dict[str, list[Trial]]()
    if request.recordings is not None:
        flat, uskin = gathered.recorded
        if "recordings" not in request.suites:
            read(request.recordings, request.objects, advance, gathered.recorded)
        recorded["recorded: uSkin, still"] = [trial for trial in uskin if not trial.slides]
        recorded["recorded: uSkin, slips"] = [trial for trial in uskin if trial.slides]
        recorded["recorded: grasps"] = flat
    recorded = {name: some for name, some in recorded.items() if some}
    return [hands_table(engine, trials, recorded), arrays_table(engine, trials)]


def _recordings(
    request: Request,
    root: Path,
    engine: Engine,
    advance: Advance,
    gathered: Gathered,
) -> list[Table]:
    flat, uskin = read(root, request.objects, advance, gathered.recorded)
    subject = Subject(engine, programs=request.programs)
    recorded = Recorded(flat, uskin, subject.play(flat), subject.play(uskin))
    groups = _grouped(flat, recorded.flat_answers)
    if flat:
        groups["all objects"] = (flat, recorded.flat_answers)
    if uskin:
        groups["uSkin trials"] = (uskin, recorded.uskin_answers)
    made = [
        score_table(engine, recorded, tunes="slip" not in request.programs),
        report_table(groups),
    ]
    if flat:
        made += [turn_table(recorded), recorded_levels(flat, recorded.flat_answers)]
    if uskin:
        made.append(trial_table(uskin, recorded.uskin_answers))
    return made


def _grouped(
    trials: Sequence[Trial], answers: Sequence[Answers]
) -> dict[str, tuple[Sequence[Trial], Sequence[Answers]]]:
    names = dict.fromkeys(trial.family for trial in trials)
    pairs = list(zip(trials, answers, strict=True))
    return {
        name: (
            [trial for trial, _ in pairs if trial.family == name],
            [verdict for trial, verdict in pairs if trial.family == name],
        )
        for name in sorted(names, key=lambda text: (len(text), text))
    }
