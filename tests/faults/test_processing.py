"""Many recordings whose driver or workers are killed end in the same tables, here and on Dask."""

import csv
import importlib.util
import os
import random
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import cnnum

ROOT = Path(__file__).parents[2]
FULL = os.environ.get("CNNUM_FAULTS") == "full"
MANY = int(os.environ.get("CNNUM_MANY", "160"))
"""Recordings; the page on many recordings tells of 10,000."""

FIELDS = MANY <= 1000
"""Whether their fields are written, too, which takes three times as long as the tables."""

TABLE = "csv" if importlib.util.find_spec("pyarrow") is None else "parquet"

SCENE = """
needs = ["contact", "load_normal"]
engine.name = "numba"
array = { driver = "file", path = "none.npz" }
program = { name = "contact", parameters = { push = 1.0 } }
"""


def command(folder, name, *options):
    words = [sys.executable, "-m", "cnnum", "process", "set", "--scene", "s.toml", *options]
    words += ["--out", f"{name}.{TABLE}", *(["--fields", f"{name}.zarr"] if FIELDS else [])]
    return subprocess.Popen(
        words, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def finished(process):
    """Wait for a command, and return the most memory that it and a child of it took, in MB."""
    most = [0.0, 0.0]

    def watch():
        while process.poll() is None:
            for place, pids in enumerate(([process.pid], children(process))):
                most[place] = max([most[place], *map(memory, pids)])
            time.sleep(0.2)

    watcher = threading.Thread(target=watch)
    watcher.start()
    _, said = process.communicate(timeout=300.0 + MANY)
    watcher.join()
    assert process.returncode == 0, said.decode()
    return [round(size) for size in most]


def memory(pid):
    """Return the largest resident size so far, in MB, or 0 where the system does not say it."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024.0
    return 0.0


def children(process):
    found = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, check=False)
    return [int(word) for word in found.stdout.split()]


def results(folder, name):
    """Return all files of a run: the two tables, and the fields."""
    fields, kinds = folder / f"{name}.zarr", (TABLE, f"recordings.{TABLE}")
    return {
        **{kind: (folder / f"{name}.{kind}").read_bytes() for kind in kinds},
        **{p.relative_to(fields): p.read_bytes() for p in fields.rglob("*") if p.is_file()},
    }


def rows(path):
    """Return the rows of a table."""
    if TABLE == "csv":
        return list(csv.DictReader(path.read_text().splitlines()))
    return importlib.import_module("pyarrow.parquet").read_table(path).to_pylist()


def until_parts(folder, name, count, process):
    end = time.monotonic() + 200.0 + MANY
    while len(list(folder.glob(f"{name}.{TABLE}.parts/runs_*"))) < count and process.poll() is None:
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
    most = finished(command(tmp_path, "whole", "--workers", "2"))
    print(f"{MANY} recordings: {time.monotonic() - begin:.0f} s on two processes, {most} MB")
    whole = results(tmp_path, "whole")
    pressed = {row["recording"] for row in rows(tmp_path / f"whole.{TABLE}")}
    errors = [row["error"] for row in rows(tmp_path / f"whole.recordings.{TABLE}")]
    assert len(pressed) == MANY - 1 == errors.count(None if TABLE == "parquet" else "")
    assert len(whole) > 5 * (MANY - 1) * FIELDS
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
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
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
        print(f"on Dask: {finished(command(tmp_path, 'spread', *words))} MB")
    assert kills == 10
    assert results(tmp_path, "spread") == whole
    print("kills survived: 10 on processes, 10 on Dask")
