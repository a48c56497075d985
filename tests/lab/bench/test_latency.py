"""The way of one frame: to its events, in time, with an error, and with missing cases named."""

import json
import time

import pytest
from click.testing import CliRunner

from cnnum.cli import main
from cnnum.lab.bench import errors, latency
from cnnum.lab.bench.samples import scene_frames, touch
from cnnum.lab.commands import bench
from cnnum.programs.library import program_names
from cnnum.scenes.events import EventDetector
from cnnum.scenes.pipeline import load_scene

WHOLE = latency.Subject("tactile", "tactile")
QUICK = latency.Subject("contact", "contact")


@pytest.fixture(scope="module")
def simulated():
    return scene_frames(latency.SCENE)


@pytest.fixture(autouse=True)
def _simulated_once(simulated, monkeypatch):
    monkeypatch.setattr(latency, "scene_frames", lambda scene: simulated)


def row_of(opencl, subject, count=300, seconds=20.0):
    return next(latency.measure_latency(opencl, count=count, chosen=[subject], seconds=seconds))


def test_every_program_is_measured_and_slip_with_twist():
    names = [subject.name for subject in latency.subjects()]
    assert names == [*program_names("tactile"), "slip and twist", "slip and twist, 4,096 skins"]


def test_slip_and_twist_are_the_plan_of_a_scene_that_wants_both(opencl):
    scene = load_scene("tactile", engine=opencl, changes={"needs": ["slip", "twist"]})
    scene.driver.close()
    plan = latency.BOTH.plan(opencl)
    assert set(plan.schedule.outputs) == set(scene.plan.schedule.outputs)
    kinds = {rule.kind for rule in latency.rules_of(plan)}
    assert kinds == {"slip", "twist"}
    whole = WHOLE.plan(opencl)
    assert plan.explain().ops < whole.explain().ops


def test_many_skins_have_the_events_that_each_has_alone(opencl, simulated):
    skins, pushes = 18, 800
    plan = latency.BOTH.plan(opencl)
    together = latency._Skins(plan, simulated, skins)
    for _ in range(pushes):
        together.push()
    alone = 0
    for skin in range(skins):
        frames = [simulated[(skin + at) % len(simulated)] for at in range(pushes)]
        one = latency._Frames(plan, frames)
        for _ in frames:
            one.push()
        alone += one.events
    assert together.events == alone >= skins


def test_frames_go_as_far_as_their_events(opencl, monkeypatch):
    """The detector runs within the time, on every frame, and reports the stream's events."""
    seen = []
    update = EventDetector.update

    def slow(self, t, frame, outputs, **known):
        seen.append(frame)
        time.sleep(2e-3)
        return update(self, t, frame, outputs, **known)

    monkeypatch.setattr(latency.EventDetector, "update", slow)
    row = row_of(opencl, QUICK, count=200)
    assert row.p50_us >= 2000.0
    # one frame more begins each turn, of which there is at least one
    assert seen == list(range(len(seen)))
    assert len(seen) > row.frames + latency.WARM_UP
    assert row.first_us >= 2000.0


@pytest.mark.in_full("test_frames_go_as_far_as_their_events")
def test_all_that_the_scene_does_is_reported(opencl, simulated):
    """Once around: a contact and a release, a gross slip, and a twist."""
    frames = len(simulated)
    both = row_of(opencl, latency.BOTH, count=frames - latency.WARM_UP)
    assert both.events == 2
    whole = row_of(opencl, WHOLE, count=frames - latency.WARM_UP)
    # edges come and go with the contact, as often as they like
    assert whole.events >= 4


def test_both_ratios_and_the_tail_are_of_the_rows_own_figures(opencl):
    row = row_of(opencl, QUICK)
    assert row.ratio == pytest.approx(row.p50_us / row.empty_launch_us)
    assert row.own_ratio == pytest.approx(row.p50_us / row.own_launch_us)
    assert row.tail == pytest.approx(row.p99_us / row.p50_us)
    assert row.tail >= 1.0
    assert row.frames == 300


def test_frames_there_was_no_time_for_are_named(opencl, capsys):
    found = latency.measure_latency(opencl, count=5000, chosen=[QUICK], seconds=1e-4)
    assert bench._report("latency", found, None, opencl.device, None, False, False) == 0
    stated = capsys.readouterr().out.split("Left out:")[1]
    frames = int(stated.partition(" of 5000 frames")[0].split()[-1])
    assert "contact:" in stated
    assert 0 < frames < 5000
    assert "nothing" not in stated


