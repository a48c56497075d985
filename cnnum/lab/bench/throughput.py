"""Cell updates a second on a device, and their share of its own arithmetic."""

import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.engine import Engine
from cnnum.graph.nodes import RunSpec
from cnnum.lab.bench.errors import STEPS, ends_error
from cnnum.lab.bench.samples import channelwise, even_template, frames, full_template
from cnnum.lab.bench.timing import difference, seconds_of
from cnnum.plan import Plan
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.template import Template


class PeakMeter:
    """Measures the multiply-add peak of an engine's device; the best of a whole run counts.

    Only OpenCL devices have kernels to measure it with: it is NaN on other engines.

    Attributes
    ----------
    best : float
        Best rate so far of any kernel, operations per second; 0 before the first measurement.
    kernel : str
        The kernel that had it; empty before.
    """

    def __init__(self, engine: Engine) -> None:
        self._name = engine.device if engine.name == "opencl" else None
        self.best, self.kernel = (math.nan if self._name is None else 0.0), ""

    def measure(self, times: int = 1) -> None:
        """Measure all kernels a number of times."""
        if self._name is None:
            return
        from cnnum.engines.devices.peak import measure
        from cnnum.engines.devices.selection import choose_device

        for _ in range(times):
            peak = measure(choose_device(self._name))
            if peak.flops > self.best:
                self.best, self.kernel = peak.flops, peak.kernel

    def turn(self) -> Callable[[], float]:
        """Return a function that runs the best kernel once, some 20 ms, for operations per second.

        It runs here, not in a process of its own, for it has run in one: `measure` comes first.
        """
        if self._name is None:
            return lambda: math.nan
        from cnnum.engines.devices.peak import Bench, arithmetic_kernels
        from cnnum.engines.devices.selection import choose_device

        (kernel,) = (known for known in arithmetic_kernels() if known.label == self.kernel)
        return Bench(choose_device(self._name)).rate(kernel)


STEP = 0.01

APART = 0.01
"""Of templates of frames' own: standard deviation of the weights, as a share of each."""

TURNS = 7

PEAKS = 3
"""Measurements of the peak before the first case and after the last; between cases it is one."""

FULL, EVEN, EVEN_5 = full_template(), even_template(), even_template(2)


@dataclass(frozen=True, slots=True)
class Throughput:
    """A row of `cnnum bench throughput`.

    Attributes
    ----------
    case, device, precision : str
    shape : (rows, cols)
    batch : int
    cell_updates_per_s : float
        Of the steps alone: the time of more steps in the same launch.
    host_to_host_per_s : float
        With copies and conversions, at the larger number of steps.
    flops : float
        2·taps + 4 a cell update, a second.
    peak_flops : float
        Best multiply-add kernel on the same device in the whole run: one number for all rows.
    share_of_peak : float
    share_in_turns : float
        Median over turns of the rate over that of the best multiply-add kernel in the same turn:
        on a machine that others share, both see the same of them.
    seconds, spread : float
        One launch host to host, s.
    error : float
        Of the first and the last frame after a few of the steps, over their largest output. The
        reference engine's own steps are the truth.
    beside_one_template : float or None
        Of frames with a template each: the rate over that of the same frames with one, in turns.
    """

    case: str
    device: str
    precision: str
    shape: Shape
    batch: int
    cell_updates_per_s: float
    host_to_host_per_s: float
    flops: float
    peak_flops: float
    share_of_peak: float
    share_in_turns: float
    seconds: float
    spread: float
    error: float
    beside_one_template: float | None = None


@dataclass(frozen=True, slots=True)
class ThroughputCase:
    """A template without zeros on every channel of a batch of frames, by Euler's method.

    With `own`, every frame has a template of its own.
    """

    name: str
    shape: Shape
    batch: int
    channels: int
    steps: int
    template: Template = FULL
    own: bool = False


CASES = (
    ThroughputCase("8×8×3, batch 65536", (8, 8), 65_536, 3, 100),
    ThroughputCase("8×8×3, batch 1024", (8, 8), 1024, 3, 3000),
    ThroughputCase("16×16×3, batch 4096", (16, 16), 4096, 3, 300),
    ThroughputCase("1024×1024", (1024, 1024), 1, 1, 400),
    ThroughputCase("8×8×3, batch 1024, equal weights", (8, 8), 1024, 3, 4000, EVEN),
    ThroughputCase("8×8×3, batch 1024, equal weights, 5×5", (8, 8), 1024, 3, 2000, EVEN_5),
    ThroughputCase("1024×1024, equal weights", (1024, 1024), 1, 1, 400, EVEN),
    ThroughputCase("8×8, batch 4096, a template each", (8, 8), 4096, 1, 1500, FULL, own=True),
)


