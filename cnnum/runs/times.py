"""A transient at several times: runs from one time to the next."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import finite
from cnnum.errors import ArrayError, MethodError
from cnnum.runs.result import Result
from cnnum.templating.reads import autonomous
from cnnum.templating.template import Duration, Template

MOST = 10_000
"""Times of one run."""

DIGITS = 9
"""Decimals of a stretch of time: stretches that differ by rounding run by the same plan."""

Run = Callable[..., Result]
"""`Engine.run` of a template, without its duration."""


def checked_times(at: ArrayLike, duration: Duration | None = None) -> tuple[float, ...]:
    """Return times in time constants, each after the one before.

    Raises
    ------
    MethodError
        If they are not, or there are none; or if there is a duration, too.
    """
    if duration is not None:
        raise MethodError("A run has a duration, or times 'at' which it is looked at: not both.")
    try:
        times = finite("at", at)
    except ArrayError as error:
        raise MethodError(str(error)) from None
    rising = times.ndim == 1 and times.size and times[0] >= 0.0 and (np.diff(times) > 0.0).all()
    if not rising or times.size > MOST:
        raise MethodError(
            f"'at' is a list of 1 to {MOST} times from 0 up, each after the one before, in time "
            f"constants, got {np.array2string(times, threshold=8).rstrip('.')}."
        )
    return tuple(float(time) for time in times)


def restartable(template: Template) -> bool:
    """Return whether an array goes on from its state alone, wherever its time stands."""
    return autonomous(template)


def run_at(
    template: Template, times: Sequence[float], run: Run, maps: dict[str, ArrayLike | None]
) -> Result:
    """Return the results at all times, along a new first axis.

    An array that its state alone determines runs from each time to the next; its errors are summed.
    One with delays or gains in time runs from the start to each time.

    Parameters
    ----------
    template : Template
    times : sequence of float
    run : callable
        Takes the maps and a duration.
    maps : dict of str to array
        Input, previous, state, bias and mask.
    """
    if not restartable(template):
        return stacked([run(**maps, duration=time) for time in times], times)
    found: list[Result] = []
    now, before, error = dict(maps), 0.0, np.zeros(())
    for time in times:
        result = run(**now, duration=round(time - before, DIGITS))
        error = error + result.error
        found.append(replace(result, error=np.asarray(error)))
        before = time
        now = {**now, "state": result.state}
        if not template.inputs:
            now["input"] = None  # it was the initial state
    return stacked(found, times)


def stacked(results: Sequence[Result], times: Sequence[float]) -> Result:
    """Return results at several times as one, with the times along a new first axis."""

    def over(name: str) -> np.ndarray:
        return np.stack([np.asarray(getattr(result, name)) for result in results])

    lead = np.ndim(results[0].time)
    reached = np.array(times).reshape(-1, *(1,) * lead)
    methods = dict.fromkeys(result.method for result in results)
    return Result(
        output=over("output"),
        state=over("state"),
        time=np.broadcast_to(reached, over("time").shape).copy(),
        steps=np.cumsum(over("steps"), axis=0),
        settled=over("settled"),
        error=over("error"),
        method=", ".join(methods),
        reason=results[-1].reason,
        times=tuple(times),
    )
