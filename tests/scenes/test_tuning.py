"""A level and constants that are learned from one's own recordings, and what they are good for."""

import json
import tomllib

import numpy as np
import pytest

import cnnum
from cnnum.cli import main
from cnnum.errors import SceneError, UnknownNameError
from cnnum.programs.reports import report
from cnnum.scenes.tuning import Label, Outcome, level_for, read_labels, tune

RATE = 50.0
ENGINE = cnnum.Engine("numba")


@cnnum.program
def knock(frame, *, gain: float = 1.0, level: float = 5.0, hold_time: float = 0.1):
    strength = gain * frame.normal.max()
    return {
        "knocks": report(frame, strength, level, hold_time * frame.rate),
        "knock": strength,
        "gate": strength > 0.0,
    }


SCENE = """needs = []
[array]
driver = "simulated"
[program]
name = "knocks.py:knock"
[[event]]
kind = "knock"
flag = "knocks"
strength = "knock"
"""
MODULE = """import cnnum
from cnnum.programs.reports import report


@cnnum.program
def knock(frame, *, gain: float = 1.0, level: float = 5.0, hold_time: float = 0.1):
    strength = gain * frame.normal.max()
    return {"knocks": report(frame, strength, level, hold_time * frame.rate), "knock": strength}
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "knocks.py").write_text(MODULE)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def recording(peaks, seconds=20.0):
    """Taxels that read noise below 0.1, and a peak of one frame in the middle of some seconds."""
    rng = np.random.default_rng(len(peaks))
    values = 0.1 * rng.random((int(seconds * RATE), 2, 2, 1))
    for second, peak in peaks.items():
        values[int((second + 0.5) * RATE), 0, 1] = peak
    return cnnum.Recording(values, rate=RATE, unit="strain", channels=("normal",))


@pytest.mark.parametrize("asked", [0.5, 2.0, 20.0])
def test_a_level_keeps_its_rate_on_strengths_to_come(asked):
    """Of exponential strengths the true rate at a level is known: rate · exp(−level)."""
    rng = np.random.default_rng(3)
    seconds, got = 300, []
    for _ in range(300):
        peaks = rng.exponential(size=seconds)
        level, extrapolated = level_for(peaks, float(seconds), asked)
        got.append(600.0 * np.exp(-level) / asked)
        assert extrapolated == (asked * seconds < 600.0)
    # a rate from so few reports scatters; its middle is within a factor of 1.6 of what is asked
    assert 1.0 / 1.6 < np.median(got) < 1.6
    assert np.mean(np.array(got) > 4.0) < 0.15


def test_no_report_bounds_the_rate_by_three_over_the_time():
    quiet = Outcome(seconds=600.0)
    assert quiet.bound == pytest.approx(-np.log(0.05))
    # by Poisson's law: of a rate at the bound, 3 or fewer reports come in 5 % of all cases
    some = Outcome(false=3, seconds=600.0)
    terms = [some.bound**k / np.prod(np.arange(1, k + 1)) for k in range(4)]
    assert np.exp(-some.bound) * sum(terms) == pytest.approx(0.05)


def test_quiet_recordings_give_the_level_of_the_rate(scene):
    """Three seconds of 60 are louder than the level at 30 reports in ten minutes."""
    quiet = [recording({3: 4.0, 9: 1.5}), recording({5: 3.0}), recording({2: 2.0, 7: 1.0})]
    tuned = tune(quiet, scene, false_reports=30.0, trust=True, engine=ENGINE)
    assert (tuned.event, tuned.program, tuned.parameter) == ("knock", "knocks.py:knock", "level")
    # the third largest, but for the last frame of each recording, which ends no period
    assert tuned.level == pytest.approx(2.0, rel=0.01)
    assert not tuned.extrapolated
    assert tuned.seen.false == 2
    assert tuned.shipped.false == 0
    # without the first, two seconds of 40: 2.0; without the second: 1.5; without the third: 3.0
    assert tuned.left_out.false == 1 + 1 + 0
    assert tuned.seen.seconds == pytest.approx(60.0, abs=0.1)
    assert "2 false reports in 1.0 quiet minutes on recordings left out" in str(tuned)
    single = tune(quiet[:1], scene, false_reports=1.0, trust=True, engine=ENGINE)
    assert single.left_out is None
    assert single.extrapolated
    assert single.level >= 4.0
    assert "on the one recording" in str(single)


def test_labels_choose_constants_and_the_scene_finds_as_much(scene, tmp_path):
    """Seconds that are labelled count as found, and no longer as false; the scene runs alike."""
    loud = {3: 8.0, 9: 6.0, 15: 3.5}
    recordings = [recording({4: 2.0}), recording({8: 2.2, 12: 1.0}), recording(loud)]
    labels = [Label("2", s + 0.3, s + 0.7, "knock") for s in (3, 9)]
    labels.append(Label("2", 15.3, 15.7, "bump"))
    tuned = tune(
        recordings, scene, labels=labels, false_reports=5.0, constants={"gain": [0.5]},
        trust=True, engine=ENGINE,
    )  # fmt: skip
    assert tuned.constants == {}  # half of all strengths finds no more
    assert tuned.seen.events == tuned.seen.found == 2
    assert tuned.seen.delays == pytest.approx((0.2, 0.2))
    assert tuned.shipped.found == 2
    assert tuned.left_out.events == 2
    out = tuned.save(tmp_path / "tuned.toml")
    table = tomllib.loads(out.read_text())
    assert table["program"]["parameters"] == {"level": tuned.level}
    assert out.read_text().startswith("# knock: level =")
    with cnnum.load_scene(out, recording=recordings[2], engine=ENGINE, trust=True) as opened:
        assert [event.time for event in opened.events()] == [3.5, 9.5, 15.5]
    with pytest.raises(UnknownNameError, match="gian"):
        tune(recordings, scene, labels=labels, constants={"gian": [1]}, trust=True, engine=ENGINE)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", ["twist", "slip"])  # a twist's flag has a gate of its own
def test_strengths_at_any_level_are_those_of_the_program(name):
    """The program's own reports at two levels, against those that its open run gives."""
    from cnnum.drivers.simulated.array import SimulatedOptions
    from cnnum.drivers.simulated.settings import Phase
    from cnnum.scenes.scene_file import read_scene
    from cnnum.scenes.tuning import _dial, _marked, _played, _take

    motion = {"speed": 1.5e-3, "direction": 0.5} if name == "slip" else {"angle": 0.5}
    kind = "pull" if name == "slip" else "twist"
    script = (Phase("hold", 0.5), Phase("press", 0.3, load=1.0), Phase("hold", 0.3),
              Phase(kind, 0.8, **motion))  # fmt: skip
    with SimulatedOptions(script=script, rate=100.0, seed=3).open() as array:
        strain = array.calibration.to_strain(np.stack([f.values for f in array.frames()]))
    axes = ("shear_x", "shear_y", "normal")
    source = cnnum.Recording(strain, rate=100.0, unit="strain", channels=axes)
    dial = _dial(read_scene(name), name)
    take = _take(dial, source, None, ENGINE)
    (values,) = _played(dial, (), [take], ENGINE)
    series = _marked(dial, (), values, take, [])
    assert values.max() > 0.05
    for level in (0.3 * values.max(), 0.8 * values.max()):
        changes = {"needs": [dial.rule.flag], "program": {"name": name},
                   "program.parameters": {"level": float(level)}}  # fmt: skip
        with cnnum.load_scene(name, recording=source, engine=ENGINE, changes=changes) as opened:
            flags = [float(m.outputs[dial.rule.flag]) > 0.0 for m in opened.results()]
        assert any(flags)
        np.testing.assert_array_equal(series.flags(level), flags)


