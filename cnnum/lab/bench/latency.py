"""The way of one frame, from host memory to host events, and of an empty launch with its copies."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
from time import perf_counter

import numpy as np
import pyopencl as cl

from cnnum.engine import Engine
from cnnum.engines.devices.listing import partner_of
from cnnum.engines.devices.program_cache import build_program, make_kernel
from cnnum.engines.devices.selection import choose_device
from cnnum.frame import FORCE_AXES, Frame
from cnnum.lab.bench.errors import SLOW_REFERENCE, program_error
from cnnum.lab.bench.samples import scene_frames
from cnnum.plan import Explanation, Plan
from cnnum.programs.library import get_program, program_names
from cnnum.scenes.bad_frames import unit_range
from cnnum.scenes.conversion import AsRead
from cnnum.scenes.events import (
    EVENT_RULES,
    EventDetector,
    EventRule,
    FlagsAbreast,
    rules_that_fit,
)
from cnnum.scenes.frame_path import FramePath
from cnnum.templating.checks.program_run import RATE

_TEXT = """
__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void nothing(__global const float *restrict in, __global float *restrict out)
{
}
"""


class EmptyLaunch:
    """Copies bytes in, launches an empty kernel, copies bytes out and waits.

    Parameters
    ----------
    device : str
        Part of the device's name.
    bytes_in, bytes_out : int
    alone : bool
        Launch in the thread that asks, as single frames do, where the device has a partner that
        can.
    """

    def __init__(self, device: str, bytes_in: int, bytes_out: int, *, alone: bool = False) -> None:
        handle = choose_device(device).handle
        context = cl.Context([(partner_of(handle) if alone else None) or handle])
        self._queue = cl.CommandQueue(context)
        self._kernel = make_kernel(build_program(context, _TEXT), "nothing")
        self._given = np.zeros(max(bytes_in, 4), np.uint8)
        self._taken = np.zeros(max(bytes_out, 4), np.uint8)
        flags = cl.mem_flags
        self._input = cl.Buffer(context, flags.READ_ONLY, self._given.nbytes)
        self._output = cl.Buffer(context, flags.WRITE_ONLY, self._taken.nbytes)

    def run(self) -> None:
        """Do it once."""
        cl.enqueue_copy(self._queue, self._input, self._given, is_blocking=False)
        self._kernel(self._queue, (1,), (1,), self._input, self._output)
        cl.enqueue_copy(self._queue, self._taken, self._output)


SHAPE = (8, 8)

SCENE = "tactile"
"""Its array gives the frames: it presses, slips, twists and lets go."""

WARM_UP = 10

TURN_S = 0.1
"""Longest turn, s: a hundred frames of up to a millisecond."""

BUDGET_S = 20.0
"""s a program, after which no further turn begins: some relax for a long time on a single frame."""

OMISSIONS = (
    "Reading a frame from its driver, and calibrating it: the time is from a frame in host memory, "
    "of the channels that programs take, to its events. `cnnum bench scenes` has calibration.",
    f"{', '.join(SLOW_REFERENCE)} on the reference engine: a frame takes it more than ten seconds. "
    "Their errors are those of their checks, against closed forms.",
    "Other arrays: frames are of 8×8×3.",
)
"""Cases that are not measured, and why."""


@dataclass(frozen=True, slots=True)
class Subject:
    """A program, and the events that its plan is for; with none named, all that it gives.

    With several skins, a push is of a frame of each.
    """

    name: str
    program: str
    events: tuple[str, ...] = ()
    skins: int = 1

    def plan(self, engine: Engine) -> Plan:
        """Return the plan, as a scene that wants these events has it."""
        program = get_program(self.program).bind(rate=RATE)
        rules = rules_that_fit(self.events, program.trace(SHAPE).outputs) if self.events else ()
        needs = [name for rule in rules for name in rule.needs]
        return engine.compile(program, SHAPE, list(dict.fromkeys(needs)) or None)


BOTH = Subject("slip and twist", "tactile", ("slip", "twist"))
"""The cost of a scene that wants both events."""

MANY = Subject("slip and twist, 4,096 skins", "tactile", ("slip", "twist"), 4096)
"""The same, of skins in one array: each is a frame further in the scene than the one before."""


@dataclass(frozen=True, slots=True)
class Latency:
    """A row of `cnnum bench latency`.

    Attributes
    ----------
    case, device : str
    launches : int
        Kernel launches per frame.
    p50_us, p99_us : float
        From a frame of a stream, or of each of many skins in one array, in host memory, to events.
    first_us : float
        Median of the first frame after other work, which finds the caches full of that. It is in
        neither of the two.
    empty_launch_us : float
        Median of a launch on the device that does nothing, with copies of as many bytes in and
        out.
    ratio : float
        p50 in empty launches.
    own_launch_us : float
        Median of such a launch where single frames run: in the thread that asks, if the device
        has a partner for that.
    own_ratio : float
        p50 in those.
    tail : float
        p99 over p50.
    empty_tail, own_tail : float
        The same of the two launches that do nothing, in the same turns: the share of the machine.
    frames, events : int
        Measured, and reported of them.
    error : float
        Of a contact's frames, largest of the outputs, each over its largest value.
    truth : str
        Reference of the error: the reference engine, or a closed form.
    """

    case: str
    device: str
    launches: int
    p50_us: float
    p99_us: float
    first_us: float
    empty_launch_us: float
    ratio: float
    own_launch_us: float
    own_ratio: float
    tail: float
    empty_tail: float
    own_tail: float
    frames: int
    events: int
    error: float
    truth: str


def subjects() -> tuple[Subject, ...]:
    """Return the cases: every tactile program, slip and twist together, and those of many skins."""
    return (*(Subject(name, name) for name in program_names("tactile")), BOTH, MANY)


def measure_latency(
    engine: Engine,
    *,
    count: int = 20_000,
    chosen: Sequence[Subject] | None = None,
    seconds: float = BUDGET_S,
) -> Iterator[Latency | str]:
    """Yield one row per subject, on single 8×8×3 frames of the simulated scene, one by one.

    Parameters
    ----------
    engine : Engine
    count : int
        Frames.
    chosen : sequence of Subject, optional
        `subjects()` unless given.
    seconds : float
        s a subject, after which no further turn begins.

    Yields
    ------
    Latency or str
        A sentence after a row that has fewer frames.
    """
    frames = scene_frames(SCENE)
    for subject in subjects() if chosen is None else chosen:
        row = _measure(engine, subject, frames, count, seconds)
        yield row
        if row.frames < count:
            yield (
                f"{row.case}: {count - row.frames} of {count} frames, as its {seconds:g} s were "
                f"over after {row.frames}."
            )


def rules_of(plan: Plan) -> tuple[EventRule, ...]:
    """Return the rules of all events that a plan has the outputs for."""
    return rules_that_fit(EVENT_RULES, plan.schedule.outputs)


class _Frames:
    """Pushes the frames of a scene, again and again, through a plan to its events."""

    def __init__(self, plan: Plan, frames: Sequence[Frame]) -> None:
        reader = AsRead(FORCE_AXES).reader(plan.schedule.channels_read, checks=False)
        within = unit_range(frames[0].unit, plan.precision)
        self._way = FramePath(reader, plan.stream(), EventDetector(rules_of(plan)), within)
        self._frames = enumerate(cycle(frames))
        self.events = 0

    def push(self) -> None:
        """Run the next frame."""
        self.events += len(self._way.step(*next(self._frames)).events)


class _Skins:
    """Pushes one array of a frame of each of many skins, again and again, to their events."""

    def __init__(self, plan: Plan, frames: Sequence[Frame], skins: int) -> None:
        scene = np.stack([frame.values for frame in frames]).astype(np.float32)
        # a window of as many frames as there are skins is one array, which nothing copies
        self._scene, self._length = (
            np.resize(scene, (len(scene) + skins, *scene.shape[1:])),
            len(scene),
        )
        self._stream, self._skins, self._at = plan.stream((skins,)), skins, 0
        self._detectors = [EventDetector(rules_of(plan)) for _ in range(skins)]
        self._flags = FlagsAbreast(self._detectors)
        self._lanes, self.events = np.arange(skins), 0

    def push(self) -> None:
        """Run the next frame of every skin."""
        at, time = self._at % self._length, self._at / RATE
        outputs = self._stream.push(self._scene[at : at + self._skins])
        for lane in self._flags.look(self._lanes, np.full(self._skins, time), outputs):
            self._flags.settle(lane)
            own = {name: numbers[lane] for name, numbers in outputs.items()}
            self.events += len(self._detectors[lane].update(time, self._at, own))
            self._flags.take(lane)
        self._at += 1


def _measure(
    engine: Engine, subject: Subject, frames: Sequence[Frame], count: int, budget: float
) -> Latency:
    plan = subject.plan(engine)
    cost, skins = plan.explain(), subject.skins
    source = _Frames(plan, frames) if skins == 1 else _Skins(plan, frames, skins)
    idles = _launches(engine, cost, skins)
    (pushed, *idle), firsts = _turns((source.push, *idles), count, budget)
    launched, alone = idle or ([math.nan], [math.nan])
    p50, p99 = (1e6 * float(np.percentile(pushed, p)) for p in (50, 99))
    empty, least = (1e6 * float(np.median(seconds)) for seconds in (launched, alone))
    judged = program_error(engine, plan, subject.program)
    return Latency(
        case=subject.name,
        device=engine.device,
        launches=cost.launches,
        p50_us=p50,
        p99_us=p99,
        first_us=1e6 * float(np.median(firsts)),
        empty_launch_us=empty,
        ratio=p50 / empty,
        own_launch_us=least,
        own_ratio=p50 / least,
        tail=p99 / p50,
        empty_tail=_tail(launched),
        own_tail=_tail(alone),
        frames=len(pushed),
        events=source.events,
        error=judged.error,
        truth=judged.truth,
    )


def _launches(engine: Engine, cost: Explanation, skins: int = 1) -> tuple[Callable[[], None], ...]:
    """Return a launch that does nothing, and one in the thread that asks; none without OpenCL."""
    if engine.name != "opencl":
        return ()
    from cnnum.lab.bench.latency import EmptyLaunch

    copies = (engine.device, skins * cost.bytes_in, skins * cost.bytes_out)
    return EmptyLaunch(*copies).run, EmptyLaunch(*copies, alone=True).run


def _tail(seconds: Sequence[float]) -> float:
    """Return p99 over p50."""
    return float(np.percentile(seconds, 99) / np.median(seconds))


def _turns(
    calls: Sequence[Callable[[], object]], count: int, budget: float
) -> tuple[tuple[list[float], ...], list[float]]:
    """Return s of calls in turns of a hundred, so that all see the same disturbances.

    Turns are shorter where the first call, a frame, is slow. One more call begins each turn and is
    not counted, as it comes after another's work. Those of the frames are returned, too.
    """
    first = min(_times(calls[0], WARM_UP))
    for call in calls[1:]:
        _times(call, 100)
    turn = max(1, min(100, count, int(TURN_S / first)))
    until = perf_counter() + budget
    taken: tuple[list[float], ...] = tuple([] for _ in calls)
    firsts: list[float] = []
    while len(taken[0]) < count and (perf_counter() < until or not taken[0]):
        for seconds, call in zip(taken, calls, strict=True):
            begun = _times(call, 1)
            firsts += begun if call is calls[0] else []
            seconds += _times(call, min(turn, count - len(seconds)))
    return taken, firsts


def _times(call: Callable[[], object], count: int) -> list[float]:
    seconds: list[float] = []
    for _ in range(count):
        begin = perf_counter()
        call()
        seconds.append(perf_counter() - begin)
    return seconds


def seconds_of_launch(engine: Engine, cost: Explanation, *, count: int = 1000) -> float:
    """Return the median of empty launches where single frames run, with a plan's copies, s.

    NaN on engines that launch nothing.
    """
    for launch in _launches(engine, cost)[1:]:
        _times(launch, 100)
        return float(np.median(_times(launch, count)))
    return math.nan
