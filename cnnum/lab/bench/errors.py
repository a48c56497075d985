"""Errors of timed runs, against the reference engine: no loose answer wins a figure."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.engine import Engine
from cnnum.lab.bench.samples import TOUCHED, touch
from cnnum.plan import Plan
from cnnum.programs.library import get_program
from cnnum.templating.checks.program_registry import program_forms
from cnnum.templating.checks.program_run import RATE, run_program_check

SLOW_REFERENCE = ("halfspace_equilibrium", "halfspace_layers", "surface_load")
"""Programs whose frame takes the reference engine over ten seconds; all have a closed form."""

REFERENCE_S = 15.0
"""s that the reference engine may take for a program's frames."""

STEPS = 20
"""Fixed steps after which states are compared; a timed run takes more of the same."""

Answer = dict[str, Floats]


@dataclass(frozen=True, slots=True)
class Judged:
    """An error, and its reference.

    Attributes
    ----------
    error : float
        Largest of the outputs, each over its largest value.
    truth : str
        "reference engine", or the name of a closed form.
    frames : int
        Number of frames compared.
    """

    error: float
    truth: str
    frames: int


def truths(
    name: str,
    shape: Shape,
    seconds: float,
    size: float = 1.0,
    needs: Sequence[str] | None = None,
) -> list[Answer]:
    """Return the reference engine's results of a program on the first frames of `touch`.

    Parameters
    ----------
    name : str
        A program of the library.
    shape : (rows, cols)
    seconds : float
        After which no further frame begins; one always does.
    size : float
        Factor of the frames.
    needs : sequence of str, optional
        Outputs; all unless given.
    """
    stream = Engine("reference").compile(get_program(name).bind(rate=RATE), shape, needs).stream()
    result: list[Answer] = []
    until = time.perf_counter() + seconds
    for frame in streamed_frames(shape, size):
        if result and time.perf_counter() > until:
            break
        result.append(stream.push(frame))
    return result


def streamed_frames(shape: Shape, size: float = 1.0) -> Floats:
    """Return the frames of `touch`, multiplied with a size."""
    # in float64: single precision has no small numbers left to multiply
    return size * touch(shape=shape).astype(np.float64)


def stream_error(
    plan: Plan, true: list[Answer], size: float = 1.0, over: list[Answer] | None = None
) -> float:
    """Return the largest difference of a plan's outputs from the truth, each over its largest.

    It is that of the frames with a contact, if the truth has some: the direction of a pull that
    is not there is rounding.

    Parameters
    ----------
    plan : Plan
    true : list of dict
        The results of `truths`.
    size : float
        Factor of the frames.
    over : list of dict, optional
        Answers whose largest values are to be divided by; the truth unless given.
    """
    stream = plan.stream(rate=RATE)
    got = [stream.push(frame) for frame in streamed_frames(plan.schedule.shape, size)[: len(true)]]
    first = TOUCHED if len(true) > TOUCHED else 0
    result: list[float] = [0.0]
    for name in true[0]:
        ours, theirs, whole = (
            np.stack([answer[name] for answer in all_[first:]])
            for all_ in (got, true, over or true)
        )
        largest = float(np.abs(whole).max())
        result.append(float(np.abs(ours - theirs).max()) / (largest or 1.0))
    return max(result)


def program_error(engine: Engine, plan: Plan, name: str) -> Judged:
    """Return the error of a program's stream; where the reference is too slow, of its check.

    It is too slow where its time is over before anything touches, when all outputs may be 0.
    """
    if name in SLOW_REFERENCE:
        return form_error(engine, name, plan.schedule.shape)
    shape, needs = plan.schedule.shape, tuple(plan.schedule.outputs)
    true = truths(name, shape, REFERENCE_S, needs=needs)
    if len(true) <= TOUCHED and program_forms(name):
        return form_error(engine, name, shape)
    return Judged(stream_error(plan, true), "reference engine", len(true))


def form_error(engine: Engine, name: str, shape: Shape) -> Judged:
    """Return the largest error against the closed forms of a program, as its check has it."""
    forms = program_forms(name)
    results = [run_program_check(form, get_program(name), engine, shape=shape) for form in forms]
    worst = max(results, key=lambda result: result.error)
    return Judged(worst.error, f"closed form '{worst.check}'", len(results))


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
