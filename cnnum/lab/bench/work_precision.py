"""Error against run time of PDE templates and tactile programs, by method, precision, engine."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from math import inf
from typing import TypeVar

from cnnum.engine import Engine
from cnnum.engines.registry import backend_names, device_for
from cnnum.errors import CnnumError
from cnnum.lab.bench.errors import REFERENCE_S, SLOW_REFERENCE
from cnnum.lab.bench.programs.program_rungs import WHOLE, ladder_of, program_rungs
from cnnum.programs.library import program_names
from cnnum.report.work_precision import EXACT, LEAST, SINGLE, Rung, WorkPrecision, rungs
from cnnum.templating.library import get_template, template_names
from cnnum.templating.template import Template

Row = TypeVar("Row")
Task = tuple[str, Callable[[], Row | None]]
"""The name of a row, and its measurement."""


def shared_out(
    cases: Sequence[str],
    tasks_of: Callable[[str], Iterable[Task[Row]]],
    seconds: float,
) -> Iterator[Row | str | None]:
    """Yield the rows of all cases, as they are measured.

    A case may take an equal share of the time that is left. So the cases that follow get the rest
    of a short one, and share the overrun of a long one.

    Parameters
    ----------
    cases : sequence of str
    tasks_of : callable
        Yields the tasks of a case.
    seconds : float
        For all cases. No task begins after a case's share is over; one that has begun is finished.

    Yields
    ------
    row, str or None
        One item per task: a row, None if there is none, and instead of those that were not begun
        a sentence that names them.
    """
    until = time.perf_counter() + seconds
    for number, case in enumerate(cases):
        share = (until - time.perf_counter()) / (len(cases) - number)
        yield from _within(case, tasks_of(case), max(share, 0.0))


def _within(case: str, tasks: Iterable[Task[Row]], seconds: float) -> Iterator[Row | str | None]:
    until, missed = time.perf_counter() + seconds, list[str]()
    for name, measure in tasks:
        if time.perf_counter() < until:
            yield measure()
        else:
            missed.append(name)
    if missed:
        names = "; ".join(missed)
        yield f"{case}: not run, as its share of the time ({seconds:.3g} s) was over: {names}."
        yield from [None] * (len(missed) - 1)


WAVES = (
    "diffusion", "band-pass", "coupled", "uncoupled-cell", "autowave", "oscillator",
    "delayed-coupling", "fading", "dominoes", "interpolation",
)  # fmt: skip
"""Checks of templates that are differential equations: their answer is a field, not a decision."""

QUICK_CASES = ("tactile_diffusion", "AUTOWAVE", "contact")
"""A template that takes no time steps if it need not, one whose waves do, and a tactile program."""

FIXED = ("euler", "heun", "rk4", "exponential-euler", "etd-rk2")
ADAPTIVE = ("bogacki-shampine", "dormand-prince", "runge-kutta-chebyshev")

LADDER = (
    Rung("propagator"),
    *(Rung(name, rtol=10.0**-n) for name in ADAPTIVE for n in (2, 3, 4, 6, 8)),
    *(Rung(name, dt=dt) for name in FIXED for dt in (0.2, 0.1, 0.05, 0.01)),
)
QUICK = (
    Rung("propagator"),
    *(Rung(name, rtol=1e-4) for name in ADAPTIVE),
    *(Rung(name, dt=0.05) for name in ("euler", "rk4", "etd-rk2")),
    *(Rung(name, dt=0.01) for name in ("euler", "rk4")),
)
QUICK_PLACES = (("opencl", "float32"), ("numba", "float64"))
"""Engine and precision of a quick round: the first that is there. Building kernels takes
its time, and Numba's first build takes half a minute."""

QUICK_TIME_S = 45.0
"""s for all cases of a quick round, the builds of their kernels among them. A task that has begun
is finished: a round ends within 60 s with empty caches. Others have no limit."""

OMISSIONS = (
    "The reference engine is the truth, so it has no row of its own.",
    f"The truth is that of closed forms for checks of {', '.join(EXACT)}.",
    "A rung that an engine refuses is left out. It refuses steps beyond the stability bound, and "
    "the propagator of an array that is not linear. It refuses Chebyshev steps where rates are not "
    "real. With a delay it takes Euler's and Heun's steps alone: others look between steps.",
    "method='auto' has no row of its own where it is one of the methods shown.",
    f"Tolerances below {SINGLE:g} are not asked of float32, whose rounding is above them.",
    "A rung is timed no longer than 0.15 s (0.03 s with --quick; a program's 0.3 s), but twice at "
    "least; building its kernel is not counted.",
    f"An error of 0 is drawn at {LEAST:g}: the axis has no 0.",
)
"""Cases that no run shows, and why."""