def test_the_command_takes_another_engine(monkeypatch):
    """It launches nothing: columns of empty launches are empty, and the times are its own."""
    monkeypatch.setattr(latency, "subjects", lambda: (QUICK,))
    asked = ["bench", "latency", "--engine", "numba", "--frames", "200", "--json"]
    done = CliRunner().invoke(main, asked)
    row = next(json.loads(line) for line in done.stdout.splitlines() if '"contact"' in line)
    assert (done.exit_code, row["launches"], row["empty_launch_us"]) == (0, 0, None)
    assert 0.0 < row["p50_us"] <= row["p99_us"]
    assert CliRunner().invoke(main, [*asked[:3], "numbas"]).exit_code == 2


def test_nothing_is_named_where_all_frames_ran(opencl):
    found = list(latency.measure_latency(opencl, count=250, chosen=[QUICK]))
    assert [type(item) for item in found] == [latency.Latency]


@pytest.mark.parametrize("name", ["surface_load", "halfspace_layers"])
def test_programs_that_are_slow_on_the_reference_are_held_to_their_closed_forms(opencl, name):
    subject = latency.Subject(name, name)
    row = row_of(opencl, subject, count=50)
    assert row.truth.startswith("closed form")
    # tolerances of `cnnum templates check`: a regularised inverse, and relaxation to 1e-5
    assert 0.0 < row.error < {"surface_load": 1e-4, "halfspace_layers": 5e-5}[name]


def test_every_slow_program_has_a_closed_form():
    for name in errors.SLOW_REFERENCE:
        assert errors.program_forms(name), name


def test_frames_before_a_contact_judge_nothing(opencl, monkeypatch):
    """On a busy machine the reference ends at rest, where all outputs are 0 on both sides."""
    monkeypatch.setattr(errors, "REFERENCE_S", 0.0)
    plan = latency.Subject("twist", "twist").plan(opencl)
    judged = errors.program_error(opencl, plan, "twist")
    assert judged.truth.startswith("closed form")
    assert judged.error > 0.0


def test_errors_are_those_of_the_outputs_that_are_wanted(opencl, monkeypatch):
    """Of a plan of some outputs, against the reference engine's same outputs."""
    plan = latency.BOTH.plan(opencl)
    true = errors.truths("tactile", (8, 8), 60.0, needs=tuple(plan.schedule.outputs))
    names = {name for rule in latency.rules_of(plan) for name in rule.needs}
    assert set(true[0]) == names == set(plan.schedule.outputs)
    assert len(true) == len(touch())
    # float32 through some thousand operations; strengths are ratios of small differences
    assert 0.0 < errors.stream_error(plan, true) < 5e-3
    wrong = [answer | {"slip_strength": 1.1 * answer["slip_strength"]} for answer in true]
    assert errors.stream_error(plan, wrong) > 0.09


def test_tails_of_launches_are_those_of_the_same_turns(opencl, monkeypatch):
    """Every fiftieth empty launch of 1 ms takes 9: p99 is nine medians, for any times of frames."""
    taken = ([1e-3] * 100, [1e-3] * 100, ([1e-3] * 49 + [9e-3]) * 2)
    monkeypatch.setattr(latency, "_turns", lambda *_: (taken, [2e-3]))
    row = row_of(opencl, QUICK)
    assert (row.tail, row.empty_tail) == (1.0, 1.0)
    assert row.own_tail == pytest.approx(9.0)


def test_what_comes_after_other_work_is_distinguished(monkeypatch):
    """By a clock of its own: a frame takes 1 ms, after another call 5."""
    now, last = [0.0], ["other"]

    def frame():
        now[0] += 1e-3 if last[0] == "frame" else 5e-3
        last[0] = "frame"

    def other():
        now[0] += 1e-4
        last[0] = "other"

    monkeypatch.setattr(latency, "perf_counter", lambda: now[0])
    (frames, others), firsts = latency._turns((frame, other), 300, 20.0)
    assert len(frames) == len(others) == 300
    assert frames == pytest.approx(300 * [1e-3])
    assert firsts == pytest.approx(3 * [5e-3])
