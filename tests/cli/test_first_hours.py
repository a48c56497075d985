"""The first hours of three users, command by command, in one folder each."""

import json
import subprocess
import sys

import numpy as np
import pytest

import cnnum

WRONG_WAY = "program.parameters.push=-1"
WAIT = 120  # s after which a command counts as hung; none takes a tenth of it


@pytest.fixture
def shell(tmp_path):
    """A shell in an empty folder: what a command prints, and its exit code."""

    def run(*arguments, code=0):
        command = [sys.executable, "-m", "cnnum", *map(str, arguments)]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=WAIT)
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        if code == 2:
            assert done.stdout == ""
            assert done.stderr.count("\n") == 1
            assert done.stderr.startswith("cnnum: ")
        return done.stderr if code == 2 else done.stdout

    return run


def of_kind(text, kind):
    return [r for r in map(json.loads, text.splitlines()) if r.get("kind") == kind]


SCENE = """
wants = ["contact", "contact_map"]
[array]
driver = "file"
path = "grip.csv"
[program]
name = "contact"
[program.parameters]
push = 1.0
reads = "force"
"""


def test_a_tactile_researcher(shell, tmp_path):
    """With a CSV file of counts: from nothing to newtons and a file of fields."""
    counts = np.random.default_rng(0).normal(16000.0, 3.0, (120, 16, 3))
    counts[60:, [5, 6, 9, 10], 2] += 300.0
    header = [f"txl{n}_{axis}" for n in range(1, 17) for axis in "xyz"]
    rows = [",".join(f"{value:.0f}" for value in frame.ravel()) for frame in counts]
    (tmp_path / "grip.csv").write_text("\n".join([",".join(header), *rows]) + "\n")

    assert "There is no layout 'grip.toml'" in shell("replay", "grip.csv", code=2).replace(
        f"{tmp_path}/", ""
    )
    layout = 'shape = [4, 4]\nvalues = "txl{n}_{axis}"\nfirst = 1\nrate = 60.0\n'
    (tmp_path / "grip.toml").write_text(layout)
    assert "--scene" in shell("replay", "grip.csv", code=2)
    assert "counts" in shell("replay", "grip.csv", "--scene", "demo", code=2)
    assert "'pads' = 2" in shell("replay", "grip.csv", "--scene", "uskin_grasp", code=2)

    (tmp_path / "scene.toml").write_text(SCENE)
    fast = ("--engine", "numba")
    (contact,) = of_kind(shell("run", "scene.toml", *fast, "--json"), "contact")
    assert contact["unit"] == "count"
    assert contact["where"] == pytest.approx([1.5, 1.5], abs=0.1)
    assert "did you mean 'contact'" in shell(
        "plan", "scene.toml", "--set", "wants=['contct']", code=2
    )

    with (tmp_path / "scene.toml").open("a") as file:
        file.write('[calibration]\ngain = 0.02\nunit = "N"\ntare = 20\n')
    assert " N" in shell("run", "scene.toml", *fast, "--save", "fields.npz")
    (contact,) = of_kind(shell("replay", "grip.csv", "--scene", "scene.toml", "--json"), "contact")
    assert contact["strength"] == pytest.approx(24.0, rel=0.02)
    with np.load(tmp_path / "fields.npz") as fields:
        assert fields["contact_map"][-1].sum() == 4

    assert "wrong way round" in subprocess.run(
        [sys.executable, "-m", "cnnum", "run", "scene.toml", *fast, "--set", WRONG_WAY],
        cwd=tmp_path, capture_output=True, text=True, timeout=WAIT,
    ).stderr  # fmt: skip


def test_a_template_designer(shell, tmp_path):
    """With a picture file: from the list to a template of one's own that can be seen."""
    pytest.importorskip("PIL")
    assert "EDGE" in shell("templates", "list")
    assert "did you mean 'HOLE'" in shell("templates", "show", "HOEL", code=2)
    dot = -np.ones((12, 12))
    dot[4:8, 4:8] = 1.0
    dot[5:7, 5:7] = -1.0
    cnnum.save_picture(dot, tmp_path / "ring.png")
    options = ("--input", "ring.png", "--engine", "numba", "--transient")
    for suffix in ("html", "png", "gif"):
        assert "Written" in shell("templates", "show", "HOLE", *options, f"hole.{suffix}")
        assert (tmp_path / f"hole.{suffix}").stat().st_size > 100
    assert "cannot be read as a picture" in shell(
        "templates", "show", "HOLE", "--input", "grip.csv", "--transient", "a.html", code=2
    )
    mine = cnnum.Template(name="mine", A=[[0, 0, 0], [0, 1, 0], [0, 0, 0]], z=-0.5, duration=2.0)
    cnnum.save_template(mine, tmp_path / "mine.toml")
    assert "mine" in shell("templates", "show", "mine.toml", "--transient", "mine.html")
    assert "1 of 1 passed" in shell("templates", "check", "EDGE", "--engine", "numba")


def test_an_embedded_engineer(shell, tmp_path):
    """With a driver of their own: what it costs, before any hardware is chosen."""
    (tmp_path / "pad.py").write_text(DRIVER)
    (tmp_path / "scene.toml").write_text(
        'wants = ["contact"]\n[array]\ndriver = "pad:Options"\n[program]\nname = "contact"\n'
    )
    fast = ("--engine", "numba")
    (plan,) = map(json.loads, shell("plan", "scene.toml", *fast, "--json").splitlines())
    assert plan["flops"] > 0
    assert plan["left_out"]
    grouped = shell("plan", "scene.toml", *fast, "--ops", "--json").splitlines()
    rows = [json.loads(line) for line in grouped]
    assert sum(row["flops"] for row in rows) == plan["flops"]
    assert {"program", "line", "count", "flops", "bytes", "live_bytes"} <= set(rows[0])
    assert "frames" in shell("probe", "pad:Options", "--frames", 20)
    assert "40 frames" in shell("record", "pad:Options", "tape.mcap")
    assert "is there already" in shell("record", "pad:Options", "tape.mcap", code=2)
    (summary,) = of_kind(shell("run", "scene.toml", *fast, "--json"), "summary")
    assert summary["frames"] == 40
    again = shell("replay", "tape.mcap", "--scene", "scene.toml", *fast, "--json")
    assert of_kind(again, "summary")[0]["handed_on"] == summary["handed_on"]


DRIVER = """
from dataclasses import dataclass

import numpy as np

from cnnum import Frame
from cnnum.drivers.driver import Closing, Counters


@dataclass(frozen=True, slots=True)
class Options:
    rate: float = 60.0

    def open(self):
        return Pad(self.rate)


class Pad(Closing):
    shape, channels, unit = (4, 4), ("shear_x", "shear_y", "normal"), "count"

    def __init__(self, rate):
        self.rate, self.counters = rate, Counters()

    def frames(self):
        noise = np.random.default_rng(0)
        for number in range(40):
            values = noise.normal(16000.0, 3.0, (4, 4, 3))
            yield Frame(values, self.channels, self.unit, number, number / self.rate)
"""
