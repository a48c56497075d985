"""Errata of the dissertation: the printed value, and the right one."""

from math import sqrt

import numpy as np

from cnnum.lab.reproduce.faults import scaled
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.tactile.inverse import largest_spacing
from cnnum.tactile.pad import Pad
from cnnum.tactile.taxel import Bridge, Piezoresistor
from cnnum.tactile.texture import WINDOW, texture

FLAT = 0.5
"""A coefficient of friction that does not change."""


def third_nearest() -> float:
    """Return the pitch, in depths, at which the third-nearest taxel just reaches √2 z.

    The place of a load in a cell of the square array is searched on a lattice, which holds the
    worst places: midway between two neighbours.
    """
    side = np.linspace(0.0, 1.0, 21)
    x, y = np.meshgrid(side, side)
    taxels = np.stack(np.meshgrid(np.arange(-1, 3), np.arange(-1, 3)), axis=-1).reshape(-1, 2)
    away = np.hypot(x[..., None] - taxels[:, 0], y[..., None] - taxels[:, 1])
    return sqrt(2.0) / float(np.sort(away, axis=-1)[..., 2].max())


S1, S2, S3, S4 = 5.0, 3.0, 2.0, 1.0
"""Pressures of four taxels under a bump, in the order of Fig. 6.13."""


def unevenly_pressed() -> float:
    """Return T_y of a bump on four taxels; rows run along y, which points up in Fig. 6.13."""
    frame = np.array([[S3, S4], [S1, S2]])
    return float(Pad.regular((2, 2)).to_three_axial(frame)[0, 0, 1])


def even_friction() -> float:
    """Return the friction of a window in which it does not change."""
    signals = np.tile([FLAT, 0.0, 1.0], (WINDOW + 1, 1))
    return float(texture(signals).friction[-1])


def wave() -> tuple[np.ndarray, int]:
    """Return five ratios whose mean is 1 and whose variance is ½, and T = 4."""
    return np.array([2.0, 1.0, 1.0, 1.0, 0.0]), 4


def rough() -> float:
    """Return the roughness of five ratios, ours."""
    ratios, window = wave()
    signals = np.stack([ratios, np.zeros(5), np.ones(5)], axis=-1)
    return float(texture(signals, window=window).roughness[-1])


def rough_as_printed() -> float:
    """Return (6.4) as printed, over T − 1, but with the mean for μ̄."""
    ratios, window = wave()
    return float(100.0 * np.sqrt(np.sum((ratios - 1.0) ** 2) / (window - 1)))


def transversal() -> float:
    """Return π_t, 1e-11/Pa."""
    return 1e11 * Piezoresistor().transversal


def table_change() -> float:
    """Return ΔR/R under 10 mN normal load."""
    return float(Bridge().resistance_change([0.0, 0.0, 10e-3])[0])


CHAPTER = Chapter(
    "Errata — as printed, and as it should be",
    (
        Item("erratum-3.6", "π_t, whose second line is printed as π_l", "(3.6)",
             0.5 * (6.6 - 1.1 - 138.1), transversal, 1e-12, "closed form", "1e-11/Pa",
             printed=lambda: 0.5 * (6.6 - 1.1 + 138.1),
             faults=(scaled(Piezoresistor.transversal, -1.0),
                     scaled(Piezoresistor.transversal, 1.001))),
        Item("erratum-3.6-unit", "ΔR/R under 10 mN; π is printed without its 1e-11",
             "after (3.6); Table 3.I", -0.114, table_change, 5e-4,
             "the table prints three decimals", printed=lambda: 1e11 * table_change(),
             faults=(scaled(Bridge.resistance_change, 1.01),)),
        Item("erratum-5.11", "largest pitch with three taxels inside √2 z of any load",
             "(5.11); right: √(8/5) z", third_nearest(), lambda: float(largest_spacing(1.0)),
             1e-9, "found by a search over a lattice of loads, on which the worst place lies", "z",
             printed=lambda: (1.0 + sqrt(2.0)) / 2.0, faults=(scaled(largest_spacing, 1.001),)),
        Item("erratum-6.2", "T_y of the pressures 5, 3, 2, 1; printed S1 − S2 − S3 − S4",
             "(6.2); right: (6.1) turned by 45°", sqrt(0.5) * (S1 + S2 - S3 - S4),
             unevenly_pressed, 1e-12, "rounding", printed=lambda: sqrt(0.5) * (S1 - S2 - S3 - S4),
             faults=(scaled(Pad.to_three_axial, -1.0, entry=1),
                     scaled(Pad.to_three_axial, 1.001, entry=1))),
        Item("erratum-6.3", "mean friction of a constant 0.5, printed as a sum", "(6.3)", FLAT,
             even_friction, 1e-12, "rounding", printed=lambda: FLAT * (WINDOW + 1),
             faults=(scaled(texture, 1.001, part="friction"),)),
        Item("erratum-6.4", "roughness of five ratios of variance ½, printed over T − 1",
             "(6.4)", 100.0 * sqrt(0.5), rough, 1e-10, "unbiased variance of T + 1 points: over T",
             "%", printed=rough_as_printed, faults=(scaled(texture, sqrt(0.8), part="roughness"),
                                                   scaled(texture, 1.001, part="roughness"))),
    ),
    {},
)  # fmt: skip
