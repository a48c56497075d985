"""A small made-up scene: its events are known to the frame."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cnnum.drivers.driver import Counters
from cnnum.graph.schedule import LeftOut, Parts
from cnnum.plan import Explanation
from cnnum.report import PlanCost, SceneRecord, WorkPrecision
from cnnum.report.environment import Environment
from cnnum.report.record import ReportData
from cnnum.scenes.events import Event
from cnnum.scenes.scene_record import Summary
from cnnum.templating.checks import CheckResult

FRAMES, RATE, SHAPE = 120, 100.0, (3, 4)
CONTACT, INCIPIENT, GROSS, TWIST = (20, 110), (40, 48), (48, 60), (75, 90)


def during(span: tuple[int, int]) -> Any:
    numbers = np.arange(FRAMES)
    return ((numbers >= span[0]) & (numbers < span[1])).astype(float)


def made_truth() -> dict[str, Any]:
    pulled = during((30, 60))
    return {
        "contact": during(CONTACT),
        "incipient": during(INCIPIENT),
        "slip": during(GROSS),
        "twist_slip": during(TWIST),
        "twist_rate": -0.3 * during(TWIST),
        "slip_direction": 0.5 * during(GROSS),
        "normal_force": 1.25 * during(CONTACT),
        "shear_x": 0.6 * pulled * np.cos(0.4),
        "shear_y": 0.6 * pulled * np.sin(0.4),
        "torque": -1.5e-3 * during(TWIST),
        "contact_radius": 2e-3 * during(CONTACT),
        "stick_radius": 1e-3 * during(CONTACT),
        "x": np.full(FRAMES, 0.3e-3),
        "y": np.full(FRAMES, -0.2e-3),
    }


def made_events() -> tuple[Event, ...]:
    return (
        Event(time=0.22, kind="contact", frame=22, where=(1.0, 2.0), strength=0.5),
        Event(time=0.43, kind="slip", phase="incipient", frame=43, direction=0.42),
        Event(time=0.48, kind="slip", phase="gross", frame=48, direction=0.6),
        Event(time=0.80, kind="twist", frame=80, sense=-1),
        Event(time=1.09, kind="release", frame=109),
    )


def made_flags() -> dict[str, Any]:
    """The report of a program with every phase."""
    names = ("incipient_slip", "gross_slip", "twist")
    return {"contact": during((22, 109)), **{name: during((0, 0)) for name in names}}


def explained(program: str, channels: tuple[str, ...], ops: int, *left: LeftOut) -> Explanation:
    return Explanation(
        program=program,
        engine="opencl",
        device="a device <of> mine & yours",
        precision="float32",
        shape=SHAPE,
        ops=ops,
        ops_most=10 * ops,
        parts=Parts(),
        launches=1,
        channels_read=channels,
        maps_read_back=("contact_map",),
        transients=("template smooth by propagator (it is linear)",),
        flops=12_345,
        flops_most=67_890,
        bytes_in=144,
        bytes_out=52,
        private_bytes=2048,
        local_bytes=0,
        scratch_bytes=0,
        left_out=left,
    )


@pytest.fixture
def record() -> SceneRecord:
    rng = np.random.default_rng(3)
    channels = ("shear_x", "shear_y", "normal")
    values = rng.normal(0.0, 1e-2, (FRAMES, *SHAPE, 3))
    values[5] = np.nan
    seconds = rng.uniform(80e-6, 160e-6, FRAMES)
    seconds[5] = np.nan
    contact_map = during(CONTACT)[:, None, None] * (values[..., 2] > 0)
    contact_map[5] = np.nan
    return SceneRecord(
        name="made & up",
        needs=("contact", "slip", "twist"),
        shape=SHAPE,
        rate=RATE,
        pitch=1.5e-3,
        channels=channels,
        unit="strain",
        times=np.arange(FRAMES) / RATE,
        values=values,
        push=-1,
        outputs={**made_flags(), "contact_map": contact_map},
        events=made_events(),
        truth=made_truth(),
        seconds=seconds,
        explanation=explained("made", channels, 77, LeftOut("output 'edge'", "not wanted", 0, 99)),
        summary=Summary(FRAMES, FRAMES - 1, 1, 0, Counters(frames=FRAMES), 0.0, 119.5, 158.25),
        environment=Environment.here("a device <of> mine & yours"),
    )


@pytest.fixture
def data(record: SceneRecord) -> ReportData:
    checks = (
        check("FINE", 2.5e-5, 1e-3, 310e-6),
        check("EXACT", 0.0, 1e-2, 440e-6),
        check("WRONG", 0.75, 1e-2, 520e-6),
    )
    ladder = tuple(
        WorkPrecision(
            "FINE", "opencl", "float32", "euler", None, dt, 0.1 * dt, 256, 1e-4 / dt, 0, 9
        )
        for dt in (0.1, 0.05)
    )
    shear = LeftOut("channel shear_x", "nothing reads it", 48, 0)
    lean = PlanCost("contact only", explained("made", ("normal",), 21, shear), 119, 61.0, 93.0)
    return ReportData(record, checks, ladder, (PlanCost.of_record("demo", record), lean))


def check(template: str, error: float, tolerance: float, seconds: float) -> CheckResult:
    passed = error <= tolerance
    how = ("opencl", "float32", "heun", "form")
    return CheckResult(template, *how, error, tolerance, seconds, passed, "its rates turn")


@pytest.fixture
def with_events(record: SceneRecord) -> Any:
    """Return the record with other events."""
    return lambda *events: replace(record, events=tuple(events))
