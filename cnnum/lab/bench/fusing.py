"""The saving of fused linear operations: plans against the same plans with nothing fused."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.engine import Engine
from cnnum.lab.bench.samples import generator
from cnnum.lab.bench.timing import Call, interleaved
from cnnum.plan import Plan
from cnnum.programs.library import get_program, program_names
from cnnum.templating.checks.program_run import RATE

REPEATS = 50
"""Single frames a timed run, which would be over too soon with one."""

SHAPES: tuple[Shape, ...] = ((8, 8), (16, 16))


@dataclass(frozen=True, slots=True)
class Fusing:
    """A row of `cnnum bench fusing`.

    Attributes
    ----------
    case, device : str
    shape : (rows, cols)
    batch : int
        1: a frame of a stream.
    us, unfused_us : float
        Medians of a frame's time in plans that take turns, µs.
    ratio : float
        The second over the first.
    flops, unfused_flops : int
        Arithmetic per frame, loop bodies counted once.
    error : float
        Largest difference between the two in any output, over that output's largest value.
    """

    case: str
    device: str
    shape: Shape
    batch: int
    us: float
    unfused_us: float
    ratio: float
    flops: int
    unfused_flops: int
    error: float


def measure_fusing(engine: Engine, *, quick: bool = False) -> Iterator[Fusing | str]:
    """Yield one row per tactile program, array and batch; words for cases that are not fused."""
    budget = 0.3 if quick else 2.0
    for shape in SHAPES[:1] if quick else SHAPES:
        for name in program_names("tactile"):
            plan = engine.compile(get_program(name).bind(rate=RATE), shape)
            if plan.built is plan.schedule:
                yield f"{name} on {shape[0]}×{shape[1]} cells: nothing in it is fused"
                continue
            yield from _rows(name, plan, budget)


def _rows(name: str, plan: Plan, budget: float) -> Iterator[Fusing]:
    alone = plan.unfused()
    flops, unfused_flops = plan.explain().flops, alone.explain().flops
    for batch in (1, 1024):
        frames = generator().normal(size=(batch, *plan.schedule.shape, 3))
        calls = [_call(plan, frames), _call(alone, frames)]
        for call in calls:  # builds the kernels, which is not timed
            call()
        own, other = interleaved(calls, budget=budget, runs=30)
        scale = 1e6 / (REPEATS if batch == 1 else batch)
        yield Fusing(
            case=name,
            device=plan.device,
            shape=plan.schedule.shape,
            batch=batch,
            us=own.median * scale,
            unfused_us=other.median * scale,
            ratio=other.median / own.median,
            flops=flops,
            unfused_flops=unfused_flops,
            error=_difference(plan(frames), alone(frames)),
        )


def _call(plan: Plan, frames: Floats) -> Call:
    """Return a run of a batch, or of single frames of a stream."""
    if len(frames) > 1:
        return lambda: plan(frames)
    stream, frame = plan.stream(), frames[0]
    return lambda: [stream.push(frame) for _ in range(REPEATS)]


def _difference(got: dict[str, Floats], expected: dict[str, Floats]) -> float:
    return max(
        float(np.abs(got[name] - value).max() / max(np.abs(value).max(), 1e-30))
        for name, value in expected.items()
    )
