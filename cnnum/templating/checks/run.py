"""Running a template on an engine, and comparing the result with its closed form."""

import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, as_shape
from cnnum.integrators.schemes import WAVEFRONT
from cnnum.templating.checks.measuring import SHAPE, drift, shifted
from cnnum.templating.checks.records import Case, CheckResult
from cnnum.templating.checks.registry import form_of, posed
from cnnum.templating.checks.running import WAY, Engine, Result, run_case
from cnnum.templating.files.entry import Measured
from cnnum.templating.template import Template

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
