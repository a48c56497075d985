"""Files are plain MCAP: the library of the format reads them, and their frames are ours."""

import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory

from cnnum.errors import CodecError, RecordingError
from cnnum.frame import Frame
from cnnum.recordings.export import export
from cnnum.recordings.layout import MOST_VALUES, Layout
from cnnum.recordings.mcap_chunks import ChunkMaker, beginning
from cnnum.recordings.reader import look


@pytest.mark.parametrize("whole", [True, False], ids=["indexed", "cut off"])
def test_an_independent_reader_finds_the_same_numbers(recorded, scans, whole):
    with recorded.open("rb") as file:
        if whole:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        else:
            reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages(log_time_order=whole))
    assert len(found) == 20
    times = [message.log_time for _, _, message, _ in found]
    assert times == sorted(times)
    for (schema, channel, message, seen), frame in zip(found, scans(20), strict=True):
        assert schema.name == "cnnum_msgs/msg/TaxelFrame"
        assert (channel.metadata["rows"], channel.metadata["unit"]) == ("2", "N")
        assert message.publish_time == round(1e9 * frame.time)
        assert (seen.sequence, seen.time, seen.quality) == (
            frame.sequence,
            frame.time,
            frame.quality,
        )
        assert seen.values == frame.values.ravel().tolist()
        np.testing.assert_array_equal(seen.truth, list(frame.truth.values.values()))
        marks = np.zeros((2, 3)) if frame.saturated is None else frame.saturated
        np.testing.assert_array_equal(np.reshape(seen.saturated, (2, 3)), marks)


def test_recordings_without_marks_are_read(scans, tmp_path):
    """Those of earlier versions have none, and `cnnum recover` gives them the place for them."""
    first, path = scans(1)[0], tmp_path / "old.mcap"
    maker = ChunkMaker(replace(Layout.of(first, 100.0, None), marks=False))
    for frame in scans(8):
        maker.add(frame, 1)
    path.write_bytes(beginning() + maker.end())
    export(look(path), tmp_path / "new.mcap")
    for name in ("old.mcap", "new.mcap"):
        held = [frame for frame, _ in look(tmp_path / name).stored()]
        assert [frame.saturated for frame in held] == [None] * 8
        assert [frame.sequence for frame in held] == list(range(8))
    assert look(tmp_path / "new.mcap").layout.marks


def test_the_index_leads_to_every_chunk(recorded):
    with recorded.open("rb") as file:
        summary = make_reader(file).get_summary()
        for index in summary.chunk_indexes:
            file.seek(index.chunk_start_offset)
            opcode, length = struct.unpack("<BQ", file.read(9))
            assert (opcode, length + 9) == (6, index.chunk_length)
            (behind,) = index.message_index_offsets.values()
            file.seek(behind)
            assert file.read(1) == b"\x07"
    assert summary.statistics.message_count == 20
    assert summary.statistics.channel_message_counts == {1: 20}


def test_frames_come_back_bit_for_bit(recorded, scans):
    for (got, _), frame in zip(look(recorded).stored(), scans(20), strict=True):
        assert got.values.tobytes() == frame.values.tobytes()
        assert list(got.truth.values) == list(frame.truth.values)
        truths = [np.array(list(f.truth.values.values())).tobytes() for f in (got, frame)]
        assert truths[0] == truths[1]
        for name in ("sequence", "time", "quality", "channels", "unit"):
            assert getattr(got, name) == getattr(frame, name)


def test_numbers_at_the_ends_of_their_range(scans, tmp_path):
    (frame,) = scans(1)
    values = np.array([np.nan, np.inf, -np.inf, -0.0, 5e-324, 1.8e308]).reshape(1, 2, 3)
    ends = [
        Frame(values, frame.channels, "N", sequence, time)
        for sequence, time in ((2**63 - 1, np.inf), (-(2**63), np.nan), (2**32, -1.0))
    ]
    maker = ChunkMaker(Layout.of(ends[0], np.inf, None))
    for end in ends:
        maker.add(end, 1)
    path = tmp_path / "ends.mcap"
    path.write_bytes(beginning() + maker.end())
    for (got, _), end in zip(look(path).stored(), ends, strict=True):
        assert got.values.tobytes() == end.values.tobytes()
        assert (got.sequence, repr(got.time)) == (end.sequence, repr(float(end.time)))


def test_halves_are_whole_chunks(scans, tmp_path):
    frames = scans(5)
    maker = ChunkMaker(Layout.of(frames[0], 100.0, None))
    for frame in frames:
        maker.add(frame, frame.sequence)
    first, second = maker.take().halves()
    assert maker.count == 0
    path = tmp_path / "halves.mcap"
    path.write_bytes(beginning() + first.chunk() + second.chunk())
    assert [frame.sequence for frame, _ in look(path).stored()] == [0, 1, 2, 3, 4]
    # the second one has its own index, which must count from its own begin
    (log_time, place) = second.index[0]
    assert second.records[place] == 5
    assert struct.unpack_from("<Q", second.records, place + 15) == (log_time,)
    assert first.halves()[0].halves() == ()


def test_frames_of_another_shape_or_number_are_refused(scans):
    maker = ChunkMaker(Layout.of(scans(1)[0], 100.0, None))
    with pytest.raises(RecordingError, match=r"expected \(2, 3, 3\), got \(3, 3, 3\)"):
        maker.add(scans(1, shape=(3, 3))[0], 0)
    (large,) = scans(1, first=2**63)
    with pytest.raises(RecordingError, match="cannot be recorded"):
        maker.add(large, 0)
    assert maker.count == 0


def test_a_layout_that_no_frame_has_is_refused():
    with pytest.raises(CodecError, match="at most"):
        Layout((1, MOST_VALUES + 1), ("normal",), "V", 1.0)
    with pytest.raises(CodecError, match="needs rows"):
        Layout((0, 1), ("normal",), "V", 1.0)
    held = Layout((1, 1), ("normal",), "V", 1.0).metadata()
    for key, value in (("rows", "x"), ("channels", "{}"), ("truths", "[1]"), ("kind", "other")):
        with pytest.raises(CodecError):
            Layout.from_metadata({**held, key: value})
    del held["rate"]
    with pytest.raises(CodecError, match="it has no 'rate'"):
        Layout.from_metadata(held)


def test_the_checksum_is_that_of_the_format(scans):
    maker = ChunkMaker(Layout.of(scans(1)[0], 100.0, None))
    maker.add(scans(1)[0], 7)
    waiting = maker.take()
    assert struct.pack("<I", zlib.crc32(waiting.records)) in waiting.chunk()[:64]
