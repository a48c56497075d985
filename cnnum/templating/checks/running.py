"""Templates run on an engine: compared with their closed forms, and measured.

Measured figures of a template: its end state, how soon it is there, and how far from flipping.

All are taken on the pictures of the template's own check, so that anyone can take them again.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, Shape, as_shape
from cnnum.errors import CnnumError
from cnnum.integrators.schemes import WAVEFRONT
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.boundary import parse_boundary
from cnnum.templating.checks.pictures import binary_case
from cnnum.templating.checks.records import Case, CheckResult, ClosedForm
from cnnum.templating.checks.registry import form_of, posed
from cnnum.templating.files.entry import Measured
from cnnum.templating.network import autonomous
from cnnum.templating.template import Duration, Template


class Result(Protocol):
    """A run as a check reads it."""

    @property
    def output(self) -> ArrayLike:
        """Outputs of the cells."""
        ...

    @property
    def state(self) -> ArrayLike:
        """States of the cells."""
        ...

    @property
    def time(self) -> ArrayLike:
        """Time constants that each picture took."""
        ...

    @property
    def method(self) -> str:
        """Integration method used."""
        ...

    @property
    def reason(self) -> str:
        """Why this method."""
        ...


class Engine(Protocol):
    """An engine as a check uses it."""

    @property
    def name(self) -> str:
        """As users call it."""
        ...

    @property
    def precision(self) -> str:
        """Precision of the arithmetic, "float32" or "float64"."""
        ...

    def run(
        self,
        template: Template | TemplateBatch,
        *,
        input: Floats | None = None,
        previous: Floats | None = None,
        state: Floats | None = None,
        bias: Floats | None = None,
        mask: Floats | None = None,
        duration: Duration | None = None,
        method: str = "auto",
        rtol: float = 1e-4,
        atol: float = 1e-5,
    ) -> Result:
        """Run a template, or many at once."""
        ...


WAY = "dormand-prince"
"""The method of runs whose end would be found without the way there."""


def run_way(
    template: Template | TemplateBatch,
    engine: Engine,
    case: Case,
    rtol: float,
    method: str = "auto",
) -> Result:
    """Run templates on a case by their transient, even where `auto` finds its end without it."""
    result = run_case(template, engine, case, rtol, method)
    if result.method != WAVEFRONT or method != "auto":
        return result
    return run_case(template, engine, case, rtol, WAY)


def run_case(
    template: Template | TemplateBatch,
    engine: Engine,
    case: Case,
    rtol: float,
    method: str = "auto",
) -> Result:
    """Run templates on a case, with a tenth of the relative tolerance as the absolute one."""
    return engine.run(
        template,
        **case.given,
        method=method,
        rtol=rtol,
        atol=0.1 * rtol,
    )


SHAPE: Shape = (8, 8)
SIDES = (8, 12, 16)
"""Sides of the square arrays on which the settle time is taken."""

NEAR = 0.01
"""Outputs this close to their end have settled."""

_CHUNKS = 40
_AT_REST = 0.8
"""Fraction of a run after which it is cut off if it is at rest for the remaining fifth."""
_BIASES = np.geomspace(0.01, 8.0, 30)
_FINER = 23
"""Steps of one per cent between two biases of the ladder."""

_STEP = 1.05
"""Beyond the finer steps, with room for an engine's own errors."""

_RTOL = 1e-4

_ALLOWED = 0.01
"""Of a mean over all states: engines end within 0.01 of each other, cell by cell."""

WRONG = 0.5
"""Outputs this far from black or white are wrong."""


def measure(template: Template, engine: Engine) -> Measured:
    """Return the figures of a template, taken on an engine.

    Raises
    ------
    TemplateError
        If the template has no check.
    """
    form = form_of(template)
    case, _ = posed(template, 0, SHAPE)
    mean, rms = summary(run_way(template, engine, case, form.rtol).state)
    return Measured(
        template.digest,
        mean,
        rms,
        settle_times(template, engine),
        _margin(template, engine, form, case) if form.digital else None,
    )


