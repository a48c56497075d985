"""The suite "recordings": scores of real trials with each object left out, and their reports."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Trial
from cnnum.engine import Engine
from cnnum.errors import RecordingError
from cnnum.lab.scoring.judge import auc
from cnnum.lab.scoring.left_out import GRID
from cnnum.lab.scoring.recorded import (
    FLAT,
    USKIN,
    flat_folders,
    flat_trial,
    uskin_folders,
    uskin_trial,
)
from cnnum.lab.scoring.subjects import MORE, TWIST, Answers, Subject
from cnnum.lab.scoring.table import Column, Row, Table

WINDOWS = (1, 5)
"""Frames over which a change of shear is averaged."""

LEARNED_WINDOWS = (1, 2, 5)

FAINT = 20.0
"""Counts, added to the load that something is divided by."""

RIDGE = 0.1
"""Inverse weight of the regression's penalty."""


def shear_change(trial: Trial, window: int, *, incoherent: bool, over_load: bool = False) -> Floats:
    """Return the mean change of shear from frame to frame, over the last frames.

    Parameters
    ----------
    trial : Trial
        Pads side by side.
    window : int
        Frames.
    incoherent : bool
        Whether the pad's mean change is taken off.
    over_load : bool
        Whether it is divided by the mean load of a taxel.

    Returns
    -------
    (frames,) float
    """
    change = _change_of_frames(trial)[..., :2]
    change = change - change.mean(axis=(2, 3), keepdims=True) if incoherent else change
    result = _averaged(np.sqrt((change**2).sum(axis=-1).mean(axis=(1, 2, 3))), window)
    return result / (_load(trial) + FAINT) if over_load else result


def _load(trial: Trial) -> Floats:
    """Return the mean load of a taxel above the first frames."""
    pads = _pads(trial)
    values: Floats = np.abs((pads - pads[:4].mean(axis=0))[..., 2].mean(axis=(2, 3))).mean(axis=1)
    return values


def features(trial: Trial) -> Floats:
    """Return logarithms of changes, load and friction in use, (frames, features)."""
    pads = _pads(trial)
    load = _load(trial)
    shear = (pads - pads[:4].mean(axis=0))[..., :2].mean(axis=(2, 3))
    pull = np.sqrt((shear**2).sum(axis=-1)).mean(axis=1)
    normal = _change_of_frames(trial)[..., 2]
    mean = normal.mean(axis=(2, 3), keepdims=True)
    grows, shifts = np.abs(mean).mean(axis=(1, 2, 3)), np.abs(normal - mean).mean(axis=(1, 2, 3))
    columns = [np.log(load + FAINT), np.log(pull + 3.0) - np.log(load + FAINT)]
    for window in LEARNED_WINDOWS:
        columns += [
            np.log(shear_change(trial, window, incoherent=False) + 0.5),
            np.log(shear_change(trial, window, incoherent=True) + 0.5),
            np.log(_averaged(grows, window) + 0.5),
            np.log(_averaged(shifts, window) + 0.5),
        ]
    return np.stack(columns, axis=-1)


def can_learn() -> bool:
    """Return whether scikit-learn (extra `texture`) is there."""
    return find_spec("sklearn") is not None


def regression(learned: Sequence[Trial], judged: Sequence[Trial]) -> list[Floats]:
    """Return a logistic regression's score on trials, learned on others.

    Parameters
    ----------
    learned, judged : sequence of Trial

    Returns
    -------
    list of (frames,) float
    """
    known = [trial.scored & np.isfinite(trial.slips) for trial in learned]
    x = np.concatenate([features(t)[k] for t, k in zip(learned, known, strict=True)])
    y = np.concatenate([t.slips[k] for t, k in zip(learned, known, strict=True)])
    middle, spread = x.mean(axis=0), x.std(axis=0) + 1e-9
    linear: Any = import_module("sklearn.linear_model")
    model = linear.LogisticRegression(C=RIDGE, class_weight="balanced", max_iter=500)
    model.fit((x - middle) / spread, y)
    return [model.decision_function((features(t) - middle) / spread) for t in judged]


def _pads(trial: Trial) -> Floats:
    """Return (frames, pads, rows, cols, 3) readings."""
    count = int(trial.setting.get("pads", 1))
    return np.stack(np.split(trial.frames.astype(np.float64), count, axis=2), axis=1)


def _change_of_frames(trial: Trial) -> Floats:
    pads = _pads(trial)
    return np.diff(pads, axis=0, prepend=pads[:1])


def _averaged(values: Floats, window: int) -> Floats:
    """Return the mean of the last values, of fewer at the start."""
    total, place = np.concatenate([[0.0], np.cumsum(values)]), np.arange(len(values))
    start = np.maximum(place - window + 1, 0)
    return np.asarray((total[place + 1] - total[start]) / (place + 1 - start))


