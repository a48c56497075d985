"""Levels of `slip` and `twist` by the rate of false reports that they lead to.

The rates are those of simulated hands that grip, press, pull in part, tremble and shake, without
slip: `docs/scoring.md` has the table and its command. Rolling under a weight is not among them.
"""

import numpy as np

from cnnum.programs.parameters import refuse_outside

Levels = tuple[tuple[float, float], ...]
"""Reports in ten minutes, from few to many, and the level that leads to them."""

SLIP: Levels = ((0.3, 0.45), (1.0, 0.40), (2.0, 0.32), (4.0, 0.28), (13.0, 0.20))
TWIST: Levels = ((0.3, 0.1), (0.6, 0.03), (4.0, 0.02), (50.0, 0.01))


def level_of(false_reports: float, levels: Levels) -> float:
    """Return the level of a rate: between two that were measured, straight over its logarithm.

    Raises
    ------
    ProgramError
        If the rate is outside those that were measured.
    """
    refuse_outside(false_reports=(false_reports, levels[0][0], levels[-1][0]))
    rates, heights = zip(*levels, strict=True)
    return float(np.interp(np.log(false_reports), np.log(rates), heights))
