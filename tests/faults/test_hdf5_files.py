"""HDF5 files that attack or are damaged, and HDF5 on a full disk: one sentence each, no dead."""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cnnum
from cnnum.errors import RecordingError
from cnnum.recordings import hdf5_file
from cnnum.recordings.export import export
from cnnum.recordings.reader import look

h5py = pytest.importorskip("h5py", reason="the extra 'hdf5' is not installed")

HERE = Path(__file__).parent
FULL = os.environ.get("CNNUM_FAULTS") == "full"
LAYOUT = 'shape = [2, 2]\nchannels = ["x", "y", "z"]\nrate = 50.0\nunit = "N"\n'
SHAPE = (20, 2, 2, 3)


def external(folder, file):
    """Numbers of another file, by external storage."""
    (folder / "secret").write_bytes(np.full(SHAPE, 42.0).tobytes())
    stored = [(str(folder / "secret"), 0, h5py.h5f.UNLIMITED)]
    file.create_dataset("values", SHAPE, "f8", external=stored)


def pipe(folder, file):
    """External storage on a pipe, which nobody writes to."""
    os.mkfifo(folder / "pipe")
    file.create_dataset("values", SHAPE, "f8", external=[(str(folder / "pipe"), 0, 1920)])


def virtual(folder, file):
    """Numbers of another file, by a virtual dataset."""
    with h5py.File(folder / "secret.h5", "w") as secret:
        secret["held"] = np.full(SHAPE, 42.0)
    layout = h5py.VirtualLayout(SHAPE, "f8")
    layout[:] = h5py.VirtualSource(folder / "secret.h5", "held", SHAPE)
    file.create_virtual_dataset("values", layout)


def link(folder, file):
    """A link to a dataset of another file."""
    with h5py.File(folder / "secret.h5", "w") as secret:
        secret["held"] = np.full(SHAPE, 42.0)
    file["values"] = h5py.ExternalLink(str(folder / "secret.h5"), "held")


def empty(_, file):
    """A dataset with neither shape nor numbers."""
    file["values"] = h5py.Empty("f8")


def large(_, file):
    """1.6 GB that are nothing but one fill value."""
    file.create_dataset("values", (16_000_000, 2, 2, 3), "f8", chunks=(1000, 2, 2, 3), fillvalue=1)


def large_chunk(_, file):
    """A chunk of 3 GB around few numbers."""
    chunks = (30_000_000, 2, 2, 3)
    file.create_dataset("values", SHAPE, "f8", chunks=chunks, maxshape=(None, *SHAPE[1:]))


def text(_, file):
    """Texts of any length, where numbers belong."""
    file.create_dataset("values", (20,), h5py.string_dtype())


def short_text(_, file):
    """Texts of one length in ASCII, whose codec Python would load on first use."""
    file["values"] = np.full(SHAPE, b"12")


ATTACKS = {
    external: "are in other files",
    pipe: "are in other files",
    virtual: "are in other files",
    link: "has no array 'values'",
    empty: "is empty",
    large: "more than the file can contain",
    large_chunk: "more than the file can contain",
    text: "must contain numbers",
    short_text: "must contain numbers",
}


ATTACK = pytest.mark.promise(
    "An HDF5 file that attacks is refused in one sentence, soon and with little memory."
)

OPEN = """
import json, resource, sys, time
import cnnum
from cnnum.drivers import open_driver
began = time.monotonic()
try:
    open_driver("file", {"path": sys.argv[1]})
    found = "nothing", ""
except cnnum.CnnumError as error:
    found = "CnnumError", str(error)
seconds = time.monotonic() - began
kib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print(json.dumps([*found, seconds, kib]))
"""