def settle_times(template: Template, engine: Engine) -> tuple[tuple[int, float], ...]:
    """Return cells along a side and the time (unit of τ) until the outputs rest, where they do.

    A template without a check runs on black-and-white pictures.
    """
    result = ((n, _settle(template, engine, (n, n))) for n in SIDES)
    return tuple((n, time) for n, time in result if time is not None)


def summary(states: object) -> tuple[float, float]:
    """Return the mean of all states and the root of the mean of their squares."""
    values = np.asarray(states, dtype=np.float64)
    return float(values.mean()), float(np.sqrt((values**2).mean()))


def _case(template: Template, shape: Shape) -> Case:
    cases = binary_case if template.check is None else form_of(template).cases
    return cases(template, np.random.default_rng(0), shape)


def wrong_at(
    template: Template, engine: Engine, form: ClosedForm, case: Case, biases: Floats
) -> list[bool]:
    """Return for each number whether, added to the bias, it makes a cell wrong; one run for all."""
    expected = form.expected(template, case)
    count, times = len(expected), len(biases)

    def repeated(maps: Floats | None) -> Floats | None:
        return None if maps is None else np.concatenate([maps] * times)

    layers = (template.layers,) if template.layers > 1 else ()
    lifted = np.repeat(biases, count).reshape(-1, *(1 for _ in layers), 1, 1)
    offset = np.broadcast_to(lifted, (times * count, *layers, *expected.shape[-2:])).copy()
    if case.bias is not None:
        offset += np.concatenate([case.bias] * times)
    many = replace(
        case,
        input=repeated(case.input),
        previous=repeated(case.previous),
        state=repeated(case.state),
        mask=repeated(case.mask),
        bias=offset,
    )
    outputs = np.asarray(run_case(template, engine, many, form.rtol).output, dtype=np.float64)
    apart = np.abs(outputs.reshape(times, *expected.shape) - expected)
    return [bool(not (gap <= WRONG).all()) for gap in apart]


def _margin(template: Template, engine: Engine, form: ClosedForm, case: Case) -> float:
    """Return the largest bias tried that flips no cell in either direction, 0 where none is right.

    Once the ladder says between which two numbers it lies, finer steps find it to one per cent.
    """
    low = _last_right(template, engine, form, case, _BIASES)
    if not 0.0 < low < _BIASES[-1]:
        return low
    between = low * np.geomspace(1.0, float(_BIASES[1] / _BIASES[0]), _FINER + 1)[:-1]
    return _last_right(template, engine, form, case, between)


def _last_right(
    template: Template, engine: Engine, form: ClosedForm, case: Case, biases: Floats
) -> float:
    """Return the last bias before the first that makes a cell wrong, 0 where none is right."""
    wrong = np.array(wrong_at(template, engine, form, case, np.concatenate([biases, -biases])))
    either = wrong[: len(biases)] | wrong[len(biases) :]
    first = int(np.argmax(either)) if either.any() else len(biases)
    return float(biases[first - 1]) if first else 0.0


def _settle(template: Template, engine: Engine, shape: Shape) -> float | None:
    """Return when all outputs are within 0.01 of their end, a fortieth of the duration too late.

    A run goes on for twice the template's duration, or until it settles, also where its check
    stops it before: so it shows whether the end of the duration is a rest.
    """
    if template.output.discrete:
        return None
    # a run that knows its past or its clock cannot be cut into parts
    from_start = not autonomous(template)
    longest = _longest(template)
    case = replace(_case(template, shape), duration=longest)
    chunks = _CHUNKS if longest is None else 2 * _CHUNKS
    try:
        whole = _run(template, engine, case)
    except CnnumError:
        return None  # it diverges, or settles within no time that an engine runs for
    end = float(np.max(whole.time))
    if not 0.0 < end < np.inf or not np.isfinite(whole.output).all():
        return None
    goal, step = np.asarray(whole.output), end / chunks
    last, now = 0, case if template.inputs else replace(case, input=None, state=_start(case))
    for n in range(1, chunks):
        part = replace(case, duration=n * step) if from_start else replace(now, duration=step)
        passed = _run(template, engine, part)
        now = replace(now, state=np.asarray(passed.state, dtype=np.float64))
        if not (np.abs(np.asarray(passed.output) - goal) <= NEAR).all():
            last = n
    # a course that is cut off comes near its end in any case
    latest = chunks - 1 if longest is None else _AT_REST * chunks
    return (last + 1) * step if last < latest else None


