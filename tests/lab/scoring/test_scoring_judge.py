"""Judging: invented trials whose figures can be counted by hand."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cnnum.drivers.simulated.grips import Trial, runs
from cnnum.lab.scoring.hands import Played, _row
from cnnum.lab.scoring.judge import auc, judge, median, per_ten_minutes, sense_right
from cnnum.lab.scoring.left_out import Choice, chosen, reached
from cnnum.lab.scoring.levels import Outcome, rate_of
from cnnum.lab.scoring.recorded import LOST, held, labels, speeds, turning
from cnnum.lab.scoring.recordings import can_learn, folds, pooled, regression, shear_change
from cnnum.lab.scoring.suites import onsets, report_table
from cnnum.lab.scoring.table import Column, Table
from cnnum.programs.reports import latched

FRAMES, RATE = 600, 100.0
SETTLED, LOOSE, ONSET, END = 45, 280, 300, 500


def between(*spans):
    frames = np.arange(FRAMES)
    inside = [(frames >= a) & (frames < b) for a, b in spans]
    return np.any([np.zeros(FRAMES, bool), *inside], axis=0)


def invented(**changes):
    """A slide of 1 mm/s along +y, which is incipient for 0.2 s before it."""
    trial = Trial(
        family="invented",
        name="invented 1",
        rate=RATE,
        frames=np.zeros((FRAMES, 4, 4, 3), np.float32),
        slips=between((ONSET, END)).astype(float),
        scored=np.arange(FRAMES) >= SETTLED,
        early=between((LOOSE, ONSET)),
        slid=np.clip(np.arange(FRAMES) - ONSET + 1, 0, END - ONSET) * 1e-3 / RATE,
        sense=np.zeros(FRAMES, int),
        direction=np.pi / 2,
        rows=3 * np.arange(FRAMES),
    )
    return replace(trial, **changes)


def answers(*spans, twist=(), sense=0, direction=np.pi / 2):
    return {
        "gross_slip": between(*spans).astype(float),
        "slip_x": np.full(FRAMES, np.cos(direction)),
        "slip_y": np.full(FRAMES, np.sin(direction)),
        "twist": between(*twist).astype(float),
        "twist_sense": np.full(FRAMES, float(sense)),
    }


def test_a_slip_is_found_after_the_sliding_before_its_report():
    one = judge(invented(), answers((320, 400), direction=np.pi / 2 + 0.1))
    assert one.found
    assert one.slid == pytest.approx(0.21e-3)  # 21 frames of 10 µm
    assert one.delay == pytest.approx(0.2)
    assert one.turned == pytest.approx(np.degrees(0.1))
    assert (one.false, one.twists) == (0, 0)
    assert one.seconds == pytest.approx((FRAMES - SETTLED) / RATE)


def test_a_report_that_lasts_into_the_slip_finds_it_at_once():
    one = judge(invented(), answers((100, 350)))
    assert one.found
    assert one.delay == 0
    assert one.false == 1  # and began where nothing slips


def test_nothing_reported_is_not_found():
    one = judge(invented(), answers())
    assert not one.found
    assert np.isnan([one.slid, one.delay, one.turned]).all()


@pytest.mark.parametrize(
    ("start", "false"),
    [
        (LOOSE - 11, 1),  # more than 0.1 s before the slip, and nothing is loose yet
        (LOOSE, 0),
        (ONSET + 50, 0),
        (END + 9, 0),
        (END + 11, 1),
        (SETTLED - 20, 1),  # the rest of it counts
    ],
)
def test_reports_are_false_where_nothing_slips(start, false):
    assert judge(invented(), answers((start, start + 30))).false == false


def test_every_report_counts_once_and_minutes_are_those_that_count():
    still = invented(slips=np.zeros(FRAMES), early=between())
    one = judge(still, answers((100, 110), (120, 121), (200, 300)))
    assert one.false == 3
    assert per_ten_minutes(one.false, one.seconds) == pytest.approx(3 * 600 / 5.55)


def test_frames_of_unknown_truth_make_no_report_false():
    unknown = invented(slips=np.full(FRAMES, np.nan), early=between())
    assert judge(unknown, answers((100, 200))).false == 0


def test_a_twist_must_have_its_own_sense_throughout():
    sense = np.where(between((300, 400)), -1, 0)
    twists = invented(slips=np.zeros(FRAMES), sense=sense)
    assert sense_right(twists, answers(twist=[(290, 380)], sense=-1))
    assert not sense_right(twists, answers(twist=[(290, 380)], sense=1))
    assert not sense_right(twists, answers())
    assert judge(twists, answers(twist=[(100, 200), (290, 380)])).twists == 1


def test_the_program_s_own_flags_give_way_to_others():
    one = judge(invented(), answers((320, 400)), between((350, 360)))
    assert one.delay == pytest.approx(0.5)


def test_auc_is_the_chance_that_a_slip_scores_higher():
    rng = np.random.default_rng(0)
    high, low = rng.integers(0, 9, 40) + 1.0, rng.integers(0, 9, 60).astype(float)
    pairs = list(product(high, low))
    expected = sum((a > b) + 0.5 * (a == b) for a, b in pairs) / len(pairs)
    assert auc(high, low) == pytest.approx(expected)
    assert np.isnan(auc(high, np.zeros(0)))


def test_a_latch_stays_on_down_to_its_share():
    values = np.array([0.0, 0.5, 1.1, 0.7, 0.51, 0.5, 0.9, 1.2, 0.6])
    np.testing.assert_array_equal(latched(values, 1.0, 0.5, 0), [0, 0, 1, 1, 1, 0, 0, 1, 1])


def test_a_latch_waits_before_it_goes_off():
    values = np.array([0.1, 0.1, 1.1, 0.4, 0.6, 0.4, 0.4, 0.4, 0.6, 1.1, 0.3])
    np.testing.assert_array_equal(latched(values, 1.0, 0.5, 1), [0, 0, 1, 1, 1, 1, 0, 0, 0, 1, 1])
    np.testing.assert_array_equal(latched(values, 1.0, 0.5, 2), [0, 0, 1, 1, 1, 1, 1, 0, 0, 1, 1])
    np.testing.assert_array_equal(latched(values, 1.0, 0.5, 3), [0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1])


def test_medians_do_not_mix_what_never_came():
    assert median([0.1, np.inf, np.inf]) == np.inf
    assert median([0.1, 0.2, np.inf]) == 0.2


def test_onsets_are_matched_in_rows_of_the_log():
    trial = invented(slips=between((ONSET, END), (550, 551)).astype(float))
    one = onsets(trial, between((310, 320), (400, 410)))
    assert (one.slips, one.found) == (1, 1)  # one frame alone is no slip
    assert one.delays == (pytest.approx(0.1),)
    assert one.rows == (30,)  # three rows a frame
    early = onsets(trial, between((ONSET - 40, 320)))
    assert (early.found, early.delays) == (1, ())  # it was on before
    assert onsets(trial, between((100, 200))).found == 0


def test_reports_of_a_group_add_up():
    still = invented(slips=np.zeros(FRAMES), early=between())
    said = [answers((310, 320)), answers((100, 110)), answers()]
    row = report_table({"5": ([invented(), still, still], said)}).rows[0]
    assert (row["trials"], row["quiet"], row["quiet_reported"]) == (3, 2, 1)
    assert row["quiet_share"] == 0.5
    assert (row["slips"], row["found"], row["rows"]) == (1, 1, 30)
    assert row["false"] == pytest.approx(600 / (3 * 5.55))


def choice(level, near, false=None):
    outcomes = {
        name: Outcome(1.0, share, (0.1e-3,), (false or {}).get(name, 0), 600.0)
        for name, share in near.items()
    }
    outcomes["held"] = Outcome(np.nan, np.nan, (), (false or {}).get("held", 0), 600.0)
    return Choice({"still": 0.25, "pull": 0.5, "level": level}, outcomes)


def test_constants_are_those_that_reach_most_aims_on_the_others():
    one, other = choice(0.2, {"a": 1.0, "b": 0.6}), choice(0.4, {"a": 0.1, "b": 0.8})
    assert chosen([one, other], "b") is one  # as many aims, more found by 0.3 mm
    assert chosen([one, other], "a") is other
    noisy = choice(0.1, {"a": 1.0, "b": 1.0}, {"held": 40})
    assert chosen([noisy, one], "b") is one  # one aim fewer
    assert chosen([noisy, one], "held") is noisy


def test_a_family_has_an_aim_for_false_reports_and_two_for_slips():
    assert reached(Outcome(0.95, 0.5, (0.3e-3, 0.3e-3), 1, 600.0)) == 3
    assert reached(Outcome(0.94, 0.5, (0.3e-3, 0.3e-3), 1, 600.0)) == 2
    assert reached(Outcome(0.95, 0.5, (0.3e-3, np.inf), 2, 600.0)) == 1
    assert reached(Outcome(np.nan, np.nan, (), 1, 600.0)) == 1
    assert rate_of([Outcome(np.nan, np.nan, (), 2, 600.0)]) == 2


def test_a_family_left_out_is_never_seen():
    rng = np.random.default_rng(1)
    plain = [choice(level, dict(zip("abc", rng.random(3), strict=True))) for level in range(20)]
    for name in ("a", "b", "c", "held"):
        best = chosen(plain, name).constants
        worse = Outcome(0.0, 0.0, (np.inf,), 10**6, 1.0)
        spoilt = [
            Choice(one.constants, {**one.outcomes, name: worse if n % 2 else one.outcomes[name]})
            for n, one in enumerate(plain)
        ]
        assert chosen(spoilt, name).constants == best


def test_no_object_is_in_its_own_fold():
    trials = [invented(family=name) for name in ("5", "7", "5", "13")]
    found = folds(trials)
    assert [name for name, _, _ in found] == ["5", "7", "13"]
    for name, mine, others in found:
        assert {trials[n].family for n in mine} == {name}
        assert name not in {trials[n].family for n in others}
        assert sorted([*mine, *others]) == [0, 1, 2, 3]


def test_pooled_areas_take_frames_that_count_and_are_known():
    scores = np.where(between((ONSET, END)), 1.0, 0.0)
    assert pooled([invented()], [scores]) == 1.0
    spoilt = np.where(np.arange(FRAMES) < SETTLED, 5.0, scores)
    assert pooled([invented()], [spoilt]) == 1.0
    unknown = np.where(between((100, 200)), np.nan, invented().slips)
    spoilt = np.where(between((100, 200)), 5.0, scores)
    assert pooled([invented(slips=unknown)], [spoilt]) == 1.0


def test_a_marker_s_speed_is_that_of_its_motion():
    rate, speed = 40.0, np.array([3e-3, -4e-3, 0.0])
    places = np.arange(200)[:, None] / rate * speed
    np.testing.assert_allclose(speeds(places, rate), 5e-3, rtol=1e-9)
    places[100:120] = 10.0  # not seen
    gone = np.isnan(speeds(places, rate))
    assert gone[104:116].all()
    assert not gone[:95].any()


def test_a_marker_s_turn_is_that_of_its_motion():
    """A turn at 30°/s about a slanted axis; the marker is lost in between."""
    time = np.arange(60) / 50.0
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    turned = Rotation.from_rotvec(np.radians(30.0) * time[:, None] * axis).as_quat()
    places = np.zeros((60, 3))
    places[20:40] = LOST
    found = turning(places, turned, 50.0)
    np.testing.assert_allclose(found[:16], 30.0, rtol=1e-6)
    assert np.isnan(found[20:40]).all()


def test_labels_leave_out_what_is_in_between():
    found = labels(np.array([7e-3, 6e-3, 3e-3, 1.5e-3, 1e-3, np.nan]))
    np.testing.assert_array_equal(found, [1, np.nan, np.nan, np.nan, 0, np.nan])


def test_an_object_is_held_until_it_is_gone():
    values = np.zeros((100, 4, 8, 3))
    values[20:80, ..., 2] = 100.0
    values[40:43, :, :4, 2] = 0.0  # one pad, for three frames
    assert runs(held(values)) == [(20, 80)]
    values[40:46, :, :4, 2] = 0.0
    assert runs(held(values)) == [(20, 40)]
    values[:, :, 4:, 2] = 0.0
    assert not held(values).any()


def changing(slip, still):
    """Two pads: all taxels change alike when still, and against each other in a slip."""
    rng = np.random.default_rng(2)
    frames = np.zeros((FRAMES, 4, 8, 3))
    frames[..., 2] = 500.0
    checks = np.where(np.indices((4, 8)).sum(axis=0) % 2, 1.0, -1.0)
    moves = np.where(between((ONSET, END)), slip, 0.0)
    frames[..., 0] += np.cumsum(moves)[:, None, None] * checks
    frames[..., 1] += np.cumsum(rng.normal(size=FRAMES) * still)[:, None, None]
    return invented(frames=frames.astype(np.float32), setting={"pads": 2})


def test_the_incoherent_change_ignores_what_a_whole_pad_does():
    trial = changing(1.0, 5.0)
    score = shear_change(trial, 1, incoherent=True)
    assert pooled([trial], [score]) == 1.0
    assert pooled([trial], [shear_change(trial, 1, incoherent=False)]) < 0.9
    np.testing.assert_allclose(score[ONSET + 1 : END], 1.0, rtol=1e-3)
    mean = shear_change(trial, 5, incoherent=True)
    np.testing.assert_allclose(mean[ONSET + 1], 2 / 5, rtol=1e-3)  # two of five frames


@pytest.mark.skipif(not can_learn(), reason="scikit-learn is not installed (extra 'texture')")
def test_a_regression_learns_on_other_trials():
    trial = changing(1.0, 5.0)
    (score,) = regression([changing(2.0, 5.0)], [trial])
    assert pooled([trial], [score]) > 0.99


def test_a_table_counts_aims_and_has_no_infinite_numbers():
    columns = (
        Column("name", "name"),
        Column("found", "found", 2, least=0.95),
        Column("slid", "slid", 1, most=0.3),
    )
    rows = [
        {"name": "a", "found": 0.95, "slid": 0.31},
        {"name": "b", "found": float("nan"), "slid": float("inf")},
    ]
    made = Table("t", "T", "", columns, rows)
    assert (made.aimed, made.missed) == (
        3,
        2,
    )  # a row that never came misses, one that was not there does not
    assert list(made.records())[1] == {"table": "t", "name": "b", "found": None, "slid": None}
    assert [column.text(rows[1][column.key]) for column in columns] == ["b", "–", "–"]
    others = replace(made, rows=[{**row, "baseline": True} for row in rows])
    assert (others.aimed, others.missed) == (0, 0)


def test_a_situation_counts_what_is_found_false_and_unmarked():
    """A slide of 2 s that is found after 0.2 s, and three false reports, one of them marked."""
    marks = between((500, FRAMES))
    said = answers((50, 60), (320, 400), (540, 550), twist=((100, 110),), sense=1)
    said["slip_strength"] = between((ONSET, END), (LOOSE, ONSET)).astype(float)
    row = _row("invented", [Played(invented(), said, marks)])
    assert (row["slips"], row["slips_found"], row["delay_s"]) == (1, 1, pytest.approx(0.2))
    minutes = (FRAMES - SETTLED - (END - ONSET)) / RATE / 60.0
    assert row["minutes"] == pytest.approx(minutes)
    assert row["false"] == pytest.approx(2 / minutes)
    assert row["twists"] == pytest.approx(10 / minutes)
    assert (row["unmarked"], row["marked"], row["turns"]) == (2, 1, 0)
    assert row["auc"] == 1.0  # frames in which it is incipient do not count


def test_a_turn_is_found_in_its_own_sense_alone():
    turning = invented(slips=np.zeros(FRAMES), sense=np.where(between((ONSET, END)), -1, 0))
    none = np.zeros(FRAMES, bool)
    for sense, right in ((-1, 1), (1, 0)):
        said = answers(twist=((ONSET - 20, END),), sense=sense)
        said["slip_strength"] = np.zeros(FRAMES)
        row = _row("invented", [Played(turning, said, none)])
        assert (row["turns"], row["turns_found"], row["twists"]) == (1, right, 0.0)


def test_a_minute_with_several_slips_counts_each():
    """Of five slips of 1 s in 40 s three are found."""
    frames = 4000
    slips = np.zeros(frames)
    for start in range(500, 3000, 500):
        slips[start : start + 100] = 1.0
    flags = np.zeros(frames)
    flags[[550, 1050, 1550]] = 1.0
    trial = invented(
        frames=np.zeros((frames, 4, 4, 3), np.float32), slips=slips, slid=np.zeros(frames),
        scored=np.ones(frames, bool), early=np.zeros(frames, bool), rows=np.arange(frames),
        sense=np.zeros(frames, int),
    )  # fmt: skip
    said = {"gross_slip": flags, "slip_strength": flags}
    row = _row("invented", [Played(trial, said, np.zeros(frames, bool))])
    assert (row["slips"], row["slips_found"], row["false"]) == (5, 3, 0.0)
