"""Running a program on an engine, and comparing its outputs with a closed form."""

import statistics
import time
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from cnnum.arrays import Floats, as_shape
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm
from cnnum.templating.checks.records import CheckResult

RATE = 200.0
"""Frames a second of a case that says none, Hz."""


class Stream(Protocol):
    """A stream as a check uses it."""

    def push(self, frame: Floats, /) -> Mapping[str, Floats]:
        """Run the program on the next frame."""
        ...


class Plan(Protocol):
    """A plan as a check uses it."""

    def stream(self, batch: Sequence[int] = ()) -> Stream:
        """Return a stream of frames."""
        ...


class Program(Protocol):
    """A program as a check uses it."""

    def bind(self, **parameters: object) -> Any:
        """Return the program with its parameters set."""
        ...


class Compiler(Protocol):
    """An engine as a check uses it."""

    @property
    def name(self) -> str:
        """As users call it."""
        ...

    @property
    def precision(self) -> str:
        """Of the arithmetic: "float32" or "float64"."""
        ...

    def compile(
        self, program: Any, shape: Sequence[int], needs: Sequence[str] | None = None, /
    ) -> Plan:
        """Return a plan of a program."""
        ...


def run_program_check(
    form: ProgramForm,
    program: Program,
    engine: Compiler,
    *,
    seed: int = 0,
    shape: Sequence[int] = (8, 8),
    repeats: int = 1,
) -> CheckResult:
    """Run a program on the frames of a closed form and measure how far the outputs are from it.

    Parameters
    ----------
    form : ProgramForm
    program : Program
        The one that the form names.
    engine : Engine
        Object with a name, a precision and `compile`.
    seed : int
        Seed of the noise and the places drawn.
    shape : (rows, cols)
    repeats : int
        Timed runs after a first one; their median is reported, or the first's time for 0.

    Returns
    -------
    CheckResult
        `seconds` is the time of all frames.
    """
    size = as_shape(shape)
    case = form.cases(np.random.default_rng(seed), size)
    plan = engine.compile(program.bind(**{"rate": RATE, **case.parameters}), size, form.needs)
    begin = time.perf_counter()
    frames = streamed(plan, case)
    taken = [time.perf_counter() - begin]
    if repeats:
        taken = [_seconds(plan, case) for _ in range(repeats)]
    error = judged(form, case, frames)
    return CheckResult(
        template=form.program,
        engine=engine.name,
        precision=engine.precision,
        method="program",
        check=form.name,
        error=error,
        tolerance=form.tolerance,
        seconds=statistics.median(taken),
        passed=error <= form.tolerance,
        reason="a program runs every template by its own method",
    )


def streamed(plan: Plan, case: ProgramCase) -> list[Outputs]:
    """Return the outputs of every frame of a case, one after the other."""
    stream = plan.stream(case.batch)
    return [stream.push(frame) for frame in case.frames]


def judged(form: ProgramForm, case: ProgramCase, frames: Sequence[Outputs]) -> float:
    """Return the largest error of the outputs of a case's frames."""
    return form.error(case, frames[-1] if form.compares == "last" else _stacked(frames))


def _seconds(plan: Plan, case: ProgramCase) -> float:
    begin = time.perf_counter()
    streamed(plan, case)
    return time.perf_counter() - begin


def _stacked(frames: Sequence[Outputs]) -> Outputs:
    return {name: np.stack([frame[name] for frame in frames]) for name in frames[0]}
