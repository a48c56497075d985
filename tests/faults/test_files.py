"""Files of wrong content, wrong kind or wrong size: one sentence, little memory, no waiting."""

import os
import random
import resource
import signal
import socket
import struct
import subprocess
import sys
import warnings
import zipfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from cnnum.drivers.npz_file import KIND, SPARED, read_npz
from cnnum.drivers.recording_file import load_recording
from cnnum.drivers.text_table import read_table
from cnnum.drivers.uskin_csv import UskinCsvOptions
from cnnum.errors import CnnumError
from cnnum.safety.reading import open_regular
from cnnum.scenes.scene_file import read_scene
from cnnum.tactile.taxel import calibration
from cnnum.templating.files import load_template

SECONDS = 5  # more than any bounded file takes, less than a wait for a writer that never comes
ROOT = Path(__file__).parents[2]
READERS = {
    "recording.npz": read_npz,
    "table.csv": read_table,
    "scene.toml": read_scene,
    "calibration.toml": calibration.load,
    "template.toml": load_template,
}
TOMLS = {
    "scene.toml": b'name = "x"\nneeds = ["contact"]\n[array]\ndriver = "simulated"\nseed = 3\n'
    b'[program.parameters]\npush = -1.0\n[engine]\nprecision = "float64"\n',
    "calibration.toml": b'kind = "taxel calibration"\nalpha_normal = 0.1\nlimit = 5.0\n'
    b"offsets = [0.0, 0.1, 0.2, 0.3]\n[heat]\namplitude = 0.0\n",
    "template.toml": b'name = "t"\nA = [[0, 0, 0], [0, 2, 0], [0, 0, 0]]\nz = -1\n'
    b'boundary = "zero-flux"\n[check]\nname = "none"\n',
}


def archive(path, *, compressed):
    """Write a recording of seven frames with a calibration."""
    frames = 7
    (np.savez_compressed if compressed else np.savez)(
        path,
        kind=KIND,
        channels=["left", "right", "top", "bottom"],
        unit="V",
        rate=200.0,
        truths=np.array(["slip"]),
        values=np.zeros((frames, 2, 3, 4)),
        sequence=np.arange(frames),
        time=np.arange(frames) / 200,
        quality=np.zeros(frames, np.int64),
        truth=np.zeros((frames, 1)),
        calibration_alpha_normal=0.1,
        calibration_beta_ns=1.5,
        calibration_limit=5.0,
        calibration_depth=1e-3,
        calibration_offsets=np.zeros(4),
        calibration_cross=np.eye(3),
        calibration_drift=np.zeros(4),
        calibration_heat=[0.0, 1.0],
    )


