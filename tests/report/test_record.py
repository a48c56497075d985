"""From a scene that really runs to its record."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import cnnum
from cnnum.drivers.registry import open_driver
from cnnum.engine import Engine
from cnnum.errors import ArrayError
from cnnum.frame import Frame, Quality
from cnnum.report import PlanCost, SceneRecord, SceneRecorder, compare
from cnnum.scenes.bad_frames import unit_range
from cnnum.scenes.conversion import ByCalibration
from cnnum.scenes.events import EVENT_RULES
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.pipeline import Scene
from cnnum.scenes.push_watch import HeldWatch, OrderWatch, PushWatch
from cnnum.scenes.scene_file import SceneSpec

OPTIONS = {
    "shape": [4, 5],
    "pitch": 2e-3,
    "noise": 0.0,
    "script": [
        {"kind": "hold", "duration": 0.05},
        {"kind": "press", "duration": 0.1, "load": 0.3},
        {"kind": "release", "duration": 0.1},
        {"kind": "hold", "duration": 0.05},
    ],
}


@cnnum.program
def touch(frame: Any) -> Any:
    pressed = -frame.normal
    peak = pressed.max()
    return {
        "contact": peak > 1e-4,
        "contact_row": (pressed * frame.row).sum(),
        "contact_column": (pressed * frame.column).sum(),
        "load_normal": peak,
        "contact_map": pressed > 1e-4,
    }


def opened() -> Scene:
    spec = SceneSpec(
        "touch", needs=("contact",), driver="simulated", driver_options=OPTIONS, program="touch"
    )
    driver: Any = open_driver("simulated", OPTIONS)
    conversion = ByCalibration(driver.calibration)
    engine = Engine("reference")
    plan = engine.compile(touch, driver.shape, channels=conversion.channels)
    within = unit_range(driver.unit, engine.precision)
    watch, rules = PushWatch(touch, conversion.channels), EVENT_RULES["contact"]
    offered = tuple(plan.schedule.outputs)
    return Scene(
        spec,
        engine,
        driver,
        conversion,
        plan,
        rules,
        within,
        None,
        offered,
        watch,
        OrderWatch(driver.channels, 1),
        HeldWatch(touch, conversion.channels),
    )


@pytest.fixture(scope="module")
def ran() -> tuple[SceneRecord, list[FrameResult]]:
    scene = opened()
    recorder, moments = SceneRecorder(scene), list[FrameResult]()
    for moment in scene.results():
        recorder.add(moment)
        moments.append(moment)
    return recorder.record(), moments


def test_record_is_what_the_moments_were(ran: tuple[SceneRecord, list[FrameResult]]) -> None:
    record, moments = ran
    assert record.frames == len(moments) == 60
    assert record.channels == ("normal",)
    assert (record.unit, record.push, record.pitch, record.shape) == ("strain", -1, 2e-3, (4, 5))
    for number in (0, 25, 59):
        moment = moments[number]
        assert moment.frame.truth is not None
        np.testing.assert_array_equal(record.values[number], moment.values)
        np.testing.assert_array_equal(
            record.outputs["contact_map"][number], moment.outputs["contact_map"]
        )
        assert record.truth["contact_radius"][number] == moment.frame.truth["contact_radius"]
        assert record.seconds[number] == moment.seconds > 0
        assert record.times[number] == moment.frame.time
    assert record.maps().keys() == {"contact_map"}
    assert record.summary.frames == 60


def test_its_events_are_judged(ran: tuple[SceneRecord, list[FrameResult]]) -> None:
    record, moments = ran
    assert record.events == tuple(event for moment in moments for event in moment.events)
    # noise-free, a touch is seen as soon as its strain passes 1e-4: some frames of the press
    rows = compare(record)
    assert [row.title for row in rows] == ["contact", "release"]
    assert all(row.passed for row in rows), rows


def test_frames_that_were_not_allowed_are_gaps(ran: tuple[SceneRecord, list[FrameResult]]) -> None:
    _, moments = ran
    scene = opened()
    recorder = SceneRecorder(scene)
    bad: Frame = replace(moments[1].frame, quality=Quality.CORRUPT, truth=None)
    recorder.add(moments[0])
    recorder.add(FrameResult(1, bad, None, {}, (), 0.0))
    scene.driver.close()
    record = recorder.record()
    assert np.isnan(record.values[1]).all()
    assert np.isnan(record.seconds[1])
    assert np.isnan(record.outputs["contact"][1])
    assert np.isnan(record.truth["contact"][1])
    assert record.outputs["contact"][0] == 0.0


def test_cost_of_a_plan_is_that_of_its_frames(ran: tuple[SceneRecord, list[FrameResult]]) -> None:
    record, moments = ran
    cost = PlanCost.of_record("touch", record)
    micros = sorted(1e6 * moment.seconds for moment in moments)
    assert cost.frames == 60
    assert micros[29] <= cost.p50_us <= micros[30]
    assert cost.explanation.channels_read == ("normal",)
    measured, _ = PlanCost.measure({"again": opened(), "once more": opened()})
    assert measured.frames == 60
    assert 0 < measured.p50_us <= measured.p99_us


def test_plans_take_turns_frame_by_frame() -> None:
    """A machine that is slower for a while is so for all; a frame that did not run has no cost."""
    order = list[str]()

    class Timed:
        def __init__(self, label: str, slowness: float) -> None:
            self.label, self.slowness = label, slowness
            self.plan = opened().plan

        def results(self) -> Iterator[FrameResult]:
            frame: Any = None  # no cost depends on it
            for number in range(9):
                order.append(self.label)
                outputs = {"contact": np.ones(())} if number else {}
                yield FrameResult(number, frame, None, outputs, (), 1e-6 * number * self.slowness)

    scenes: Any = {"lean": Timed("lean", 1.0), "whole": Timed("whole", 10.0)}
    lean, whole = PlanCost.measure(scenes)
    assert order == 9 * ["lean", "whole"]
    assert (lean.label, lean.frames, lean.p50_us) == ("lean", 8, pytest.approx(4.5))
    assert (whole.label, whole.frames, whole.p50_us) == ("whole", 8, pytest.approx(45.0))


def test_cost_needs_a_frame_that_ran(record: SceneRecord) -> None:
    with pytest.raises(ArrayError, match="ran for no frame"):
        PlanCost.of_record("none", replace(record, seconds=np.full(record.frames, np.nan)))
