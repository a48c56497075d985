"""Sweeps whose process is killed."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXPERIMENT = """
template = "HOLE"
draws = 40
engine = "numba"
chunk = 5
[axes]
mismatch = [0.0, 0.1]
"""


def command(folder, name):
    words = [sys.executable, "-m", "cnnum", "sweep", "e.toml", "--output", name]
    path = {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        words, cwd=folder, env=os.environ | path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def finished(process):
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said.decode()


def test_a_killed_sweep_ends_in_the_same_file(faults, tmp_path):
    """A sweep that is killed at any moment goes on where it was, and ends in the same bytes."""
    pytest.importorskip("xarray", reason="the extra 'tables' is not installed")
    (tmp_path / "e.toml").write_text(EXPERIMENT)
    finished(command(tmp_path, "whole.nc"))
    whole = (tmp_path / "whole.nc").read_bytes()
    for trial in faults.trials(short=1, full=12):
        name, wanted = f"{trial}.nc", random.Random(trial).randint(1, 14)
        process = command(tmp_path, name)
        parts = tmp_path / f"{name}.parts"
        until = time.monotonic() + 60.0
        while len(list(parts.glob("runs_*.npz"))) < wanted and process.poll() is None:
            assert time.monotonic() < until
            time.sleep(0.002)
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
        process.communicate()
        kept = {path.name: path.stat().st_mtime_ns for path in parts.glob("runs_*.npz")}
        finished(command(tmp_path, name))
        if (tmp_path / name).read_bytes() != whole:
            faults.lose(f"the file of trial {trial} differs, after {len(kept)} tasks")
    assert not list(tmp_path.glob("*.parts"))
