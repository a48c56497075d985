"""Error against run time of PDE templates and tactile programs, by method, precision, engine."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from cnnum.arrays import Floats
from cnnum.bench.samples import frames
from cnnum.bench.timing import timed
from cnnum.engine import Engine
from cnnum.engines.backend import backend_names
from cnnum.errors import CnnumError
from cnnum.library import get_template, template_names
from cnnum.program_library import get_program, program_names
from cnnum.report.work_precision import Rung, WorkPrecision, measure_work_precision
from cnnum.template import Template

WAVES = ("diffusion", "band-pass", "coupled", "uncoupled-cell")
"""Checks of templates that are differential equations: their answer is a field, not a decision."""

STEPS = (0.2, 0.1, 0.05, 0.02, 0.01)
FIXED = ("euler", "heun", "rk4", "exponential-euler", "etd-rk2")
ADAPTIVE = ("bogacki-shampine", "dormand-prince", "runge-kutta-chebyshev")

LADDER = (
    Rung("propagator"),
    *(Rung("auto", rtol=10.0**-n) for n in (3, 4, 5, 6)),
    *(Rung(name, rtol=10.0**-n) for name in ADAPTIVE for n in (2, 3, 4, 5, 6, 8)),
    *(Rung(name, dt=dt) for name in FIXED for dt in STEPS),
)
QUICK = (
    Rung("propagator"),
    *(Rung(name, rtol=10.0**-n) for name in ADAPTIVE for n in (3, 5)),
    *(Rung(name, dt=dt) for name in FIXED for dt in (0.1, 0.02)),
)

PROGRAM_SHAPE, PROGRAM_FRAMES = (8, 8), 64

OMISSIONS = (
    "The reference engine is the truth, so it has no row of its own.",
    "A rung that an engine refuses is left out: a step beyond the stability bound, a propagator "
    "of an array that is not linear, Chebyshev steps of an array whose rates are not real.",
    "Tactile programs run with the method that is chosen for each of their templates; their rows "
    "tell engines and precisions apart, not methods.",
    "Black-and-white templates are left out: their answer is a decision, with no error but 0 or 2.",
)
"""What the plot does not show, and why."""


def wave_templates() -> tuple[Template, ...]:
    """Return the templates of the library whose answer is a field in time."""
    found = (get_template(name) for name in template_names())
    return tuple(t for t in found if t.check is not None and t.check.name in WAVES)


def engines_here(device: str | None) -> tuple[Engine, ...]:
    """Return every engine of this machine but the reference, in every precision it has."""
    found: list[Engine] = []
    for name in backend_names():
        for precision in ("float32", "float64"):
            if name == "reference":
                continue
            try:
                on = device if name == "opencl" else None
                found.append(Engine(name, device=on, precision=precision))
            except CnnumError:  # not on this machine
                continue
    return tuple(found)


def cases() -> tuple[str, ...]:
    """Return the names of what is measured: templates, then programs."""
    return (*(template.name for template in wave_templates()), *program_names("tactile"))


def measure_case(
    name: str, engines: Sequence[Engine], *, quick: bool = False
) -> Iterator[WorkPrecision]:
    """Yield the rows of a template or a tactile program."""
    if name in program_names("tactile"):
        yield from _program(name, engines)
        return
    yield from measure_work_precision(
        get_template(name),
        engines,
        ladder=QUICK if quick else LADDER,
        batch=16 if quick else 256,
        repeats=3 if quick else 7,
    )


def _program(name: str, engines: Sequence[Engine]) -> Iterator[WorkPrecision]:
    batch = np.abs(frames(PROGRAM_FRAMES, PROGRAM_SHAPE)).astype(np.float64)
    truth = Engine("reference").compile(get_program(name), PROGRAM_SHAPE)(batch)
    for engine in engines:
        try:
            plan = engine.compile(get_program(name), PROGRAM_SHAPE)
        except CnnumError:  # the engine says why in `cnnum plan`
            continue
        timing = timed(partial(plan, batch), budget=0.5)
        yield WorkPrecision(
            case=name,
            engine=engine.name,
            precision=engine.precision,
            method="auto",
            tolerance=1e-4,
            step=None,
            error=_largest(plan(batch), truth),
            pictures=PROGRAM_FRAMES,
            seconds=timing.median,
            spread=timing.spread,
            steps=0,
        )


def _largest(got: dict[str, Floats], truth: dict[str, Floats]) -> float:
    return max(float(np.abs(got[name] - truth[name]).max()) for name in truth)
