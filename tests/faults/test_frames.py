"""One bad frame costs one frame: whatever a cell reads, later frames are as without it."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby, product

import numpy as np
import pytest

import cnnum
from cnnum.arrays import Floats
from cnnum.errors import ArrayError
from cnnum.frame import FORCE_AXES, Frame
from cnnum.plan import Plan
from cnnum.programs.library import get_program, program_names
from cnnum.scenes.bad_frames import range_for, unit_range
from cnnum.scenes.conversion import AsRead
from cnnum.scenes.events import EVENT_RULES, EventDetector, EventRule
from cnnum.scenes.frame_path import FramePath, FrameResult
from cnnum.scenes.pipeline import Scene, load_scene

SIZES = (1e5, 1e10, 1e15, 1e19, 1e22, 1e30, 1e38)
BAD = (math.nan, math.inf, -math.inf, *SIZES, *(-size for size in SIZES))
SHAPE = (8, 8)
SLOW = ("halfspace_equilibrium", "localize", "texture")  # milliseconds a frame
PRESS = """array.script=[{kind="hold",duration=0.3},{kind="press",load=1,duration=0.3},
{kind="hold",duration=0.1},{kind="pull",speed=0.004,duration=0.4},{kind="release",duration=0.2}]"""


@pytest.fixture(scope="module")
def scripted() -> dict[str, object]:
    from cnnum.cli.options import assignments

    return {**assignments([PRESS]), "array.rate": 100.0}


@pytest.fixture(scope="module")
def contact(scripted) -> Scene:
    return load_scene("contact", changes=scripted)


@pytest.fixture(scope="module")
def volts(contact) -> list[Frame]:
    """Bridges of a sphere that is pressed, pulled and lifted."""
    return list(contact.driver.frames())


@pytest.fixture(scope="module")
def strain(contact, volts) -> list[Frame]:
    read = contact.conversion.reader(FORCE_AXES)
    return [Frame(read(f), FORCE_AXES, "strain", f.sequence, f.time) for f in volts]


def spoilt(frame: Frame, place: tuple[int, int, int], value: float) -> Frame:
    values = frame.values.copy()
    values[place] = value
    return replace(frame, values=values)


def places(frame: Frame) -> list[tuple[int, int, int]]:
    return list(product(*map(range, frame.values.shape)))


def rules_of(plan: Plan) -> tuple[EventRule, ...]:
    given = set(plan.schedule.outputs)
    return tuple(r for rules in EVENT_RULES.values() for r in rules if set(r.needs) <= given)


def way_of(plan: Plan, unit: str) -> FramePath:
    read = AsRead(FORCE_AXES).reader(plan.schedule.channels_read, checks=False)
    within = unit_range(unit, plan.precision)
    rate = None if plan.rate else 100.0
    return FramePath(read, plan.stream(rate=rate), EventDetector(rules_of(plan)), within)


def same(one: FrameResult, other: FrameResult) -> bool:
    """Whether two frames came to the same, to the bit; they may differ by a gap."""
    outputs = all(np.array_equal(one.outputs[n], other.outputs[n]) for n in one.outputs)
    events = [replace(e, after_gap=None, gap_end=None) for e in other.events]
    return outputs and one.outputs.keys() == other.outputs.keys() and list(one.events) == events


def differences(
    clean: FramePath, hit: FramePath, frames: Sequence[Frame], bad: Sequence[Frame]
) -> Iterator[str]:
    """Run good frames through both, and between them the bad ones, evenly spread, through one."""
    cuts = np.linspace(0, len(bad), len(frames) + 1).astype(int)
    for number, frame in enumerate(frames):
        for wrong in bad[cuts[number] : cuts[number + 1]]:
            moment = hit.step(number, wrong)
            if moment.error is None:
                yield "a bad frame was run"
        if not same(clean.step(number, frame), hit.step(number, frame)):
            yield f"frame {number} differs"


def test_a_value_out_of_range_costs_one_frame_of_every_program(faults, fast, strain):
    """A NaN, an infinity or an outlier of 1e5 to 1e38 in any cell changes no later frame."""
    # a program takes seconds to build: a short run has three, with memories and without
    names = program_names("tactile") if faults.full else ("edges", "halfspace_layers", "twist")
    every = list(product(names, places(strain[0]), BAD))
    for name, cases in groupby(faults.each(every, short=52), key=lambda case: case[0]):
        plan = fast.compile(get_program(name), SHAPE, channels=FORCE_AXES)
        frames = strain[:: 10 if name in SLOW else 2]
        wrong = [spoilt(frames[at % 3], place, value) for at, (_, place, value) in enumerate(cases)]
        for what in differences(way_of(plan, "strain"), way_of(plan, "strain"), frames, wrong):
            faults.lose(f"{name}: {what}")


def test_a_bridge_out_of_range_costs_one_frame_of_every_scene(faults, scripted, volts):
    """A NaN, an infinity or an outlier of a bridge changes no later frame of a scene."""
    # the second wants all that the program of these scenes gives, and takes long to build
    names = ("contact", "tactile") if faults.full else ("contact",)
    every = list(product(names, places(volts[0]), BAD))
    for name, cases in groupby(faults.each(every, short=60), key=lambda case: case[0]):
        scene = load_scene(name, changes=scripted)
        wrong = [spoilt(volts[at % 3], place, value) for at, (_, place, value) in enumerate(cases)]
        for what in differences(scene.path(), scene.path(), volts, wrong):
            faults.lose(f"{name}: {what}")


@cnnum.program
def leaky(frame):
    """Memories that huge numbers overflow at once, in the next frame, or through `exp`."""
    mean = frame.memory("mean")
    mean.store(0.5 * mean.value + 0.5 * frame.normal)
    power = frame.memory("power")
    power.store(0.5 * power.value + frame.normal * frame.normal)
    late = frame.memory("late")
    late.store(0.5 * mean.value * mean.value + frame.shear_x)
    growth = frame.memory("growth")
    growth.store(0.5 * growth.value + cnnum.exp(frame.shear_y))
    numbers = {"mean": mean.value, "late": late.value.max(), "growth": growth.value.sum(),
               "power": power.value.sum()}  # fmt: skip
    # a flag is finite for any memories
    return {**numbers, "wanted": mean.value + late.value + growth.value + power.value > 0.5}


ENGINES = (("opencl", "float32"), ("numba", "float32"), ("reference", "float64"))


@pytest.mark.parametrize(("engine", "precision"), ENGINES)
@pytest.mark.parametrize("wanted", [None, ["wanted"]], ids=["all", "flags"])
def test_a_finite_outlier_never_poisons_a_stream(faults, engine, precision, wanted):
    """A finite outlier that is pushed without a scene is refused, or forgotten in time."""
    plan = cnnum.Engine(engine, precision=precision).compile(leaky, (3, 4), wanted)
    rng, tiny = np.random.default_rng(3), 1e-3  # of the memories' half-lives: 2⁻¹⁰ of 1
    frames = rng.uniform(-1.0, 1.0, (200, 3, 4, 3))
    sizes = (89.0, 100.0, 1e3, *SIZES, 1e77, 1e154, 1e200, 1e308)
    channels = sorted(map(plan.schedule.channels.index, plan.schedule.channels_read))
    for at, sign, size in faults.each(list(product(channels, (1, -1), sizes)), short=12):
        clean, hit = plan.stream(), plan.stream()
        for frame in frames[:40]:
            clean.push(frame), hit.push(frame)
        outlier = frames[40].copy()
        outlier[1, 2, at] = sign * size
        refused = _refused(hit, outlier)
        after = [(clean.push(f), _pushed(hit, f)) for f in frames[41:]]
        if any(got is None for _, got in after):
            faults.lose(f"{size:g}: a later frame is refused")
        elif refused and not all(_equal(a, b, 0.0) for a, b in after):
            faults.lose(f"{size:g}: a later frame differs")
        # the rest of it halves each frame: of exp(100), 3e43, 7e-5 is left after 158 frames
        elif size < 1e19 and not _equal(*after[-1], tiny):
            faults.lose(f"{size:g}: it is not forgotten")


def _refused(stream, frame: Floats) -> bool:
    with np.errstate(all="raise"):
        return _pushed(stream, frame) is None


def _pushed(stream, frame: Floats):
    try:
        return stream.push(frame)
    except ArrayError:
        return None


def _equal(one, other, tolerance: float) -> bool:
    return all(np.allclose(one[n], other[n], rtol=tolerance, atol=tolerance) for n in one)


@pytest.mark.parametrize("engine", ["opencl", "numba"])
def test_every_program_outlives_an_outlier_without_a_scene(faults, engine, strain):
    """No outlier pushed to a tactile program's stream makes a later frame fail."""
    made = cnnum.Engine(engine, precision="float32")
    names = [n for n in program_names("tactile") if n not in SLOW]
    if not faults.full:  # of those that are built fast, with memories of every kind
        names = ["contact", "slip", "on_off"]
    cells = [(0, 0, 0), (3, 4, 2), (7, 2, 1)]
    every = list(product(names, cells, [v for v in BAD if math.isfinite(v)]))
    for name, cases in groupby(faults.each(every, short=6), key=lambda case: case[0]):
        plan = made.compile(get_program(name).bind(rate=200.0), SHAPE, channels=FORCE_AXES)
        for _, place, value in cases:
            stream, clean = plan.stream(), plan.stream()
            for frame in strain[30:50]:
                stream.push(frame.values), clean.push(frame.values)
            refused = _pushed(stream, spoilt(strain[50], place, value).values) is None
            for frame in strain[51:60]:
                got, want = _pushed(stream, frame.values), clean.push(frame.values)
                if got is None or (refused and not _equal(got, want, 0.0)):
                    faults.lose(f"{name}: {value:g} at {place}")
                    break