def _longest(template: Template) -> float | None:
    return None if template.duration == "settle" else 2.0 * template.duration


def unsettled(template: Template, measured: Measured) -> str:
    """Return why a template has no settle time on some arrays, in a sentence; empty if it has."""
    known = dict(measured.settle)
    without = [f"{side}×{side}" for side in SIDES if side not in known]
    if not without:
        return ""
    where = f" ({', '.join(without)})" if known else ""
    return _why(template).removesuffix(".") + where + "."


def _why(template: Template) -> str:
    if template.output.discrete:
        return f"It runs in steps, for {template.timed(float(template.duration))}."
    if template.duration == "settle":
        return "A cell is still on its way when the longest run ends."
    return f"It is still on its way after {template.timed(2.0 * template.duration)}."


def _start(case: Case) -> Floats:
    return case.pictures if case.state is None else case.state


def _run(template: Template, engine: Engine, case: Case) -> Result:
    rtol = _RTOL if template.check is None else form_of(template).rtol
    return run_way(template, engine, case, rtol)


def drift(template: Template, result: Result, measured: Measured) -> str:
    """Return how a template differs from its measured figures, in a sentence; empty if not.

    Parameters
    ----------
    template : Template
    result : Result
        Result of the check's case on 8×8 cells, seed 0.
    measured : Measured
    """
    if template.digest != measured.digest:
        return "its numbers are not those that were measured"
    mean, rms = summary(result.state)
    # cells that chatter end anywhere within the tolerance of their check
    allowed = max(_ALLOWED * max(1.0, measured.rms), form_of(template).tolerance)
    if not (abs(mean - measured.mean) <= allowed and abs(rms - measured.rms) <= allowed):
        return f"its states end at a mean of {mean:.4g} and {rms:.4g} rms"
    return ""


def shifted(template: Template, engine: Engine, measured: Measured) -> str:
    """Return how margin or settle time differ from the measured ones, in a sentence; empty if not.

    A margin is right if 0.95 times it flips no cell, and 1.05 times it flips one.
    """
    form, case = form_of(template), _case(template, SHAPE)
    margin = measured.margin
    if margin is not None and form.digital and margin > 0.0:
        tries = np.array([margin / _STEP, -margin / _STEP, _STEP * margin, -_STEP * margin])
        wrong = wrong_at(template, engine, form, case, tries)
        if any(wrong[:2]):
            return f"a bias of {margin / _STEP:.3g} more or less flips a cell"
        if margin < _BIASES[-1] and not any(wrong[2:]):
            return f"a bias of {_STEP * margin:.3g} more or less flips no cell"
    known = dict(measured.settle).get(SHAPE[0])
    # beyond where a check stops, the rounding of a processor may decide how long a cell takes
    if known is not None and case.duration is None:
        result = _settle(template, engine, SHAPE)
        if result is None or abs(result - known) > 0.3 * known + 0.2:
            return f"it settles after {template.timed(result or np.inf, 3)}"
    return ""


_SLOW = 0.5
"""Seconds; a compiled run that takes longer is timed once."""

_LONGEST_COMPILING = 3.0
"""Seconds; a longer first run is the time, since compiling is a small part of it."""


