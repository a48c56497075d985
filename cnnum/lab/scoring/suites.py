"""The suites, put together: what is asked for becomes a report."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path

from cnnum.engine import Engine
from cnnum.errors import SceneError
from cnnum.lab.scoring.alarms import alarm_measures
from cnnum.lab.scoring.confusion import confusion_measures
from cnnum.lab.scoring.events import event_measures, strength_measures, warning_measures
from cnnum.lab.scoring.generated.batches import Player
from cnnum.lab.scoring.generated.case import SCORING, Case
from cnnum.lab.scoring.generated.scripts import held_case, slip_case
from cnnum.lab.scoring.groups import group_measures
from cnnum.lab.scoring.judge import Judgement, judge
from cnnum.lab.scoring.measures import Measure
from cnnum.lab.scoring.recordings import (
    Trial,
    failing_trials,
    play_trial,
    recording_measures,
    trials_in,
)
from cnnum.lab.scoring.scenes import play_scene
from cnnum.lab.scoring.twists import twist_measures
from cnnum.lab.scoring.worst import Failing, failing

SUITES = ("slip", "false-alarms", "recordings", "all")

QUICK, FULL = 24, 300
"""Scenes of the suite "slip", unless told, and of a run that is to be published."""

HELD_SHARE = 3
"""Scenes that slip for one in which an object is held: 300 of them go with ten minutes."""


@dataclass(frozen=True, slots=True)
class Request:
    """What is to be scored.

    Attributes
    ----------
    suites : tuple of str
    scenes : tuple of str
        Names or files.
    recordings : tuple of Path
        Folders of trials.
    count : int
        Scenes of the suite "slip"; a third as many of "false-alarms", unless that is alone.
    seed : int
        Of the first scene.
    program : str
    """

    suites: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    recordings: tuple[Path, ...] = ()
    count: int = QUICK
    seed: int = SCORING
    program: str = "tactile"

    def __post_init__(self) -> None:
        if "recordings" in self.suites and not self.recordings:
            raise SceneError(
                "The suite 'recordings' needs a folder of trials: name one, or set "
                "CNNUM_RECORDINGS."
            )

    def cases(self) -> tuple[Case, ...]:
        """Return the generated scenes that are asked for."""
        slips = range(self.seed, self.seed + self.count) if "slip" in self.suites else range(0)
        some = ceil(self.count / HELD_SHARE) if "slip" in self.suites else self.count
        held = range(self.seed, self.seed + some) if "false-alarms" in self.suites else range(0)
        return (*map(slip_case, slips), *map(held_case, held))

    def trials(self) -> tuple[Path, ...]:
        """Return the trials that are asked for.

        Raises
        ------
        RecordingError
            If a folder has none.
        """
        return tuple(trial for folder in self.recordings for trial in trials_in(folder))


@dataclass(frozen=True, slots=True)
class Report:
    """What a request came to.

    Attributes
    ----------
    measures : tuple of Measure
        Whole suites first; those of groups name theirs.
    failing : tuple of Failing
        The worst scenes of each suite first.
    """

    measures: tuple[Measure, ...]
    failing: tuple[Failing, ...] = field(default=())

    def records(self) -> Iterator[dict[str, object]]:
        """Yield all of it as JSON objects: a measure each, then a scene that went wrong each."""
        yield from (measure.record() for measure in self.measures)
        yield from (item.record() for item in self.failing)

    @property
    def missed(self) -> tuple[Measure, ...]:
        """Measures whose target is not reached."""
        return tuple(measure for measure in self.measures if measure.reached is False)


def score(
    request: Request, engine: Engine, advance: Callable[[str], object] = lambda _: None
) -> Report:
    """Play and judge everything that is asked for.

    Parameters
    ----------
    request : Request
    engine : Engine
    advance : callable
        Told the name of every scene that is done.

    Raises
    ------
    CnnumError
        Whatever is wrong with a scene, a trial or the device.
    """
    measures, wrong = list[Measure](), list[Failing]()
    judged: dict[str, list[Judgement]] = {}
    for play in Player(engine, request.program).play(request.cases()):
        judged.setdefault(play.suite, []).append(judge(play))
        advance(play.name)
    for name in request.scenes:
        play = play_scene(name, engine)
        judged.setdefault(play.suite, []).append(judge(play))
        advance(name)
    for suite, ones in judged.items():
        measures += suite_measures(suite, ones)
        wrong += failing(ones)
    trials = list[Trial]()
    for folder in request.trials():
        trials.append(play_trial(folder, engine))
        advance(folder.name)
    if trials:
        measures += recording_measures(trials)
        wrong += failing_trials(trials)
    return Report(tuple(measures), tuple(wrong))


def suite_measures(suite: str, judged: Sequence[Judgement]) -> Iterator[Measure]:
    """Yield all measures of a suite of plays."""
    if suite == "false-alarms":
        yield from alarm_measures(suite, judged, target=0.0)
        yield from confusion_measures(suite, judged)
        return
    yield from event_measures(suite, judged)
    yield from warning_measures(suite, judged)
    yield from strength_measures(suite, judged)
    yield from twist_measures(suite, judged)
    yield from confusion_measures(suite, judged)
    yield from alarm_measures(suite, judged)
    yield from group_measures(suite, judged)
