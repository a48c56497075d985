"""Materials rubbed over a bump, simulated, and told apart by friction and roughness.

Simulated materials, rubbed over a bump: four surfaces as in Fig. 6.18 of the dissertation.

A surface is a profile along the stroke. The round bump traces it as a stylus does (the envelope of
its own circle). It is pressed as a Hertz contact, and is pushed along by friction on the slope that
it stands on. The taxel below adds its gains and noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from cnnum.errors import ArrayError, PhysicsError, missing_extra
from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.contact import contact_modulus
from cnnum.tactile.texture import WINDOW, texture

Kind = Literal["thread", "grain", "weave", "teeth"]

FRAME = 15e-3
"""Time between two frames, s (section 6.5)."""

_STEP = 4e-6  # m, of the profile: a fiftieth of the bump's radius


@dataclass(frozen=True, slots=True)
class Material:
    """A surface that is drawn over a bump.

    Attributes
    ----------
    name : str
    kind : str
        "thread": periodic; "grain": band-limited noise; "weave": a wave whose height wanders;
        "teeth": single teeth at random distances.
    friction : float
        Coefficient against rubber, the mean over strokes.
    height : float, m
        Amplitude of a thread or weave, RMS of a grain, mean height of teeth.
    length : float, m
        Period, correlation length, or mean distance of teeth.
    spread : float
        Relative scatter of friction and height from stroke to stroke.
    """

    name: str
    kind: Kind
    friction: float
    height: float
    length: float
    spread: float = 0.12

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise PhysicsError(f"'kind' must be one of {get_args(Kind)}, got '{self.kind}'.")
        if not (min(self.friction, self.height, self.length) > 0.0 and 0.0 <= self.spread < 1.0):
            raise PhysicsError(
                f"Material '{self.name}': friction, height and length must be positive and "
                f"'spread' from 0 to below 1, got {self.friction}, {self.height} m, "
                f"{self.length} m and {self.spread}."
            )


FOUR = (
    Material("screw", "thread", 0.30, 30e-6, 0.4e-3),
    Material("smooth wood", "grain", 0.45, 1.5e-6, 0.3e-3),
    Material("fine textile", "weave", 0.70, 8e-6, 0.35e-3),
    Material("rasp", "teeth", 0.55, 60e-6, 0.9e-3, spread=0.2),
)
"""Those of the dissertation. Their friction and relief are this package's, not measured."""


@dataclass(frozen=True, slots=True)
class Bump:
    """The bump and the taxel below it.

    Attributes
    ----------
    radius : float, m
    youngs_modulus : float, Pa
    normal_gain : float, V/N
        S_n of a normal force.
    shear_gain : float, V/N
        T of a sideways force; about half as much (section 6.4.2).
    noise : float, V
        RMS of one amplified bridge (Table 3.II).
    """

    radius: float = 200e-6
    youngs_modulus: float = 0.87e6
    normal_gain: float = 100.0
    shear_gain: float = 50.0
    noise: float = 2.5e-3


@dataclass(frozen=True, slots=True)
class Stroke:
    """One straight pull over the bump.

    Attributes
    ----------
    direction : float, rad
        Direction of the surface's motion, from x towards y.
    indentation : float, m
        Mean approach of surface and bump: how hard it is pressed.
    speed : float, m/s
    frames : int
    """

    direction: float = 0.0
    indentation: float = 70e-6
    speed: float = 12e-3
    frames: int = 200


def rub(
    material: Material, stroke: Stroke, rng: np.random.Generator, bump: Bump | None = None
) -> Array:
    """Return the signals of a taxel while a material is drawn over its bump.

    Parameters
    ----------
    material : Material
    stroke : Stroke
    rng : numpy.random.Generator
        Draws the surface, the scatter and the noise.
    bump : Bump, optional

    Returns
    -------
    (frames, 3) float, V
        T_x, T_y, S_n.
    """
    below = Bump() if bump is None else bump
    scatter = 1.0 + material.spread * rng.uniform(-1.0, 1.0, 2) * np.sqrt(3.0)
    place = stroke.speed * FRAME * np.arange(stroke.frames)
    trace = scatter[1] * profile(material, float(place[-1]), rng)
    touched = envelope(trace, below.radius)
    force, lean = _pressed(touched, stroke, below)
    ratio = np.tan(np.arctan(scatter[0] * material.friction) + np.arctan(lean))
    wobble = 1.0 + 0.1 * np.sin(2.0 * np.pi * place / place[-1] * rng.uniform(0.5, 2.0))
    at = np.minimum((place / _STEP).astype(np.intp), force.size - 1)
    normal = wobble * force[at]
    along = ratio[at] * normal
    clean = [np.cos(stroke.direction) * along, np.sin(stroke.direction) * along]
    signals = np.stack([*(below.shear_gain * part for part in clean), below.normal_gain * normal])
    noise = below.noise * np.sqrt([2.0, 2.0, 1.0])[:, np.newaxis]
    return np.asarray((signals + noise * rng.normal(size=signals.shape)).T)


