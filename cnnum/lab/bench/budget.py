"""A time for a whole benchmark, shared out evenly over its cases; others are named."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

Row = TypeVar("Row")
Task = tuple[str, Callable[[], Row | None]]
"""The name of a row, and its measurement."""


def shared_out(
    cases: Sequence[str],
    tasks_of: Callable[[str], Iterable[Task[Row]]],
    seconds: float,
) -> Iterator[Row | str | None]:
    """Yield the rows of all cases, as they are measured.

    A case may take an equal share of the time that is left. So the cases that follow get the rest
    of a short one, and share the overrun of a long one.

    Parameters
    ----------
    cases : sequence of str
    tasks_of : callable
        Yields the tasks of a case.
    seconds : float
        For all cases. No task begins after a case's share is over; one that has begun is finished.

    Yields
    ------
    row, str or None
        An item a task: a row, None where there is none, and instead of those that were not begun
        a sentence that names them.
    """
    until = time.perf_counter() + seconds
    for number, case in enumerate(cases):
        share = (until - time.perf_counter()) / (len(cases) - number)
        yield from _within(case, tasks_of(case), max(share, 0.0))


def _within(case: str, tasks: Iterable[Task[Row]], seconds: float) -> Iterator[Row | str | None]:
    until, missed = time.perf_counter() + seconds, list[str]()
    for name, measure in tasks:
        if time.perf_counter() < until:
            yield measure()
        else:
            missed.append(name)
    if missed:
        names = "; ".join(missed)
        yield f"{case}: not run, as its share of the time ({seconds:.3g} s) was over: {names}."
        yield from [None] * (len(missed) - 1)
