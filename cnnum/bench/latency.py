"""The way of one frame, from host array to host events, beside an empty launch with its copies."""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from cnnum.bench.errors import program_error
from cnnum.bench.samples import frames
from cnnum.engine import Engine
from cnnum.engines.opencl.empty import EmptyLaunch
from cnnum.plan import Explanation, Plan
from cnnum.program_library import get_program, program_names

SHAPE = (8, 8)

WARM_UP = 10

TURN_S = 0.1
"""Longest turn, s: a hundred frames of up to a millisecond."""

BUDGET_S = 20.0
"""s a program, after which no further turn begins: some relax for a long time on a single frame."""


@dataclass(frozen=True, slots=True)
class Latency:
    """A row of `cnnum bench latency`.

    Attributes
    ----------
    case, device : str
    launches : int
        Kernel launches a frame.
    p50_us, p99_us : float
        Host to host, of single frames of a stream.
    empty_launch_us : float
        Median of a launch on the device that does nothing, with copies of as many bytes in and
        out.
    ratio : float
        p50 in empty launches.
    own_launch_us : float
        Median of such a launch where single frames run: in the thread that asks, if the device
        has a partner for that.
    frames : int
    error : float or None
        Of a contact's frames, largest of the outputs, each over its largest value, against the
        reference engine; None where that takes longer than ten seconds a frame.
    """

    case: str
    device: str
    launches: int
    p50_us: float
    p99_us: float
    empty_launch_us: float
    ratio: float
    own_launch_us: float
    frames: int
    error: float | None


def measure_latency(
    engine: Engine, *, count: int = 20_000, programs: tuple[str, ...] | None = None
) -> list[Latency]:
    """Return a row a tactile program on single 8×8×3 frames.

    Parameters
    ----------
    engine : Engine
        On an OpenCL device.
    count : int
        Frames.
    programs : tuple of str, optional
        All of the library unless given.
    """
    plans = {
        name: engine.compile(get_program(name), SHAPE)
        for name in (program_names("tactile") if programs is None else programs)
    }
    return [_measure(engine, name, plan, count) for name, plan in plans.items()]


def _measure(engine: Engine, name: str, plan: Plan, count: int) -> Latency:
    cost, stream = plan.explain(), plan.stream()
    queue = iter(np.resize(frames(256, SHAPE).astype(np.float64), (count + 200, *SHAPE, 3)))
    empty = EmptyLaunch(engine.device, cost.bytes_in, cost.bytes_out)
    own = EmptyLaunch(engine.device, cost.bytes_in, cost.bytes_out, alone=True)
    first = min(_times(lambda: stream.push(next(queue)), WARM_UP))
    _times(empty.run, 100)
    _times(own.run, 100)
    # in turns of a hundred, so that both see the same disturbances; fewer where a frame is slow
    turn = max(1, min(100, int(TURN_S / first)))
    until = perf_counter() + BUDGET_S
    pushed: list[float] = []
    launched: list[float] = []
    alone: list[float] = []
    while len(pushed) < count and (perf_counter() < until or not pushed):
        pushed += _times(lambda: stream.push(next(queue)), turn)
        launched += _times(empty.run, turn)
        alone += _times(own.run, turn)
    p50, p99 = (1e6 * float(np.percentile(pushed, p)) for p in (50, 99))
    idle, least = (1e6 * float(np.median(seconds)) for seconds in (launched, alone))
    error = program_error(plan, name)
    return Latency(
        name, engine.device, cost.launches, p50, p99, idle, p50 / idle, least, len(pushed), error
    )


def _times(call: Callable[[], object], count: int) -> list[float]:
    seconds: list[float] = []
    for _ in range(count):
        begin = perf_counter()
        call()
        seconds.append(perf_counter() - begin)
    return seconds


def seconds_of_launch(engine: Engine, cost: Explanation, *, count: int = 1000) -> float:
    """Return the median of empty launches where single frames run, with a plan's copies, s."""
    empty = EmptyLaunch(engine.device, cost.bytes_in, cost.bytes_out, alone=True)
    _times(empty.run, 100)
    return float(np.median(_times(empty.run, count)))
