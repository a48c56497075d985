"""Cost of numbers next to zero: states and inputs that decay below the smallest normal number."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.engine import Engine
from cnnum.lab.bench.errors import stream_error, truths
from cnnum.lab.bench.samples import full_template, maps, touch
from cnnum.lab.bench.timing import Call, interleaved
from cnnum.programs.library import get_program
from cnnum.templating.checks.program_run import RATE
from cnnum.templating.template import Template

DECAY = 40.0
"""Time constants of a run."""

PROGRAM = "tactile"
FRAME_SHAPE = (8, 8)
PROGRAM_S = 15.0
"""s that the reference engine may take for the program's frames."""


@dataclass(frozen=True, slots=True)
class Denormals:
    """A row of `cnnum bench denormals`.

    Attributes
    ----------
    case, device, precision : str
    seconds, ordinary_seconds : float
        Medians of runs next to zero and of numbers of order 1, in turns, s.
    ratio : float
        The first over the second.
    spread : float
        Of the first, s.
    error, ordinary_error : float
        Largest difference of both results from the reference engine's, over the largest of the
        latter. Next to zero it is 1 where a device takes denormals as 0. It is up to 2 where an
        output is -1 for nothing (places of edges). It is anything above where steps follow an
        absolute tolerance: both are of a truth that is almost nothing.
    absolute_error : float or None
        The same difference next to zero as it is, against an absolute tolerance of 1e-5 where steps
        follow their error. None of a program, whose outputs have units of their own.
    error_of_start : float
        That over the largest state that the run begins with. Of a program, over the largest value
        that the output has in the ordinary run.
    """

    case: str
    device: str
    precision: str
    seconds: float
    ordinary_seconds: float
    ratio: float
    spread: float
    error: float
    ordinary_error: float
    absolute_error: float | None
    error_of_start: float


@dataclass(frozen=True, slots=True)
class Errors:
    """The errors of a row."""

    near: float
    ordinary: float
    of_start: float
    absolute: float | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """A run of `decaying` on a batch of arrays; without a step it follows its error."""

    name: str
    shape: Shape
    batch: int
    method: str
    dt: float | None


CASES = (
    Case("8×8, Euler", (8, 8), 1, "euler", 0.01),
    Case("8×8, batch 1024, Euler", (8, 8), 1024, "euler", 0.02),
    Case("8×8, batch 1024, adaptive", (8, 8), 1024, "bogacki-shampine", None),
    Case("512×512, Euler", (512, 512), 1, "euler", 0.1),
)

COUNT = 2 * (len(CASES) + 1)
"""Rows."""


def measure_denormals(engine: Engine, *, quick: bool = False) -> Iterator[Denormals]:
    """Yield one row per case, of an engine in float32 and in float64."""
    budget = 0.3 if quick else 3.0
    engines = (engine, engine.with_precision("float64"))
    for case in CASES:
        true = case_truths(case)
        for engine_used in engines:
            yield measure_case(engine_used, case, true, budget)
    for engine_used in engines:
        yield measure_program(engine_used, budget)


def smallest(precision: str) -> float:
    """Return the smallest normal number."""
    return float(np.finfo(np.dtype(precision)).smallest_normal)


def decaying() -> Template:
    """Return a template whose cells all go to zero where their inputs are zero."""
    full = full_template()
    return Template("decaying", full.A, full.B, 0.0, boundary=0.0, initial=0.0, duration=DECAY)


def near_zero(ordinary: Floats, least: float) -> tuple[Floats, Floats]:
    """Return states that pass a least number within the run, and inputs below it."""
    return ordinary * least * np.exp(0.25 * DECAY), ordinary * 0.1 * least


LINEAR = 2.0**-20
"""A least number at which all of a run lies within the linear range, for truths: there states are
as large as their terms, and float64 has all its digits."""


def case_truths(case: Case) -> tuple[Floats, Floats]:
    """Return the states of the first and the last array that the reference engine comes to.

    Returns
    -------
    near, ordinary : (arrays, rows, cols) float
        Next to zero, over the least number there; and of numbers of order 1.
    """
    ordinary = _ends(maps(case.batch, *case.shape))
    state, given = near_zero(ordinary, LINEAR)
    result = [
        _states(Engine("reference"), case, state, given) / LINEAR,
        _states(Engine("reference"), case, ordinary, ordinary),
    ]
    return result[0], result[1]


def _ends(batch: Floats) -> Floats:
    return batch[:: max(1, len(batch) - 1)]


def _states(engine: Engine, case: Case, state: Floats, given: Floats) -> Floats:
    method = case.method if case.dt or engine.name != "reference" else "auto"
    return engine.run(decaying(), input=given, state=state, method=method, dt=case.dt).state


def measure_case(
    engine: Engine, case: Case, true: tuple[Floats, Floats], budget: float
) -> Denormals:
    """Return the row of a case whose truths are known."""
    ordinary, least = maps(case.batch, *case.shape), smallest(engine.precision)
    near = near_zero(ordinary, least)
    runs = [partial(_states, engine, case, *near), partial(_states, engine, case, *2 * (ordinary,))]
    wanted = (least * true[0], true[1])
    off = [float(np.abs(_ends(run()) - end).max()) for run, end in zip(runs, wanted, strict=True)]
    largest = [float(np.abs(end).max()) for end in (*wanted, near[0])]
    errors = Errors(off[0] / largest[0], off[1] / largest[1], off[0] / largest[2], off[0])
    return _row(case.name, engine, [*runs], errors, budget)


def measure_program(engine: Engine, budget: float) -> Denormals:
    """Return the row of a program on the stream of a touch."""
    plan = engine.compile(get_program(PROGRAM).bind(rate=RATE), FRAME_SHAPE)
    sizes = (0.1 * smallest(engine.precision), 1.0)

    def run(size: float) -> None:
        stream = plan.stream()
        for frame in size * touch(shape=FRAME_SHAPE).astype(np.float64):
            stream.push(frame)

    near, ordinary = (truths(PROGRAM, FRAME_SHAPE, PROGRAM_S, size) for size in sizes)
    errors = Errors(
        stream_error(plan, near, sizes[0]),
        stream_error(plan, ordinary),
        stream_error(plan, near, sizes[0], over=ordinary),
    )
    calls: list[Call] = [partial(run, size) for size in sizes]
    return _row(f"{PROGRAM}, stream of 8×8×3", engine, calls, errors, budget)


def _row(case: str, engine: Engine, calls: list[Call], errors: Errors, budget: float) -> Denormals:
    for call in calls:
        call()
    near, ordinary = interleaved(calls, budget=budget, runs=41)
    return Denormals(
        case=case,
        device=engine.device,
        precision=engine.precision,
        seconds=near.median,
        ordinary_seconds=ordinary.median,
        ratio=near.median / ordinary.median,
        spread=near.spread,
        error=errors.near,
        ordinary_error=errors.ordinary,
        absolute_error=errors.absolute,
        error_of_start=errors.of_start,
    )
