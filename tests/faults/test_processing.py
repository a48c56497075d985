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
SCENE = """
needs = ["contact"]
engine.name = "numba"
array = { driver = "file", path = "none.npz" }
program = { name = "contact", parameters = { push = 1.0 } }
"""


def command(folder, name, *options):
    words = [sys.executable, "-m", "cnnum", "process", "set", "--scene", "s.toml", *options]
    return subprocess.Popen(
        [*words, "--out", name], cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def finished(process):
    _, said = process.communicate(timeout=300.0)
    assert process.returncode == 0, said.decode()


def children(process):
    found = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, check=False)
    return [int(word) for word in found.stdout.split()]


def until_parts(folder, name, count, process):
    end = time.monotonic() + 200.0
    while len(list(folder.glob(f"{name}.parts/runs_*"))) < count and process.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.mark.skipif(not FULL, reason="a minute a kill: `make faults` has them")
def test_kills_of_driver_and_workers_leave_the_same_bytes(faults, tmp_path):
    """kill -9 of the command, of its processes and of Dask's workers, ten times in all."""
    (tmp_path / "s.toml").write_text(SCENE)
    (tmp_path / "set").mkdir()
    rng = np.random.default_rng(5)
    for number in range(160):
        values = rng.normal(0.0, 2.0, (60, 3, 3, 3))
        values[40:50, 1, 1, 2] += 900.0
        cnnum.Recording(values, rate=100.0).save(tmp_path / "set" / f"r{number:03d}.mcap")
    (tmp_path / "set" / "r080.mcap").write_bytes(b"junk")
    finished(command(tmp_path, "whole.csv"))
    whole = (tmp_path / "whole.csv").read_bytes()
    assert whole.count(b"\n") > 159
    next(faults.trials(short=1, full=1))
    draw = random.Random(1)
    for step in range(5):  # each is a worker, then the driver
        process = command(tmp_path, "cut.csv", "--workers", "2")
        until_parts(tmp_path, "cut.csv", 1 + 2 * step, process)
        for pid in [draw.choice(children(process) or [0])]:
            if pid:
                os.kill(pid, signal.SIGKILL)
        until_parts(tmp_path, "cut.csv", 2 + 2 * step, process)
        process.send_signal(signal.SIGKILL)
        process.communicate()
    finished(command(tmp_path, "cut.csv", "--workers", "2"))
    assert (tmp_path / "cut.csv").read_bytes() == whole
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options, silence_logs=50) as cluster:
        words = ("--scheduler", cluster.scheduler_address)
        process = command(tmp_path, "spread.csv", *words)
        until_parts(tmp_path, "spread.csv", 2, process)
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        until_parts(tmp_path, "spread.csv", 4, process)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        finished(command(tmp_path, "spread.csv", *words))
    assert (tmp_path / "spread.csv").read_bytes() == whole
    recordings = [
        (tmp_path / f"{name}.recordings.csv").read_bytes() for name in ("whole", "cut", "spread")
    ]
    assert recordings[0] == recordings[1] == recordings[2]
    print("kills survived: 12")