def profile(material: Material, length: float, rng: np.random.Generator) -> Array:
    """Return the height of a surface along a line, in steps of 4 µm.

    Parameters
    ----------
    material : Material
    length : float, m
    rng : numpy.random.Generator

    Returns
    -------
    (n,) float, m
    """
    x: Array = _STEP * np.arange(int(length / _STEP) + 2, dtype=np.float64)
    wave = np.cos(2.0 * np.pi * x / material.length + rng.uniform(0.0, 2.0 * np.pi))
    match material.kind:
        case "thread":
            return np.asarray(material.height * wave)
        case "weave":
            wander = 1.0 + 0.5 * _noise(x.size, 4 * material.length, rng)
            return np.asarray(material.height * wave * wander)
        case "grain":
            return material.height * _noise(x.size, material.length, rng)
        case "teeth":
            return material.height * _teeth(x, material.length, rng)


def envelope(trace: Array, radius: float) -> Array:
    """Return the height at which a circle of that radius rides over a profile.

    Parameters
    ----------
    trace : (n,) float, m
        In steps of 4 µm.
    radius : float, m

    Returns
    -------
    (n,) float, m
    """
    half = int(0.8 * radius / _STEP)
    across = _STEP * np.arange(-half, half + 1)
    circle = np.sqrt(radius**2 - across**2) - radius
    dilate: Any = ndimage.grey_dilation
    lifted = dilate(trace, structure=circle, mode="nearest")
    return np.asarray(lifted, dtype=np.float64)


def _pressed(height: Array, stroke: Stroke, bump: Bump) -> tuple[Array, Array]:
    """Return Hertz's force and the slope under the contact, along the profile."""
    modulus = float(contact_modulus(bump.youngs_modulus))
    approach = np.maximum(stroke.indentation + height - height.mean(), 0.0)
    force = 4.0 / 3.0 * modulus * np.sqrt(bump.radius) * approach**1.5
    patch = 2.0 * np.sqrt(bump.radius * stroke.indentation)
    slope = np.gradient(height, _STEP)
    mean = ndimage.uniform_filter1d(slope, max(1, int(patch / _STEP)), mode="nearest")
    return force, np.asarray(mean, dtype=np.float64)


def _noise(count: int, length: float, rng: np.random.Generator) -> Array:
    """Return Gaussian noise of unit RMS with that correlation length."""
    rough = ndimage.gaussian_filter1d(rng.normal(size=count), length / _STEP / 2.0, mode="wrap")
    return np.asarray(rough / (rough.std() or 1.0), dtype=np.float64)


def _teeth(x: Array, distance: float, rng: np.random.Generator) -> Array:
    """Return teeth of random height and place, of triangular shape, mean height 1."""
    count = max(3, round(float(x[-1]) / distance))
    centres = np.sort(rng.uniform(x[0], x[-1], count))
    sizes = rng.uniform(0.5, 1.5, count)
    flank = np.abs(x - centres[:, np.newaxis]) / (0.25 * distance)
    return np.asarray(np.max(sizes[:, np.newaxis] * np.maximum(1.0 - flank, 0.0), axis=0))


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
        Number of strokes per material.
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
    outputs = texture(signals)
    whole = np.stack([outputs.friction, outputs.roughness], axis=-1)
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
            "'samples' (n, features), 'labels' (n,) and 'groups' (n,) must belong to the same "
            f"samples, got {values.shape}, {truth.shape} and {parts.shape}."
        )
    if not (values > 0.0).all():
        raise ArrayError("'samples' must be positive: leave out windows without contact.")
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