@contextmanager
def soon():
    """Raise in a block that takes longer than it may."""

    def late(*_):
        raise TimeoutError(f"more than {SECONDS} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def fault_of(call, *arguments, may_pass=True):
    """Return the fault in the way in which a call ends; None where there is none."""
    try:
        with soon():
            call(*arguments)
    except CnnumError as error:
        said = str(error)
        return None if said.endswith(".") and "\n" not in said else f"not one sentence: {said:.200}"
    except Exception as error:
        return f"{type(error).__name__}: {error!s:.200}"
    return None if may_pass else "it was read"


def damaged(content, rng, places):
    """Return content with bytes flipped, set, cut off, put in, or taken out at such places."""
    bad = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = min(rng.choice(places), max(0, len(bad) - 1))
        kind = rng.randrange(6)
        if kind == 0 and bad:
            bad[at] ^= 1 << rng.randrange(8)
        elif kind == 1 and bad:
            bad[at] = rng.choice((0, 1, 10, 0x27, 0x28, 0x7F, 0x80, 0xFF, rng.randrange(256)))
        elif kind == 2 and rng.random() < 0.2:
            del bad[at:]
        elif kind == 3:
            bad[at:at] = rng.randbytes(rng.choice((1, 2, 8, 100)))
        elif kind == 4:
            del bad[at : at + rng.choice((1, 2, 4, 30))]
        else:
            number = rng.choice((0, 1, 0x7FFFFFFF, 0xFFFFFFFF, rng.randrange(2**32)))
            bad[at : at + 4] = struct.pack("<I", number)
    return bytes(bad)


def headers(content):
    """Return the places of an archive's headers: of members, of arrays, and of the directory."""
    starts = [n for n in range(len(content)) if content[n : n + 2] in (b"PK", b"\x93N")]
    return [place for start in starts for place in range(start, min(start + 128, len(content)))]


@pytest.mark.parametrize("compressed", [False, True], ids=["stored", "deflated"])
def test_damaged_recordings(faults, tmp_path, compressed):
    """A recording with damaged bytes is read, or refused in one sentence."""
    path = tmp_path / "recording.npz"
    archive(path, compressed=compressed)
    content, rng = path.read_bytes(), random.Random(7 + compressed)
    places = headers(content)
    assert len(read_npz(path).values) == 7
    read = []
    for trial in faults.trials(short=400, full=10_000):
        path.write_bytes(damaged(content, rng, places))
        if fault := fault_of(read_frames, path, read):
            faults.lose(f"trial {trial}: {fault}")
    assert len(read) < 0.75 * faults.tried  # the damage does damage


def test_an_archive_of_a_later_kind_is_refused(tmp_path):
    """`zipfile` raises NotImplementedError for it; guided fuzzing found that."""
    path = tmp_path / "recording.npz"
    archive(path, compressed=False)
    content = bytearray(path.read_bytes())
    content[content.index(b"PK\x01\x02") + 6] = 200  # the version that it takes to read it
    path.write_bytes(content)
    with pytest.raises(CnnumError, match=r"recording\.npz"):
        load_recording(path)


def read_frames(path, read=None):
    recording = read_npz(path)
    for number in range(len(recording.values)):
        recording.frame(number)
        recording.lost_before(number)
    if read is not None:
        read.append(path)


def test_rewritten_array_headers(faults, tmp_path):
    """A recording whose arrays have other shapes and types than they should is refused."""
    path = tmp_path / "recording.npz"
    archive(path, compressed=False)
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    types = (
        "'<f8'",
        "'|O'",
        "'<c16'",
        "'<U9999'",
        "'|V0'",
        "[('a','<f8')]",
        "'<M8[s]'",
        "7",
        "'<U0'",
    )
    shapes = ("()", "(7,)", "(-1,)", f"(1{'0' * 30},)", "(0,)", "(9999999999, 0)", "'x'", "(1.5,)")
    more = ("(True,)", "(" * 300, "None", "(1,)*9", "(0, 1, 1, 4)", "(7, 2, 3, 4)")
    cases = [(m, t, s) for m in members for t in types for s in (*shapes, *more)]
    for name, kind, shape in faults.each(cases, short=150):
        text = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}\n".encode("latin1")
        body = members[name][10 + struct.unpack("<H", members[name][8:10])[0] :]
        with zipfile.ZipFile(path, "w") as file:
            for other, content in members.items():
                made = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + body
                file.writestr(other, made if other == name else content)
        if fault := fault_of(read_frames, path):
            faults.lose(f"{name} {kind} {shape:.40}: {fault}")


BOMB = """
import resource, sys
from pathlib import Path
from cnnum.drivers.npz_file import read_npz
from cnnum.errors import CnnumError
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    read_npz(Path(sys.argv[1]))
except CnnumError as error:
    took = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(took // 1024, str(error))
"""


