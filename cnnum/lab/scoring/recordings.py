"""Labelled real trials: uSkin pads that hold an object, with and without slip."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.errors import RecordingError
from cnnum.lab.scoring.measures import Measure, auc, share
from cnnum.lab.scoring.worst import Failing
from cnnum.report.verdicts import held
from cnnum.scenes.events import Event
from cnnum.scenes.pipeline import FrameResult, load_scene

SUITE = "recordings"
SCENE = "uskin_grasp"
"""The scene that comes with the package: one setting for all trials."""

PAD_FILE = "xela_sensor1.csv"
"""By which a folder is known as a trial."""

NEAR = 6
"""Rows between a label and a report."""

POOLED, FALSE = 0.96, 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A trial as it went.

    Attributes
    ----------
    name : str
    slip : (rows,) bool
        The label.
    kept : (rows,) bool
        Whether the object is not yet lost.
    strength : (rows,) float
        `slip_strength`; in a row that repeats a scan, that of the row before.
    reports : tuple of int
        Rows before the loss in which gross slip was reported.
    """

    name: str
    slip: Floats
    kept: Floats
    strength: Floats
    reports: tuple[int, ...]

    @property
    def onsets(self) -> tuple[int, ...]:
        """First row of every labelled slip before the loss."""
        return tuple(first for first, _ in held(self.slip * self.kept))


def trials_in(folder: Path) -> tuple[Path, ...]:
    """Return the folders of trials at or below a folder, in order.

    Raises
    ------
    RecordingError
        If there is none.
    """
    found = sorted(file.parent for file in folder.rglob(PAD_FILE))
    if not found:
        raise RecordingError(
            f"Expected folders of uSkin trials in '{folder}', got none with a '{PAD_FILE}': name "
            "a folder that has them, or set CNNUM_RECORDINGS to it."
        )
    return tuple(found)


def play_trial(folder: Path, engine: Engine) -> Trial:
    """Run the program of the scene over a trial.

    Raises
    ------
    CnnumError
        If the trial cannot be read, or nobody labelled it.
    """
    scene = load_scene(SCENE, engine=engine, changes={"array.path": str(folder.resolve())})
    moments = list(scene.results())
    truths = [moment.frame.truth for moment in moments]
    if any(truth is None for truth in truths):
        raise RecordingError(
            f"Trial '{folder}' has no 'slip_label.csv': expected a label a row; leave it out."
        )
    known = [truth for truth in truths if truth is not None]
    kept = np.array([float(truth["fail"] == 0) for truth in known])
    events = [event for moment in moments for event in moment.events]
    return Trial(
        name=folder.name,
        slip=np.array([float(truth["slip"] > 0) for truth in known]),
        kept=kept,
        strength=np.array(_strengths(moments)),
        reports=tuple(e.frame for e in events if _gross(e) and kept[e.frame] > 0),
    )


def _gross(event: Event) -> bool:
    return event.kind == "slip" and event.phase == "gross"


def _strengths(moments: Sequence[FrameResult]) -> list[float]:
    """Return the strength in every row, carried over repeats."""
    found, last = list[float](), 0.0
    for moment in moments:
        last = float(moment.outputs["slip_strength"]) if moment.outputs else last
        found.append(last)
    return found


def recording_measures(trials: Sequence[Trial]) -> Iterator[Measure]:
    """Yield what the trials came to."""
    kept = [trial.kept > 0 for trial in trials]
    scores = np.concatenate([t.strength[k] for t, k in zip(trials, kept, strict=True)])
    labels = np.concatenate([t.slip[k] for t, k in zip(trials, kept, strict=True)])
    yield Measure(
        "slip_strength against the label before the loss: pooled AUC",
        SUITE,
        auc(scores, labels),
        scores.size,
        "rows",
        POOLED,
    )
    away = [abs(delay) for trial in trials for delay in delays(trial)]
    onsets = sum(len(trial.onsets) for trial in trials)
    near = sum(delay <= NEAR for delay in away)
    name = f"slip onsets within {NEAR} rows of the label"
    yield Measure(name, SUITE, share(near, onsets), onsets, target=1.0)
    largest = float(max(away)) if away and len(away) == onsets else float("nan")
    yield Measure("slip onset against the label, largest", SUITE, largest, onsets, "rows")
    quiet = [trial for trial in trials if not trial.onsets]
    alarms = float(sum(len(trial.reports) for trial in quiet))
    name = "false reports in trials without slip"
    yield Measure(name, SUITE, alarms, len(quiet), "reports", FALSE, "at most")
    others = [trial for trial in trials if trial.onsets]
    extra = float(sum(len(extra_reports(trial)) for trial in others))
    yield Measure("other reports in trials with slip", SUITE, extra, len(others), "reports")


def delays(trial: Trial) -> list[int]:
    """Return, for each onset that has a report, the rows from it to the nearest one."""
    if not trial.reports:
        return []
    return [min((r - onset for r in trial.reports), key=abs) for onset in trial.onsets]


def extra_reports(trial: Trial) -> list[int]:
    """Return reports that are near no onset."""
    return [r for r in trial.reports if all(abs(r - onset) > NEAR for onset in trial.onsets)]


def failing_trials(trials: Sequence[Trial]) -> list[Failing]:
    """Return the trials in which something went wrong."""
    found = [Failing(SUITE, trial.name, None, tuple(_faults(trial))) for trial in trials]
    return [item for item in found if item.wrong]


def _faults(trial: Trial) -> Iterator[str]:
    for row in extra_reports(trial):
        yield f"slip reported in row {row}, where none begins"
    for onset in trial.onsets:
        delay = min((r - onset for r in trial.reports), key=abs, default=None)
        if delay is None:
            yield f"slip from row {onset} on missed"
        elif abs(delay) > NEAR:
            yield f"slip from row {onset} on reported {delay:+d} rows away"