def test_a_hold_that_is_tried_is_that_of_the_program(scene):
    """Two knocks a second apart are one report under a hold of 1.2 s, and two under 0.1 s."""
    from cnnum.scenes.scene_file import read_scene
    from cnnum.scenes.tuning import _dial, _marked, _played, _take

    knocks = recording({3: 8.0, 4: 7.0})
    dial = _dial(read_scene(scene, trust=True), "knock")
    take = _take(dial, knocks, None, ENGINE)
    for hold, reports in ((0.1, 2), (1.2, 1)):
        tried = (("hold_time", hold),)
        (values,) = _played(dial, tried, [take], ENGINE)
        flags = _marked(dial, tried, values, take, []).flags(5.0)
        changes = {"needs": ["knocks"], "program.parameters": {"level": 5.0, "hold_time": hold}}
        with cnnum.load_scene(
            scene, recording=knocks, engine=ENGINE, changes=changes, trust=True
        ) as opened:
            expected = [float(m.outputs["knocks"]) > 0.0 for m in opened.results()]
        np.testing.assert_array_equal(flags, expected)
        assert np.diff(flags.astype(int)).clip(0).sum() == reports


def test_the_scene_runs_from_any_folder(scene, tmp_path):
    """A program beside the scene that was tuned is named with its whole path."""
    other = tmp_path / "other"
    other.mkdir()
    knocks = recording({3: 8.0})
    tuned = tune([knocks], scene, trust=True, engine=ENGINE, labels=[Label("0", 3.4, 3.6, "bump")])
    assert "No knock is labelled" in str(tuned)
    out = tuned.save(other / "tuned.toml")
    with cnnum.load_scene(out, recording=knocks, engine=ENGINE, trust=True) as opened:
        assert [event.time for event in opened.events()] == [3.5]


