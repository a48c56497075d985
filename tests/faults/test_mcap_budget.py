"""MCAP files made to keep their reader busy are refused in seconds and in little memory."""

import re
import resource
import struct
import subprocess
import sys
import time
import zlib

import numpy as np
import pytest
import zstandard

import cnnum
from cnnum.errors import CodecError
from cnnum.frame import Frame
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_chunks import ChunkMaker, beginning
from cnnum.recordings.reader import look

SECONDS = 20.0
"""s of this process that a file of at most 4 MiB may take; those of before took minutes."""

LAYOUT = Layout((1, 1), ("normal",), "V", 100.0, ())


def record(opcode, data=b""):
    return struct.pack("<BQ", opcode, len(data)) + data


def chunk(records, name=b"", packed=None, crc=None):
    """A chunk; `packed` instead of its records."""
    held = records if packed is None else packed
    head = struct.pack("<QQQI", 0, 0, len(records), zlib.crc32(records) if crc is None else crc)
    head += struct.pack("<I", len(name)) + name + struct.pack("<Q", len(held))
    return record(6, head + held)


def frames(count):
    """The records of a chunk of so many frames."""
    maker = ChunkMaker(LAYOUT)
    for n in range(count):
        values = np.zeros((1, 1, 1))
        frame = Frame(values=values, channels=("normal",), unit="V", sequence=n, time=n / 100.0)
        maker.add(frame, n)
    return maker.take().records


def empty_messages():
    """A chunk of 4 MiB of messages without a byte, after one frame that makes it a recording."""
    opening = frames(1)[: -LAYOUT.message.itemsize]
    return beginning() + chunk(frames(1)) + chunk(opening + record(5) * 460_000)


def empty_records():
    """Records without data, then something that leads to no chunk, many times over."""
    inner = chunk(b"")
    return beginning() + chunk(frames(1)) + record(8, inner) * 60_000 + b"\xff" * 9


def embedded_chunks():
    """Chunks inside the data of small records: after each, the walk over the rest begins anew."""
    one = record(8, chunk(record(8)) + record(8))
    return beginning() + chunk(frames(1)) + one * 40_000 + b"\xff"


def false_chunks():
    """Beginnings of chunks that reach to the end of the file, whose checksums are all wrong."""
    size, heads = 4 << 20, []
    body = 49
    for place in range(0, 40_000 * body, body):
        left = size - place - body
        heads.append(struct.pack("<BQQQQIIQ", 6, left + 40, 0, 0, left, 1, 0, left))
    return (beginning() + b"".join(heads)).ljust(size + len(beginning()), b"\0")


def dense_chunks():
    """Chunks of some kB that unpack to 60 MiB each."""
    records = record(8, bytes(60 << 20))
    packed = zstandard.ZstdCompressor(level=3).compress(records)
    return beginning() + chunk(frames(1)) + chunk(records, b"zstd", packed) * 60


def dense_wrong_chunks():
    """The same with wrong checksums: they are unpacked all the same."""
    records = record(8, bytes(60 << 20))
    packed = zstandard.ZstdCompressor(level=3).compress(records)
    return beginning() + chunk(frames(1)) + chunk(records, b"zstd", packed, crc=1) * 60


def many_frames():
    """A few kB that become millions of frames."""
    opening = frames(1)
    step = LAYOUT.message.itemsize
    records = opening + opening[-step:] * 200_000
    packed = zstandard.ZstdCompressor(level=3).compress(records)
    return beginning() + chunk(records, b"zstd", packed) * 20


ATTACKS = {
    empty_messages: "takes far longer|1 frames",
    empty_records: "takes far longer|1 frames",
    embedded_chunks: "takes far longer",
    false_chunks: "takes far longer",
    dense_chunks: "unpacks to far more bytes|takes far longer",
    dense_wrong_chunks: "unpacks to far more bytes|takes far longer",
    many_frames: "far more frames|unpacks to far more",
}


pytestmark = pytest.mark.filterwarnings("ignore::cnnum.errors.RecordingWarning")


@pytest.mark.promise("An MCAP file that keeps its reader busy is read in time, or refused.")
@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.__name__)
def test_a_file_that_keeps_its_reader_busy_is_refused(tmp_path, attack):
    path = tmp_path / "busy.mcap"
    path.write_bytes(attack())
    assert path.stat().st_size < 5 << 20
    began, before = time.thread_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        said = f"{len(cnnum.load_recording(path))} frames"  # read in time, it attacks no more
    except CodecError as error:
        said = str(error)
    took = time.thread_time() - began
    print(f"{attack.__name__}: {path.stat().st_size} bytes, {took:.1f} s: {said}")
    assert re.search(ATTACKS[attack], said)
    assert took < SECONDS
    # KiB: a chunk of 64 MiB is held packed, unpacked and in parts at most
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 512 << 10


def test_the_option_raises_the_budget(tmp_path):
    """What is refused names the option, and with it the file is read."""
    path = tmp_path / "dense.mcap"
    opening, step = frames(1), LAYOUT.message.itemsize
    records = opening + opening[-step:] * 150_000
    packed = zstandard.ZstdCompressor(level=3).compress(records)
    path.write_bytes(beginning() + chunk(records, b"zstd", packed))
    with pytest.raises(CodecError, match=r"array\.budget=10.*--budget 10"):
        look(path)
    assert look(path, budget=3.0).frames == 150_001
    driver = cnnum.drivers.open_driver("mcap", {"path": str(path), "budget": 3.0})
    assert sum(1 for _ in driver.frames()) == 150_001
    assert len(cnnum.load_recording(path, budget=3.0)) == 150_001


def test_the_options_of_the_sentence_are_there(tmp_path):
    path = tmp_path / "busy.mcap"
    path.write_bytes(many_frames())
    for options in (["recover", path, tmp_path / "out.npz"], ["replay", path, "--scene", "demo"]):
        found = []
        for raised in (
            [],
            ["--budget", "1e-9"] if "recover" in options else ["--set", "array.budget=0"],
        ):
            command = [sys.executable, "-m", "cnnum", *map(str, options), *raised]
            found.append(subprocess.run(command, capture_output=True, text=True))
        assert [one.returncode for one in found] == [2, 2]
        assert "far more frames" in found[0].stderr
        words = "far longer" if "recover" in options else "'budget' must be a number above 0"
        assert words in found[1].stderr


def test_recordings_of_our_own_are_far_below_the_budget(tmp_path):
    """Also the densest that another program can make of one: a tenth must do."""
    values = np.zeros((3000, 2, 2, 3))
    recording = cnnum.Recording(values, rate=100.0, unit="N", channels=("x", "y", "z"))
    path = recording.save(tmp_path / "own.mcap")
    assert look(path, budget=0.1).frames == 3000
