"""Judging: invented plays whose figures can be counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from cnnum.errors import RecordingError, SceneError
from cnnum.lab.scoring.alarms import alarm_measures
from cnnum.lab.scoring.confusion import confusion_measures
from cnnum.lab.scoring.events import event_measures, strength_measures, warning_measures
from cnnum.lab.scoring.judge import faults, judge
from cnnum.lab.scoring.measures import Measure, auc
from cnnum.lab.scoring.play import Play, Span
from cnnum.lab.scoring.recordings import Trial, failing_trials, recording_measures
from cnnum.lab.scoring.suites import Request, score
from cnnum.lab.scoring.twists import twist_measures
from cnnum.lab.scoring.worst import failing
from cnnum.report.verdicts import MAX_DELAY
from cnnum.scenes.events import Event

FRAMES, RATE, PITCH = 400, 100.0, 1.5e-3
CONTACT, LIFTED = 50, 390
PULL, LOOSE, GROSS, RELAX = 100, 140, 160, 200
TWIST, TURNS, BACK = 260, 290, 340


def between(first, after):
    return ((np.arange(FRAMES) >= first) & (np.arange(FRAMES) < after)).astype(float)


def ramp(first, top, after):
    return np.interp(np.arange(FRAMES), [first - 1, top, after - 1, after], [0, 1, 1, 0])


def invented(events=(), **changes):
    """A pull that slips towards +y and a twist of sense −1, under 1 N on 2 mm."""
    stick = between(CONTACT, LIFTED)
    stick[PULL:RELAX] = np.interp(np.arange(PULL, RELAX), [PULL, LOOSE, GROSS], [1, 0.5, 0])
    stick[TWIST:BACK] = np.interp(np.arange(TWIST, BACK), [TWIST, TURNS, BACK], [1, 0.5, 0.3])
    zero = np.zeros(FRAMES)
    truth = {
        "contact": between(CONTACT, LIFTED),
        "contact_radius": 2e-3 * between(CONTACT, LIFTED),
        "stick_radius": 2e-3 * stick,
        "incipient": between(LOOSE, GROSS),
        "slip": between(GROSS, RELAX),
        "slip_direction": np.pi / 2 * between(GROSS, RELAX),
        "twist_rate": -0.5 * between(TWIST, BACK),
        "twist_slip": between(TURNS, BACK),
        "normal_force": between(CONTACT, LIFTED),
        "shear_x": zero,
        "shear_y": 0.5 * ramp(PULL, GROSS, RELAX),
        "torque": -0.5e-3 * ramp(TWIST, BACK - 2, BACK),
        "x": np.full(FRAMES, PITCH),
        "y": zero,
    }
    outputs = {"slip_strength": between(LOOSE, RELAX), "twist": zero}
    play = Play(
        name="invented",
        suite="made up",
        seed=7,
        shape=(8, 8),
        rate=RATE,
        pitch=PITCH,
        times=np.arange(FRAMES) / RATE,
        truth=truth,
        outputs=outputs,
        events=tuple(events),
        phases=(Span("grip", 210, 240), Span("twist", TWIST, BACK)),
    )
    return replace(play, **changes)


def event(kind, frame, phase=None, **more):
    return Event(frame / RATE, kind, frame, phase, **more)


def all_right():
    return (
        event("contact", CONTACT),
        event("slip", LOOSE - 3, "incipient", direction=1.6),
        event("slip", GROSS + 2, "gross", direction=1.5),
        event("twist", TURNS + 1, sense=-1, where=(3.5, 4.5)),
        event("release", LIFTED),
    )


def figures(measures):
    return {m.measure: m.value for m in measures if m.unit != "s"}


def test_all_right():
    judged = [judge(invented(all_right()))]
    got = figures(event_measures("x", judged))
    for kind in ("contact", "release", "incipient slip", "gross slip", "twist"):
        assert got[f"{kind}: precision"] == got[f"{kind}: recall"] == 1.0
    assert got["gross slip: delay, median"] == 2
    assert got["incipient slip: delay, median"] == -3
    assert got["incipient slip: direction error, median"] == pytest.approx(
        np.degrees(1.6 - np.pi / 2)
    )
    assert not list(faults(judged[0]))
    warned = figures(warning_measures("x", judged))
    assert warned["incipient slip before gross slip"] == 1.0
    stick = 1 - 0.5 * (LOOSE - 3 - PULL) / (LOOSE - PULL)
    assert warned["stick radius c/a at the report of incipient slip, median"] == pytest.approx(
        stick
    )
    turned = figures(twist_measures("x", judged))
    assert turned["twist: sense right"] == turned["twist: centre within half a pitch"] == 1.0
    assert turned["twist: centre error, median"] == pytest.approx(0.0, abs=1e-12)
    confused = figures(confusion_measures("x", judged))
    assert confused["slip against twist"] == 0.0
    assert confused["slip reported as slip"] == confused["twist reported as twist"] == 1.0
    assert confused["grip reported as slip"] == 0.0
    assert figures(alarm_measures("x", judged))["false slip and twist"] == 0


@pytest.mark.parametrize(
    ("shift", "recall", "in_time", "precision"),
    [
        (MAX_DELAY, 1.0, 1.0, 1.0),
        (MAX_DELAY + 1, 1.0, 0.0, 1.0),  # late, but it does slip
        (-MAX_DELAY, 1.0, 1.0, 1.0),
        (-MAX_DELAY - 1, 0.0, 0.0, 0.0),  # before it slips: false, and the slip is missed
    ],
)
def test_gross_slip_must_be_in_time(shift, recall, in_time, precision):
    judged = [judge(invented([event("slip", GROSS + shift, "gross", direction=1.57)]))]
    got = figures(event_measures("x", judged))
    assert got["gross slip: recall"] == recall
    assert got["gross slip: recall within 5 frames"] == in_time
    assert got["gross slip: precision"] == precision


def test_second_reports_are_false():
    twice = (*all_right(), event("slip", GROSS + 20, "gross", direction=1.5))
    one = judge(invented(twice))
    assert [e.frame for e in one.alarms] == [GROSS + 20]
    assert figures(event_measures("x", [one]))["gross slip: precision"] == 0.5
    assert next(faults(one)).startswith("false gross slip")


def test_reports_in_a_grip_are_false_alarms():
    grip = (event("slip", 220, "incipient", direction=0.0), event("twist", 225, sense=1))
    judged = [judge(invented((*all_right(), *grip)))]
    got = figures(alarm_measures("x", judged))
    assert (got["false slip"], got["false twist"], got["false during grip"]) == (1, 1, 2)
    assert got["false slip and twist a minute"] == pytest.approx(2 / (FRAMES / RATE / 60))
    confused = figures(confusion_measures("x", judged))
    assert confused["grip reported as slip"] == confused["grip reported as twist"] == 1.0


def test_slip_and_twist_confused():
    wrong = (event("twist", GROSS, sense=1), event("slip", TURNS, "gross", direction=0.0))
    judged = [judge(invented(wrong))]
    got = figures(confusion_measures("x", judged))
    assert got["slip against twist"] == 1.0
    assert got["slip reported as slip"] == 0.0
    assert len(judged[0].alarms) == 2


def test_what_a_report_says_is_checked():
    wrong = (
        event("slip", GROSS, "gross", direction=-np.pi / 2),
        event("twist", TURNS, sense=1, where=(3.5, 5.2)),
    )
    one = judge(invented(wrong))
    said = list(faults(one))
    assert any("direction off by 180°" in text for text in said)
    assert any("wrong sense" in text for text in said)
    assert any("centre off by 0.70 pitches" in text for text in said)
    assert any("incipient slip" in text and "missed" in text for text in said)
    got = figures(twist_measures("x", [one]))
    assert got["twist: sense right"] == got["twist: centre within half a pitch"] == 0.0
    assert got["twist: centre error, median"] == pytest.approx(0.7)


def test_nothing_reported_misses_every_target():
    judged = [judge(invented())]
    measures = [
        *event_measures("x", judged),
        *warning_measures("x", judged),
        *twist_measures("x", judged),
    ]
    aimed = [measure for measure in measures if measure.target is not None]
    assert len(aimed) == 7
    assert all(measure.reached is False for measure in aimed)


def test_the_worst_scenes_come_with_their_seed_and_what_went_wrong():
    bad = invented(name="bad", about={"kind": "pull and twist", "faults": "dead"})
    better = invented(all_right()[:3], name="better")
    worst, second = failing([judge(better), judge(invented(all_right())), judge(bad)])
    assert (worst.name, second.name) == ("bad", "better")
    record = worst.record()
    assert (record["worst"], record["seed"], record["faults"]) == ("bad", 7, "dead")
    assert record["wrong"] == [
        f"incipient slip at frame {LOOSE} missed",
        f"gross slip at frame {GROSS} missed",
        f"twist at frame {TURNS} missed",
    ]
    assert second.wrong == (f"twist at frame {TURNS} missed",)


@pytest.mark.parametrize(("told", "near"), [(-0.46, 1.0), (-0.44, 0.0), (0.5, 0.0)])
def test_twist_rate(told, near):
    outputs = {
        "slip_strength": np.zeros(FRAMES),
        "twist": between(TURNS, BACK),
        "twist_rate": told * between(TURNS, BACK),
    }
    judged = [judge(invented([event("twist", TURNS, sense=-1, where=(3.5, 4.5))], outputs=outputs))]
    assert figures(twist_measures("x", judged))["twist: rate within 10 %"] == near


def test_a_rate_of_nothing_is_not_told():
    """Frames without a rate do not count, and a twist without any has none."""
    told = []
    for first in (TURNS + 5, BACK):
        outputs = {
            "slip_strength": np.zeros(FRAMES),
            "twist": between(TURNS, BACK),
            "twist_rate": -0.5 * between(first, BACK),
        }
        events = [event("twist", TURNS, sense=-1, where=(3.5, 4.5))]
        told.append(judge(invented(events, outputs=outputs)))
    found = {one.measure: one for one in twist_measures("x", told)}
    near, share = found["twist: rate within 10 %"], found["twist: rate told"]
    assert (near.value, near.count) == (1.0, 1)
    assert (share.value, share.count) == (0.5, 2)
    assert found["twist: rate error, median"].value == 0.0


def test_a_slip_as_the_contact_vanishes_may_be_reported():
    truth = dict(invented().truth)
    truth["slip"] = truth["slip"] + between(LIFTED - 3, LIFTED)
    events = (*all_right()[:-1], event("slip", LIFTED - 2, "gross", direction=0.0))
    one = judge(invented(events, truth=truth))
    assert len(one.of("gross slip")) == 1
    assert not one.alarms


def test_strength_is_ranked_over_all_frames():
    (either, gross) = strength_measures("x", [judge(invented())])
    assert either.value == 1.0
    # all of gross slip at 1, of the others the 20 incipient frames too: ties count half
    others = FRAMES - (RELAX - GROSS)
    assert gross.value == pytest.approx(1 - 0.5 * (GROSS - LOOSE) / others)


def test_auc_against_counting_pairs():
    rng = np.random.default_rng(2)
    scores, labels = np.round(rng.normal(0, 1, 80), 1), rng.random(80) < 0.3
    high, low = scores[labels], scores[~labels]
    counted = np.mean((high[:, None] > low) + 0.5 * (high[:, None] == low))
    assert auc(scores, labels.astype(float)) == pytest.approx(counted, rel=1e-12)
    assert np.isnan(auc(scores, np.zeros(80)))


def test_a_target_is_reached_from_its_side():
    assert Measure("m", "s", 0.9, 1, target=0.9).reached
    assert not Measure("m", "s", 0.89, 1, target=0.9).reached
    assert Measure("m", "s", 1.0, 1, target=1.0, rule="at most").reached
    assert not Measure("m", "s", 2.0, 1, target=1.0, rule="at most").reached
    assert Measure("m", "s", float("nan"), 0, target=0.9).reached is False
    assert Measure("m", "s", 0.9, 1).reached is None


def trial(slip_from, reports, name="t", lost=200):
    slip, kept = np.zeros(200), (np.arange(200) < lost).astype(float)
    if slip_from is not None:
        slip[slip_from : slip_from + 40] = 1.0
    return Trial(name, slip, kept, slip + 0.1, tuple(reports))


def test_trials():
    trials = [trial(80, [84, 150], "one"), trial(100, [], "two"), trial(None, [30], "three")]
    got = figures(recording_measures(trials))
    assert got["slip onsets within 6 rows of the label"] == 0.5
    assert np.isnan(got["slip onset against the label, largest"])  # one has no report at all
    assert got["false reports in trials without slip"] == 1
    assert got["other reports in trials with slip"] == 1
    assert got["slip_strength against the label before the loss: pooled AUC"] == 1.0
    assert [item.name for item in failing_trials(trials)] == ["one", "two", "three"]
    late = [trial(80, [87])]
    assert figures(recording_measures(late))["slip onsets within 6 rows of the label"] == 0.0


def test_rows_after_the_loss_do_not_count():
    lost = trial(80, [84], lost=100)
    (pooled, *_) = recording_measures([lost])
    assert pooled.count == 100
    assert lost.onsets == (80,)


def test_the_suite_of_recordings_needs_some(tmp_path):
    with pytest.raises(SceneError, match="CNNUM_RECORDINGS"):
        Request(suites=("recordings",))
    with pytest.raises(RecordingError, match="xela_sensor1"):
        score(Request(recordings=(tmp_path,)), None)
