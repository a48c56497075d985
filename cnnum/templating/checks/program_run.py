"""A program's check: frames of known answer, the run, and the error of outputs."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np

from cnnum.arrays import Floats, Shape, as_shape
from cnnum.templating.checks.records import CheckResult

Outputs = Mapping[str, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class ProgramCase:
    """Frames that a program is run on, and the right answer.

    Attributes
    ----------
    frames : (frames, [batch,] rows, cols, channels) float
        One stream, or several side by side.
    expected : mapping
        The reference of the form's `error`.
    parameters : mapping
        Keyword parameters of the program.
    """

    frames: Floats
    expected: Outputs
    parameters: Mapping[str, object] = field(default_factory=dict[str, object])

    @property
    def batch(self) -> tuple[int, ...]:
        """Leading axes of one frame."""
        return self.frames.shape[1:-3]


@dataclass(frozen=True, slots=True)
class ProgramForm:
    """A closed form that a tactile program is checked against.

    Attributes
    ----------
    name : str
        Name of the closed form.
    program : str
        Program of the program in the library.
    needs : tuple of str
        Outputs that are compared.
    cases : callable
        (random generator, (rows, cols)) to a case.
    error : callable
        (case, outputs of the last frame, or of all) to the largest error.
    tolerance : float
    tolerance_reason : str
        Why it is not smaller.
    summary : str
        Description of the answer.
    too_slow : tuple of str
        Engines that take longer than a minute, and are left out.
    left_out : str
        Why.
    compares : "last" or "all"
        The last frame's outputs, or those of all frames, with the frames as the first axis.
    """

    name: str
    program: str
    needs: tuple[str, ...]
    cases: Callable[[np.random.Generator, Shape], ProgramCase]
    error: Callable[[ProgramCase, Outputs], float]
    tolerance: float
    tolerance_reason: str
    summary: str
    too_slow: tuple[str, ...] = ()
    left_out: str = ""
    compares: Literal["last", "all"] = "last"


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
        """Precision of the arithmetic, "float32" or "float64"."""
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