POOLED, USKIN_AUC = 0.90, 0.96
"""Aims."""

SHIPPED, CHOSEN = "slip_strength", "constants chosen without the object"
"""Rows of the program; the others are baselines."""

NOTE = (
    "Area under the ROC curve of the frames in which an object is held. Its marker moves faster "
    "than 6 mm/s (slip) or slower than 1.5 mm/s (none). A number is an object."
)
Advance = Callable[[str], object]
Scores = dict[str, list[Floats]]
"""Scores of the trials, in order, by row of the table."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """Real trials, with the program's outputs.

    Attributes
    ----------
    flat, uskin : list of Trial
    flat_answers, uskin_answers : list of Answers
    """

    flat: list[Trial]
    uskin: list[Trial]
    flat_answers: list[Answers]
    uskin_answers: list[Answers]


def read(
    root: Path,
    objects: tuple[str, ...] | None,
    advance: Advance,
    trials: tuple[list[Trial], list[Trial]] | None = None,
) -> tuple[list[Trial], list[Trial]]:
    """Return the trials of the two data sets in a folder, those that are there.

    Parameters
    ----------
    root : Path
        With the folders "uskin_grasp" and "tactile_prediction_flat_dataset".
    objects : tuple of str, optional
        Of the flat data set; all but those held back unless given.
    advance : callable
        Called with the name of every trial that is read.
    found : (list, list), optional
        Takes each trial in as it comes, so that those of a run that is stopped are not lost.

    Raises
    ------
    RecordingError
        If there is neither, or no trial of these objects.
    CnnumError
        If a file is not as it should be.
    """
    flat, uskin = flat_folders(root, objects), uskin_folders(root)
    if not flat and not uskin:
        raise RecordingError(
            f"Expected '{USKIN}' or '{FLAT}' with trials in '{root}', got neither: set "
            "CNNUM_RECORDINGS to the folder that has them."
        )
    trials = ([], []) if trials is None else trials
    for place, (folders, load) in enumerate(((flat, flat_trial), (uskin, uskin_trial))):
        for folder in folders:
            trials[place].append(load(folder))
            advance(folder.path.name)
    return trials


def score_table(engine: Engine, recorded: Recorded, *, tunes: bool = True) -> Table:
    """Return the areas under the curve of the program and of its baselines."""
    rows = _shipped(recorded)
    rows |= {name: _change(recorded, *how) for name, how in CHANGES.items()}
    if recorded.flat:
        if tunes:  # the constants are those of the shipped program
            rows[CHOSEN] = _chosen(engine, recorded.flat), []
        if can_learn():
            rows["logistic regression without the object"] = _learned(recorded.flat), []
    objects = sorted({trial.family for trial in recorded.flat}, key=_number)
    columns = (
        Column("score", "score"),
        Column("pooled", "pooled", 3, least=POOLED),
        *(Column(f"object_{name}", name, 3) for name in objects),
        Column("uskin", "uSkin trials", 3, least=USKIN_AUC),
    )
    made = [_row(name, recorded, objects, *scores) for name, scores in rows.items()]
    missing = "" if can_learn() else " scikit-learn is missing: no regression."
    return Table("recordings", "Real recordings", NOTE + missing, columns, made)


CHANGES = {
    f"{name}{' over load' * over}, {window} frame{'s' * (window > 1)}": (window, incoherent, over)
    for over in (False, True)
    for name, incoherent in (("mean change of shear", False), ("incoherent change", True))
    for window in WINDOWS
}


def _shipped(recorded: Recorded) -> dict[str, tuple[list[Floats], list[Floats]]]:
    answers = (recorded.flat_answers, recorded.uskin_answers)
    flat, uskin = ([answer["slip_strength"] for answer in some] for some in answers)
    return {SHIPPED: (flat, uskin)}


def _change(
    recorded: Recorded, window: int, incoherent: bool, over_load: bool
) -> tuple[list[Floats], list[Floats]]:
    flat, uskin = (
        [
            shear_change(trial, window, incoherent=incoherent, over_load=over_load)
            for trial in trials
        ]
        for trials in (recorded.flat, recorded.uskin)
    )
    return flat, uskin


TURNS, SLIDES = 20.0, 8.0
"""Degrees/s from which a slip is a pivot, and below which it is a slide."""


BINS = (6e-3, 10e-3, 15e-3, 25e-3, 60e-3)
"""m/s: between two of these, marks on pivots are compared with marks on slides that are as fast."""

TURNED = ("slip_turning", "slip_pivots", "twist_strength")
"""Further outputs that are scored against the turning of the marker."""

LEAVES, TREES = 8, 100
"""Leaves and number of the boosted trees."""


def turn_table(recorded: Recorded) -> Table:
    """Return the areas under the curve of slides and of pivots apart, and of one against the other.

    A trial counts for itself where it has both slips and rest of six frames or more.
    """
    rows = {name: scores for name, (scores, _) in _shipped(recorded).items()}
    for name in TURNED:
        if all(name in answers for answers in recorded.flat_answers):
            rows[name] = [answers[name] for answers in recorded.flat_answers]
    rows |= {name: _change(recorded, *how)[0] for name, how in CHANGES.items()}
    rows["change of curl over load, 1 frame"] = [curl_change(t) for t in recorded.flat]
    if all(trial.speed is not None for trial in recorded.flat):
        rows["true speed of the marker"] = [
            np.nan_to_num(np.asarray(trial.speed)) for trial in recorded.flat
        ]
    if can_learn() and len({trial.family for trial in recorded.flat}) > 1:
        moments = [np.hstack([features(t), np.log(_moments(t) + 1e-3)]) for t in recorded.flat]
        rows["boosted trees without the object"] = _trees(recorded.flat, moments)
        if all({*MORE[TWIST]} <= {*answers} for answers in recorded.flat_answers):
            read = [np.stack([a[n] for n in MORE[TWIST]], axis=1) for a in recorded.flat_answers]
            rows["boosted trees of the read-outs of twist"] = _trees(recorded.flat, read)
    columns = (
        Column("score", "score"),
        Column("slides", f"slides (< {SLIDES:g}°/s) against none", 3),
        Column("pivots", f"pivots (> {TURNS:g}°/s) against none", 3),
        Column("apart", "pivots against slides", 3, least=APART),
        Column("apart_of_all", "pivots against all other slips", 3),
        Column("as_fast", "the same of marks as fast", 3),
        Column("within", "slips within a trial", 3),
    )
    note = "Of the flat data set, all objects together, by the turning of the marker."
    made = [_turn_row(name, recorded.flat, scores) for name, scores in rows.items()]
    return Table("turns", "Slides and pivots apart", note, columns, made)


APART = 0.85
"""Aim of pivots against slides."""


def _turn_row(name: str, trials: Sequence[Trial], scores: Sequence[Floats]) -> Row:
    parts: dict[str, list[Floats]] = {key: [] for key in ("none", "slide", "pivot", "between")}
    speeds: dict[str, list[Floats]] = {key: [] for key in parts}
    within = list[float]()
    for trial, score in zip(trials, scores, strict=True):
        unknown = np.full(len(score), np.nan)
        turning = unknown if trial.turning is None else trial.turning
        speed = unknown if trial.speed is None else trial.speed
        slips, none = trial.scored & (trial.slips == 1), trial.scored & (trial.slips == 0)
        pivot, slide = slips & (turning > TURNS), slips & (turning < SLIDES)
        between = slips & (turning >= SLIDES) & (turning <= TURNS)
        for key, flags in zip(parts, (none, slide, pivot, between), strict=True):
            parts[key].append(score[flags])
            speeds[key].append(speed[flags])
        if min(slips.sum(), none.sum()) > 5:
            within.append(float(auc(score[slips], score[none])))
    none, slide, pivot, between = (np.concatenate(some) for some in parts.values())
    _, of_slide, of_pivot, of_between = (np.concatenate(some) for some in speeds.values())
    others, of_others = np.concatenate([slide, between]), np.concatenate([of_slide, of_between])
    binned = [
        auc(pivot[(of_pivot > a) & (of_pivot <= b)], others[(of_others > a) & (of_others <= b)])
        for a, b in pairwise(BINS)
    ]
    return {
        "score": name,
        "baseline": name not in (SHIPPED, *TURNED),
        "slides": auc(slide, none),
        "pivots": auc(pivot, none),
        "apart": auc(pivot, slide),
        "apart_of_all": auc(pivot, others),
        "as_fast": float(np.mean(binned)),
        "within": float(np.mean(within)) if within else float("nan"),
    }


def curl_change(trial: Trial) -> Floats:
    """Return the change of the mean curl of the shear over the load, of the pads' mean size."""
    change = _change_of_frames(trial)
    curl = np.gradient(change[..., 1], axis=3) - np.gradient(change[..., 0], axis=2)
    return np.asarray(np.abs(curl.mean(axis=(2, 3))).mean(axis=1) / (_load(trial) + FAINT))