def run_check(
    template: Template,
    engine: Engine,
    *,
    seed: int = 0,
    shape: Sequence[int] = (8, 8),
    method: str = "auto",
    repeats: int = 5,
    measured: Measured | None = None,
    thorough: bool = False,
) -> CheckResult:
    """Run a template on the pictures of its closed form and measure how far the result is from it.

    Parameters
    ----------
    template : Template
        Its check names the closed form.
    engine : Engine
        Object with a name, a precision and `run`.
    seed : int
        Seed of the random pictures.
    shape : (rows, cols)
    method : str
        Integration method, or "auto".
    repeats : int
        Timed runs after a first one; their median is reported, or the first's time for 0.
    measured : Measured, optional
        Figures that the run must also agree with; they are known of 8×8 cells and seed 0 alone.
    thorough : bool
        Also compare margin and settle time with them, which takes more runs.

    Returns
    -------
    CheckResult
        A result that is not finite, or has another shape, has an infinite error.

    Raises
    ------
    TemplateError
        If the template has no check, or its parameters are not the form's.
    OneColourError
        If all right answers have one colour: the check would show nothing.
    UnknownNameError
        If there is no such closed form.
    """
    form = form_of(template)
    case, expected = posed(template, seed, as_shape(shape))
    result, first = _timed(template, engine, case, method, form.rtol)
    seconds = _time_of(first, repeats, lambda: _timed(template, engine, case, method, form.rtol)[1])
    error = _error(getattr(result, form.compares), expected)
    # the transient must come there, too, unless a cell is held by nothing to spare
    if result.method == WAVEFRONT != method and (measured is None or measured.margin != 0.0):
        result = run_case(template, engine, case, form.rtol, WAY)
        error = max(error, _error(getattr(result, form.compares), expected))
    known = measured if seed == 0 and tuple(shape) == SHAPE else None
    note = drift(template, result, known) if known else ""
    if known and thorough and not note:
        note = shifted(template, engine, known)
    return CheckResult(
        template=template.name,
        engine=engine.name,
        precision=engine.precision,
        method=result.method,
        check=form.name,
        error=error,
        tolerance=form.tolerance,
        seconds=seconds,
        passed=error <= form.tolerance and not note,
        reason=result.reason,
        margin=None if measured is None else measured.margin,
        settle=None if measured is None else dict(measured.settle).get(SHAPE[0]),
        note=note,
    )


def _time_of(first: float, repeats: int, again: Callable[[], float]) -> float:
    """Return the median time of further runs, as the first may have compiled; s."""
    if not repeats or first > _LONGEST_COMPILING:
        return first
    times = [again()]
    times += [again() for _ in range(repeats - 1 if times[0] < _SLOW else 0)]
    return statistics.median(times)


def _timed(
    template: Template, engine: Engine, case: Case, method: str, rtol: float
) -> tuple[Result, float]:
    begin = time.perf_counter()
    result = run_case(template, engine, case, rtol, method)
    return result, time.perf_counter() - begin


def _error(got: ArrayLike, expected: Floats) -> float:
    answer = np.asarray(got, dtype=np.float64)
    if answer.shape != expected.shape or not np.isfinite(answer).all():
        return np.inf
    return float(np.abs(answer - expected).max())


BOUNDARIES: tuple[float | str, ...] = (0.0, -1.0, "zero-flux")


@dataclass(frozen=True, slots=True)
class Audit:
    """Wrong cells of a template under each boundary.

    Attributes
    ----------
    template : str
    boundary : str or float
        Its own, for which the answer is defined.
    cells : int
        Number of cells of all pictures, objects at the frame among them.
    wrong : tuple of int
        Wrong cells with 0, −1 and zero-flux.
    """

    template: str
    boundary: str | float
    cells: int
    wrong: tuple[int, ...]


def audit(template: Template, engine: Engine, shape: Shape = (12, 12)) -> Audit | None:
    """Return the audit of a template, or None if its answer is gray."""
    form = form_of(template)
    if not form.digital:
        return None
    case, expected = posed(template, 0, shape)
    wrong = list[int]()
    for boundary in BOUNDARIES:
        rim = parse_boundary(boundary)
        other = replace(template, boundary=rim, input_boundary=rim)
        outputs = np.asarray(run_case(other, engine, case, form.rtol).output, dtype=np.float64)
        wrong.append(int((~(np.abs(outputs - expected) <= WRONG)).sum()))
    return Audit(template.name, template.boundary.name, expected.size, tuple(wrong))
