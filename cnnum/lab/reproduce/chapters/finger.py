"""Section 6.4.4: a finger going round over a taxel with and without a bump (Fig. 6.16)."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters.hair import FRICTION
from cnnum.lab.reproduce.figure import Dots, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import E, Z
from cnnum.tactile.cover.bump import BumpCover

PITCH = 1.5e-3
"""Pitch of the taxels, m."""

FINGER = 4e-3
"""Radius of the contact of a finger, m."""


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
        "Right below a bump the moment of the rub turns the strain's sign. So the loop is on "
        "the other side.",
        (Panel("Tangential strains", "ε_xz (%)", "ε_yz (%)", dots, equal=True),),
    )


CHAPTER = Chapter(
    "Section 6.4.4 — a finger on a bump",
    (
        Item("fig-6.16", "lateral strain under a bump over that without one",
             "Fig. 6.16: “increased lateral sensitivity”", 1.0, bump_gain, 0.0,
             "no digits; two models, one of a bump that bears all of its square's load", "",
             "at least", kind="comparison", figure="fig-6.16"),
    ),
    {
        "fig-6.16": figure_6_16,
    },
)  # fmt: skip