def _trees(trials: Sequence[Trial], inputs: Sequence[Floats]) -> list[Floats]:
    """Return the chance of a pivot among slips by trees that learned on all other objects."""
    ensemble: Any = import_module("sklearn.ensemble")
    known = [t.scored & (t.slips == 1) & np.isfinite(_turning(t)) for t in trials]
    result: dict[int, Floats] = {}
    for _, mine, others in folds(trials):
        x = np.concatenate([inputs[n][known[n]] for n in others])
        y = np.concatenate([_turning(trials[n])[known[n]] > TURNS for n in others])
        if len(np.unique(y)) < 2:  # the marker's turning is not known
            result |= {n: np.zeros(len(inputs[n])) for n in mine}
            continue
        model = ensemble.HistGradientBoostingClassifier(
            max_iter=TREES, max_leaf_nodes=LEAVES, class_weight="balanced", random_state=0
        ).fit(x, y)
        result |= {n: model.predict_proba(inputs[n])[:, 1] for n in mine}
    return [result[n] for n in range(len(trials))]


def _turning(trial: Trial) -> Floats:
    return np.full(len(trial.frames), np.nan) if trial.turning is None else trial.turning


def _moments(trial: Trial) -> Floats:
    """Return sizes of curl, divergence, torque and mean, of shear and its change, over the load."""
    pads = _pads(trial)
    above, columns = pads - pads[:4].mean(axis=0), list[Floats]()
    load = (_load(trial) + FAINT)[:, None]
    down, right = (np.indices(pads.shape[2:4]) - 1.5)[:2]
    for maps in (above, _change_of_frames(trial)):
        x, y = maps[..., 0], maps[..., 1]
        parts = (
            np.gradient(y, axis=3) - np.gradient(x, axis=2),
            np.gradient(x, axis=3) + np.gradient(y, axis=2),
            right * y - down * x, x, y,
            np.gradient(maps[..., 2], axis=2), np.gradient(maps[..., 2], axis=3),
        )  # fmt: skip
        for part in parts:
            means = np.abs(part.mean(axis=(2, 3)))
            columns += [means.mean(axis=1), means.max(axis=1)]
    return np.asarray(np.stack(columns, axis=1) / load)