MEMORY = 1500
"""Frames, 25 s: 70 times the 0.35 s in which the program forgets a load, its longest memory."""


def test_counts_that_are_legal_are_forgotten(faults, fast):
    """A count of 1e5 is legal: outputs stay finite, and are as before after the memory's time."""
    rng = np.random.default_rng(8)
    plan = fast.compile(get_program("slip").bind(push=1.0, rate=60.0), (4, 4), channels=FORCE_AXES)
    counts = 30_000.0 + np.round(rng.normal(0.0, 20.0, (MEMORY + 101, 4, 4, 3)))
    frames = [Frame(v, FORCE_AXES, "count", n, n / 60.0) for n, v in enumerate(counts)]
    clean = way_of(plan, "count")
    want = [clean.step(number, frame) for number, frame in enumerate(frames)]
    for place in faults.each(places(frames[0]), short=3):
        hit = way_of(plan, "count")
        for number, frame in enumerate(frames):
            moment = hit.step(number, spoilt(frame, place, 1e5) if number == 100 else frame)
            if moment.error is not None:
                faults.lose(f"{place}: frame {number} is refused")
        if not _equal(want[-1].outputs, moment.outputs, 1e-6):  # float32, of numbers up to 1
            faults.lose(f"{place}: not forgotten after {MEMORY} frames")


