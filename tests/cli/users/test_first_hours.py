"""The first hours of three users, command by command, in one folder each.

On the way every mistake that was seen is made, too. On the command line each gets one sentence on
standard error, nothing on standard output, and exit code 2; in Python a `CnnumError` of one line.
"""

import json
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from force_scene import force_scene

import cnnum
from cnnum.cli import main

FAST = ("--engine", "numba")
OWN = (*FAST, "--trust")
WAIT = 120  # s after which a command counts as hung; none takes a tenth of it
SETTING = "program.parameters."


class Hour:
    """A user at work in one folder, who counts the mistakes."""

    def __init__(self):
        self.mistakes = 0

    def does(self, *arguments):
        """Return the output of a command that works."""
        done = CliRunner().invoke(main, [str(argument) for argument in arguments])
        assert done.exit_code == 0, done.output
        self.warned = done.stderr
        return done.stdout

    def mistakes_a_command(self, said, *arguments):
        """Make a mistake on the command line."""
        done = CliRunner().invoke(main, [str(argument) for argument in arguments])
        assert (done.exit_code, done.stdout) == (2, ""), done.output
        assert "Traceback" not in done.stderr
        sentence = done.stderr.splitlines()[-1]
        assert done.stderr.count("cnnum: ") == 1
        assert sentence.startswith("cnnum: ")
        assert said in sentence
        self.mistakes += 1

    def mistakes_a_call(self, said, call):
        """Make a mistake in Python."""
        with pytest.raises(cnnum.CnnumError, match=said) as caught:
            call()
        assert "\n" not in str(caught.value)
        self.mistakes += 1


