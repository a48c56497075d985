"""Streams of frames from the simulated array, and programs run over them."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.settings import Phase
from cnnum.engine import Engine
from cnnum.plan import Plan
from cnnum.programs import Program

NUMBA = Engine("numba")

SHORT = (
    Phase("hold", 0.2),
    Phase("press", 0.2, load=0.8),
    Phase("hold", 0.2),
    Phase("pull", 0.5, speed=1.2e-3, direction=0.7),
    Phase("relax", 0.2),
    Phase("twist", 0.4, angle=0.2),
    Phase("release", 0.2),
    Phase("hold", 0.1),
)
"""A touch, a slip and a twist in two seconds."""

Run = Callable[..., dict[str, Floats]]


@pytest.fixture(params=["fast", "reference"])
def engine(request: pytest.FixtureRequest, fast: Engine) -> Engine:
    if request.param == "numba":
        return NUMBA
    return fast if request.param == "fast" else Engine(request.param)


@pytest.fixture
def numba() -> Engine:
    """For programs that see few frames: it builds nothing for each, where OpenCL takes seconds."""
    return NUMBA


def strain_of(**options: object) -> tuple[Floats, dict[str, Floats]]:
    """Strain frames (frames, rows, cols, 3) of a simulated scene, and its truth by name."""
    with SimulatedOptions(**options).open() as array:  # type: ignore[arg-type]
        frames = list(array.frames())
        volts = np.stack([frame.values for frame in frames])
        strain = array.calibration.to_strain(volts)
    names = frames[0].truth.values
    return strain, {name: np.array([f.truth[name] for f in frames]) for name in names}


@pytest.fixture(scope="session")
def simulate() -> Callable[..., tuple[Floats, dict[str, Floats]]]:
    return strain_of


@pytest.fixture(scope="session")
def short_scene() -> Callable[[tuple[int, int]], Floats]:
    kept: dict[tuple[int, int], Floats] = {}

    def scene(shape: tuple[int, int]) -> Floats:
        if shape not in kept:
            kept[shape], _ = strain_of(shape=shape, script=SHORT, start=(-0.4e-3, -0.3e-3), seed=3)
        return kept[shape]

    return scene


RATE = 200.0
"""Hz, of programs that are bound to none."""

Plans = Callable[[Engine, Program, tuple[int, ...], tuple[str, ...] | None], Plan]


def compiled(
    engine: Engine, program: Program, shape: tuple[int, ...], needs: tuple[str, ...] | None
) -> Plan:
    return engine.compile(program, shape, needs)


def runs_on(plans: Plans) -> Run:
    """Stream frames (frames, [batch,] rows, cols, 3) through a program."""

    def stream(
        engine: Engine, program: Program, frames: Floats, needs: list[str] | None = None
    ) -> dict[str, Floats]:
        wanted = None if needs is None else tuple(needs)
        plan = plans(engine, program, frames.shape[-3:-1], wanted)
        session = plan.stream(frames.shape[1:-3], rate=plan.rate or RATE)
        outputs = [session.push(frame) for frame in frames]
        return {name: np.array([o[name] for o in outputs]) for name in outputs[0]}

    return stream


@pytest.fixture(scope="session")
def run() -> Run:
    """Plans are kept for the runs that follow: streams of one know nothing of each other."""
    return runs_on(lru_cache(maxsize=16)(compiled))


@pytest.fixture
def run_anew() -> Run:
    """For tests that change the parts of programs: every run has a plan of its own."""
    return runs_on(compiled)
