"""Whole chunks are found in a file with any damage, and nothing absurd is believed."""

import random
import struct
import warnings
import zlib

import pytest
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from cnnum.drivers import open_driver
from cnnum.errors import CodecError, RecordingError, RecordingWarning
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_chunks import MESSAGE_HEAD, SCHEMA, ChunkMaker, beginning, channel_of
from cnnum.recordings.mcap_records import LARGEST
from cnnum.recordings.reader import WINDOW, look


def chunk_of(frames) -> bytes:
    maker = ChunkMaker(Layout.of(frames[0], 100.0, None))
    for frame in frames:
        maker.add(frame, frame.sequence)
    return maker.end()


@pytest.mark.parametrize("kind", list(CompressionType))
def test_a_file_that_another_program_has_packed_is_read(recorded, scans, tmp_path, kind):
    """Another program may pack chunks, add topics, and name our channel only once."""
    path, contents = tmp_path / "packed.mcap", look(recorded)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2000, compression=kind)
        writer.start()
        writer.register_schema("other/Kind", "ros2msg", b"int8 x")
        schema = writer.register_schema(SCHEMA.name, SCHEMA.encoding, SCHEMA.data)
        other = writer.register_channel("/other", "cdr", 1)
        ours = writer.register_channel("/skin", "cdr", schema, contents.layout.metadata())
        maker = ChunkMaker(contents.layout)
        for frame in scans(20):
            writer.add_message(other, frame.sequence, b"\x00\x01\x00\x00\x05", frame.sequence)
            data = maker.record(frame, 0)[MESSAGE_HEAD:]
            writer.add_message(ours, frame.sequence, data, frame.sequence)
        writer.finish()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with open_driver("mcap", {"path": path}) as driver:
            assert [frame.sequence for frame in driver.frames()] == list(range(20))
            assert driver.total_frames == 20


@pytest.mark.parametrize("name", ["zstd", "lz4"])
def test_a_chunk_never_unpacks_to_more_than_it_declares(name, recorded, tmp_path):
    import lz4.frame
    import zstandard

    bomb = bytes(4 * LARGEST)
    packed = zstandard.compress(bomb) if name == "zstd" else lz4.frame.compress(bomb)
    path, whole = tmp_path / "bomb.mcap", recorded.read_bytes()
    for declared in (100, LARGEST, 4 * LARGEST, (1 << 64) - 1):
        record = RecordBuilder()
        Chunk(name, packed, 0, 0, zlib.crc32(bomb), declared).write(record)
        path.write_bytes(beginning() + record.end() + whole)
        found = look(path)
        assert (found.frames, found.indexed) == (20, False) or found.unreadable > 0
        assert found.frames == 20


def test_absurd_lengths_cost_no_memory(scans, tmp_path):
    """A chunk that claims to be longer than the file, or than any chunk, is passed over."""
    path, good = tmp_path / "absurd.mcap", chunk_of(scans(3))
    for claimed in (1 << 20, LARGEST + 1, (1 << 40), (1 << 64) - 1):
        absurd = b"\x06" + struct.pack("<QQQQI", claimed, 0, 0, claimed, 0) + bytes(64)
        path.write_bytes(beginning() + absurd + good)
        found = look(path)
        assert (found.frames, found.unreadable, found.holes) == (3, len(absurd), 1)


def test_chunks_are_found_behind_more_rubbish_than_a_window(scans, tmp_path):
    path = tmp_path / "far.mcap"
    rubbish = random.Random(3).randbytes(WINDOW - 3) + b"\x06" * 20
    for size in (WINDOW - 10, WINDOW - 4, WINDOW, len(rubbish)):
        path.write_bytes(rubbish[:size] + chunk_of(scans(3)))
        found = look(path)
        assert (found.frames, found.unreadable) == (3, size)


def test_what_is_no_recording_is_refused(tmp_path, scans):
    path = tmp_path / "none.mcap"
    for data in (b"", b"hello", beginning(), beginning()[:11], bytes(5000)):
        path.write_bytes(data)
        with pytest.raises(CodecError, match="no complete chunk of frames"):
            look(path)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("other/Kind", "ros2msg", b"int8 x")
        writer.add_message(writer.register_channel("/x", "cdr", schema), 0, b"1234", 0)
        writer.finish()
    with pytest.raises(CodecError, match="no messages of the kind"):
        look(path)
    path.write_bytes(beginning() + chunk_of(scans(2)) + chunk_of(scans(2, shape=(4, 4))))
    with pytest.raises(CodecError, match="two arrays"):
        look(path)
    with pytest.raises(RecordingError, match="cannot be read"):
        look(tmp_path)


def test_messages_that_are_no_frames_are_refused(tmp_path, scans):
    """The checksum holds, so it is no damage: a program has written something else."""
    layout = Layout.of(scans(1)[0], 100.0, None)
    for data in (b"", b"\x00\x01\x00\x00" + bytes(16), bytes(layout.message.itemsize - 31)):
        path = tmp_path / "wrong.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema(SCHEMA.name, SCHEMA.encoding, SCHEMA.data)
            metadata = channel_of(layout).metadata
            writer.add_message(writer.register_channel("/x", "cdr", schema, metadata), 0, data, 0)
            writer.finish()
        with pytest.raises(CodecError, match="one of its messages"):
            look(path)


def test_a_warning_counts_what_is_not_readable(recorded):
    data = recorded.read_bytes()
    contents = look(recorded)
    assert (contents.whole, contents.holes, contents.unreadable) == (True, 0, 0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        contents.warn()
    end = data.index(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")
    recorded.write_bytes(data[:end] + b"torn!")
    with pytest.warns(RecordingWarning, match=r"5 bytes at its end .* 20 frames are readable"):
        look(recorded).warn()
    recorded.write_bytes(b"?" + data[1:])
    with pytest.warns(RecordingWarning, match=r"is damaged: \d+ bytes in it are not readable"):
        look(recorded).warn()


def test_what_comes_after_the_look_is_not_read(recorded, scans):
    contents = look(recorded)
    with recorded.open("ab") as file:
        file.write(chunk_of(scans(5, first=50)))
    assert sum(1 for _ in contents.stored()) == 20
