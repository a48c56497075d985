"""Section 4.3.3: the error of models of a flat cover against measurements on real ones."""

from functools import cache, partial
from math import sqrt

import numpy as np

from cnnum.lab.reproduce.figure import Curve, Dots, Figure, Layer, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.tactile.cover.comparison import MODELS, ComparisonRow, compare

BONDED = "bonded layer, strain 50 µm above the base"
SIZED = f"{BONDED}; needle and taxel"
NEAR = (
    "one of the eight models of the figure, a bonded cover sensed 50 µm above its base; the place "
    "of sensing is an assumption"
)
POINTED = (
    "half-space, strain",
    "half-space, stress",
    "layer, stress on base",
    "layer, strain above",
)
SHORT = (*POINTED, *(f"{name}*" for name in POINTED))
"""Of the models of `comparison`, in their order."""


@cache
def models() -> tuple[ComparisonRow, ...]:
    """Return all models of the flat cover, with the measurements."""
    return compare(MODELS, (0.2e-3, 0.3e-3, 0.4e-3, 0.5e-3))


def modelled(model: str, quantity: str) -> float:
    """Return one number of one model."""
    rows = [r for r in models() if r.model == model and r.quantity.startswith(quantity)]
    return rows[0].got


def figure_models() -> Figure:
    """Return how near each model of a flat cover gets to each measured number."""
    quantities = tuple(dict.fromkeys(row.quantity for row in models()))
    panels: list[Panel] = []
    for quantity in quantities:
        rows = [r for r in models() if r.quantity == quantity and np.isfinite(r.got)]
        names = [r.model for r in models() if r.quantity == quantity]
        heights = np.array([len(names) - names.index(r.model) for r in rows], dtype=float)
        got = np.array([r.got for r in rows])
        span = np.array([0.5, len(names) + 0.5])
        layers: list[Layer] = [
            Dots(got, heights, np.full(got.size, 40.0), 0, "model"),
            Curve(np.full(2, rows[0].measured), span, "measured", "dashed", 1),
        ]
        panels.append(
            Panel(
                quantity.replace("largest ", "").replace(" signal", ""),
                "value",
                "",
                layers,
                ticks=SHORT[::-1],
            )
        )
    return Figure(
        "flat-models",
        "Fig. 4.13, 4.16; section 4.3.3",
        "How near do models of a flat cover get?",
        "Each model's slope of W, power of A, inhibition and normal-to-shear ratio next to the "
        "measured one (dashed). * needle and taxel of their real sizes. A model without a point "
        "has no brim, so no width. No single model comes near all four. A layer bonded to "
        "silicon and felt 50 µm above its base has the measured width and power only with the real "
        "sizes, and the measured inhibition only without them.",
        panels,
    )


QUANTITIES = (
    ("W-slope", "slope of W", "slope of W", 1.14, "Fig. 4.16, section 4.3.3"),
    ("A-power", "power of A", "exponent of A", -1.45, "Fig. 4.16, section 4.3.3"),
    ("inhibition", "largest over most negative", "lateral", 19.0, "Fig. 4.13, section 4.3.3"),
    ("normal-to-shear", "largest normal over largest shear signal", "largest normal",
     1.46 * 25.0 * sqrt(5.0) / 24.0, "(4.20), section 4.3.3"),
)  # fmt: skip


def _rows() -> tuple[Item, ...]:
    """Return every number of the bonded layer, with and without the sizes of needle and taxel."""
    return tuple(
        Item(f"layer-{name}-{kind}", f"{title}: bonded layer, {sizes}", source, measured,
             partial(modelled, model, begins), 0.0, NEAR, kind="comparison", figure="flat-models")
        for name, title, begins, measured, source in QUANTITIES
        for kind, model, sizes in (
            ("point", BONDED, "point load on a point taxel"),
            ("sized", SIZED, "needle and taxel of real size"),
        )
    )  # fmt: skip


def gent(hardness: float) -> float:
    """Return Young's modulus, MPa, of rubber of a Shore A hardness: a blunt cone on a half-space.

    Gent, "On the relation between indentation hardness and Young's modulus" (1958).
    """
    return 0.0981 * (56.0 + 7.66 * hardness) / (0.137505 * (254.0 - 2.54 * hardness))


CHAPTER = Chapter(
    "Section 4.3 — models of the real flat cover",
    (
        Item("section-4.3.1", "Young's modulus of rubber of 45 Shore A", "section 4.3.1", 2.4,
             partial(gent, 45.0), 0.0, "Gent's formula; the dissertation's own is not named", "MPa",
             kind="comparison"),
        *_rows(),
    ),
    {"flat-models": figure_models},
)  # fmt: skip