@pytest.mark.parametrize(
    ("unit", "inside", "outside"),
    [("strain", 10.0, 10.1), ("V", 120.0, -121.0), ("N", 1e4, 1.1e4), ("Pa", -1e9, 1.1e9),
     ("count", 2.0**24, 2.0**24 + 2), ("mT", 1e19, 2e19)],
)  # fmt: skip
def test_each_unit_has_a_range(unit, inside, outside):
    within = unit_range(unit, "float32")
    frame = Frame(np.zeros((2, 3, 1)), ("normal",), unit, 0, 0.0)
    assert within.size(spoilt(frame, (1, 2, 0), inside)) >= abs(inside)
    with pytest.raises(ArrayError, match=r"taxel \(1, 2\) reads .* channel 'normal', expected"):
        within.size(spoilt(frame, (1, 2, 0), outside))


def test_what_is_compared_is_what_the_engine_reads():
    """2²⁴ + 1 is 2²⁴ in float32."""
    frame = Frame(np.full((1, 1, 1), 2.0**24 + 1), ("normal",), "count", 0, 0.0)
    assert unit_range("count", "float32").size(frame) == 2.0**24 + 1
    assert unit_range("count", "float64").size(frame) == 2.0**24 + 1
    frame = Frame(np.full((1, 1, 1), 2.0**53 + 4), ("normal",), "count", 0, 0.0)
    with pytest.raises(ArrayError, match="does not hold every whole number"):
        unit_range("count", "float64").size(frame)


def test_the_best_that_is_known_is_the_range():
    known = {"full_scale": 65_535.0, "saturated": 2.4}
    assert range_for("V", "float32", given=3.0, **known).limit == 3.0
    assert range_for("V", "float32", **known).limit == 65_535.0
    assert range_for("V", "float32", saturated=2.4).limit == 4.8
    assert range_for("V", "float32").limit == 120.0


def test_a_scene_says_its_own_range(scripted, volts):
    scene: Scene = load_scene("contact", changes={**scripted, "frames.range": 0.4})
    assert "frames.range" in str(scene.path().step(0, spoilt(volts[0], (0, 0, 0), 0.5)).error)
    assert scene.path().step(0, spoilt(volts[0], (0, 0, 0), 0.39)).error is None
