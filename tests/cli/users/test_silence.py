"""No silence: long work says so, and a stopped command says how far it came."""

import json
import os
import pty
import resource
import select
import signal
import subprocess
import sys
import time

import pytest

from cnnum.lab.scoring import family_tables
from cnnum.lab.scoring.families.catalogue import FAMILIES

WAIT = 60.0  # s after which a command counts as hung


def on_a_terminal(arguments, until):
    """Run a command on a terminal of 80 columns until it writes a text, or ends."""
    here, there = pty.openpty()
    began = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "cnnum", *map(str, arguments)],
        stdin=there, stdout=there, stderr=there, env={**os.environ, "COLUMNS": "80"},
    )  # fmt: skip
    os.close(there)
    seen = b""
    try:
        while time.monotonic() - began < WAIT and (not until or until.encode() not in seen):
            if not select.select([here], [], [], 1.0)[0]:
                continue
            try:
                seen += os.read(here, 1 << 16)
            except OSError:  # the other end is closed
                break
        return seen.decode(errors="replace"), time.monotonic() - began
    finally:
        process.kill()
        process.wait()
        os.close(here)


def test_compiling_is_said_at_once():
    """Within half a second on a machine at rest; three here, as others work on it, too."""
    text, seconds = on_a_terminal(["run", "demo", "--engine", "numba"], "compiling…")
    assert "compiling…" in text
    assert seconds < 3.0


def test_a_second_start_prints_its_first_event_soon():
    """Within 1.5 s on a machine at rest, most of it processor time; twice that here.

    The import of these parts of SciPy was heavy, for a scene that calls none of them.
    """
    command = [sys.executable, "-X", "importtime", "-m", "cnnum", "run", "demo", "--frames", "99"]
    place = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run(command, capture_output=True, check=True, timeout=WAIT, env=place)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    again = subprocess.run(
        command, capture_output=True, check=True, timeout=WAIT, env=place, text=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert "contact" in again.stdout.splitlines()[0]
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 3.0
    loaded = {line.split("|")[-1].strip() for line in again.stderr.splitlines()}
    assert "cnnum.scenes.pipeline" in loaded
    heavy = {"interpolate", "linalg", "ndimage", "optimize", "signal", "special", "stats"}
    assert not loaded & {*(f"scipy.{part}" for part in heavy), "matplotlib", "numba"}


def test_the_list_of_templates_fits_eighty_columns_and_says_what_they_do():
    text, _ = on_a_terminal(["templates", "list"], "")
    lines = text.splitlines()
    assert max(len(line.replace("\x1b[1m", "").replace("\x1b[0m", "")) for line in lines) <= 80
    assert "what it does" in text
    assert "Outlines of black objects" in text
    assert "No room" not in text


def test_wide_has_the_sizes(call):
    heads = [call("templates", "list", *wide).stdout.split("─")[0] for wide in ((), ("--wide",))]
    assert "radius" not in heads[0]
    assert "radius" in heads[1]


@pytest.mark.parametrize(
    ("arguments", "what"),
    [(["templates", "check", "--engine", "numba"], "checks"), (["reproduce"], "items")],
)
def test_a_stopped_command_prints_what_was_done(arguments, what):
    command = [sys.executable, "-m", "cnnum", *arguments, "--json"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as running:
        assert running.stdout.readline().startswith("{")
        running.send_signal(signal.SIGTERM)
        _, said = running.communicate(timeout=WAIT)
        assert running.returncode == 130
    assert "Stopped after " in said
    assert said.rstrip().endswith(f" {what}.")


def test_a_stopped_score_prints_the_figures_of_what_was_done(monkeypatch, call):
    """The signal comes when the second family is drawn."""
    first, second = (family.name for family in FAMILIES[:2])
    real = family_tables._drawn

    def drawn(name, count, seed):
        if name == second:
            os.kill(os.getpid(), signal.SIGTERM)
        return real(name, count, seed)

    monkeypatch.setattr(family_tables, "_drawn", drawn)
    done = call("score", "--suite", "families", "--quick", "--engine", "numba", "--json")
    assert done.exit_code == 130
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(row["family"], row["scenes"]) for row in rows] == [(first, 1)]
    assert 0.0 <= rows[0]["found"] <= 1.0
    assert f"Stopped after 1 of {len(FAMILIES)} families and trials." in done.stderr


def test_a_stopped_demo_prints_its_summary(tmp_path):
    command = [sys.executable, "-m", "cnnum", "demo", "--json", "--out", str(tmp_path / "o.html")]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as running:
        assert json.loads(running.stdout.readline())["kind"] == "contact"
        running.send_signal(signal.SIGTERM)
        rest, _ = running.communicate(timeout=WAIT)
        assert running.returncode == 130
    summary = json.loads(rest.splitlines()[-1])
    assert summary["kind"] == "summary"
    assert 0 < summary["frames"] < 1500


@pytest.mark.parametrize(
    "command",
    ["reproduce --out", "demo --out", "score --out", "stability --out", "templates gallery --out",
     "sweep experiment.toml --page", "sweep experiment.toml --output",
     "calibrate scan.csv --youngs-modulus 1e6 --out"],
)  # fmt: skip
def test_a_folder_that_is_not_there_is_said_before_the_work(call, command):
    began = time.monotonic()
    done = call(*command.split(), "no/such/page.html")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "there is no folder 'no/such'" in done.stderr
    assert time.monotonic() - began < 5.0  # all of either takes many times as long
