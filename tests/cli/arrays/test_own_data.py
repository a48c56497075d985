"""Own data on the command line: files that replay reads, and guesses that it refuses."""

import numpy as np
import pytest
from force_scene import force_scene

import cnnum

SCENE = force_scene("none.csv")

SHORT = """
needs = ["contact"]
[array]
driver = "simulated"
rate = 100.0
script = [
    {kind = "hold", duration = 0.4},
    {kind = "press", duration = 0.2, load = 4.0},
]
"""


@pytest.fixture
def counts():
    made = np.random.default_rng(0).normal(16000.0, 3.0, (90, 4, 4, 3))
    made[45:, 1:3, 1:3, 2] += 300.0
    return made


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def replay(call, file, scene, *more):
    return call("replay", file, "--scene", scene, "--engine", "numba", *more)


def test_every_kind_of_file_gives_the_same_events(call, records, counts, scene, tmp_path):
    recording = cnnum.Recording(counts, rate=60.0, channels=("x", "y", "z"))
    files = [recording.save(tmp_path / f"own.{suffix}") for suffix in ("mcap", "npz", "csv")]
    np.save(tmp_path / "raw.npy", counts)
    (tmp_path / "raw.toml").write_text("shape = [4, 4]\nrate = 60.0\n")
    events = [
        records(replay(call, file, scene, "--json").stdout)[0]
        for file in (*files, tmp_path / "raw.npy")
    ]
    assert events[0]["kind"] == "contact"
    assert events[0]["where"] == pytest.approx([1.5, 1.5], abs=0.1)
    assert all(event == events[0] for event in events)


def test_what_record_writes_as_csv_is_replayed(call, records, tmp_path):
    """The simulated scene gives the same contact from its CSV file as live."""
    scene, options = tmp_path / "press.toml", ("--engine", "numba", "--json")
    scene.write_text(SHORT)
    table = tmp_path / "demo.csv"
    assert call("record", scene, table).exit_code == 0
    assert table.read_text().startswith("sequence,time (s),quality,r0_c0_left (V)")
    runs = [call("run", scene, *options), call("replay", table, "--scene", scene, *options)]
    live, again = (records(run.stdout) for run in runs)
    assert [event["kind"] for event in live] == ["contact", "summary"]
    assert live[0] == again[0]
    assert (live[1]["frames"], live[1]["handed_on"]) == (again[1]["frames"], again[1]["handed_on"])


def refused(result, said):
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr
    assert result.stderr.count("\n") == 1


def test_counts_have_no_scene_of_their_own(call, counts, tmp_path):
    file = cnnum.Recording(counts, rate=60.0).save(tmp_path / "own.npz")
    refused(call("replay", file), "choose a scene for them, as in")


@pytest.mark.parametrize(
    ("name", "setting", "said"),
    [
        ("demo", "needs=['contact']", "the array gives counts, and 'unit' of"),
        ("scene.toml", "program.parameters.depth='1 mm'", "give 'pitch'"),
        ("scene.toml", "program.parameters={depth='1 mm', pitch='2 mm'}", "gives counts, and"),
        ("scene.toml", "program={name='surface_load'}", "'thickness' of the program"),
        ("uskin_grasp", "program.parameters.pads=2", "'pads' = 2 on an array of 4×4 taxels"),
    ],
)
def test_what_counts_cannot_mean_is_refused(call, counts, scene, name, setting, said):
    file = cnnum.Recording(counts, rate=60.0).save(scene.parent / "own.npz")
    chosen = scene if name == scene.name else name
    refused(replay(call, file, chosen, "--set", setting), said)


def test_a_layout_that_says_its_pads_is_believed(call, counts, scene):
    folder = scene.parent
    np.save(folder / "raw.npy", counts)
    (folder / "raw.toml").write_text("shape = [4, 4]\nrate = 60.0\npads = 1\n")
    refused(replay(call, folder / "raw.npy", "uskin_grasp"), "4×4 taxels, which is 1 pad(s)")
