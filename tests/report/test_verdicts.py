"""Reports against the ground truth: right, late, wrong, missed or false ones."""

from dataclasses import replace
from math import pi
from typing import Any

import pytest

from cnnum.report import SceneRecord, compare
from cnnum.report.record import true_events
from cnnum.scenes.events import Event


def test_true_events_begin_and_end_where_the_truth_changes(record: SceneRecord) -> None:
    found = [(event.title, event.frame) for event in true_events(record)]
    assert found == [
        ("contact", 20),
        ("incipient slip", 40),
        ("gross slip", 48),
        ("twist", 75),
        ("release", 110),
    ]


def test_true_directions_are_of_the_force_and_of_the_sliding(record: SceneRecord) -> None:
    _, incipient, gross, twist, _ = true_events(record)
    assert incipient.direction == pytest.approx(0.4)
    assert gross.direction == 0.5
    assert twist.sense == -1


def test_right_reports_pass_with_their_delay(record: SceneRecord) -> None:
    rows = compare(record)
    assert [row.passed for row in rows] == [True] * 5
    assert [row.delay for row in rows] == [2, 3, 0, 5, -1]
    assert rows[2].turn == pytest.approx(0.1)


def test_only_what_the_scene_wants_is_expected(record: SceneRecord) -> None:
    lean = replace(record, needs=("contact",), events=record.events[:1])
    assert [(row.title, row.text) for row in compare(lean)] == [
        ("contact", "passed"),
        ("release", "missed"),
    ]


def test_a_phase_that_the_program_does_not_report_is_not_expected(record: SceneRecord) -> None:
    outputs = {name: values for name, values in record.outputs.items() if name != "incipient_slip"}
    lean = replace(record, outputs=outputs, events=())
    titles = [row.title for row in compare(lean)]
    assert titles == ["contact", "gross slip", "twist", "release"]


def test_slip_may_be_late_and_a_twist_early_within_seconds(with_events: Any) -> None:
    slip = Event(time=0.75, kind="slip", phase="gross", frame=75, direction=0.5)
    twist = Event(time=0.50, kind="twist", frame=50, sense=-1)
    texts = {row.title: row.text for row in compare(with_events(slip, twist)) if row.reported}
    assert texts == {"gross slip": "passed", "twist": "passed"}


def test_without_ground_truth_nothing_is_compared(record: SceneRecord) -> None:
    assert compare(replace(record, truth={})) == ()


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (Event(time=0.79, kind="slip", phase="gross", frame=79, direction=0.5), "31 frames late"),
        (Event(time=0.42, kind="slip", phase="gross", frame=42, direction=0.5), "6 frames early"),
        (Event(time=0.48, kind="slip", phase="gross", frame=48), "no direction"),
        (
            Event(time=0.48, kind="slip", phase="gross", frame=48, direction=0.5 - pi / 15),
            "direction off by 12°",
        ),
        (Event(time=0.76, kind="twist", frame=76, sense=1), "wrong sense"),
        (Event(time=0.76, kind="twist", frame=76), "no sense"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_reports_fail_and_say_why(with_events: Any, event: Event, text: str) -> None:
    (row,) = (row for row in compare(with_events(event)) if row.reported)
    assert (row.passed, row.text) == (False, text)


def test_a_direction_is_compared_around_the_circle(record: SceneRecord, with_events: Any) -> None:
    event = Event(time=0.48, kind="slip", phase="gross", frame=48, direction=0.5 - 2 * pi)
    (row,) = (row for row in compare(with_events(event)) if row.reported)
    assert row.turn == pytest.approx(0.0, abs=1e-12)


def test_a_second_report_is_false_and_the_nearest_one_counts(with_events: Any) -> None:
    twists = [Event(time=n / 100, kind="twist", frame=n, sense=-1) for n in (70, 76, 80)]
    rows = [row for row in compare(with_events(*twists)) if row.title == "twist"]
    assert [(row.frame, row.text) for row in rows] == [
        (70, "false report"),
        (75, "passed"),
        (80, "false report"),
    ]


def test_a_report_far_from_any_truth_is_false_and_the_truth_missed(with_events: Any) -> None:
    rows = compare(with_events(Event(time=0.05, kind="release", frame=5)))
    texts = [row.text for row in rows if row.title == "release"]
    assert texts == ["false report", "missed"]
