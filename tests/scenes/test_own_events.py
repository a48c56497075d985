"""A program and events of one's own go wherever those of the library go."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.errors import ProgramError, SceneError, UnknownNameError
from cnnum.report.pictures import timeline
from cnnum.report.record import SceneRecorder
from cnnum.scenes.events import EventDetector, event_rule

OWN = '''
import cnnum


@cnnum.program
def poke(frame, *, level=0.02):
    """How deep each taxel is pressed, and how many are."""
    deep = -frame.normal
    return {"depth": deep, "pressed": (deep > level).count(), "deepest": deep.max()}
'''
SCENE = """
name = "pokes"

[array]
driver = "simulated"
seed = 3

[program]
name = "{place}"

[[event]]
kind = "poke"
flag = "depth"
on = 0.03
off = 0.02
ends = "lifted"
strength = "deepest"
unit = "strain"

[[event]]
kind = "wide"
flag = "pressed"
on = 4
"""
FRAMES = 300


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "scene.toml").write_text(SCENE.format(place="own.py:poke"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(main, [str(one) for one in arguments])


def expected(frames):
    """The events as NumPy finds them in the program's input, by the rules above."""
    found, poked, wide = [], False, False
    for n, values in enumerate(frames):
        deep = -values
        if deep.max() > (0.02 if poked else 0.03):
            if not poked:
                found.append(("poke", n, np.unravel_index(np.argmax(deep), deep.shape), deep.max()))
            poked = True
        elif poked:
            found.append(("lifted", n, None, None))
            poked = False
        now = (deep > 0.02).sum() > 4
        if now and not wide:
            found.append(("wide", n, None, None))
        wide = now
    return found


def test_the_events_are_those_of_numpy(folder):
    scene = cnnum.load_scene("scene.toml", trust=True)
    frames, events = [], []
    for moment in scene.results():
        frames.append(
            np.float64(moment.values[..., -1] if moment.values.ndim == 3 else moment.values)
        )
        events += moment.events
    wanted = expected(frames)
    assert {"poke", "lifted", "wide"} <= {kind for kind, *_ in wanted}
    assert [(e.kind, e.frame) for e in events] == [(kind, n) for kind, n, *_ in wanted]
    for event, (kind, _, where, strength) in zip(events, wanted, strict=True):
        if kind == "poke":
            assert event.where == tuple(where)
            assert event.strength == pytest.approx(strength, rel=1e-5)  # a single-precision sum
            assert event.unit == "strain"


def test_the_same_from_python_by_module_and_on_the_command_line(folder, monkeypatch):
    by_file = cnnum.load_scene("scene.toml", trust=True).collect(FRAMES).events
    assert by_file
    rules = [
        {"kind": "poke", "flag": "depth", "on": 0.03, "off": 0.02, "ends": "lifted",
         "strength": "deepest", "unit": "strain"},
        {"kind": "wide", "flag": "pressed", "on": 4},
    ]  # fmt: skip
    program = cnnum.load_program("own.py")
    for own in (program, "own.py:poke"):
        scene = cnnum.load_scene("demo", program=own, events=rules, changes={"array.seed": 3})
        assert scene.collect(FRAMES).events == by_file
    (folder / "scene.toml").write_text(SCENE.format(place="own:poke"))
    assert cnnum.load_scene("scene.toml", trust=True).collect(FRAMES).events == by_file
    refused = run("run", "scene.toml")
    assert refused.exit_code == 2
    assert "--trust" in refused.output
    said = run("run", "scene.toml", "--trust", "--frames", FRAMES, "--json")
    kinds = [json.loads(line).get("kind") for line in said.stdout.splitlines()]
    assert [kind for kind in kinds if kind in {"poke", "lifted", "wide"}] == [
        event.kind for event in by_file
    ]
    # a name that the user gives is no code unasked
    assert run("run", "demo", "--set", "program.name=own.py:poke", "--set", "needs=['depth']",
               "--set", "program.parameters={}", "--frames", 5).exit_code == 0  # fmt: skip


def test_page_plan_replay_and_live_view(folder):
    scene = cnnum.load_scene("scene.toml", trust=True)
    assert run("record", "scene.toml", "kept.mcap", "--frames", FRAMES, "--trust").exit_code == 0
    replayed = run("replay", "kept.mcap", "--scene", "scene.toml", "--trust", "--json")
    assert replayed.exit_code == 0, replayed.output
    kinds = [json.loads(line).get("kind") for line in replayed.stdout.splitlines()]
    assert "poke" in kinds
    planned = run("plan", "scene.toml", "--trust")
    assert planned.exit_code == 0, planned.output
    assert "poke" in planned.output
    recorder = SceneRecorder(scene)
    for moment in scene.results():
        recorder.add(moment)
    picture = timeline(recorder.record(), (), 800.0)
    assert ">poke<" in picture
    assert ">lifted<" in picture


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ('flag = "depth"', 'flag = "depht"', SceneError, "depth"),
        ('flag = "depth"\n', "", SceneError, "'flag' is missing"),
        ("off = 0.02", "off = 0.04", SceneError, "above 'on'"),
        ("on = 0.03", 'on = "high"', SceneError, "is a number"),
        ("ends =", "end =", SceneError, "end"),
        ("[[event]]", "[event]", SceneError, "TOML|list of tables"),
        ("own.py:poke", "own.py:pokes", UnknownNameError, "poke"),
        ("own.py:poke", "none.py:poke", ProgramError, "no file"),
        ("own.py:poke", "nowhere_at_all:poke", SceneError, "cannot be imported"),
        ("own.py:poke", "json:dumps", SceneError, "@cnnum.program"),
    ],
)
def test_what_is_wrong_is_one_sentence(folder, old, new, error, words):
    text = SCENE.format(place="own.py:poke").replace(old, new)
    (folder / "scene.toml").write_text(text)
    with pytest.raises(error, match=words):
        cnnum.load_scene("scene.toml", trust=True)


def test_a_wavering_value_begins_no_second_event():
    rule = event_rule({"kind": "high", "flag": "x", "on": 1.0, "off": 0.5, "steady": 0.2}, "Event")
    detector = EventDetector((rule,))
    values = [0, 1.2, 0.8, 0.8, 0.6, 1.1, 0.4, 0.4, 0.4, 1.3, 0, 0, 0]
    events = [
        event.frame
        for n, value in enumerate(values)
        for event in detector.update(0.1 * n, n, {"x": np.array(float(value))})
    ]
    assert events == [3]  # it holds 0.2 s from frame 1 on; that of frame 9 is gone too soon
