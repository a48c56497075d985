"""The suites, put together: a request becomes tables."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cnnum.engine import Engine
from cnnum.errors import SceneError
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.family_tables import drawn, played, tables
from cnnum.lab.scoring.judged_programs import Answers, Subject
from cnnum.lab.scoring.left_out import GRID, choices, left_out_table
from cnnum.lab.scoring.levels import level_table
from cnnum.lab.scoring.onsets import recorded_levels, report_table, trial_table
from cnnum.lab.scoring.recorded import flat_folders, uskin_folders
from cnnum.lab.scoring.recordings import Recorded, read, score_table
from cnnum.lab.scoring.table import Table
from cnnum.lab.scoring.trial import Trial

SUITES = ("families", "recordings")

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
    """

    suites: tuple[str, ...]
    count: int = USUAL
    seed: int = SCORING
    leave_one_out: bool = False
    recordings: Path | None = None
    objects: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if "recordings" in self.suites and self.recordings is None:
            raise SceneError(
                "The suite 'recordings' needs real trials: set CNNUM_RECORDINGS to the folder "
                "that has them."
            )

    @property
    def steps(self) -> int:
        """Number of times that progress is reported."""
        count = 0
        if "families" in self.suites:
            count += len(FAMILIES) + len(GRID) * self.leave_one_out
        if "recordings" in self.suites and self.recordings is not None:
            count += len(flat_folders(self.recordings, self.objects))
            count += len(uskin_folders(self.recordings))
        return count


@dataclass(frozen=True, slots=True)
class Gathered:
    """Scenes that are drawn and trials that are read, as far as it has come.

    Attributes
    ----------
    families : dict of str to list of Trial
    recorded : (list of Trial, list of Trial)
        Of the flat data set, and of uSkin.
    """

    families: dict[str, list[Trial]] = field(default_factory=dict[str, list[Trial]])
    recorded: tuple[list[Trial], list[Trial]] = field(
        default_factory=lambda: (list[Trial](), list[Trial]())
    )

    def tables(self, engine: Engine) -> list[Table]:
        """Return the figures of each family and trial that is there, none over all of them."""
        made = tables(played(Subject(engine), self.families)) if self.families else []
        flat, uskin = self.recorded
        groups = dict[str, tuple[Sequence[Trial], Sequence[Answers]]]()
        subject = Subject(engine, twists=False)
        if flat:
            groups |= _grouped(flat, subject.play(flat))
        if uskin:
            groups["uSkin trials"] = (uskin, subject.play(uskin))
        made += [report_table(groups)] if groups else []
        return [each for each in made if each.rows]


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
        made += _recordings(request.recordings, request.objects, engine, advance, gathered)
    return made


def _families(
    request: Request, engine: Engine, advance: Advance, gathered: Gathered
) -> list[Table]:
    trials = drawn(request.count, request.seed, advance, gathered.families)
    scenes = played(Subject(engine), trials)
    made = [*tables(scenes), level_table(scenes)]
    if request.leave_one_out:
        made.append(left_out_table(choices(engine, trials, advance)))
    return made


def _recordings(
    root: Path,
    objects: tuple[str, ...] | None,
    engine: Engine,
    advance: Advance,
    gathered: Gathered,
) -> list[Table]:
    flat, uskin = read(root, objects, advance, gathered.recorded)
    subject = Subject(engine, twists=False)
    recorded = Recorded(flat, uskin, subject.play(flat), subject.play(uskin))
    groups = _grouped(flat, recorded.flat_answers)
    if flat:
        groups["all objects"] = (flat, recorded.flat_answers)
    if uskin:
        groups["uSkin trials"] = (uskin, recorded.uskin_answers)
    made = [score_table(engine, recorded), report_table(groups)]
    if flat:
        made.append(recorded_levels(flat, recorded.flat_answers))
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
            [each for trial, each in pairs if trial.family == name],
        )
        for name in sorted(names, key=lambda text: (len(text), text))
    }
