"""What numbers next to zero cost: states and inputs that decay below the smallest normal number."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.bench.samples import full_template, maps
from cnnum.bench.timing import Call, interleaved
from cnnum.engine import Engine
from cnnum.program_library import get_program
from cnnum.template import Template

DECAY = 40.0
"""Time constants of a run."""

PROGRAM = "tactile"
FRAME_SHAPE, FRAMES = (8, 8), 64


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
    """

    case: str
    device: str
    precision: str
    seconds: float
    ordinary_seconds: float
    ratio: float
    spread: float


@dataclass(frozen=True, slots=True)
class _Case:
    name: str
    shape: Shape
    batch: int
    method: str
    dt: float | None


CASES = (
    _Case("8×8, Euler", (8, 8), 1, "euler", 0.01),
    _Case("8×8, batch 1024, Euler", (8, 8), 1024, "euler", 0.02),
    _Case("8×8, batch 1024, adaptive", (8, 8), 1024, "bogacki-shampine", None),
    _Case("512×512, Euler", (512, 512), 1, "euler", 0.1),
)


def measure_denormals(engine: Engine, *, quick: bool = False) -> Iterator[Denormals]:
    """Yield a row a case, of an OpenCL engine and of the same device in float64."""
    budget = 0.3 if quick else 3.0
    for each in (engine, Engine(engine.name, device=engine.device, precision="float64")):
        for case in CASES:
            yield _transient(each, case, budget)
        yield _program(each, budget)


COUNT = 2 * (len(CASES) + 1)
"""Rows."""


def smallest(precision: str) -> float:
    """Return the smallest normal number."""
    return float(np.finfo(np.dtype(precision)).smallest_normal)


def decaying() -> Template:
    """Return a template whose cells all go to zero where their inputs are zero."""
    full = full_template()
    return Template("decaying", full.A, full.B, 0.0, boundary=0.0, initial=0.0, duration=DECAY)


def near_zero(ordinary: Floats, precision: str) -> tuple[Floats, Floats]:
    """Return states that pass the smallest normal number within the run, and inputs below it."""
    least = smallest(precision)
    return ordinary * least * np.exp(0.25 * DECAY), ordinary * 0.1 * least


def _transient(engine: Engine, case: _Case, budget: float) -> Denormals:
    template, ordinary = decaying(), maps(case.batch, *case.shape)

    def run(state: Floats, given: Floats) -> None:
        engine.run(template, input=given, state=state, method=case.method, dt=case.dt)

    near = near_zero(ordinary, engine.precision)
    calls: list[Call] = [partial(run, *near), partial(run, ordinary, ordinary)]
    return _row(case.name, engine, calls, budget)


def _program(engine: Engine, budget: float) -> Denormals:
    plan = engine.compile(get_program(PROGRAM), FRAME_SHAPE)
    frames = maps(FRAMES, *FRAME_SHAPE, 3)
    tiny = frames * 0.1 * smallest(engine.precision)
    calls: list[Call] = [partial(plan, tiny), partial(plan, frames)]
    return _row(f"{PROGRAM}, 8×8×3", engine, calls, budget)


def _row(case: str, engine: Engine, calls: list[Call], budget: float) -> Denormals:
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
    )