@pytest.fixture
def hour(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Hour()


def of_kind(text, kind):
    return [r for r in map(json.loads, text.splitlines()) if r.get("kind") == kind]


SCENE = force_scene("grip.csv", '"contact", "contact_map"')
LAYOUT = 'shape = [4, 4]\nvalues = "txl{n}_{axis}"\nrate = 60.0\n'


def write_counts(path, separator=","):
    counts = np.random.default_rng(0).normal(16000.0, 3.0, (160, 16, 3))
    counts[60:, [5, 6, 9, 10], 2] += 300.0
    header = [f"txl{n}_{axis}" for n in range(1, 17) for axis in "xyz"]
    rows = [[f"{value:.0f}" for value in frame.ravel()] for frame in counts]
    path.write_text("\n".join(separator.join(row) for row in (header, *rows)) + "\n")


SCENE_MISTAKES = (
    ("did you mean 'contact'", "needs=['contct']"),
    ("load_normal", "needs=['wash']"),  # all that it has are listed
    ("give 'pitch'", f"{SETTING}depth=1 mm"),
    ("counts pitches", f"{SETTING}depth=1e-3"),
    ("'m', 'cm', 'mm', 'um'", f"{SETTING}depth=1 stone"),
    ("−1 where a push lowers", f"{SETTING}push=0"),
    ("newtons", f"{SETTING}unit=-5"),
    ("did you mean 'force'", f"{SETTING}reads=forc"),
    ("Unknown parameter 'dept' (did you mean 'depth'?)", f"{SETTING}dept=1"),
    ("the array gives counts", f"{SETTING}unit=1 N"),
    ("Unknown key 'prgram'", "prgram.name=slip"),
)


def test_a_tactile_researcher(hour, tmp_path):
    """With a CSV file of counts: from nothing to newtons and a file of fields."""
    write_counts(tmp_path / "grip.csv")
    wrong = hour.mistakes_a_command
    wrong("There is no recording 'grap.csv'", "replay", "grap.csv")
    wrong("There is no layout", "replay", "grip.csv")
    (tmp_path / "grip.toml").write_text(LAYOUT)
    wrong("a similar one is 'txl", "replay", "grip.csv", "--scene", "demo")  # they count from 1
    (tmp_path / "grip.toml").write_text(LAYOUT + "first = 1\n")
    write_counts(tmp_path / "semi.csv", ";")
    (tmp_path / "semi.toml").write_text(LAYOUT + "first = 1\n")
    wrong('separator = ";"', "replay", "semi.csv", "--scene", "demo")
    wrong("--scene", "replay", "grip.csv")
    wrong("There is no scene 'dmo'", "replay", "grip.csv", "--scene", "dmo")
    wrong("gives counts, and 'unit'", "replay", "grip.csv", "--scene", "demo")
    wrong("'pads' = 2 on an array", "replay", "grip.csv", "--scene", "uskin_grasp")

    (tmp_path / "scene.toml").write_text(SCENE)
    (contact,) = of_kind(hour.does("run", "scene.toml", *FAST, "--json"), "contact")
    assert contact["unit"] == "count"
    assert contact["where"] == pytest.approx([1.5, 1.5], abs=0.1)
    for said, setting in SCENE_MISTAKES:
        wrong(said, "plan", "scene.toml", *FAST, "--set", setting)
    wrong("frames a second", "plan", "demo", *FAST, "--set", f"{SETTING}rate=-1")
    (tmp_path / "trials" / "first").mkdir(parents=True)
    (tmp_path / "trials" / "first" / "xela_sensor1.csv").write_text("")
    wrong("name one of them ('first')", "replay", "trials", "--scene", "uskin_grasp")
    wrong("Unknown kind of file '.xlsx'", "run", "scene.toml", *FAST, "--save", "fields.xlsx")
    wrong("no folder 'no'", "run", "scene.toml", *FAST, "--save", "no/fields.npz")
    no_field = ("--save", "fields.npz", "--set", "needs=['contact']")
    wrong("no field", "run", "scene.toml", *FAST, *no_field)

    with (tmp_path / "scene.toml").open("a") as file:
        file.write('[calibration]\ngain = 0.02\nunit = "N"\ntare = 20\n')
    for said, setting in (
        ("'tare' needs 1000 frames", "calibration.tare=1000"),
        ("must not be 0 everywhere", "calibration.gain=0"),
        ("'gain' must be one number, or", "calibration.gain=[1.0, 2.0]"),
        ("Unknown key 'calibration.gian'", "calibration.gian=2"),
    ):
        wrong(said, "run", "scene.toml", *FAST, "--set", setting)
    assert " N" in hour.does("run", "scene.toml", *FAST, "--save", "fields.npz")
    again = hour.does("replay", "grip.csv", "--scene", "scene.toml", *FAST, "--json")
    (contact,) = of_kind(again, "contact")
    assert contact["strength"] == pytest.approx(24.0, rel=0.02)
    with np.load(tmp_path / "fields.npz") as fields:
        assert fields["contact_map"][-1].sum() == 4
    hour.does("run", "scene.toml", *FAST, "--set", f"{SETTING}push=-1")
    assert "wrong way round" in hour.warned
    assert hour.mistakes >= 25


RING = -np.ones((16, 16))
RING[4:12, 4:12] = 1.0
RING[6:10, 6:10] = -1.0
CENTRE = [[0, 0, 0], [0, 1, 0], [0, 0, 0]]
MINE = 'name = "mine"\nA = [[0, 0, 0], [0, 1, 0], [0, 0, 0]]\nz = -0.5\nduration = 2.0\n'


def test_a_template_designer(hour, tmp_path):
    """With a picture file: from the list to a template of one's own that can be seen."""
    pytest.importorskip("PIL")
    wrong = hour.mistakes_a_command
    assert "EDGE" in hour.does("templates", "list")
    wrong("did you mean 'HOLE'", "templates", "show", "HOEL")
    wrong("No such command 'lst'", "templates", "lst")
    cnnum.save_picture(RING, tmp_path / "ring.png")
    run = ("templates", "show", "HOLE", "--input", "ring.png", *FAST)
    for suffix in ("html", "png", "gif"):
        assert "Written" in hour.does(*run, "--transient", f"hole.{suffix}")
        assert (tmp_path / f"hole.{suffix}").stat().st_size > 100
    wrong("Unknown kind of picture '.avi'", *run, "--transient", "hole.avi")
    wrong("there is no folder 'no'", *run, "--transient", "no/hole.gif")
    wrong("--transient HOLE.html", *run)
    for said, text in (
        ("'A' must have rows of equal length", MINE.replace("[0, 1, 0]", "[1]")),
        ("the key 'A' is missing", 'name = "mine"\n'),
        ("Unknown boundary 'none'", MINE + 'boundary = "none"\n'),
        ("unknown key 'boundry'", MINE + "boundry = 0\n"),
        ("is not valid TOML", MINE + "boundary = \n"),
    ):
        (tmp_path / "mine.toml").write_text(text)
        wrong(said, "templates", "show", "mine.toml")
    more = ("--transient", "a.html", "--input")
    wrong("cannot be read as a picture", "templates", "show", "HOLE", *more, "mine.toml")
    (tmp_path / "mine.toml").write_text(MINE)
    assert "mine" in hour.does("templates", "show", "mine.toml", "--transient", "mine.html", *FAST)
    assert "1 of 1 passed" in hour.does("templates", "check", "EDGE", *FAST)
    wrong("ROWSxCOLS", "templates", "check", "EDGE", "--shape", "8by8")
    wrong("Unknown engine 'cuda'", "templates", "check", "EDGE", "--engine", "cuda")

    engine = cnnum.Engine("numba")
    for said, picture in (
        ("array of bool", RING > 0),
        ("array of uint8", np.where(RING > 0, 0, 255).astype(np.uint8)),
        ("whole numbers of 0 to 255", np.where(RING > 0, 0.0, 255.0)),
        ("rows of different lengths", [[0, 1], [1]]),
    ):
        hour.mistakes_a_call(said, lambda it=picture: engine.run("HOLE", input=it))
    assert (engine.run("HOLE", input=cnnum.as_picture(RING > 0)).output > 0).sum() == 64
    for said, parts in (
        ("rows of different lengths", {"A": [[0, 1], [1]]}),
        ("got None", {"A": None}),
        ("'zero-flux' or 'periodic', got None", {"A": CENTRE, "boundary": None}),
    ):
        hour.mistakes_a_call(said, lambda it=parts: cnnum.Template(name="mine", **it))
    assert hour.mistakes >= 20


@cnnum.program
def rooted(frame):
    return {"root": np.sqrt(frame.normal)}


def averaged(frame):
    return {"mean": np.mean(frame.normal)}


def chosen(frame):
    return {"high": frame.normal if frame.normal > 0 else 0.0}


def test_an_embedded_engineer(hour, tmp_path):
    """With a driver of their own: its cost, before any hardware is chosen."""
    wrong = hour.mistakes_a_command
    (tmp_path / "pad.py").write_text(DRIVER)
    scene = 'needs = ["contact"]\n[array]\ndriver = "pad:Options"\n[program]\nname = "contact"\n'
    (tmp_path / "scene.toml").write_text(scene)
    (plan,) = map(json.loads, hour.does("plan", "scene.toml", *OWN, "--json").splitlines())
    assert plan["flops"] > 0
    assert plan["left_out"]
    for said, setting in (
        ("cannot be imported", "array.driver=pda:Options"),
        ("'Optons'", "array.driver=pad:Optons"),
        ("unknown option 'speed'", "array.speed=3"),
        ("'rate' must be a number", "array.rate=fast"),
        ("Unknown program 'contct'", "program.name=contct"),
    ):
        wrong(said, "plan", "scene.toml", *OWN, "--set", setting)
    wrong("Unknown precision 'half'", "plan", "scene.toml", *OWN, "--precision", "half")
    grouped = hour.does("plan", "scene.toml", *OWN, "--ops", "--json").splitlines()
    rows = [json.loads(line) for line in grouped]
    assert sum(row["flops"] for row in rows) == plan["flops"]
    assert {"program", "line", "count", "flops", "bytes", "live_bytes"} <= set(rows[0])
    by_line = hour.does("plan", "scene.toml", *OWN, "--ops", "--lines").splitlines()
    assert len([row for row in by_line if row.startswith("   line ")]) == len(rows)
    wrong("requires --ops", "plan", "scene.toml", "--lines")
    wrong("give --trust", "plan", "scene.toml", *FAST)
    assert "frames" in hour.does("probe", "pad:Options", "--frames", 20)
    assert "40 frames" in hour.does("record", "pad:Options", "tape.mcap")
    wrong("already exists", "record", "pad:Options", "tape.mcap")
    wrong("Unknown kind of recording '.wav'", "record", "pad:Options", "tape.wav")
    wrong("expected one of the drivers", "probe", "nothing")
    (summary,) = of_kind(hour.does("run", "scene.toml", *OWN, "--json"), "summary")
    assert summary["frames"] == 40
    again = hour.does("replay", "tape.mcap", "--scene", "scene.toml", *OWN, "--json")
    assert of_kind(again, "summary")[0]["handed_on"] == summary["handed_on"]
    wrong("did you mean 'slip'", "export", "slp", "--out", "c")
    wrong("Unknown precision 'q99'", "export", "contact", "--precision", "q99", "--out", "c")

    engine = cnnum.Engine("numba")
    for said, call in (
        ("decorate the function with @cnnum.program", lambda: engine.compile(averaged, (8, 8))),
        ("such as .8, 8., got 8", lambda: engine.compile(rooted, 8)),
        ("'mean' does not accept a field", lambda: engine.compile(cnnum.program(averaged), (8, 8))),
        ("use cnnum.where", lambda: engine.compile(cnnum.program(chosen), (8, 8))),
        ("must be a list of outputs", lambda: engine.compile(rooted, (8, 8), needs="root")),
        ("call plan.frame", lambda: rooted(np.zeros((8, 8, 3)))),
    ):
        hour.mistakes_a_call(said, call)
    assert engine.compile(rooted, (8, 8))(np.full((8, 8, 3), 4.0))["root"] == pytest.approx(2.0)
    assert hour.mistakes >= 17


def test_a_real_shell_shows_one_sentence_and_no_traceback(tmp_path):
    write_counts(tmp_path / "grip.csv")
    command = [sys.executable, "-m", "cnnum", "replay", "grip.csv"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=WAIT)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("cnnum: There is no layout")


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
