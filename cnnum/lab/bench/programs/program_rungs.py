"""Error against run time of tactile programs: every transient of them by one method."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from cnnum.arrays import Shape
from cnnum.engine import Engine
from cnnum.errors import CnnumError
from cnnum.lab.bench.errors import SLOW_REFERENCE, Answer, stream_error, streamed_frames, truths
from cnnum.lab.bench.timing import Timing, timed
from cnnum.plan import Plan
from cnnum.programs import Program
from cnnum.programs.library import get_program
from cnnum.report.work_precision import SINGLE, Rung, WorkPrecision
from cnnum.templating.checks.program_registry import program_forms
from cnnum.templating.checks.program_run import RATE, ProgramForm, judged, streamed

SHAPE = (8, 8)

AUTO = Rung("auto")
"""Each transient by the method that is chosen for it."""

LADDER = (
    AUTO,
    *(Rung("dormand-prince", rtol=10.0**-n) for n in (2, 4, 6)),
    *(
        Rung(name, rtol=10.0**-n)
        for name in ("bogacki-shampine", "runge-kutta-chebyshev")
        for n in (2, 4)
    ),
    *(Rung("euler", dt=dt) for dt in (0.1, 0.01)),
    *(Rung(name, dt=0.1) for name in ("heun", "rk4", "exponential-euler", "etd-rk2")),
)
QUICK = (AUTO, Rung("dormand-prince", rtol=1e-4), Rung("euler", dt=0.1))

WHOLE = "tactile"
"""It runs the operations of the others, in one kernel that takes half a minute to build a rung:
only the chosen rung runs."""

BUDGET_S = 0.3
"""s after which no further run of a rung begins."""

Climb = Callable[[], WorkPrecision | None]


def program_rungs(
    name: str, engines: Sequence[Engine], *, quick: bool = False, seconds: float
) -> Iterator[tuple[str, Climb]]:
    """Yield the name of every point of a program, and its measurement.

    Parameters
    ----------
    name : str
        Name of a tactile program.
    engines : sequence of Engine
    quick : bool
        Fewer rungs.
    seconds : float
        Time that the reference engine may take for the frames.
    """
    # once, and only if needed
    truth = cache(lambda: truths(name, SHAPE, seconds))
    for rung in ladder_of(name, quick=quick):
        for engine in engines:
            run = partial(_climb, name, engine, rung, truth)
            yield f"{engine.name} {engine.precision} {rung}", run


def ladder_of(name: str, *, quick: bool = False) -> Sequence[Rung]:
    """Return the rungs of a program: one where it has no transient."""
    if name == WHOLE or not _moves(name):
        return (AUTO,)
    return QUICK if quick else LADDER


@cache
def _moves(name: str) -> bool:
    return bool(Engine("reference").compile(get_program(name), SHAPE).solvers)


def _climb(
    name: str, engine: Engine, rung: Rung, truth: Callable[[], list[Answer]]
) -> WorkPrecision | None:
    if engine.precision == "float32" and (rung.rtol or 1.0) < SINGLE:
        return None
    by = By(engine, rung)
    try:
        if name in SLOW_REFERENCE:
            result = max(
                (_of_form(form, by) for form in program_forms(name)),
                key=lambda candidate: candidate.error,
            )
        else:
            result = _of_stream(by.compile(get_program(name).bind(rate=RATE), SHAPE), truth())
    except CnnumError:  # a step beyond the stability bound, or the message of `cnnum plan`
        return None
    methods = {solver.method for solver in result.plan.solvers.values()}
    exact = rung == AUTO and methods == {"propagator"}
    return WorkPrecision(
        case=name,
        engine=engine.name,
        precision=engine.precision,
        method="propagator" if exact else rung.method,
        tolerance=rung.rtol,
        step=rung.dt,
        error=result.error,
        pictures=result.frames,
        seconds=result.timing.least,
        spread=result.timing.spread,
        steps=0,
    )


@dataclass(frozen=True, slots=True)
class By:
    """An engine that runs every transient of a program by one method."""

    engine: Engine
    rung: Rung

    def compile(self, program: Program, shape: Shape, needs: Sequence[str] | None = None) -> Plan:
        """Return a plan of a program.

        Raises
        ------
        MethodError
            If one of its transients cannot run by that method.
        """
        rung = self.rung
        method = None if rung == AUTO else rung.method
        return self.engine.compile(
            program, shape, needs, method=method, rtol=rung.rtol, atol=rung.rtol, dt=rung.dt
        )


@dataclass(frozen=True, slots=True)
class _Found:
    """The error of frames, and the time of the same."""

    plan: Plan
    error: float
    timing: Timing
    frames: int


def _of_stream(plan: Plan, true: list[Answer]) -> _Found:
    frames = streamed_frames(SHAPE)[: len(true)]
    error = stream_error(plan, true)

    def run() -> None:
        stream = plan.stream()
        for frame in frames:
            stream.push(frame)

    return _Found(plan, error, timed(run, budget=BUDGET_S), len(true))


def _of_form(form: ProgramForm, by: By) -> _Found:
    case = form.cases(np.random.default_rng(0), SHAPE)
    plan = by.compile(
        get_program(form.program).bind(**{"rate": RATE, **case.parameters}), SHAPE, form.needs
    )
    error = judged(form, case, streamed(plan, case))
    # one stream for all runs, as making one takes longer than a frame: these programs keep nothing
    stream = plan.stream(case.batch)

    def run() -> None:
        for frame in case.frames:
            stream.push(frame)

    timing = timed(run, budget=BUDGET_S)
    return _Found(plan, error, timing, len(case.frames) * int(np.prod(case.batch)))
