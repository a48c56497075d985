"""The simplest scores of slip, and a regression on features: the baselines of a program."""

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.scoring.trial import Trial

WINDOWS = (1, 5)
"""Frames over which a change of shear is averaged."""

LEARNED_WINDOWS = (1, 2, 5)

RIDGE = 0.1
"""Inverse weight of the regression's penalty."""


def shear_change(trial: Trial, window: int, *, incoherent: bool) -> Floats:
    """Return the mean change of shear from frame to frame, over the last frames.

    Parameters
    ----------
    trial : Trial
        Pads side by side.
    window : int
        Frames.
    incoherent : bool
        Whether the pad's mean change is taken off.

    Returns
    -------
    (frames,) float
    """
    change = _change(trial)[..., :2]
    change = change - change.mean(axis=(2, 3), keepdims=True) if incoherent else change
    return _averaged(np.sqrt((change**2).sum(axis=-1).mean(axis=(1, 2, 3))), window)


def features(trial: Trial) -> Floats:
    """Return logarithms of changes, load and friction in use, (frames, features)."""
    pads = _pads(trial)
    load = np.abs((pads - pads[:4].mean(axis=0))[..., 2].mean(axis=(2, 3))).mean(axis=1)
    shear = (pads - pads[:4].mean(axis=0))[..., :2].mean(axis=(2, 3))
    pull = np.sqrt((shear**2).sum(axis=-1)).mean(axis=1)
    normal = _change(trial)[..., 2]
    mean = normal.mean(axis=(2, 3), keepdims=True)
    grows, shifts = np.abs(mean).mean(axis=(1, 2, 3)), np.abs(normal - mean).mean(axis=(1, 2, 3))
    columns = [np.log(load + 20.0), np.log(pull + 3.0) - np.log(load + 20.0)]
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


def _change(trial: Trial) -> Floats:
    pads = _pads(trial)
    return np.diff(pads, axis=0, prepend=pads[:1])


def _averaged(values: Floats, window: int) -> Floats:
    """Return the mean of the last values, of fewer at the start."""
    total, place = np.concatenate([[0.0], np.cumsum(values)]), np.arange(len(values))
    start = np.maximum(place - window + 1, 0)
    return np.asarray((total[place + 1] - total[start]) / (place + 1 - start))
