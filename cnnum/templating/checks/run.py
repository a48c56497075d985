"""Running a template on an engine, and comparing the result with its closed form."""

import statistics
import time
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, as_shape
from cnnum.templating.checks.records import Case, CheckResult
from cnnum.templating.checks.registry import form_of
from cnnum.templating.template import Duration, Template


class Result(Protocol):
    """What a check reads of a run."""

    @property
    def output(self) -> ArrayLike:
        """Outputs of the cells."""
        ...

    @property
    def state(self) -> ArrayLike:
        """States of the cells."""
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
    """What a check asks of an engine."""

    @property
    def name(self) -> str:
        """As users call it."""
        ...

    @property
    def precision(self) -> str:
        """Of the arithmetic: "float32" or "float64"."""
        ...

    def run(
        self,
        template: Template,
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
        """Run a template."""
        ...


def run_check(
    template: Template,
    engine: Engine,
    *,
    seed: int = 0,
    shape: Sequence[int] = (8, 8),
    method: str = "auto",
    repeats: int = 5,
) -> CheckResult:
    """Run a template on the pictures of its closed form and measure how far the result is from it.

    Parameters
    ----------
    template : Template
        Its check names the closed form.
    engine : Engine
        What has a name, a precision and `run`.
    seed : int
        Of the random pictures.
    shape : (rows, cols)
    method : str
        Integration method, or "auto".
    repeats : int
        Timed runs after a first one; their median is reported, or the first's time for 0.

    Returns
    -------
    CheckResult
        A result that is not finite, or has another shape, has an infinite error.

    Raises
    ------
    TemplateError
        If the template has no check, or its parameters are not the form's.
    UnknownNameError
        If there is no such closed form.
    """
    form = form_of(template)
    case = form.cases(template, np.random.default_rng(seed), as_shape(shape))
    result, first = _timed(template, engine, case, method, form.rtol)
    others = [_timed(template, engine, case, method, form.rtol)[1] for _ in range(repeats)]
    seconds = statistics.median(others or [first])
    error = _error(getattr(result, form.compares), form.expected(template, case))
    return CheckResult(
        template=template.name,
        engine=engine.name,
        precision=engine.precision,
        method=result.method,
        check=form.name,
        error=error,
        tolerance=form.tolerance,
        seconds=seconds,
        passed=error <= form.tolerance,
        reason=result.reason,
    )


def _timed(
    template: Template, engine: Engine, case: Case, method: str, rtol: float
) -> tuple[Result, float]:
    begin = time.perf_counter()
    result = engine.run(
        template,
        input=case.input,
        previous=case.previous,
        state=case.state,
        bias=case.bias,
        mask=case.mask,
        duration=case.duration,
        method=method,
        rtol=rtol,
        atol=0.1 * rtol,
    )
    return result, time.perf_counter() - begin


def _error(got: ArrayLike, expected: Floats) -> float:
    answer = np.asarray(got, dtype=np.float64)
    if answer.shape != expected.shape or not np.isfinite(answer).all():
        return np.inf
    return float(np.abs(answer - expected).max())
