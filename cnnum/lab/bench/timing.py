"""Wall time of calls on a machine that others share: medians, spreads and interleaved runs."""

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Call = Callable[[], object]


@dataclass(frozen=True, slots=True)
class Timing:
    """How long a call takes.

    Attributes
    ----------
    least, median, spread : float
        s; the spread is from the first to the third quartile.
    runs : int
    """

    least: float
    median: float
    spread: float
    runs: int

    @classmethod
    def of(cls, seconds: Sequence[float]) -> "Timing":
        """Return the summary of at least one run."""
        if len(seconds) < 2:
            return cls(seconds[0], seconds[0], 0.0, len(seconds))
        low, middle, high = statistics.quantiles(seconds, n=4, method="inclusive")
        return cls(min(seconds), middle, high - low, len(seconds))


TURN_S = 0.05
"""s of a turn that a call takes again and again, unless it is longer."""


def seconds_of(call: Call, count: int = 1) -> float:
    """Return the wall time of a call, s: the mean of a series."""
    begin = time.perf_counter()
    for _ in range(count):
        call()
    return (time.perf_counter() - begin) / count


def timed(call: Call, *, budget: float = 1.0, runs: int = 9) -> Timing:
    """Return the time of a call that has been warmed up.

    Parameters
    ----------
    call : callable
    budget : float
        s after which no further run begins; one always does.
    runs : int
        At most.
    """
    (timing,) = interleaved([call], budget=budget, runs=runs)
    return timing


def interleaved(calls: Sequence[Call], *, budget: float = 2.0, runs: int = 9) -> tuple[Timing, ...]:
    """Return the times of calls that take turns, so that all see the same disturbances.

    A short call is repeated in its turn, as it would be in use: alone after another's, it would
    find nothing in the caches.
    """
    first = [seconds_of(call) for call in calls]
    if max(first) > budget:  # so long a run needs no warming up, and leaves no time for turns
        return tuple(
            Timing.of([seconds]) if seconds > budget else timed(call, budget=budget, runs=runs)
            for seconds, call in zip(first, calls, strict=True)
        )
    taken: list[list[float]] = [[] for _ in calls]
    turn = min(TURN_S, budget / runs)
    repeats = [max(1, int(turn / max(seconds, 1e-9))) for seconds in first]
    until = time.perf_counter() + budget
    for _ in range(runs):
        for seconds, call, count in zip(taken, calls, repeats, strict=True):
            seconds.append(seconds_of(call, count))
        if time.perf_counter() > until:
            break
    return tuple(Timing.of(seconds) for seconds in taken)


@dataclass(frozen=True, slots=True)
class Difference:
    """How much longer one call takes than another that does a part of the same.

    Attributes
    ----------
    more : float
        s, the median over the turns; a disturbance that hits one of the two does not move it.
    long : Timing
        Of the longer one.
    share : float
        Median over the turns of ``work / more / against``: the work a second over the rate of the
        same turn. NaN without one.
    """

    more: float
    long: Timing
    share: float


def difference(
    short: Call,
    long: Call,
    *,
    work: float = math.nan,
    against: Callable[[], float] | None = None,
    budget: float = 2.0,
    runs: int = 15,
) -> Difference:
    """Return how much longer the long call takes, in at least three turns of both.

    Parameters
    ----------
    short, long : callable
    work : float
        Work that the long call does more.
    against : callable, optional
        Returns the rate for ``share``. It is asked before each call of a turn and
        after the last, and the mean counts: on a shared machine rates change by the second.
    budget : float
        s after which no further turn begins.
    runs : int
        Turns, at most.
    """
    short()
    long()
    until = time.perf_counter() + budget
    turns: list[tuple[float, float, float]] = []
    rate = against or (lambda: math.nan)
    while len(turns) < runs and (len(turns) < 3 or time.perf_counter() < until):
        rates = [rate()]
        first = seconds_of(short)
        rates.append(rate())
        second = seconds_of(long)
        rates.append(rate())
        turns.append((max(second - first, 1e-9), second, statistics.mean(rates)))
    return Difference(
        statistics.median(more for more, _, _ in turns),
        Timing.of([second for _, second, _ in turns]),
        statistics.median(work / more / rate for more, _, rate in turns),
    )
