"""Section 6.2: a hair on the taxel feels which way a tip slides (Fig. 6.5)."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.figure import Curve, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import BETA, MM, E, Z
from cnnum.tactile.cover.flat import FlatCover
from cnnum.tactile.cover.hair import HairCover

FRICTION = 0.5
"""Of a tip that slides on rubber; no value is published."""

FORCE = 10e-3
"""N, of the tip."""

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

    S_n is the mean pressure. T is the difference of pressure between opposite rims of the foot,
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


CHAPTER = Chapter(
    "Section 6.2 — artificial hair",
    (
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
    ),
    {
        "fig-6.5": figure_6_5,
    },
)  # fmt: skip
