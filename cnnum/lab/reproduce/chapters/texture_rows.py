"""Section 6.5: four materials rubbed over a bump, and classified."""

from collections.abc import Callable
from functools import cache, partial
from math import sqrt
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.faults import Fault
from cnnum.lab.reproduce.figure import Curve, Dots, Figure, Matrix, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.tactile.texture import WINDOW, texture
from cnnum.tactile.texture_materials import (
    FOUR,
    FRAME,
    Classification,
    Samples,
    Stroke,
    classify,
    draw_samples,
    drift,
    rub,
)

DIRECTIONS = tuple(Stroke(direction=float(turn)) for turn in np.arange(8) * np.pi / 4)
FORCES = tuple(Stroke(indentation=depth) for depth in (50e-6, 70e-6, 100e-6))
"""From 50 to 100 µm of indentation the force of a Hertz contact grows 2.8 times."""

TURNED = np.radians(30.0)


@cache
def samples() -> Samples:
    """Return about 3000 samples, as many as the dissertation has."""
    return draw_samples()


@cache
def told_apart(by: str) -> Classification:
    """Return the cross-validation that leaves out strokes, directions or forces."""
    drawn = samples()
    octant = (drawn.direction / (np.pi / 4)).astype(np.intp)
    quarters = np.quantile(drawn.indentation, [0.25, 0.5, 0.75])
    groups = {
        "stroke": drawn.stroke,
        "direction": octant,
        "force": np.searchsorted(quarters, drawn.indentation),
    }[by]
    folds = {"stroke": 4, "direction": 8, "force": 4}[by]
    return classify(drawn.features, drawn.material, groups, names=drawn.names, folds=folds)


def accuracy(by: str) -> float:
    """Return the share of samples classified right, per cent."""
    return 100.0 * told_apart(by).accuracy


def worst_recall() -> float:
    """Return the share classified right of the worst material, per cent."""
    return float(100.0 * told_apart("stroke").recall.min())


@cache
def means(forces: bool) -> Floats:
    """Return (materials, strokes, 2) mean features over forces, or over directions."""
    strokes = FORCES if forces else DIRECTIONS
    return np.stack([drift(material, strokes, draws=4) for material in FOUR])


def sway(feature: int, forces: bool) -> float:
    """Return by how much a feature's mean changes with direction or force, at most, per cent."""
    result = means(forces)[..., feature]
    return float((100.0 * np.ptp(result, axis=1) / result.mean(axis=1)).max())


def figure_6_18() -> Figure:
    """Return the signals of one stroke over each material."""
    panels: list[Panel] = []
    for n, material in enumerate(FOUR):
        signals = rub(material, Stroke(direction=TURNED), np.random.default_rng(n))
        time: Floats = FRAME * np.arange(len(signals), dtype=np.float64)
        # the screw's panel is full of lines: the others have the legend
        names = ("normal S_n", "shear T_x", "shear T_y") if n else ("", "", "")
        curves = [
            Curve(time, signals[:, 2], names[0], "line", 0),
            Curve(time, signals[:, 0], names[1], "dotted", 1),
            Curve(time, signals[:, 1], names[2], "dotted", 2),
        ]
        panels.append(Panel(material.name, "time (s)", "signal (V)", curves))
    return Figure(
        "fig-6.18",
        "Fig. 6.18",
        "Four materials drawn over a bump",
        "Simulated, 12 mm/s at 30° to the x axis, a frame every 15 ms. The normal signal shows "
        "the relief, the ratio of the shears the direction. Friction and relief of the materials "
        "are this package's own.",
        panels,
    )


def figure_6_19() -> Figure:
    """Return friction and roughness of all samples, and the classifier's results."""
    drawn = samples()
    dots = [
        Dots(drawn.features[drawn.material == k, 0], drawn.features[drawn.material == k, 1],
             np.full(int((drawn.material == k).sum()), 9.0), k, name)
        for k, name in enumerate(drawn.names)
    ]  # fmt: skip
    result = told_apart("stroke")
    return Figure(
        "fig-6.19",
        "Fig. 6.19",
        "Texture by friction and roughness",
        f"{len(drawn.features)} samples (about 3000 in the dissertation), each the last 129 "
        "frames. They are of all directions, at 50–100 µm of indentation. Right: a quadratic "
        "discriminant, cross-validated by strokes; rows are the truth. "
        f"Accuracy {100 * result.accuracy:.1f} %.",
        (
            Panel("Two features", "mean friction, T/S_n (6.3)", "roughness (%) (6.4)", dots,
                  log="y"),
            Panel("Taken for…", "", "", [_matrix(result)]),
        ),
    )  # fmt: skip


def _matrix(classification: Classification) -> Matrix:
    short = tuple(name.split()[-1] for name in classification.names)
    return Matrix(classification.confusion, short, short)


