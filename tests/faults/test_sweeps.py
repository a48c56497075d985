"""Sweeps whose process is killed, or a worker of whose cluster."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FULL = os.environ.get("CNNUM_FAULTS") == "full"
EXPERIMENT = """
template = "HOLE"
draws = 40
engine = "numba"
chunk = 5
[axes]
mismatch = [0.0, 0.1]
"""


LARGE = """
template = "HOLE"
draws = 2000
pictures = 2
[axes]
mismatch = { from = 0.0, to = 0.2, count = 10 }
noise = [0.0, 0.1, 0.2, 0.3, 0.4]
"""


SECONDS = 600.0
"""Of a sweep of 100,000 runs, on a machine that does other things too."""


def command(folder, name, *options):
    words = [sys.executable, "-m", "cnnum", "sweep", "e.toml", "--output", name, *options]
    path = {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        words, cwd=folder, env=os.environ | path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def finished(process, seconds=120.0):
    _, said = process.communicate(timeout=seconds)
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


def parts_of(folder, name):
    return {path.name: path.stat().st_mtime_ns for path in folder.glob(f"{name}.parts/runs_*.npz")}


def until(true, seconds):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.mark.skipif(not FULL, reason="100,000 runs take minutes: `make faults` has them")
@pytest.mark.filterwarnings("ignore")  # of a library that loses a worker, as it should
def test_a_cluster_that_loses_driver_and_worker_ends_in_the_same_file(faults, tmp_path):
    """kill -9 of a worker, then of the driver, in a sweep of 100,000 runs."""
    next(faults.trials(short=1, full=1))
    pytest.importorskip("xarray", reason="the extra 'tables' is not installed")
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    (tmp_path / "e.toml").write_text(LARGE)
    begin = time.monotonic()
    finished(command(tmp_path, "whole.nc"), SECONDS)
    alone = time.monotonic() - begin
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
    with distributed.LocalCluster(**options, silence_logs=50) as cluster:
        words = ("--scheduler", cluster.scheduler_address)
        driver = command(tmp_path, "spread.nc", *words)
        until(lambda: len(parts_of(tmp_path, "spread.nc")) >= 3, SECONDS)
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        until(lambda: len(parts_of(tmp_path, "spread.nc")) >= 8, SECONDS)
        driver.send_signal(signal.SIGKILL)
        driver.communicate()
        kept = parts_of(tmp_path, "spread.nc")
        again = command(tmp_path, "spread.nc", *words)
        until(
            lambda: len(parts_of(tmp_path, "spread.nc")) > len(kept) or again.poll() == 0, SECONDS
        )
        found = parts_of(tmp_path, "spread.nc")
        assert not found or {name: found[name] for name in kept} == kept  # none was done twice
        begin = time.monotonic()
        finished(again, SECONDS)
        rest = time.monotonic() - begin
        print(f"alone {alone:.1f} s; {len(kept)} tasks kept; the others {rest:.1f} s")
    assert (tmp_path / "spread.nc").read_bytes() == (tmp_path / "whole.nc").read_bytes()
