"""Many recordings whose driver or workers are killed end in the same tables, here and on Dask."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import cnnum

ROOT = Path(__file__).parents[2]
FULL = os.environ.get("CNNUM_FAULTS") == "full"
MANY = int(os.environ.get("CNNUM_MANY", "160"))
"""Recordings; the page on many recordings tells of 10,000."""

SCENE = """
needs = ["contact", "load_normal"]
engine.name = "numba"
array = { driver = "file", path = "none.npz" }
program = { name = "contact", parameters = { push = 1.0 } }
"""


def command(folder, name, *options):
    words = [sys.executable, "-m", "cnnum", "process", "set", "--scene", "s.toml", *options]
    words += ["--out", f"{name}.csv", "--fields", f"{name}.zarr"]
    return subprocess.Popen(
        words, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def finished(process):
    _, said = process.communicate(timeout=300.0 + MANY)
    assert process.returncode == 0, said.decode()


def children(process):
    found = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, check=False)
    return [int(word) for word in found.stdout.split()]


def results(folder, name):
    """Return all files of a run: the two tables, and the fields."""
    fields = folder / f"{name}.zarr"
    return {
        **{kind: (folder / f"{name}.{kind}").read_bytes() for kind in ("csv", "recordings.csv")},
        **{p.relative_to(fields): p.read_bytes() for p in fields.rglob("*") if p.is_file()},
    }


def until_parts(folder, name, count, process):
    end = time.monotonic() + 200.0 + MANY
    while len(list(folder.glob(f"{name}.csv.parts/runs_*"))) < count and process.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.mark.skipif(not FULL, reason="a minute a kill: `make faults` has them")
def test_kills_of_driver_and_workers_leave_the_same_bytes(faults, tmp_path):
    """kill -9 of the command, of its processes and of Dask's workers, ten times on each."""
    (tmp_path / "s.toml").write_text(SCENE)
    (tmp_path / "set").mkdir()
    rng = np.random.default_rng(5)
    for number in range(MANY):
        values = rng.normal(0.0, 2.0, (60, 3, 3, 3))
        values[40:50, 1, 1, 2] += 900.0
        cnnum.Recording(values, rate=100.0).save(tmp_path / "set" / f"r{number:05d}.mcap")
    (tmp_path / "set" / "r00080.mcap").write_bytes(b"junk")
    begin = time.monotonic()
    finished(command(tmp_path, "whole", "--workers", "2"))
    print(f"{MANY} recordings: {time.monotonic() - begin:.0f} s on two processes")
    whole = results(tmp_path, "whole")
    assert whole["csv"].count(b"\n") >= MANY
    assert len(whole) > 5 * (MANY - 1)
    next(faults.trials(short=1, full=1))
    draw, stride = random.Random(1), max(1, MANY // 160)
    for step in range(5):  # each is a worker, then the driver
        process = command(tmp_path, "cut", "--workers", "2")
        until_parts(tmp_path, "cut", (1 + 2 * step) * stride, process)
        for pid in [draw.choice(children(process) or [0])]:
            if pid:
                os.kill(pid, signal.SIGKILL)
        until_parts(tmp_path, "cut", (2 + 2 * step) * stride, process)
        process.send_signal(signal.SIGKILL)
        process.communicate()
    finished(command(tmp_path, "cut", "--workers", "2"))
    assert results(tmp_path, "cut") == whole
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    kills = 0
    with distributed.LocalCluster(**options, silence_logs=50) as cluster:
        words = ("--scheduler", cluster.scheduler_address)
        for step in range(5):
            process = command(tmp_path, "spread", *words)
            until_parts(tmp_path, "spread", (1 + 2 * step) * stride, process)
            os.kill(draw.choice([*cluster.workers.values()]).pid, signal.SIGKILL)
            until_parts(tmp_path, "spread", (2 + 2 * step) * stride, process)
            kills += 1 + (process.poll() is None)
            process.send_signal(signal.SIGKILL)
            process.communicate()
        finished(command(tmp_path, "spread", *words))
    assert kills == 10
    assert results(tmp_path, "spread") == whole
    print("kills survived: 10 on processes, 10 on Dask")
