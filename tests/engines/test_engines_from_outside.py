"""An engine of another package runs what ours run: the rest asks what it can do."""

import ast
import json
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fingerprints import cases_of, fingerprint

import cnnum
from cnnum.cli import main
from cnnum.engines.backend import EngineRecord
from cnnum.engines.registry import PACKAGED, backend_names
from cnnum.errors import DeviceError, NotSupportedError, UnknownNameError

ROOT = Path(__file__).parents[2]
FULL = os.environ.get("CNNUM_TESTS") == "full"
MODULE = """
from dataclasses import replace
from cnnum.engines.backend import Limit
from cnnum.engines.registry import PACKAGED

COPY = replace(PACKAGED["numba"], name="copy")
LIMITED = replace(COPY, name="limited", limits=(
    Limit("Euler's method", "a test says so", lambda transient, solver: solver.method == "euler"),
))
"""
POINTS = """[cnnum.engines]
copy = outside_engine:COPY
limited = outside_engine:LIMITED
gone = outside_engine:GONE
absent = no_such_module:ENGINE
none = outside_engine:MODULE
misnamed = outside_engine:COPY
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A folder with an installed package that offers engines."""
    folder = tmp_path_factory.mktemp("outside")
    (folder / "outside_engine.py").write_text(f"{MODULE}MODULE = 1\n")
    about = folder / "outside_engine-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: outside-engine\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(POINTS)
    return folder


@pytest.fixture
def outside(package, monkeypatch):
    monkeypatch.syspath_prepend(package)


def test_it_is_found_by_its_entry_point(outside):
    assert backend_names()[:3] == ("opencl", "numba", "reference")
    assert {"copy", "limited"} < set(backend_names())
    engine = cnnum.Engine("copy")
    assert (engine.name, engine.precision) == ("copy", "float32")
    assert engine.with_precision("float64").name == "copy"
    assert engine.compile("slip", (8, 8)).explain().engine == "copy"
    with pytest.raises(DeviceError, match="The copy engine runs on the host"):
        cnnum.Engine("copy", device="any")
    with pytest.raises(UnknownNameError, match="'float16'"):
        cnnum.Engine("copy", precision="float16")
    with pytest.raises(UnknownNameError, match="no precision 'q15': use the engine 'opencl' or"):
        cnnum.Engine("copy", precision="q15")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("gone", "'outside_engine:GONE', which cannot be imported"),
        ("absent", "'no_such_module:ENGINE', which cannot be imported"),
        ("none", "expected a cnnum.engines.backend.EngineRecord named 'none', got int"),
        ("misnamed", "named 'misnamed', got EngineRecord"),
    ],
)
def test_what_is_no_engine_is_said(outside, name, said):
    with pytest.raises(NotSupportedError, match=re.escape(said)):
        cnnum.Engine(name)


def test_it_stands_in_for_a_device(outside, opencl):
    """As the package's own does where a device is lost: its record says that it can."""
    assert cnnum.Engine("opencl", fallback="copy").name == "opencl"
    with pytest.raises(UnknownNameError, match="fallback"):
        cnnum.Engine("opencl", fallback="reference")


def test_commands_and_scenes_take_it(outside, tmp_path):
    def call(*words):
        ran = CliRunner().invoke(main, words)
        assert ran.exit_code == 0, ran.output
        return ran.stdout

    (line,) = call("templates", "check", "edge", "--engine", "copy", "--json").splitlines()
    assert json.loads(line)["engine"] == "copy"
    assert "copy" in call("plan", "slip", "--set", "engine.name=copy", "--json")


def test_what_an_engine_leaves_out_is_refused_with_its_reason(outside):
    engine = cnnum.Engine("limited")
    assert engine.run("EDGE", input=np.eye(4)).method == "propagator"
    with pytest.raises(NotSupportedError, match=r"leaves out Euler's method .*: a test says so"):
        engine.run("EDGE", input=np.eye(4), dt=0.1)


def test_a_copy_runs_all_that_the_original_runs_to_the_same_bits(outside):
    """Texts, programs and runs of every kind; a short run takes every 60th."""
    every = 1 if FULL else 60
    tried = 0
    own, copied = (
        list(cases_of(((name, "float32"), (name, "float64")), ())) for name in ("numba", "copy")
    )
    for (name, make), (other, copy) in list(zip(own, copied, strict=True))[::every]:
        assert other == name.replace(" numba ", " copy ")
        made = fingerprint(copy).replace("'copy'", "'numba'").replace("The copy", "The numba")
        assert made == fingerprint(make), name
        tried += 1
    assert tried >= (900 if FULL else 15)


def test_the_engine_part_of_the_suite_passes_on_it(package):
    """With the copy in the place of "numba"; a short run takes one file."""
    files = ["tests/engines"] if FULL else ["tests/engines/test_adding.py"]
    way = os.environ | {"CNNUM_TEST_ENGINE": "copy", "CNNUM_TESTS": "full"}
    way["PYTHONPATH"] = os.pathsep.join([str(package), way.get("PYTHONPATH", "")])
    command = (sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-k", "numba")
    left = ("--deselect", "tests/engines/test_engines_from_outside.py")
    ran = subprocess.run(
        [*command, *files, *left], cwd=ROOT, env=way, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stdout[-3000:]
    passed = re.search(r"(\d+) passed", ran.stdout)
    assert passed is not None
    assert int(passed[1]) >= (300 if FULL else 5)


NEUTRAL = (
    "engine.py",
    "plan.py",
    "stream.py",
    "runs",
    "programs",
    "integrators",
    "graph",
    "scenes",
)


def test_the_middle_knows_no_engine_by_its_name():
    """Only the registry does, and commands where a default is the user's to change."""
    places = [ROOT / "cnnum" / place for place in NEUTRAL]
    files = [file for place in places for file in (place, *place.rglob("*.py")) if file.is_file()]
    assert len(files) > 40
    named = [
        f"{file.name}:{node.lineno}"
        for file in files
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Constant) and node.value in PACKAGED
    ]
    assert named == []


def test_the_page_has_what_each_engine_can_do():
    """A row for each field whose value differs between engines, and the limits."""
    page = (ROOT / "docs" / "engines.md").read_text()
    rows = {
        cells[1].strip(): cells[2:]
        for line in page.splitlines()
        if len(cells := line.split("|")) == 7
    }
    said = {"yes": True, "no": False}
    for field in fields(EngineRecord):
        values = [getattr(record, field.name) for record in PACKAGED.values()]
        if field.name in ("name", "open", "missing", "precisions", "limits"):
            continue
        assert f"`{field.name}`" in rows, field.name
        written = [said[cell.strip()] for cell in rows[f"`{field.name}`"][:3]]
        assert written == [bool(value) for value in values], field.name
    assert all(limit.why in page for record in PACKAGED.values() for limit in record.limits)
