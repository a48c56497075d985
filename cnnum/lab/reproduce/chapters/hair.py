"""Section 6.2: a hair on the taxel feels which way a tip slides (Fig. 6.5)."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters import printed
from cnnum.lab.reproduce.faults import changed, scaled
from cnnum.lab.reproduce.figure import Curve, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import BETA, MM, E, Z
from cnnum.tactile.cover.hair import HairCover
from cnnum.tactile.cover.protocol import FlatCover

FRICTION = 0.5
"""Friction of a tip that slides on rubber; no value is published."""

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


def hair_normal() -> float:
    """Return the smallest S_n over the largest."""
    both = np.concatenate([hair_signals(X, 1.0), hair_signals(X, -1.0)])
    return float(both[:, 2].min() / both[:, 2].max())


def caught_gap() -> float:
    """Return how far force and moment on the foot are from the printed stress, summed over the top.

    By (4.11) on 64 rings of 96 points of the rod's top. The rod hands the force on, with its
    length as the lever.
    """
    rod = hair()
    nodes, weights = np.polynomial.legendre.leggauss(64)
    rho = 0.5 * rod.radius * (nodes + 1.0)
    turn = 2.0 * np.pi * np.arange(96) / 96
    x, y = (np.multiply.outer(rho, f(turn)).reshape(-1) for f in (np.cos, np.sin))
    area = np.repeat(0.5 * rod.radius * weights * rho * 2.0 * np.pi / 96, 96)
    gaps: list[float] = []
    for way in (1.0, -1.0):
        places, force = sliding(X[::20], way)
        total, moment = rod.caught(places, force)
        for at, ours, turned in zip(places, total, moment, strict=True):
            place = np.stack([x - at[0], y - at[1], np.full_like(x, rod.above)])
            push = -printed.stress(place, np.broadcast_to(force[:, np.newaxis], place.shape))[2]
            theirs = push @ area
            tilt = np.array([push[2] @ (area * x), push[2] @ (area * y)])
            tilt += rod.length * theirs[:2]
            gaps.append(float(np.abs(ours - theirs).max() / FORCE))
            gaps.append(float(np.abs(turned - tilt).max() / FORCE / rod.length))
    return max(gaps)


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
        Item("fig-6.5", "force and moment of a tip on a hair's foot, as it slides over it",
             "Fig. 6.4, 6.5; (4.11)", 0.0, caught_gap, 1e-9,
             "two quadratures of a smooth field over the rod's top: rounding", "of the load",
             figure="fig-6.5",
             faults=(changed(HairCover.caught, "sign of the moment", lambda two: (two[0], -two[1])),
                     scaled(FlatCover.stress, 1.001))),
        *(
            Item(name, title, f"Fig. 6.5: {said}", expected, compute, 0.0, reason, "", "at least",
                 kind="comparison", figure="fig-6.5")
            for name, title, said, expected, compute, reason in (
                ("fig-6.5-shear", "largest |T_x| over the largest S_n of a taxel with a hair",
                 "shear becomes “dominant”", 1.0, hair_size,
                 "no digits; statics of a rigid rod, of signals in units of pressure"),
                ("fig-6.5-direction", "T_x towards the motion over T_x against it",
                 "T_x “reflects motion direction”", 1.0, hair_lobes,
                 "no digits; depends on the friction, which is not published"),
                ("fig-6.5-normal", "smallest S_n over the largest", "S_n “is positive”", 0.0,
                 hair_normal, "no digits; a load far ahead lifts by Q x + F z < 0"),
            )
        ),
    ),
    {
        "fig-6.5": figure_6_5,
    },
)  # fmt: skip
