"""The suites, put together: a request becomes tables."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cnnum.engine import Engine
from cnnum.errors import SceneError
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.family_tables import drawn, played, tables
from cnnum.lab.scoring.left_out import GRID, choices, left_out_table
from cnnum.lab.scoring.levels import level_table
from cnnum.lab.scoring.onsets import recorded_levels, report_table, trial_table
from cnnum.lab.scoring.recorded import flat_folders, uskin_folders
from cnnum.lab.scoring.recordings import Recorded, read, score_table
from cnnum.lab.scoring.subject import Answers, Subject
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


def score(request: Request, engine: Engine, advance: Advance = str) -> list[Table]:
    """Return the tables of everything that is asked for.

    Parameters
    ----------
    request : Request
    engine : Engine
    advance : callable
        Called with the name of whatever is done.

    Raises
    ------
    CnnumError
        Whatever is wrong with a scene, a trial or the device.
    """
    made = list[Table]()
    if "families" in request.suites:
        made += _families(request, engine, advance)
    if "recordings" in request.suites and request.recordings is not None:
        made += _recordings(request.recordings, request.objects, engine, advance)
    return made


def _families(request: Request, engine: Engine, advance: Advance) -> list[Table]:
    trials = drawn(request.count, request.seed, advance)
    scenes = played(Subject(engine), trials)
    made = [*tables(scenes), level_table(scenes)]
    if request.leave_one_out:
        made.append(left_out_table(choices(engine, trials, advance)))
    return made


def _recordings(
    root: Path, objects: tuple[str, ...] | None, engine: Engine, advance: Advance
) -> list[Table]:
    flat, uskin = read(root, objects, advance)
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
