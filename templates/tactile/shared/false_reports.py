"""Levels of `slip` and `twist` by the rate of false reports that they lead to.

Rates are upper bounds (90 %) from simulated hands that grip, press, pull in part, tremble and
shake, without slip: `docs/figures/false_reports.py`. Rolling under a weight is not among them.
"""

from math import log

import numpy as np

from cnnum.programs.parameters import refuse_outside

Levels = tuple[tuple[float, float], ...]
"""Reports in ten minutes, from few to many, and the level that leads to them."""

SLIP: Levels = (
    (0.5, 0.60), (1.2, 0.50), (2.0, 0.40), (3.2, 0.36), (4.7, 0.32), (5.9, 0.28), (6.4, 0.25),
    (11.6, 0.20),
)  # fmt: skip
TWIST: Levels = ((0.3, 0.1), (0.5, 0.03), (0.7, 0.02), (5.0, 0.01))


def level_of(false_reports: float, levels: Levels) -> float:
    """Return the level of a rate: between two that were measured, straight over its logarithm.

    Raises
    ------
    ProgramError
        If the rate is outside those that were measured.
    """
    refuse_outside(false_reports=(false_reports, levels[0][0], levels[-1][0]))
    rates = [log(rate) for rate, _ in levels]
    found = np.interp(np.array([log(false_reports)]), rates, [level for _, level in levels])
    return float(found[0])
