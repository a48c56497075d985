"""Templates from pictures: celnn's genetic algorithm and gradients against ours, to its loss."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from typing import TypeVar

import numpy as np

from cnnum.design.learning import Learned, Lesson, learn, untied
from cnnum.errors import CnnumError, MissingExtraError
from cnnum.lab.bench.peers.celnn_learning import (
    STEP,
    STEPS,
    Task,
    genetic,
    gradients,
    judged,
    tasks,
)
from cnnum.templating.template import Template

T = TypeVar("T")

TURNS, FEW = 5, 3
"""Timings of ours, the median of which counts; theirs are seconds long, and few."""

NEAR = 1e-4
"""A loss that is as good as none: outputs are off by 1 % of the range at most."""


@dataclass(frozen=True, slots=True)
class DesignRun:
    """A row of `cnnum bench design`.

    Attributes
    ----------
    case, peer, peer_version : str
        The template that is to be found again, and the peer's way.
    peer_seconds, seconds : float
        Until theirs ends, and until our loss, as celnn judges it, is no larger; medians, s.
    ratio : float
    peer_error, error : float
        Mean squared errors.
    peer_runs, runs : int
        Of the array; ours with gradients.
    near_seconds, near_error : float
        Of ours, until the loss is as good as none or all starts have ended.
    """

    case: str
    peer: str
    peer_version: str
    peer_seconds: float
    seconds: float
    ratio: float
    peer_error: float
    error: float
    peer_runs: int
    runs: int
    near_seconds: float
    near_error: float


def measure_design(*, quick: bool = False) -> Iterator[DesignRun | str]:
    """Yield one row per task, or a sentence where a peer's library is missing.

    Parameters
    ----------
    quick : bool
        One timing each, and few tasks.
    """
    ways = (("celnn's genetic algorithm", genetic, False), ("celnn's gradients", gradients, True))
    for name, way, signals in ways:
        try:
            given = tasks(signals=signals)
            for task in given[:2] if quick else given:
                yield _race(name, way, task, quick=quick)
        except MissingExtraError as missing:
            yield str(missing)


def _race(
    name: str, way: Callable[[Task], tuple[float, int]], task: Task, *, quick: bool
) -> DesignRun:
    _ours(task, np.inf)  # compiled loops are read, or compiled the first time
    turns = 1 if quick else FEW
    theirs = [_timed(lambda: way(task)) for _ in range(turns)]
    loss, count = theirs[0][1]
    ours = [_timed(lambda: _ours(task, loss)) for _ in range(1 if quick else TURNS)]
    made = ours[0][1]
    near_seconds, near = _timed(lambda: _ours(task, NEAR))
    error = _judged(task, made.template)
    # our run and celnn's are the same steps: roundings alone are between them
    if error > loss + 1e-9:
        raise CnnumError(f"'{task.name}': celnn judges ours at {error:g}, expected {loss:g}.")
    peer = float(np.median([seconds for seconds, _ in theirs]))
    seconds = float(np.median([time for time, _ in ours]))
    return DesignRun(
        case=task.name,
        peer=name,
        peer_version=version("celnn"),
        peer_seconds=peer,
        seconds=seconds,
        ratio=peer / seconds,
        peer_error=loss,
        error=error,
        peer_runs=count,
        runs=made.evaluations,
        near_seconds=near_seconds,
        near_error=_judged(task, near.template),
    )


def _timed(call: Callable[[], T]) -> tuple[float, T]:
    begin = time.perf_counter()
    result = call()
    return time.perf_counter() - begin, result


def _ours(task: Task, enough: float) -> Learned:
    form = untied("learned", size=task.size, boundary="zero-flux", rows=task.input.ndim == 1)
    lesson = Lesson(
        form,
        np.atleast_2d(task.target),
        np.atleast_2d(task.input),
        duration=STEPS * STEP,
        step=STEP,
        method="euler",
    )
    return learn(lesson, restarts=6, enough=enough)


def _judged(task: Task, template: Template) -> float:
    own = task.size // 2 if task.input.ndim == 1 else slice(None)
    return judged(task, template.A[0, 0][own], template.B[0, 0][own], float(template.z[0]))
