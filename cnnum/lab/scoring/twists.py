"""Measures of twists: sense, centre and rate."""

from collections.abc import Iterator, Sequence

import numpy as np

from cnnum.lab.scoring.judge import HALF_PITCH, RATE_SHARE, Find, Judgement
from cnnum.lab.scoring.measures import Measure, quantile, share

NEARLY_ALL = 0.995
"""Share of the reported twists whose sense, centre and rate must each be right."""


def twist_measures(suite: str, judged: Sequence[Judgement]) -> Iterator[Measure]:
    """Yield sense, centre and rate of the twists that were reported."""
    finds = [find for one in judged for find in one.of("twist")]
    if not finds:
        return
    found = [find for find in finds if find.report is not None]
    right = sum(find.report is not None and find.report.sense == find.truth.sense for find in found)
    count = len(found)
    yield Measure("twist: sense right", suite, share(right, count), count, target=NEARLY_ALL)
    away = [find.away for find in found if find.away is not None]
    near = sum(a <= HALF_PITCH for a in away)
    yield Measure(
        "twist: centre within half a pitch", suite, share(near, count), count, target=NEARLY_ALL
    )
    for name, place in (("median", 0.5), ("95 % below", 0.95)):
        value = quantile(away, place)
        yield Measure(f"twist: centre error, {name}", suite, value, len(away), "pitches")
    yield from _rates(suite, found)


def _rates(suite: str, found: Sequence[Find]) -> Iterator[Measure]:
    """Yield how far `twist_rate` is off; a program that does not report it has no count."""
    reported = [find for find in found if "twist_rate" in find.play.outputs]
    errors = [error for find in reported if (error := rate_error(find)) is not None]
    near, count = sum(error <= RATE_SHARE for error in errors), len(errors)
    yield Measure("twist: rate within 10 %", suite, share(near, count), count, target=NEARLY_ALL)
    yield Measure("twist: rate error, median", suite, quantile(errors, 0.5), count)
    yield Measure("twist: rate told", suite, share(count, len(reported)), len(reported))


def rate_error(find: Find) -> float | None:
    """Return how far the rate told from the report on is off, as a share; None without one.

    A rate of 0 says that it is not known, and tells nothing.
    """
    play, truth = find.play, find.play.truth["twist_rate"]
    if find.report is None or "twist_rate" not in play.outputs:
        return None
    from_here = np.arange(play.frames) >= find.report.frame
    turning = from_here & (truth == truth[find.truth.frame]) & (play.outputs["twist"] > 0)
    told = play.outputs["twist_rate"][turning]
    told = told[told != 0.0]
    if not len(told):
        return None
    return abs(float(np.nanmedian(told)) / float(truth[find.truth.frame]) - 1.0)