def measure_throughput(
    engine: Engine, *, quick: bool = False, cases: tuple[ThroughputCase, ...] = CASES
) -> Iterator[list[Throughput] | None]:
    """Yield None after each case, and instead of the last the rows of all.

    The peak is measured before the first case, between cases and after the last. A row is a share
    of the best of the whole run, which is known at its end: then rows come, or where Ctrl-C ends it
    before.

    Parameters
    ----------
    engine : Engine
        Of the OpenCL devices.
    quick : bool
        Fewer repeats.
    cases : tuple of ThroughputCase
    """
    meter, rows = PeakMeter(engine), list[Throughput]()
    try:
        meter.measure(1 if quick else PEAKS)
        for case in cases:
            if rows:
                yield None
            rows.append(_measure(engine, case, meter.turn(), budget=1.0 if quick else 6.0))
            meter.measure()
        meter.measure(0 if quick else PEAKS - 1)
    except KeyboardInterrupt:
        yield of_peak(rows, meter.best)
        raise
    yield of_peak(rows, meter.best)


def of_peak(rows: Sequence[Throughput], peak: float) -> list[Throughput]:
    """Return rows as shares of a peak."""
    return [replace(row, peak_flops=peak, share_of_peak=row.flops / peak) for row in rows]


def _plan(engine: Engine, case: ThroughputCase, steps: int) -> Plan:
    names = tuple("xyz"[: case.channels])
    spec = RunSpec(duration=steps * STEP, method="euler", dt=STEP)
    program = channelwise(case.template, spec)
    return engine.compile(program, case.shape, channels=names)


def _timed(
    engine: Engine, case: ThroughputCase, batch: NDArray[np.floating], steps: int
) -> Callable[[], object]:
    """Return the call of a launch of that number of steps."""
    if case.own:
        maps = np.asarray(batch[..., 0], dtype=np.float64)
        weights = drawn(case.template, case.batch)
        return partial(run_of(engine, case.template, maps, STEP, weights), steps)
    return partial(_plan(engine, case, steps), batch)


def _measure(
    engine: Engine, case: ThroughputCase, peak: Callable[[], float], budget: float
) -> Throughput:
    """Time two numbers of steps in turns: their difference is that of steps alone.

    The peak is still to come.
    """
    batch = frames(case.batch, case.shape, case.channels)
    maps = np.asarray(batch[..., 0], dtype=np.float64)
    short, long = (_timed(engine, case, batch, n) for n in (case.steps, 3 * case.steps))
    cells = case.batch * case.channels * case.shape[0] * case.shape[1]
    a_cell = 2 * np.count_nonzero(case.template.A) + 4
    result = difference(
        short,
        long,
        work=cells * 2.0 * case.steps * a_cell,
        against=peak,
        budget=budget,
    )
    rate = cells * 2 * case.steps / result.more
    return Throughput(
        case=case.name,
        device=engine.device,
        precision=engine.precision,
        shape=case.shape,
        batch=case.batch,
        cell_updates_per_s=rate,
        host_to_host_per_s=cells * 3 * case.steps / result.long.median,
        flops=rate * a_cell,
        peak_flops=math.nan,
        share_of_peak=math.nan,
        share_in_turns=result.share,
        seconds=result.long.median,
        spread=result.long.spread,
        error=ends_error(lambda on, some: _outputs(on, case, some), engine, batch),
        beside_one_template=(
            rate_beside_one(engine, case.template, maps, STEP, case.steps) if case.own else None
        ),
    )


def _outputs(engine: Engine, case: ThroughputCase, batch: NDArray[np.floating]) -> Floats:
    if case.own:
        maps = np.asarray(batch[..., 0], dtype=np.float64)
        weights = drawn(case.template, case.batch)
        # the reference runs the first and the last frame alone, with their own templates
        weights = weights if len(maps) == case.batch else weights[[0, -1]]
        return run_of(engine, case.template, maps, STEP, weights)(STEPS)[:, np.newaxis]
    return np.stack(list(_plan(engine, case, STEPS)(batch).values()), axis=1)


def run_of(
    engine: Engine, template: Template, maps: Floats, step: float, weights: Floats | None = None
) -> Callable[[int], Floats]:
    """Return a function of the number of steps that runs frames, with a template each or one.

    Parameters
    ----------
    engine : Engine
    template : Template
    maps : (frames, rows, cols) float
        Inputs and initial states.
    step : float
        Of Euler's method, in time constants.
    weights : (frames, ...) float, optional
        A of each frame's own template; all have one unless given.
    """
    given = template if weights is None else TemplateBatch(template, weights)

    def run(steps: int) -> Floats:
        length = steps * step
        return engine.run(
            given,
            input=maps,
            state=maps,
            duration=length,
            dt=step,
            method="euler",
        ).output

    return run


def drawn(template: Template, count: int) -> Floats:
    """Return weights of A of templates near one."""
    rng = np.random.default_rng(0)
    return template.A * (1.0 + APART * rng.normal(size=(count, *template.A.shape)))


def rate_beside_one(
    engine: Engine, template: Template, maps: Floats, step: float, steps: int
) -> float:
    """Return the rate of frames with a template each over that of frames with one, in turns.

    It is that of the steps alone: the time of more steps in the same launch.
    """
    weights_of_each = drawn(template, len(maps))
    own, single = (
        run_of(engine, template, maps, step, weights) for weights in (weights_of_each, None)
    )
    for run in (own, single):
        run(steps)
        run(3 * steps)

    def more(run: Callable[[int], Floats]) -> float:
        short = seconds_of(partial(run, steps))
        return max(seconds_of(partial(run, 3 * steps)) - short, 1e-9)

    return statistics.median(more(single) / more(own) for _ in range(TURNS))