@ATTACK
@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.__name__)
def test_a_file_that_attacks_is_refused(tmp_path, attack):
    path = tmp_path / "attack.h5"
    path.with_suffix(".toml").write_text(LAYOUT)
    with h5py.File(path, "w") as file:
        attack(tmp_path, file)
    # the memory of a child counts from that of the process that starts it, and this one's is large
    done = subprocess.run([sys.executable, "-c", OPEN, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    kind, sentence, seconds, kib = json.loads(done.stdout)
    assert kind == "CnnumError"
    assert ATTACKS[attack] in sentence
    assert seconds < hdf5_file.SECONDS
    # HDF5 and NumPy themselves take some 60 MiB; the smallest attack on memory unpacks to 1.6 GB
    assert kib < 1 << 18


@ATTACK
def test_the_child_opens_no_other_file(tmp_path, monkeypatch):
    """Also where a check of ours were wrong: it may not open any."""
    path = tmp_path / "attack.h5"
    with h5py.File(path, "w") as file:
        external(tmp_path, file)
    child = tmp_path / "child.py"
    known = hdf5_file.CHILD.read_text()
    child.write_text(known.replace("if array.external is not None or array.is_virtual:", "if 0:"))
    assert child.read_text() != known
    monkeypatch.setattr(hdf5_file, "CHILD", child)
    with pytest.raises(RecordingError, match="cannot be read"):
        hdf5_file.read_hdf5(path, ["values"])


@ATTACK
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("os.kill(os.getpid(), 11)", "ended the HDF5 library that read it"),
        ("time.sleep(60)", "it took more than 1 s"),
        ('print(\'{"names": ["values"], "arrays": [["<f8", [4]]]}\')', "ended the HDF5"),
        ('print(\'{"names": ["values"], "arrays": [["<f8", [999999999]]]}\')', "ended the"),
    ],
)
def test_a_child_that_dies_or_hangs_is_a_sentence(tmp_path, monkeypatch, body, words):
    path, child = tmp_path / "any.h5", tmp_path / "child.py"
    path.write_bytes(b"any")
    child.write_text(f"import os, time\n{body}\n")
    monkeypatch.setattr(hdf5_file, "CHILD", child)
    monkeypatch.setattr(hdf5_file, "SECONDS", 1.0 if "sleep" in body else 60.0)
    with pytest.raises(RecordingError, match=words):
        hdf5_file.read_hdf5(path, ["values"])


def test_damaged_hdf5_files_are_read_or_refused(faults, tmp_path):
    """A damaged HDF5 file is read or refused: no raw error, and none that ends or holds us."""
    count = 100_000 if FULL else 150
    command = [sys.executable, str(HERE / "hdf5_forks.py"), str(tmp_path / "forks")]
    seed = int(os.environ.get("CNNUM_SEED", "0"))
    done = subprocess.run([*command, str(seed), str(count)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    print(found)
    assert sum(1 for _ in faults.trials(short=150, full=100_000)) == count == found["tried"]
    for number in range(found["raw"] + found.get("raw in the child", 0) + found.get("late", 0)):
        faults.lose(f"{number}: {found['first']}")
    # damage that changed nothing, or that nothing noticed, were no test
    assert found["read"] < 0.8 * count
    assert found["refused"] > 0.2 * count


def test_a_full_disk_ends_a_file_and_not_the_process(faults, tmp_path):
    """HDF5 on a full disk leaves no file and raises one sentence, wherever the disk ends."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=(2000, 4, 4, 3))
    axes = ("shear_x", "shear_y", "normal")
    tape = cnnum.Recording(values, rate=100.0, unit="N", channels=axes).save(tmp_path / "tape.mcap")
    contents, whole = look(tape), tmp_path / "whole.h5"
    export(contents, whole)
    size = whole.stat().st_size
    with h5py.File(whole) as file:
        assert np.array_equal(file["values"][...], values)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for trial in faults.trials(short=12, full=200):
        target = tmp_path / "cut.h5"
        room = (0, 1, 95, 96, 2048)[trial] if trial < 5 else int(rng.integers(size))
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
        try:
            export(contents, target)
            faults.lose(f"{room} bytes: it was written")
        except RecordingError as error:
            if "\n" in str(error):
                faults.lose(f"{room} bytes: {error}")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        if target.exists() or len(list(tmp_path.iterdir())) != 2:
            faults.lose(f"{room} bytes: left {list(tmp_path.iterdir())}")
