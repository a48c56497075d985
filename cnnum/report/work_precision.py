"""Error against run time: one template by every method, at a ladder of tolerances and steps."""

import math
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import TypedDict, Unpack

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.engine import Engine
from cnnum.errors import CnnumError
from cnnum.templating.checks import Case, form_of
from cnnum.templating.template import Template

REFERENCE_RTOL = 1e-10
"""Tolerance of the run that all others are compared with, absolute and relative: five decades
below the tightest rung."""


EXACT = ("delayed-coupling", "fading", "dominoes", "interpolation", "oscillator")
"""Checks whose answers are the truth themselves. With a delay, or a coupling that changes in time,
the reference engine's steps are no better than those judged. The two others take it half
a minute and more."""

LEAST = 1e-17
"""Errors below it, 0 among them, are drawn at it: a logarithmic axis has no 0."""

SINGLE = 1e-6
"""Tightest tolerance that is asked of float32, whose rounding is not far below it."""


@dataclass(frozen=True, slots=True)
class WorkPrecision:
    """One run of a template: its time, and its error against the reference.

    Attributes
    ----------
    case : str
        The template or program.
    engine, precision, method : str
    tolerance : float or None
        Relative tolerance asked for; None for a propagator, which has none.
    step : float or None
        Fixed step in the unit of τ, or None if the method takes its own.
    error : float
        Largest absolute difference of any cell's output; a program's over the output's largest.
    pictures : int
        In the batch; a program's frames in a stream.
    seconds : float
        Least wall time of all of them, s.
    spread : float
        From the first to the third quartile of the runs, s; 0 of a single one.
    steps : int
        Taken, rejected ones counted; unknown of programs, 0.
    """

    case: str
    engine: str
    precision: str
    method: str
    tolerance: float | None
    step: float | None
    error: float
    pictures: int
    seconds: float
    spread: float
    steps: int


@dataclass(frozen=True, slots=True)
class Rung:
    """A method with the one number that sets its accuracy."""

    method: str
    rtol: float | None = None
    dt: float | None = None

    def __str__(self) -> str:
        step = "" if self.dt is None else f" dt={self.dt:g}"
        return self.method + step + ("" if self.rtol is None else f" rtol={self.rtol:g}")


Climb = Callable[[], WorkPrecision | None]
"""Measures one rung on one engine, or None if the engine refuses it."""

LADDER = (
    Rung("propagator"),
    *(Rung("bogacki-shampine", rtol=10.0**-n) for n in (2, 3, 4)),
    *(Rung("dormand-prince", rtol=10.0**-n) for n in (2, 3, 4)),
    *(Rung("euler", dt=dt) for dt in (0.2, 0.1, 0.05)),
    *(Rung("rk4", dt=dt) for dt in (0.2, 0.1)),
)

BATCH = 256
"""Pictures a run: enough that the arithmetic, not the launch, takes the time."""


class Climbing(TypedDict, total=False):
    """Options of `climb_ladder` and of `rungs`, which explains their defaults."""

    ladder: Sequence[Rung]
    shape: Shape
    seed: int
    batch: int
    repeats: int
    budget: float


def measure_work_precision(
    template: Template, engines: Sequence[Engine], **options: Unpack[Climbing]
) -> tuple[WorkPrecision, ...]:
    """Run a template up a ladder of methods and tolerances on every engine.

    The parameters are those of `climb_ladder`, whose refused rungs are left out.

    Raises
    ------
    TemplateError
        If the template has no check.
    """
    return tuple(point for point in climb_ladder(template, engines, **options) if point is not None)


def climb_ladder(
    template: Template, engines: Sequence[Engine], **options: Unpack[Climbing]
) -> Iterator[WorkPrecision | None]:
    """Yield one point per rung and engine, as they are measured, or None.

    It is None if an engine refuses a rung, or is of float32 and the rung is below `SINGLE`.

    The pictures are those of the template's check. The truth is the reference engine's at
    `REFERENCE_RTOL`, or the answer of an `EXACT` check, found once. Engines refuse a step beyond
    the stability bound, or a propagator of an array that is not linear.

    Parameters
    ----------
    template : Template
        With a check.
    engines : sequence of Engine
    ladder : sequence of Rung
    shape : (rows, cols)
    seed : int
        Seed of the random pictures.
    batch : int
        Pictures a run, at least; the check's own are repeated up to that.
    repeats : int
        Timed runs after a first one that is not timed.
    budget : float
        s after which no further run of a rung begins; two always do.

    Raises
    ------
    TemplateError
        If the template has no check.
    """
    return (climb() for _, climb in rungs(template, engines, **options))