def _chosen(engine: Engine, trials: Sequence[Trial]) -> list[Floats]:
    """Return scores with the constants that are best on all other objects.

    Each fold's are in units of the others' median without slip: constants scale the score.
    """
    settings = [
        [answers["slip_strength"] for answers in Subject(engine, known, twists=False).play(trials)]
        for known in GRID
    ]
    result: dict[int, Floats] = {}
    for _, mine, others in folds(trials):
        rest = [trials[n] for n in others]
        best = max(settings, key=lambda scores: pooled(rest, [scores[n] for n in others]))
        quiet = np.concatenate(split(rest, [best[n] for n in others])[1])
        unit = float(np.median(quiet)) if len(quiet) else 1.0
        result.update({n: best[n] / unit for n in mine})
    return [result[n] for n in range(len(trials))]


def _learned(trials: Sequence[Trial]) -> list[Floats]:
    result: dict[int, Floats] = {}
    for _, mine, others in folds(trials):
        scores = regression([trials[n] for n in others], [trials[n] for n in mine])
        result.update(zip(mine, scores, strict=True))
    return [result[n] for n in range(len(trials))]


def folds(trials: Sequence[Trial]) -> list[tuple[str, list[int], list[int]]]:
    """Return for every object its trials, and all others."""
    objects = dict.fromkeys(trial.family for trial in trials)
    places = range(len(trials))
    return [
        (
            name,
            [n for n in places if trials[n].family == name],
            [n for n in places if trials[n].family != name],
        )
        for name in objects
    ]


def split(trials: Sequence[Trial], scores: Sequence[Floats]) -> tuple[list[Floats], list[Floats]]:
    """Return the scores of frames that slip, and of those that do not, a trial each."""
    pairs = list(zip(trials, scores, strict=True))
    return (
        [score[trial.scored & (trial.slips == 1)] for trial, score in pairs],
        [score[trial.scored & (trial.slips == 0)] for trial, score in pairs],
    )


def pooled(trials: Sequence[Trial], scores: Sequence[Floats]) -> float:
    """Return the area under the curve of all frames of all trials together."""
    if not trials:
        return float("nan")
    slips, none = split(trials, scores)
    return auc(np.concatenate(slips), np.concatenate(none))


def _row(
    name: str,
    recorded: Recorded,
    objects: Sequence[str],
    flat: Sequence[Floats],
    uskin: Sequence[Floats],
) -> Row:
    baseline = name not in (SHIPPED, CHOSEN)
    row: Row = {"score": name, "baseline": baseline, "pooled": pooled(recorded.flat, flat)}
    for item in objects:
        mine = [n for n, trial in enumerate(recorded.flat) if trial.family == item]
        row[f"object_{item}"] = pooled([recorded.flat[n] for n in mine], [flat[n] for n in mine])
    row["uskin"] = pooled(recorded.uskin, uskin) if len(uskin) else None
    return row


def _number(name: str) -> tuple[int, str]:
    return (int(name), "") if name.isdigit() else (10**6, name)
