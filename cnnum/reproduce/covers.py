"""Hair, ridge and single bump (Fig. 6.5, 6.7, 6.16), and models of the real flat cover."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np

from cnnum.arrays import Floats
from cnnum.reproduce.figure import Curve, Dots, Figure, Layer, Panel
from cnnum.reproduce.record import Chapter, Item
from cnnum.reproduce.setup import BETA, MM, E, Z
from cnnum.tactile.cover.bump import BumpCover
from cnnum.tactile.cover.comparison import MODELS, ComparisonRow, compare
from cnnum.tactile.cover.flat import FlatCover
from cnnum.tactile.cover.hair import HairCover
from cnnum.tactile.cover.protocol import Cover
from cnnum.tactile.cover.ridge import RidgeCover

FRICTION = 0.5
"""Of a tip that slides on rubber; no value is published."""

FORCE = 10e-3
"""N, of the tip and of each turn of the screw."""

THREAD = 0.7e-3
"""Pitch of the screw, m: M4; the screw of Fig. 6.7 is not named."""

PITCH = 1.5e-3
"""Of the taxels, m."""

FINGER = 4e-3
"""Radius of the contact of a finger, m."""

X = np.linspace(-0.8e-3, 0.8e-3, 321)


def hair() -> HairCover:
    """Return a rod of Ø 50 µm (the hole of Fig. 3.8) under 200 µm of rubber."""
    return HairCover(radius=25e-6, length=150e-6, above=Z, youngs_modulus=E)


def sliding(x: Floats, way: float) -> tuple[Floats, Floats]:
    """Return places of a tip on y = 0 and the force of its sliding towards ±x."""
    places = np.stack([x, np.zeros_like(x)], axis=-1)
    return places, FORCE * np.array([way * FRICTION, 0.0, 1.0])


def hair_signals(x: Floats, way: float) -> Floats:
    """Return (n, 3) T_x, T_y, S_n of a taxel with a hair: the pressure under its foot, Pa.

    S_n is the mean pressure; T the difference of pressure between opposite rims of the foot,
    which bends opposite bridges against each other.
    """
    rod = hair()
    total, moment = rod.caught(*sliding(x, way))
    area = np.pi * rod.radius**2
    rim = 2.0 * 4.0 * moment / (area * rod.radius)
    return np.concatenate([rim, total[..., 2:] / area], axis=-1)


def hair_size() -> float:
    """Return the largest |T_x| over the largest S_n as a tip slides across a hair."""
    signals = hair_signals(X, 1.0)
    return float(np.abs(signals[:, 0]).max() / signals[:, 2].max())


def hair_lobes() -> float:
    """Return the largest T_x towards the motion over the largest against it, the worse way."""
    ratios: list[float] = []
    for way in (1.0, -1.0):
        towards = way * hair_signals(X, way)[:, 0]
        ratios.append(float(towards.max() / -towards.min()))
    return min(ratios)


def hair_across() -> float:
    """Return the largest |T_y| over the largest |T_x|."""
    both = np.concatenate([hair_signals(X, 1.0), hair_signals(X, -1.0)])
    return float(np.abs(both[:, 1]).max() / np.abs(both[:, 0]).max())


def hair_normal() -> float:
    """Return the smallest S_n over the largest."""
    both = np.concatenate([hair_signals(X, 1.0), hair_signals(X, -1.0)])
    return float(both[:, 2].min() / both[:, 2].max())


def flat_sign() -> float:
    """Return T_x over S_n of a flat cover right below a sliding tip."""
    strain = FlatCover(Z, E).strain([0.0, 0.0], [0.0, 0.0], sliding(np.zeros(1), 1.0)[1])
    return float(strain[0] / strain[2])


def screw_signals(cover: Cover, angle: float, shift: Floats) -> Floats:
    """Return (n, 2) shear along the motion × β and normal signal under a screw, strain.

    The turns are point loads a pitch apart along the motion, each with its share of friction;
    over a ridge only those count that stand on it.
    """
    turns = THREAD * np.arange(-3, 4)
    along = np.array([np.cos(angle), np.sin(angle)])
    place = (shift[:, np.newaxis] + turns)[..., np.newaxis] * along
    force = FORCE * np.array([*(FRICTION * along), 1.0])
    strain = cover.strain(place, [0.0, 0.0], force)
    if isinstance(cover, RidgeCover):
        strain = strain * (np.abs(place[..., :1]) <= cover.width / 2)
    total = -strain.sum(axis=1)
    return np.stack([(total[:, :2] @ along) / BETA, total[:, 2]], axis=-1)


def flat_cover() -> FlatCover:
    """Return the flat cover of 200 µm."""
    return FlatCover(Z, E)


def ridge() -> RidgeCover:
    """Return the ridge of the dissertation, along y."""
    return RidgeCover(Z, E)


@cache
def screw(case: str) -> Floats:
    """Return the signals over three pitches: "flat", "along" or "across" the ridge."""
    shift = np.linspace(-1.5 * THREAD, 1.5 * THREAD, 241)
    if case == "flat":
        return screw_signals(flat_cover(), 0.0, shift)
    return screw_signals(ridge(), np.pi / 2 if case == "along" else 0.0, shift)


def wrong_way(case: str) -> float:
    """Return the largest shear against the friction over the largest along it."""
    shear = screw(case)[:, 0]
    return float(max(-shear.min(), 0.0) / shear.max())


def likeness() -> float:
    """Return the correlation of the shear along a ridge with that of a flat cover."""
    swings = [screw(case)[:, 0] - screw(case)[:, 0].mean() for case in ("flat", "along")]
    return float(np.corrcoef(*swings)[0, 1])


def directness(case: str) -> float:
    """Return the correlation of S_n with the load that stands on the place of the ridge."""
    shift = np.linspace(-1.5 * THREAD, 1.5 * THREAD, 241)
    turns = shift[:, np.newaxis] + THREAD * np.arange(-3, 4)
    load = np.count_nonzero(np.abs(turns) <= ridge().width / 2, axis=1)
    return float(np.corrcoef(screw(case)[:, 1], load)[0, 1])


def shear_gain() -> float:
    """Return how far the shear swings across a ridge, over its swing on a flat cover."""
    return float(np.ptp(screw("across")[:, 0]) / np.ptp(screw("flat")[:, 0]))


def finger(turn: Floats) -> Floats:
    """Return (n, 3) traction of a finger going round, at the taxel, Pa.

    A Hertz pressure of 2 N whose middle goes round at 1 mm; its shear is half of it.
    """
    away = 1e-3 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    peak = 1.5 * 2.0 / (np.pi * FINGER**2)
    wobble = 1.0 + 0.15 * np.sin(5.0 * turn)
    pressure = peak * wobble * np.sqrt(1.0 - np.sum(away**2, axis=-1) / FINGER**2)
    way = np.stack([-np.sin(turn), np.cos(turn)], axis=-1)
    return np.concatenate([FRICTION * pressure[:, None] * way, pressure[:, None]], axis=-1)


def lateral(bump: bool) -> tuple[Floats, Floats]:
    """Return ε_xz and ε_yz (sign turned) under a finger, with or without a bump."""
    traction = finger(np.linspace(0.0, 6.0 * np.pi, 400))
    if not bump:
        # the finger is twenty times as wide as the cover is thick: σ_iz = −q_i
        return 1.5 * traction[:, 0] / E, 1.5 * traction[:, 1] / E
    cover = BumpCover(Z, E)
    strain = -cover.strain([0.0, 0.0], [0.0, 0.0], PITCH**2 * traction)
    return strain[:, 0], strain[:, 1]


def bump_gain() -> float:
    """Return how much larger the lateral strain is under a bump."""
    sizes = [np.hypot(*lateral(bump)).mean() for bump in (True, False)]
    return float(sizes[0] / sizes[1])


@cache
def models() -> tuple[ComparisonRow, ...]:
    """Return all models of the flat cover beside what was measured."""
    return compare(MODELS, (0.2e-3, 0.3e-3, 0.4e-3, 0.5e-3))


def modelled(model: str, quantity: str) -> float:
    """Return one number of one model."""
    rows = [r for r in models() if r.model == model and r.quantity.startswith(quantity)]
    return rows[0].got


def figure_6_5() -> Figure:
    """Return the signals of a hair as a tip slides over it, there and back."""
    forth, back = hair_signals(X, 1.0), hair_signals(X[::-1], -1.0)
    both = np.concatenate([forth, back]) / forth[:, 2].max()
    way = MM * np.concatenate([X - X[0], X + X[-1] - 2 * X[0]])
    names = ("T_x", "T_y", "S_n")
    strain = [
        -FlatCover(Z, E).strain(sliding(x, w)[0], [0.0, 0.0], sliding(x, w)[1])
        for x, w in ((X, 1.0), (X[::-1], -1.0))
    ]
    flat = np.concatenate(strain) / strain[0][:, 2].max() / [BETA, BETA, 1.0]
    panels = [
        Panel(title, "way of the tip (mm)", "signal / largest S_n",
              [Curve(way, v[:, k], n) for k, n in enumerate(names)],
              marks=[(MM * (X[-1] - X[0]), "turns back")])
        for title, v in (("With a hair", both), ("Flat cover", flat))
    ]  # fmt: skip
    return Figure(
        "fig-6.5",
        "Fig. 6.5",
        "A hair feels which way a tip slides",
        "A tip with friction 0.5 slides over the taxel and back. The rod (Ø 50 µm, 150 µm long, "
        "under 200 µm of rubber) turns shear into a moment at its foot; a flat cover has none "
        "right below the tip. Statics of a rigid rod: shapes, not volts.",
        panels,
    )


def figure_6_7() -> Figure:
    """Return the signals of a screw over three covers."""
    shift = MM * np.linspace(-1.5 * THREAD, 1.5 * THREAD, 241)
    titles = {"flat": "Flat cover", "along": "Along the ridge", "across": "Across the ridge"}
    panels = [
        Panel(title, "way of the screw (mm)", "strain signal (%)",
              [Curve(shift, 100 * screw(case)[:, 1], "normal S_n", colour=0),
               Curve(shift, 100 * screw(case)[:, 0], "shear T", colour=1)])
        for case, title in titles.items()
    ]  # fmt: skip
    return Figure(
        "fig-6.7",
        "Fig. 6.7",
        "A screw drawn over a ridge",
        "Turns 0.7 mm apart, 10 mN each, friction 0.5; the ridge is 0.5 mm wide and 0.265 mm "
        "high. Across the ridge only the turn that stands on it counts, and the signals switch "
        "on and off. The model is beam statics on a half-space: it selects directions as the "
        "measured ridge does, but not with the measured size and sign of the shear.",
        panels,
    )


def figure_6_16() -> Figure:
    """Return the lateral strains of a circling finger with and without a bump."""
    dots = [
        Dots(100 * x, 100 * y, np.full(x.size, 4.0), colour, name)
        for (x, y), colour, name in ((lateral(True), 1, "bump"), (lateral(False), 0, "flat"))
    ]
    return Figure(
        "fig-6.16",
        "Fig. 6.16",
        "A finger going round, with and without a bump",
        "Finite-element bump of Ø 0.4 mm on 200 µm, which takes the load of a taxel's square of "
        "1.5 mm; the finger presses with 2 N over a radius of 4 mm and rubs at half of that. "
        "Right below a bump the moment of the rub turns the strain's sign, so that the loop is "
        "on the other side.",
        (Panel("Tangential strains", "ε_xz (%)", "ε_yz (%)", dots, equal=True),),
    )


POINTED = (
    "half-space, strain",
    "half-space, stress",
    "layer, stress on base",
    "layer, strain above",
)
SHORT = (*POINTED, *(f"{name}*" for name in POINTED))
"""Of the models of `comparison`, in their order."""


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
        "Each model's slope of W, power of A, inhibition and normal-to-shear ratio beside the "
        "measured one (dashed). * needle and taxel of their real sizes. A model without a point "
        "has no brim, so no width. A layer bonded to silicon and felt 50 µm above its base comes "
        "near the measured width, power and inhibition.",
        panels,
    )


FIGURES: dict[str, Callable[[], Figure]] = {
    "flat-models": figure_models,
    "fig-6.5": figure_6_5,
    "fig-6.7": figure_6_7,
    "fig-6.16": figure_6_16,
}
BONDED = "bonded layer, strain 50 µm above the base"
SIZED = f"{BONDED}; needle and taxel"
STATICS = (
    "beam statics on a half-space: friction at the ridge's height is a moment on its foot, whose "
    "shear right below is turned against the friction; a real ridge sits on a rigid chip"
)
NEAR = "bonded cover with an assumed place of sensing; nothing was fitted"

CHAPTER = Chapter(
    "Chapter 6 — hair, ridge and bump, and the real flat cover",
    (
        Item("layer-W-slope", "slope of W: bonded layer, needle and taxel of real size",
             "Fig. 4.16, section 4.3.3", 1.14, partial(modelled, SIZED, "slope of W"), 0.0, NEAR,
             kind="comparison", figure="flat-models"),
        Item("layer-A-power", "power of A: bonded layer, needle and taxel of real size",
             "Fig. 4.16, section 4.3.3", -1.45, partial(modelled, SIZED, "exponent of A"), 0.0,
             NEAR, kind="comparison", figure="flat-models"),
        Item("layer-inhibition", "largest over most negative: bonded layer, point load",
             "Fig. 4.13, section 4.3.3", 19.0, partial(modelled, BONDED, "lateral"), 0.0, NEAR,
             kind="comparison", figure="flat-models"),
        Item("fig-6.5-shear", "largest |T_x| over the largest S_n of a taxel with a hair",
             "Fig. 6.5: shear becomes “dominant”", 1.0, hair_size, 0.0,
             "no digits: dominant is larger", "", "at least", figure="fig-6.5"),
        Item("fig-6.5-direction", "T_x towards the motion over T_x against it",
             "Fig. 6.5: T_x “reflects motion direction”", 1.0, hair_lobes, 0.0,
             "no digits: the lobe towards the motion is the larger, there and back", "",
             "at least", figure="fig-6.5"),
        Item("fig-6.5-flat", "T_x over S_n of a flat cover right below a sliding tip",
             "(4.16): no shear right below, even with Q", 0.0, flat_sign, 1e-12, "rounding",
             figure="fig-6.5"),
        Item("fig-6.5-across", "largest T_y over largest T_x", "Fig. 6.5: T_y “nearly zero”",
             0.0, hair_across, 1e-9, "symmetry: rounding of the sum over the rod's top",
             figure="fig-6.5"),
        Item("fig-6.5-normal", "smallest S_n over the largest", "Fig. 6.5: S_n “is positive”",
             0.0, hair_normal, 0.05,
             "no digits; a load far ahead lifts by Q x + F z < 0, a few per cent", "",
             "at least", figure="fig-6.5"),
        Item("fig-6.7-flat", "shear against the friction over that along it, flat cover",
             "Fig. 6.7: point-load shape, both signs", 0.25, partial(wrong_way, "flat"), 0.0,
             "no digits: both signs are there", "", "at least", figure="fig-6.7"),
        Item("fig-6.7-across", "correlation of S_n across a ridge with the load on it",
             "Fig. 6.7: “a more direct function of the surface load”", 0.9,
             partial(directness, "across"), 0.0,
             "no digits: a direct function correlates nearly fully (a flat cover's: 0.6)", "",
             "at least", figure="fig-6.7"),
        Item("fig-6.7-along", "correlation of the shear along a ridge with a flat cover's",
             "Fig. 6.7: “acts the same way as a flat cover”", 1.0, likeness, 0.0, STATICS,
             kind="comparison", figure="fig-6.7"),
        Item("fig-6.7-gain", "shear's swing across a ridge over a flat cover's",
             "Fig. 6.7: “highly increased”", 1.0, shear_gain, 0.0, STATICS, "", "at least",
             kind="comparison", figure="fig-6.7"),
        Item("fig-6.16", "lateral strain under a bump over that without one",
             "Fig. 6.16: “increased lateral sensitivity”", 1.0, bump_gain, 0.0,
             "no digits: it must be larger", "", "at least", figure="fig-6.16"),
    ),
    FIGURES,
)  # fmt: skip
