"""Errors of what benchmarks time, against the reference engine: no loose answer wins a figure."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.bench.samples import TOUCHED, touch
from cnnum.engine import Engine
from cnnum.plan import Plan
from cnnum.program_library import get_program

SLOW_REFERENCE = ("halfspace_equilibrium", "halfspace_layers", "surface_load")
"""Programs of which the reference engine takes longer than ten seconds a frame."""

REFERENCE_S = 15.0
"""s that the reference engine may take for a program's frames."""

STEPS = 20
"""Fixed steps after which states are compared; a timed run takes more of the same."""

Answer = dict[str, Floats]


def truths(name: str, shape: Shape, seconds: float, size: float = 1.0) -> list[Answer]:
    """Return what the reference engine makes of a program on the first frames of `touch`.

    Parameters
    ----------
    name : str
        A program of the library.
    shape : (rows, cols)
    seconds : float
        After which no further frame begins; one always does.
    size : float
        What the frames are multiplied with.
    """
    stream = Engine("reference").compile(get_program(name), shape).stream()
    found: list[Answer] = []
    until = time.perf_counter() + seconds
    for frame in _sized(shape, size):
        if found and time.perf_counter() > until:
            break
        found.append(stream.push(frame))
    return found


def _sized(shape: Shape, size: float) -> Floats:
    # in float64: single precision has no small numbers left to multiply
    return size * touch(shape=shape).astype(np.float64)


def stream_error(plan: Plan, true: list[Answer], size: float = 1.0) -> float:
    """Return the largest difference of a plan's outputs from the truth, each over its largest.

    It is that of the frames with a contact, if the truth has some: the direction of a pull that
    is not there is rounding.
    """
    stream = plan.stream()
    got = [stream.push(frame) for frame in _sized(plan.schedule.shape, size)[: len(true)]]
    first = TOUCHED if len(true) > TOUCHED else 0
    found: list[float] = [0.0]
    for name in true[0]:
        ours, theirs = (np.stack([each[name] for each in all_[first:]]) for all_ in (got, true))
        largest = float(np.abs(theirs).max())
        found.append(float(np.abs(ours - theirs).max()) / (largest or 1.0))
    return max(found)


def program_error(plan: Plan, name: str) -> float | None:
    """Return the error of a program's stream; None where the reference is too slow to tell."""
    if name in SLOW_REFERENCE:
        return None
    return stream_error(plan, truths(name, plan.schedule.shape, REFERENCE_S))


def ends_error(
    run: Callable[[Engine, NDArray[np.floating]], Floats],
    engine: Engine,
    batch: NDArray[np.floating],
) -> float:
    """Return the error of a batch's first and last frame over their largest value.

    Parameters
    ----------
    run : callable
        Runs frames on an engine.
    engine : Engine
    batch : (frames, ...) float
    """
    ends = [0, len(batch) - 1]
    got, true = run(engine, batch)[ends], run(Engine("reference"), batch[ends])
    return float(np.abs(got - true).max() / np.abs(true).max())