def bomb(path, *, member, promised, sent):
    """Write an archive of which one member has `sent` bytes, most of them after deflation."""
    archive(path, compressed=False)
    shape = (promised // 32, 1, 1, 4) if member == "values" else (promised // 8,)
    text = repr({"descr": "<f8", "fortran_order": False, "shape": shape}).encode() + b"\n"
    with zipfile.ZipFile(path) as file:
        kept = {name: file.read(name) for name in file.namelist() if name != f"{member}.npy"}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in kept.items():
            file.writestr(name, content)
        with file.open(f"{member}.npy", "w", force_zip64=True) as stream:
            stream.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text)
            for _ in range(sent // (1 << 24)):
                stream.write(bytes(1 << 24))


def test_archives_that_promise_gigabytes(faults, tmp_path):
    """An archive that promises gigabytes is refused with less than 100 MB of memory."""
    gigabyte, over = 1 << 30, SPARED + (1 << 24)  # the least that is refused, and one chunk
    cases = [
        ("values", over, over),
        ("values", 1 << 50, 0),
        ("time", over, over),
        ("calibration_cross", 1 << 45, 1 << 24),
    ]
    for member, promised, sent in faults.each(cases, short=2):
        path = tmp_path / "bomb.npz"
        bomb(path, member=member, promised=promised, sent=sent)
        done = subprocess.run(
            [sys.executable, "-c", BOMB, path],
            capture_output=True,
            text=True,
            timeout=60,
            cwd=ROOT,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (4 * gigabyte, 4 * gigabyte)),
        )
        took, _, said = done.stdout.partition(" ")
        if done.returncode or not took.isdigit() or int(took) > 100 or "bomb.npz" not in said:
            faults.lose(f"{member} {promised}: {done.stdout}{done.stderr[-300:]}")


def test_long_directory(faults, tmp_path):
    """An archive of very many members is refused before they are listed."""
    path = tmp_path / "many.npz"
    for _ in faults.trials(short=1, full=2):
        with zipfile.ZipFile(path, "w") as file:
            for number in range(20_000):
                file.writestr(f"{number:08}", b"")
        if fault := fault_of(read_npz, path, may_pass=False):
            faults.lose(fault)


def test_constant_recordings_are_read(faults, tmp_path):
    """A compressed recording of frames that never change is read, as its size is no bomb's."""
    path = tmp_path / "still.npz"
    for _ in faults.trials(short=1, full=3):
        archive(path, compressed=True)
        with np.load(path) as held:
            parts = {name: held[name] for name in held.files}
        frames = 20_000
        parts |= {"values": np.zeros((frames, 8, 8, 4)), "truth": np.zeros((frames, 1))}
        parts |= {name: np.zeros(frames, np.int64) for name in ("sequence", "quality")}
        np.savez_compressed(path, **{**parts, "time": np.zeros(frames)})
        if len(read_npz(path).values) != frames or path.stat().st_size > 1 << 20:
            faults.lose("frames are lost")


@pytest.mark.parametrize("name", TOMLS)
def test_damaged_toml(faults, tmp_path, name):
    """A TOML file with damaged bytes is read, or refused in one sentence."""
    path, rng = tmp_path / name, random.Random(name)
    content = TOMLS[name]
    path.write_bytes(content)
    READERS[name](path)
    for trial in faults.trials(short=150, full=4_000):
        path.write_bytes(damaged(content, rng, range(len(content))))
        if fault := fault_of(READERS[name], path):
            faults.lose(f"trial {trial}: {fault}: {path.read_bytes()!r:.200}")


HOSTILE = {
    "nested lists": "seed = " + "[" * 9000 + "]" * 9000,
    "nested to the limit": "seed = " + "[" * 300 + "]" * 300,
    "nested tables": "seed = " + "{a=" * 3000,
    "long key": ".".join("a" * 100_000) + " = 1",
    "long header": "[" + ".".join(["'a'"] * 100_000) + "]",
    "spaced key": " . ".join("a" * 100_000) + " = 1",
    "whole number": "seed = 1" + "0" * 400,
    "very whole number": "seed = 1" + "0" * 5000,
    "hexadecimal": "seed = 0x" + "f" * 500_000,
    "not a number": "seed = nan",
    "NUL": "seed = \0",
    "escaped NUL": 'seed = "\\u0000"',
    "surrogate": 'seed = "\\ud800"',
    "unknown": "zz_zz = 1",
    "long unknown": "z" * 1_000_000 + " = 1",
    "long text": 'seed = "' + "x" * 1_000_000 + '"',
    "date": "seed = 9999-99-99",
    "not text": "\udcff\udcfe",
}


