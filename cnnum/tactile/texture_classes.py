"""Classify materials by friction and roughness, as in Fig. 6.19 of the dissertation."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError, missing_extra
from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.texture import WINDOW, texture
from cnnum.tactile.texture_materials import FOUR, Material, Stroke, rub

Whole = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Friction and roughness of many strokes over known materials.

    Attributes
    ----------
    features : (n, 2) float
        Friction (6.3) and roughness (6.4).
    material : (n,) int
        Number in `names`.
    stroke : (n,) int
        Which stroke a sample is of: windows of one stroke overlap.
    direction : (n,) float, rad
    indentation : (n,) float, m
    names : tuple of str
    """

    features: Array
    material: Whole
    stroke: Whole
    direction: Array
    indentation: Array
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Classification:
    """The results of a cross-validated classifier.

    Attributes
    ----------
    confusion : (classes, classes) float
        Samples of each class (rows) that were taken for each (columns), none seen in training.
    names : tuple of str
    """

    confusion: Array
    names: tuple[str, ...]

    @property
    def accuracy(self) -> float:
        """Share of samples that were classified right."""
        return float(np.trace(self.confusion) / self.confusion.sum())

    @property
    def recall(self) -> Array:
        """(classes,) float: share of each class that was classified right."""
        return np.asarray(np.diag(self.confusion) / self.confusion.sum(axis=1))


def draw_samples(
    materials: Sequence[Material] = FOUR,
    *,
    strokes: int = 25,
    per_stroke: int = 30,
    indentation: tuple[float, float] = (50e-6, 100e-6),
    speed: tuple[float, float] = (10e-3, 14e-3),
    seed: int = 0,
) -> Samples:
    """Return samples of simulated strokes in all directions, with changing force.

    Parameters
    ----------
    materials : sequence of Material
    strokes : int
        Of each material.
    per_stroke : int
        Samples of a stroke, each over a full window of 129 frames.
    indentation : (float, float) m
        Range of how hard strokes press.
    speed : (float, float) m/s
        Range of their speeds: "relatively narrow" (section 6.5).
    seed : int

    Returns
    -------
    Samples
        len(materials) · strokes · per_stroke of them: 3000 by default.
    """
    rng = np.random.default_rng(seed)
    rows: list[Array] = []
    keys: list[tuple[float, ...]] = []
    for kind, material in enumerate(materials):
        for number in range(strokes):
            stroke = Stroke(
                direction=float(rng.uniform(0.0, 2.0 * np.pi)),
                indentation=float(rng.uniform(*indentation)),
                speed=float(rng.uniform(*speed)),
                frames=WINDOW + per_stroke,
            )
            rows.append(features(rub(material, stroke, rng)))
            key = (kind, kind * strokes + number, stroke.direction, stroke.indentation)
            keys += [key] * len(rows[-1])
    table = np.asarray(keys, dtype=np.float64)
    kinds, numbers = table[:, :2].astype(np.intp).T
    names = tuple(material.name for material in materials)
    return Samples(np.concatenate(rows), kinds, numbers, table[:, 2], table[:, 3], names)


def features(signals: ArrayLike) -> Array:
    """Return friction and roughness of every full window of a recording.

    Parameters
    ----------
    signals : (frames, 3) float
        T_x, T_y, S_n.

    Returns
    -------
    (frames − 128, 2) float
    """
    found = texture(signals)
    whole = np.stack([found.friction, found.roughness], axis=-1)
    return np.asarray(whole[WINDOW:])


def classify(
    samples: ArrayLike,
    labels: ArrayLike,
    groups: ArrayLike,
    *,
    names: Sequence[str],
    folds: int = 4,
) -> Classification:
    """Return how a quadratic discriminant does on samples that it was not trained on.

    A Gaussian is fitted to each class's logarithms of the features; a sample belongs to where
    it is likeliest. Whole groups are left out in turn: with strokes as groups, no window of a
    stroke that is judged was trained on.

    Parameters
    ----------
    samples : (n, features) float
        Positive.
    labels : (n,) int
        Class of each, from 0.
    groups : (n,) int
        The group of each sample; groups stay whole.
    names : sequence of str
        Names of the classes.
    folds : int
        At most as many as groups.

    Returns
    -------
    Classification

    Raises
    ------
    ArrayError
        If the shapes do not belong together, or a feature is not positive.
    MissingExtraError
        If scikit-learn is not installed.
    """
    values = checks.finite("samples", samples)
    truth = np.asarray(labels, dtype=np.intp)
    parts = np.asarray(groups, dtype=np.intp)
    if values.ndim != 2 or not len(values) == len(truth) == len(parts):
        raise ArrayError(
            "'samples' (n, features), 'labels' (n,) and 'groups' (n,) must be of the same "
            f"samples, got {values.shape}, {truth.shape} and {parts.shape}."
        )
    if not (values > 0.0).all():
        raise ArrayError("'samples' must be positive: leave windows without contact out.")
    predicted = _left_out(np.log(values), truth, parts, folds)
    confusion = np.zeros((len(names), len(names)))
    np.add.at(confusion, (truth, predicted), 1.0)
    return Classification(confusion, tuple(names))


def _left_out(values: Array, truth: Whole, groups: Whole, folds: int) -> Whole:
    """Return the class of each sample by a classifier that has not seen its group."""
    analysis = _sklearn("discriminant_analysis").QuadraticDiscriminantAnalysis
    splits = _sklearn("model_selection").GroupKFold(folds)
    predicted = np.empty_like(truth)
    for train, test in splits.split(values, truth, groups):
        model = analysis(reg_param=1e-3).fit(values[train], truth[train])
        predicted[test] = model.predict(values[test])
    return predicted


def _sklearn(module: str) -> Any:
    try:
        return import_module(f"sklearn.{module}")
    except ImportError as missing:
        raise missing_extra("classifying textures", "scikit-learn", "texture") from missing


def drift(material: Material, changed: Sequence[Stroke], *, draws: int = 8, seed: int = 1) -> Array:
    """Return the mean features of the same surfaces under several strokes.

    Parameters
    ----------
    material : Material
        Every draw has the same surface and noise for each stroke.
    changed : sequence of Stroke
    draws : int
    seed : int

    Returns
    -------
    (strokes, 2) float
        Friction and roughness.
    """
    means = [
        np.mean(
            [
                features(rub(material, stroke, np.random.default_rng([seed, n]))).mean(axis=0)
                for n in range(draws)
            ],
            axis=0,
        )
        for stroke in changed
    ]
    return np.asarray(means, dtype=np.float64)