FIGURES: dict[str, Callable[[], Figure]] = {"fig-6.18": figure_6_18, "fig-6.19": figure_6_19}


def by_hand(signals: Floats) -> tuple[float, float]:
    """Return (6.3), as a mean, and (6.4) of all frames."""
    ratios = np.sqrt(signals[:, 0] ** 2 + signals[:, 1] ** 2) / signals[:, 2]
    mean = float(ratios.sum() / len(ratios))
    return mean, 100.0 * sqrt(float(np.sum((ratios - mean) ** 2)) / (len(ratios) - 1)) / mean


def feature_gap(feature: int) -> float:
    """Return the largest relative error of a feature of strokes that are turned and pressed harder.

    Against (6.3) or (6.4) by hand of the stroke as it was: neither has a direction or a scale.
    """
    gaps: list[float] = []
    for n, material in enumerate(FOUR):
        signals = rub(material, Stroke(), np.random.default_rng(n))[-WINDOW - 1 :]
        exact = by_hand(signals)[feature]
        for k in range(8):
            turn, force = k * np.pi / 4, 1.0 + 0.225 * k  # up to 2.6 times the force
            cos, sin = np.cos(turn), np.sin(turn)
            axes = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
            result = texture(force * signals @ axes)
            ours = (result.friction, result.roughness)[feature][-1]
            gaps.append(abs(float(ours) / exact - 1.0))
    return max(gaps)


def _stretched(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a texture for which one axis of shear counts more than the other."""

    def stretched(signals: Floats, **options: Any) -> Any:
        return function(np.asarray(signals) * [1.01, 1.0, 1.0], **options)

    return stretched


def _curved(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a texture that takes a power of the normal load for it."""

    def wrong(signals: Floats, **options: Any) -> Any:
        rows = np.array(signals)
        rows[..., 2] = np.abs(rows[..., 2]) ** 1.01
        return function(rows, **options)

    return wrong


TEXTURES = (Fault(texture, "1.01 T_x in place of T_x", _stretched, 0.01),
            Fault(texture, "S_n^1.01 in place of S_n", _curved, 0.01))  # fmt: skip

OWN = "no digits: of surfaces that this package simulates, as no recording is published"

CHAPTER = Chapter(
    "Section 6.5 — texture",
    (
        *(
            Item(name, title, source, expected, compute, 0.0, OWN, "%", "at least",
                 kind="comparison", figure="fig-6.19")
            for name, title, source, expected, compute in (
                ("fig-6.19-accuracy", "samples classified right, cross-validated by strokes",
                 "Fig. 6.19: “relatively separable”", 75.0, partial(accuracy, "stroke")),
                ("fig-6.19-worst", "the same, of the worst material",
                 "Fig. 6.19: “applicable even in this case”", 50.0, worst_recall),
                ("fig-6.19-direction", "the same, directions never trained on",
                 "section 6.5: “insensitive to motion direction”", 75.0,
                 partial(accuracy, "direction")),
                ("fig-6.19-force", "the same, forces never trained on",
                 "section 6.5: “insensitive to … the overall force”", 75.0,
                 partial(accuracy, "force")),
            )
        ),
        *(
            Item(f"texture-{name}", f"{name} of strokes turned and pressed harder, by hand",
                 f"({equation}); section 6.5: “insensitive to motion direction and force”", 0.0,
                 partial(feature_gap, feature), 1e-9, "the same formula, turned: rounding",
                 "relative", figure="fig-6.18", faults=TEXTURES)
            for feature, name, equation in ((0, "friction", "6.3"), (1, "roughness", "6.4"))
        ),
        *(
            Item(f"texture-{name}-direction", f"change of {name} over eight directions, at most",
                 "section 6.5: “insensitive to motion direction”", 0.0,
                 partial(sway, feature, False), 0.0, reason, "%", kind="comparison",
                 figure="fig-6.18")
            for feature, name, reason in (
                (0, "friction", "noise of the bridges alone: 0.5 % of a frame's signal"),
                (1, "roughness", "noise of the bridges alone: as much as a quarter of the "
                 "2 % that wood has, and it adds to it in different shares"),
            )
        ),
        Item("texture-friction-force", "change of friction as the force grows 2.8 times, at most",
             "section 6.5: “insensitive to … the overall force”", 0.0, partial(sway, 0, True),
             0.0, "friction is taken as Coulomb's; a light contact loses the valleys it does "
             "not reach", "%", kind="comparison", figure="fig-6.18"),
        Item("texture-roughness-force", "change of roughness as the force grows 2.8 times",
             "section 6.5: “insensitive to … the overall force”", 0.0, partial(sway, 1, True),
             0.0, "not insensitive: a larger contact averages the relief over more of it", "%",
             kind="comparison", figure="fig-6.19"),
    ),
    FIGURES,
)  # fmt: skip