def test_hostile_toml(faults, tmp_path):
    """TOML that is nested, long, or holds huge numbers is refused soon and in one sentence."""
    cases = [(name, what) for name in TOMLS for what in HOSTILE]
    for name, what in faults.each(cases, short=len(cases)):
        path = tmp_path / name
        text = HOSTILE[what].encode("utf-8", "surrogateescape")
        path.write_bytes(text + b"\n" + TOMLS[name])
        if fault := fault_of(READERS[name], path, may_pass=False):
            faults.lose(f"{name} {what}: {fault}")


@pytest.mark.filterwarnings("ignore:.*is left out. whatever wrote it was stopped")
def test_damaged_tables(faults, tmp_path):
    """A CSV table with damaged bytes is read, or refused with the file and the line."""
    path, rng = tmp_path / "table.csv", random.Random(3)
    content = b"time,x,y\r\n" + b"".join(b"%d.5,-1e3,7\r\n" % n for n in range(20))
    for trial in faults.trials(short=150, full=4_000):
        path.write_bytes(damaged(content, rng, range(len(content))))
        if fault := fault_of(lambda: read_table(path).numbers(["time", "y"])):
            faults.lose(f"trial {trial}: {fault}")


def kinds(folder):
    """Return places where there is no regular file."""
    pipe, inner, listening = folder / "pipe", folder / "folder", folder / "socket"
    os.mkfifo(pipe)
    inner.mkdir()
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(listening))
    link, loop = folder / "link", folder / "loop"
    link.symlink_to(pipe)
    loop.symlink_to(loop)
    devices = (Path("/dev/zero"), Path("/dev/null"), Path("/dev/tty"))
    return [pipe, inner, listening, link, loop, *devices]


def test_other_kinds_of_files(faults, tmp_path):
    """A pipe, a device, a socket or a folder in place of a file is refused at once."""
    places = kinds(tmp_path)
    cases = [(name, place) for name in READERS for place in places]
    for name, place in faults.each(cases, short=len(cases)):
        target = tmp_path / name
        target.unlink(missing_ok=True)
        target.symlink_to(place)  # readers go by the suffix
        if fault := fault_of(READERS[name], target, may_pass=False):
            faults.lose(f"{name} is {place}: {fault}")


def test_pipes_in_a_trial(faults, tmp_path):
    """A uSkin trial with a pipe among its files is refused at once."""
    for _ in faults.trials(short=1, full=3):
        (tmp_path / "xela_sensor1.csv").unlink(missing_ok=True)
        os.mkfifo(tmp_path / "xela_sensor1.csv")
        if fault := fault_of(lambda: UskinCsvOptions(tmp_path).open(), may_pass=False):
            faults.lose(fault)


def test_large_files(faults, tmp_path):
    """A file beyond the limit of its kind is refused before it is read."""
    for name in faults.each([n for n in READERS if n != "recording.npz"], short=4):
        path = tmp_path / name
        with path.open("wb") as file:
            file.truncate(1 << 34)
        if fault := fault_of(READERS[name], path, may_pass=False):
            faults.lose(f"{name}: {fault}")


def test_odd_names(faults):
    """A path that no file can have is refused in one sentence by every reader."""
    names = ("a\0b", "x" * 10_000, "\udcff\0", "")
    cases = [(reader, name) for reader in READERS for name in names]
    for reader, name in faults.each(cases, short=len(cases)):
        path = Path(f"{name}{Path(reader).suffix}")
        if fault := fault_of(READERS[reader], path, may_pass=False):
            faults.lose(f"{reader} {name!r:.20}: {fault}")


def test_regular_files_are_read(tmp_path):
    """The guard of all readers opens a regular file, of the limit's size too."""
    (tmp_path / "file").write_bytes(b"12345")
    with warnings.catch_warnings(), open_regular(tmp_path / "file", most=5) as file:
        assert file.read() == b"12345"
    with pytest.raises(OSError, match="more than"):
        open_regular(tmp_path / "file", most=4)