def rungs(
    template: Template,
    engines: Sequence[Engine],
    *,
    ladder: Sequence[Rung] = LADDER,
    shape: Shape = (8, 8),
    seed: int = 0,
    batch: int = BATCH,
    repeats: int = 7,
    budget: float = math.inf,
) -> Iterator[tuple[str, Climb]]:
    """Yield the name of every point of `climb_ladder`, and its measurement.

    Engines take turns at each rung, so that whoever stops early has all of them. The parameters
    are those of `climb_ladder`; the truth is found once, when the first point is measured.
    """
    own = form_of(template).cases(template, np.random.default_rng(seed), shape)
    case, truth = _batch(own, batch), cache(lambda: _truth(template, own, batch))
    for rung in ladder:
        for engine in engines:
            run = partial(_climb, template, case, truth, engine, rung, repeats, budget)
            yield f"{engine.name} {engine.precision} {rung}", run


def _batch(case: Case, pictures: int) -> Case:
    """Return the case with its pictures repeated up to a number at least."""
    maps = {"input": case.input, "state": case.state, "bias": case.bias, "mask": case.mask}
    longest = max((len(m) for m in maps.values() if m is not None and m.ndim > 2), default=1)
    times = -(-pictures // longest)

    def repeated(values: Floats | None) -> Floats | None:
        if values is None or values.ndim < 3 or len(values) != longest:
            return values
        return np.tile(values, (times, *(1,) * (values.ndim - 1)))

    return Case(**{name: repeated(m) for name, m in maps.items()}, duration=case.duration)


def _truth(template: Template, case: Case, pictures: int) -> Floats:
    """Return outputs of a case's pictures, repeated up to a number at least."""
    form = form_of(template)
    if form.name in EXACT:
        result = form.expected(template, case)
        result = template.output.numpy(result) if form.compares == "state" else result
    else:
        result = _run(template, case, Engine("reference"), Rung("auto", rtol=REFERENCE_RTOL))[0]
    times = -(-pictures // max(len(result), 1))
    return np.tile(result, (times, *(1,) * (result.ndim - 1))) if result.ndim > 2 else result


def _climb(
    template: Template,
    case: Case,
    truth: Callable[[], Floats],
    engine: Engine,
    rung: Rung,
    repeats: int,
    budget: float,
) -> WorkPrecision | None:
    if engine.precision == "float32" and (rung.rtol or 1.0) < SINGLE:
        return None
    try:
        output, steps, method = _run(template, case, engine, rung)
    except CnnumError:
        return None
    until = time.perf_counter() + budget
    seconds: list[float] = []
    while len(seconds) < max(repeats, 2) and (len(seconds) < 2 or time.perf_counter() < until):
        seconds.append(_timed(template, case, engine, rung))
    low, _, high = statistics.quantiles(seconds, n=4, method="inclusive")
    return WorkPrecision(
        case=template.name,
        engine=engine.name,
        precision=engine.precision,
        method=method,
        tolerance=rung.rtol,
        step=rung.dt,
        error=float(np.abs(output - truth()[: len(output)]).max()),
        pictures=len(output),
        seconds=min(seconds),
        spread=high - low,
        steps=steps,
    )


def _timed(template: Template, case: Case, engine: Engine, rung: Rung) -> float:
    begin = time.perf_counter()
    _run(template, case, engine, rung)
    return time.perf_counter() - begin


def _run(template: Template, case: Case, engine: Engine, rung: Rung) -> tuple[Floats, int, str]:
    rtol = 1e-4 if rung.rtol is None else rung.rtol
    result = engine.run(
        template,
        **case.given,
        method=rung.method,
        rtol=rtol,
        atol=rtol,
        dt=rung.dt,
    )
    return np.asarray(result.output, dtype=np.float64), int(np.max(result.steps)), result.method
