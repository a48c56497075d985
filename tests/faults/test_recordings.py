"""Recordings under kills, signals and full disks: stored frames are there."""

import json
import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path

import pytest
from played_recordings import frames_in
from same_frames import same

from cnnum.drivers import open_driver
from cnnum.frame import Frame

WORKERS = 6
WAIT = 20.0  # s after which a recorder counts as hung; none takes a tenth of it
PROMISED = 1.0  # s: frames older than this are in the file
ARRAY = {
    "seed": 11,
    "shape": [3, 3],
    "script": [
        {"kind": "press", "load": 1.0, "duration": 0.2},
        {"kind": "hold", "duration": 1000.0},
    ],
}
SCRIPT = 'script=[{kind="press",load=1.0,duration=0.2},{kind="hold",duration=1000}]'
SETTINGS = ["--set", "seed=11", "--set", "shape=[3,3]", "--set", SCRIPT]


class Recorder:
    """A process that runs `cnnum record` in a child of its own, one after the other."""

    def __init__(self, prefix: tuple[str, ...] = ()) -> None:
        root = Path(__file__).parents[2]
        paths = [str(root), os.environ.get("PYTHONPATH", "")]
        self._process = subprocess.Popen(
            [*prefix, sys.executable, str(Path(__file__).with_name("recorder.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": ":".join(paths)},
        )

    def start(self, **job: object) -> int:
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()
        return int(self._process.stdout.readline())

    def ended(self) -> int:
        return int(self._process.stdout.readline())

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait(WAIT)
        self._process.stdout.close()


class Tape:
    """The frames of the seeded array, in their order, each as often as it is asked for."""

    def __init__(self) -> None:
        self._source = open_driver("simulated", ARRAY).frames()
        self._frames: list[Frame] = []

    def begins_with(self, frames: list[Frame]) -> bool:
        """Whether these are the first frames of the array, bit for bit."""
        self._frames += islice(self._source, max(0, len(frames) - len(self._frames)))
        return all(map(same, frames, self._frames))


@pytest.fixture
def call():
    from click.testing import CliRunner

    from cnnum.cli import main

    return lambda *arguments: CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def tape() -> Tape:
    return Tape()


@pytest.fixture(scope="module")
def recorders() -> Iterator[list[Recorder]]:
    made = [Recorder() for _ in range(WORKERS)]
    yield made
    for recorder in made:
        recorder.close()


def in_turn(recorders: list[Recorder], work, cases) -> list:
    """Do work on cases, on all recorders at once."""
    cases = list(cases)

    def share(number: int) -> list:
        return [work(recorders[number], case) for case in cases[number :: len(recorders)]]

    with ThreadPoolExecutor(len(recorders)) as pool:
        return [item for part in pool.map(share, range(len(recorders))) for item in part]


def moments(log: Path) -> list[int]:
    data = log.read_bytes() if log.exists() else b""
    return [moment for (moment,) in struct.iter_unpack("<q", data[: len(data) // 8 * 8])]


def until_first(log: Path) -> None:
    """Wait for the first frame, at most a minute."""
    end = time.monotonic() + 60
    while time.monotonic() < end and not moments(log):
        time.sleep(0.02)


SOURCES = ({}, {"pause": 0.002}, {"pause": 0.3}, {"pause": 0.01, "stall": 20}, {"stall": 3})
"""As fast as it goes; quick; slow; and arrays that fall silent."""


def test_kill(faults, recorders, tape, tmp_path):
    """Frames that came more than a second before kill -9 are in the file, bit for bit."""
    rng = random.Random(5)

    def one(recorder: Recorder, trial: int) -> tuple[int, Path, int]:
        suffix, life = (".mcap", ".npz", ".csv")[trial % 3], rng.uniform(0.05, 2.2)
        target, log = tmp_path / f"{trial}{suffix}", tmp_path / f"{trial}.log"
        pid = recorder.start(
            arguments=["record", "simulated", str(target), *SETTINGS],
            said=str(tmp_path / f"{trial}.said"),
            log=str(log),
            **SOURCES[trial % len(SOURCES)],
        )
        if trial % 2:  # half of them are killed after frames came, however slow the machine is
            until_first(log)
        time.sleep(life)
        killed = time.monotonic_ns()
        os.kill(pid, signal.SIGKILL)
        assert recorder.ended() == -signal.SIGKILL
        path = target if suffix == ".mcap" else target.with_name(f"{target.name}.recording.mcap")
        return sum(m < killed - PROMISED * 1e9 for m in moments(log)), path, trial

    kept = 0
    for promised, path, trial in in_turn(recorders, one, faults.trials(short=10, full=200)):
        found = frames_in(path) if path.exists() else []
        kept += len(found)
        if len(found) < promised:
            faults.lose(f"{promised - len(found)} of {promised} frames of trial {trial}")
        if not tape.begins_with(found):
            faults.lose(f"frames of trial {trial} are not those of the array")
    assert kept > 100


@pytest.mark.parametrize("suffix", [".mcap", ".npz", ".csv"])
def test_signal(faults, recorders, tape, tmp_path, suffix):
    """SIGINT, SIGTERM and SIGHUP end a recording in order: every frame recorded is in the file."""
    rng = random.Random(6)
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def one(recorder: Recorder, trial: int) -> tuple[int, str, int, Path, int]:
        target, log = tmp_path / f"{trial}{suffix}", tmp_path / f"{trial}.log"
        said = tmp_path / f"{trial}.said"
        pid = recorder.start(
            arguments=["record", "simulated", str(target), *SETTINGS, "--json"],
            said=str(said),
            log=str(log),
            pause=0.002,
        )
        deadline = time.monotonic() + WAIT
        while len(moments(log)) < 3:
            assert time.monotonic() < deadline, said.read_text()
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.7))
        os.kill(pid, numbers[trial % 3])
        return recorder.ended(), said.read_text(), len(moments(log)), target, trial

    for code, said, came, target, trial in in_turn(recorders, one, faults.trials(short=3, full=12)):
        report = json.loads(said)
        # the last frame may have been on its way to the recorder when the signal came
        whole = code == 130 and report["lost"] == 0 and came - 1 <= report["frames"] <= came
        if not whole or not target.exists():
            faults.lose(f"trial {trial}: exit code {code}, {said}")
        elif suffix == ".csv":
            if len(target.read_text().splitlines()) != 1 + report["frames"]:
                faults.lose(f"trial {trial}: rows of the table")
        else:
            found = frames_in(target)
            if len(found) != report["frames"] or not tape.begins_with(found):
                faults.lose(f"trial {trial}: {len(found)} frames of {report['frames']}")
    assert not list(tmp_path.glob("*.recording.mcap"))


def full_disk(faults, tape, target: Path, code: int, said: str, count: int, what: str) -> None:
    """Check the sentence and the files of a recording that met a full disk."""
    journal = target.with_name(f"{target.name}.recording.mcap")
    if code == 0:
        if target.suffix != ".csv" and len(frames_in(target)) != count:
            faults.lose(f"{what}: frames of a recording that ended well")
        if journal.exists():
            faults.lose(f"{what}: a journal is left of a recording that ended well")
        return
    sentences = [line for line in said.splitlines() if line.startswith("cnnum: ")]
    path = target if target.suffix == ".mcap" else journal
    found = frames_in(path) if path.exists() else []
    if code != 2 or len(sentences) != 1 or "Traceback" in said:
        faults.lose(f"{what}: exit code {code}: {said}")
    elif found and not (
        f"{len(found)} frames are kept in " in sentences[0] and path.name in sentences[0]
    ):
        faults.lose(f"{what}: {len(found)} frames are in '{path}': {said}")
    elif not found and "none of" not in said and "cannot be written" not in said:
        faults.lose(f"{what}: {said}")
    if not tape.begins_with(found):
        faults.lose(f"{what}: frames are not those of the array")
    if target != path and target.exists():
        faults.lose(f"{what}: a torn '{target.name}' is there")
    drafts = [item for item in target.parent.iterdir() if item.name.endswith(".part")]
    if drafts:
        faults.lose(f"{what}: a draft is left")


COUNT = 120
SIZES = [4096 * n for n in range(1, 51)]  # to 205 kB: a journal and the file fit


@pytest.mark.parametrize("suffix", [".mcap", ".npz", ".csv"])
def test_limit(faults, recorders, tape, tmp_path, suffix):
    """A recording that reaches the largest size of a file keeps its frames, and says so."""

    def one(recorder: Recorder, trial: int):
        limit, folder = SIZES[trial] + 117 * trial, tmp_path / str(trial)
        folder.mkdir()
        target, said = folder / f"x{suffix}", tmp_path / f"{trial}.said"
        arguments = ["record", "simulated", str(target), *SETTINGS, "--frames", str(COUNT)]
        recorder.start(arguments=arguments, said=str(said), limit=limit)
        return target, recorder.ended(), said.read_text(), limit

    for target, code, said, limit in in_turn(recorders, one, faults.each(range(50), short=5)):
        full_disk(faults, tape, target, code, said, COUNT, f"{limit} bytes")


@pytest.fixture(scope="module")
def mounting() -> Iterator[Recorder | None]:
    """A recorder that may mount file systems of its own; None where nothing lets it."""
    trial = ["unshare", "-rm", "mount", "-t", "tmpfs", "none", "/mnt"]
    known = shutil.which("unshare") is not None
    if not known or subprocess.run(trial, capture_output=True, check=False).returncode:
        yield None
        return
    recorder = Recorder(("unshare", "-rm"))
    yield recorder
    recorder.close()


@pytest.mark.parametrize("suffix", [".mcap", ".npz", ".csv"])
def test_full_disk(faults, mounting, tape, tmp_path, suffix):
    """A recording on a disk that gets full keeps all that was stored, and says how much that is."""
    if mounting is None:
        faults.tried = 1  # an account of nothing would fail
        pytest.skip("no user may mount a file system here")
    disk = tmp_path / "disk"
    disk.mkdir()
    for size in faults.each(SIZES, short=5):
        copy, said = tmp_path / str(size), tmp_path / f"{size}.said"
        target = disk / f"x{suffix}"
        arguments = ["record", "simulated", str(target), *SETTINGS, "--frames", str(COUNT)]
        mounting.start(
            arguments=arguments, said=str(said), disk=str(disk), size=size, copy=str(copy)
        )
        code, what = mounting.ended(), f"{size} bytes"
        full_disk(faults, tape, copy / target.name, code, said.read_text(), COUNT, what)


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_file_that_appears(faults, recorders, tape, call, tmp_path, suffix):
    """A file that appears while recording is not replaced, and no frame is lost for it."""
    for trial in faults.trials(short=1, full=5):
        target, said = tmp_path / f"{trial}{suffix}", tmp_path / f"{trial}.said"
        arguments = ["record", "simulated", str(target), *SETTINGS, "--frames", "20"]
        log = str(tmp_path / f"{trial}.log")
        recorders[0].start(arguments=arguments, said=str(said), log=log, appears=str(target))
        code, journal = recorders[0].ended(), target.with_name(f"{target.name}.recording.mcap")
        found = frames_in(journal)
        if target.read_text() != "of another program" or len(found) != 20:
            faults.lose(f"trial {trial}: {said.read_text()}")
        if code != 2 or f"'cnnum recover {journal} OUT'" not in said.read_text():
            faults.lose(f"trial {trial}: exit code {code}, {said.read_text()}")
        other = tmp_path / f"{trial}-other.npz"
        assert call("recover", journal, other).exit_code == 0
        if not tape.begins_with(frames_in(other)) or len(frames_in(other)) != 20:
            faults.lose(f"trial {trial}: the recovered frames")


@pytest.mark.parametrize("suffix", [".mcap", ".npz"])
def test_kill_with_force(faults, recorders, tape, tmp_path, suffix):
    """With --force, the old file is whole until the new one is complete."""
    for trial in faults.trials(short=1, full=5):
        target, log = tmp_path / f"{trial}{suffix}", tmp_path / f"{trial}.log"
        target.write_text("old")
        arguments = ["record", "simulated", str(target), *SETTINGS, "--force"]
        said = str(tmp_path / f"{trial}.said")
        pid = recorders[0].start(arguments=arguments, said=said, log=str(log), pause=0.002)
        time.sleep(1.5 + 0.1 * trial)
        os.kill(pid, signal.SIGKILL)
        recorders[0].ended()
        found = frames_in(target.with_name(f"{target.name}.recording.mcap"))
        if target.read_text() != "old" or not found or not tape.begins_with(found):
            faults.lose(f"trial {trial}: {len(found)} frames")