WRONG = {
    "no label file": ("absent.csv", "cannot be read|no labels|there is no"),
    "no column": ("recording,begin\n0,1\n", "have no column 'end'"),
    "no number": ("recording,begin,end\n0,one,2\n", "line 2: begin and end must be times in s"),
    "not there": (
        "recording,begin,end\nx.npz,1,2\n",
        "recording 'x.npz', which is unknown",
    ),
    "outside": ("recording,begin,end\n0,19,27\n", "19 to 27 s is outside the recording '0'"),
    "turned": ("recording,begin,end\n0,5,4\n", "expected 0 ≤ begin ≤ end"),
    "all": ("recording,begin,end,kind\n0,0,20,x\n", "0 s of quiet time, expected at least 1 s"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_labels_get_one_sentence(case, scene, tmp_path):
    text, said = WRONG[case]
    path = tmp_path / "absent.csv"
    if text != "absent.csv":
        path = tmp_path / "events.csv"
        path.write_text(text)
    with pytest.raises(SceneError, match=said):
        tune([recording({})], scene, labels=path, trust=True, engine=ENGINE)


def test_what_cannot_be_tuned_is_said(scene, tmp_path):
    with pytest.raises(SceneError, match="has no level of 'contact'"):
        tune([recording({})], "contact", event="contact")
    with pytest.raises(SceneError, match="at least one recording"):
        tune([], scene)
    with pytest.raises(SceneError, match=r"0\.001 to 1000, got -1"):
        tune([recording({})], scene, false_reports=-1)
    labels = tmp_path / "events.csv"
    labels.write_text("\ufeffrecording, begin, end, kind\n0, 1.5, 2, slip\n")
    assert read_labels(labels) == (Label("0", 1.5, 2.0, "slip"),)


def test_the_command_writes_scene_and_chart(scene, tmp_path, capsys):
    files = [recording({4: 2.0}), recording({8: 2.2}), recording({3: 8.0})]
    paths = [str(r.save(tmp_path / f"r{n}.npz")) for n, r in enumerate(files)]
    (tmp_path / "events.csv").write_text("recording,begin,end\nr2.npz,3.4,3.6\n")
    out, chart = tmp_path / "own.toml", tmp_path / "own.svg"
    given = ["--scene", str(scene), "--labels", str(tmp_path / "events.csv"), "--try", "gain=2",
             "--out", str(out), "--chart", str(chart), "--trust", "--engine", "numba"]  # fmt: skip
    with pytest.raises(SystemExit, match="0"):
        main(["tune", *paths, *given, "--json"])
    line = json.loads(capsys.readouterr().out)
    assert line["left_out"]["found"] == line["seen"]["found"] == line["seen"]["events"] == 1
    assert line["level"] == tomllib.loads(out.read_text())["program"]["parameters"]["level"]
    assert "median delay after the label, s" in chart.read_text()
    with pytest.raises(SystemExit, match="2"):
        main(["tune", *paths, "--out", str(tmp_path / "no.toml"), "--chart", "x.xyz"])
    assert "'.xyz': expected one of '.png'" in capsys.readouterr().err
    assert not (tmp_path / "no.toml").exists()
    rateless = tmp_path / "times.npy"
    np.save(rateless, np.zeros((50, 2, 2, 1)))
    rateless.with_suffix(".toml").write_text('shape = [2, 2]\nchannels = ["z"]\n')
    with pytest.raises(SystemExit, match="2"):
        main(
            ["tune", str(rateless), "--scene", str(scene), "--trust", "--out", str(out), "--force"]
        )
    said = capsys.readouterr().err
    assert "rate" in said
    assert len(said.strip().splitlines()) <= 3
