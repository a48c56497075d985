"""Results out: fields that a scene wants go into files and records."""

import csv
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

import cnnum

SHORT = """
needs = ["contact", "contact_map", "load_normal"]
[array]
driver = "simulated"
script = [{kind = "hold", duration = 0.15}, {kind = "press", duration = 0.15, load = 4.0}]
[program]
name = "contact"
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "press.toml"
    path.write_text(SHORT)
    return path


@pytest.fixture(scope="module")
def engine():
    return cnnum.Engine("numba")


def fields_of(path):
    """Times, maps and numbers of a saved file, by another reader than ours."""
    if path.suffix == ".npz":
        with np.load(path) as held:
            return held["time"], held["contact_map"], held["load_normal"]
    if path.suffix == ".nc":
        from scipy.io import netcdf_file

        with netcdf_file(path, mmap=False) as file:
            held = {name: variable[:].copy() for name, variable in file.variables.items()}
        return held["time"], held["contact_map"], held["load_normal"]
    with path.open() as file:
        rows = list(csv.DictReader(file))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    cells = [columns[f"contact_map[{row}, {col}]"] for row, col in np.ndindex(8, 8)]
    return columns["time"], np.stack(cells, -1).reshape(-1, 8, 8), columns["load_normal"]


@pytest.mark.parametrize("suffix", ["npz", "csv", "nc"])
def test_saved_fields_are_those_of_the_scene(call, scene, engine, suffix, tmp_path):
    out = tmp_path / f"out.{suffix}"
    done = call("run", scene, "--engine", "numba", "--save", out)
    assert done.exit_code == 0, done.stderr
    assert str(out) in done.stdout
    record = cnnum.load_scene(scene, engine=engine).collect()
    times, maps, loads = fields_of(out)
    assert np.array_equal(times, record.times)
    assert np.array_equal(maps, record["contact_map"])
    assert np.array_equal(loads, record["load_normal"])
    assert maps.any()


def test_json_has_a_record_a_field(call, records, scene, engine):
    made = records(call("run", scene, "--engine", "numba", "--json").stdout)
    fields = [record for record in made if record["kind"] == "field"]
    record = cnnum.load_scene(scene, engine=engine).collect()
    assert len(fields) == 2 * len(record)
    last = {field["name"]: field for field in fields}
    assert last["contact_map"]["value"] == record["contact_map"][-1].tolist()
    assert last["load_normal"]["value"] == record["load_normal"][-1]
    assert last["load_normal"]["frame"] == record.numbers[-1]


@pytest.mark.parametrize(
    ("scene_name", "file", "said"),
    [
        ("demo", "out.npz", "requests only events and no field, so there is nothing to save"),
        ("edges", "out.wav", "Unknown kind of file '.wav': expected one of '.npz', '.csv', '.nc'"),
        ("edges", "no/out.npz", "there is no folder 'no'"),
    ],
)
def test_what_cannot_be_saved_is_said_before_the_work(call, scene_name, file, said):
    done = call("run", scene_name, "--engine", "numba", "--save", file)
    assert (done.exit_code, done.stdout) == (2, "")
    assert said in done.stderr


def test_what_was_seen_is_saved_when_a_run_is_stopped(scene, tmp_path):
    out = tmp_path / "out.npz"
    text = SHORT.replace("duration = 0.15, load", "duration = 600.0, load")
    scene.write_text(text)
    command = [sys.executable, "-m", "cnnum", "run", scene, "--engine", "numba", "--json"]
    with subprocess.Popen([*command, "--save", out], stdout=subprocess.PIPE) as running:
        for _ in range(20):
            running.stdout.readline()
        os.kill(running.pid, signal.SIGTERM)
        running.stdout.read()
        assert running.wait(60) == 130
    assert len(fields_of(out)[0]) >= 9


def test_a_scene_that_wants_everything_saves_everything(engine, scene):
    changes = {"needs": ["everything"]}
    made = cnnum.load_scene(scene, engine=engine, changes=changes)
    assert set(made.fields) == set(made.offered)