PROGRAM_OMISSIONS = (
    "A tactile program runs a stream with a contact. The reference engine gets through its frames "
    f"in {REFERENCE_S:g} s (1 s with --quick). Time and error are of the same frames. The "
    "error is the largest of the outputs, flags among them, each over its largest value. "
    "Its rungs run every transient by one method. Programs without transients have one row, and so "
    f"has '{WHOLE}', which runs the operations of the others. Where all transients are exact "
    "by themselves, the method chosen for them is called the propagator.",
    f"{', '.join(SLOW_REFERENCE)}: a frame takes the reference engine more than ten seconds, and "
    "the Numba engine up to a minute. They run on OpenCL alone, and time and error are those of "
    "their checks' frames, against closed forms.",
)
"""Cases that runs of tactile programs do not show, and why."""

CASE_OMISSIONS = (
    "Black-and-white templates are left out, DELAYED_WAVE among them: their answer is a decision, "
    "with no error but 0 or 2.",
    "Filters, EDGEGRAY and AVERGRAD are left out: cells that nothing couples go to a constant, as "
    "those of FILBLACK and FILWHITE do. MAX, MEDIAN and MIN, which pick one of their inputs by the "
    "signs of differences, are decisions too.",
)
"""Which templates a run of everything does not show, and why."""


def omissions(names: Sequence[str], *, quick: bool = False) -> tuple[str, ...]:
    """Return the omissions of a run of these cases, and why."""
    everything, programs = cases(), program_names("tactile")
    texts = OMISSIONS + (PROGRAM_OMISSIONS if any(name in programs for name in names) else ())
    missing = [name for name in everything if name not in names]
    if not missing:
        return texts + CASE_OMISSIONS
    if not quick:
        return texts
    return (
        *texts,
        f"--quick does not run {', '.join(missing)}; it has fewer rungs, and one engine "
        "in one precision: building kernels takes longest, Numba's first half a minute.",
    )


def wave_templates() -> tuple[Template, ...]:
    """Return the templates of the library whose answer is a field in time."""
    result = (get_template(name) for name in template_names())
    return tuple(t for t in result if t.check is not None and t.check.name in WAVES)


def engines_here(device: str | None, *, quick: bool = False) -> tuple[Engine, ...]:
    """Return every engine of this machine but the reference, in every precision it has.

    A quick round gets one of them.

    Raises
    ------
    DeviceError
        If there is no such OpenCL device.
    """
    if device is not None:
        Engine("opencl", device=device)
    result: list[Engine] = []
    for name in backend_names():
        for precision in ("float32", "float64"):
            if name == "reference" or (quick and (name, precision) not in QUICK_PLACES):
                continue
            try:
                on = device_for(name, device)
                result.append(Engine(name, device=on, precision=precision))
            except CnnumError:  # not on this machine
                continue
    if quick:
        result.sort(key=lambda engine: QUICK_PLACES.index((engine.name, engine.precision)))
    return tuple(result[:1] if quick else result)


def cases(*, quick: bool = False) -> tuple[str, ...]:
    """Return the names of the cases: templates, then programs."""
    if quick:
        return QUICK_CASES
    return (*(template.name for template in wave_templates()), *program_names("tactile"))


def count(names: Sequence[str], engines: Sequence[Engine], *, quick: bool = False) -> int:
    """Return how many items `measure_cases` yields for all of these."""
    programs = program_names("tactile")
    rungs = len(engines) * len(QUICK if quick else LADDER)
    return sum(
        len(_compiling(name, engines, quick=quick)) * len(ladder_of(name, quick=quick))
        if name in programs
        else rungs
        for name in names
    )


def measure_cases(
    names: Sequence[str],
    engines: Sequence[Engine],
    *,
    quick: bool = False,
    seconds: float | None = None,
) -> Iterator[WorkPrecision | str | None]:
    """Yield the rows of templates and tactile programs, as they are measured.

    Parameters
    ----------
    names : sequence of str
    engines : sequence of Engine
    quick : bool
        Fewer rungs, frames and repeats.
    seconds : float, optional
        For everything; no limit unless given (`QUICK_TIME_S` of a quick round).

    Yields
    ------
    WorkPrecision, str or None
        None for a refused case; a sentence for one that there was no time for.
    """
    limit = (QUICK_TIME_S if quick else inf) if seconds is None else seconds
    return shared_out(names, partial(_tasks, engines=engines, quick=quick), limit)


def _tasks(
    name: str, *, engines: Sequence[Engine], quick: bool
) -> Iterator[tuple[str, Callable[[], WorkPrecision | None]]]:
    if name not in program_names("tactile"):
        yield from rungs(
            get_template(name),
            engines,
            ladder=QUICK if quick else LADDER,
            batch=16 if quick else 256,
            repeats=3 if quick else 7,
            budget=0.03 if quick else 0.15,
        )
        return
    seconds = 1.0 if quick else REFERENCE_S
    yield from program_rungs(
        name, _compiling(name, engines, quick=quick), quick=quick, seconds=seconds
    )


def _compiling(name: str, engines: Sequence[Engine], *, quick: bool) -> Sequence[Engine]:
    """Return the engines that run a program."""
    opencl = [engine for engine in engines if engine.name == "opencl"]
    return opencl if name in SLOW_REFERENCE or (quick and opencl) else engines
