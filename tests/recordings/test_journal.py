"""Frames reach the file in time and leave memory; an older file is not touched."""

import errno
import time
import tracemalloc

import pytest

from cnnum.cli.commands.record import Recorder, journal_of
from cnnum.drivers import open_driver
from cnnum.errors import CnnumError, RecordingError
from cnnum.recordings.export import export
from cnnum.recordings.journal import Journal
from cnnum.recordings.reader import look
from cnnum.safety.files import written

WHOLE_SECOND = 1.0  # s, as promised


def test_what_waits_reaches_the_file_when_the_source_stalls(scans, tmp_path):
    journal = Journal(tmp_path / "stalls.mcap", 100.0, None)
    try:
        journal.add(scans(1)[0])
        time.sleep(WHOLE_SECOND)
        assert look(journal.path).frames == 1
        for frame in scans(2, first=1):
            journal.add(frame)
        time.sleep(WHOLE_SECOND)
        assert look(journal.path).frames == 3
    finally:
        journal.close(index=False)


def test_a_file_without_frames_is_removed(tmp_path):
    journal = Journal(tmp_path / "empty.mcap", 100.0, None)
    assert journal.path.exists()
    journal.close(index=True)
    journal.close(index=True)
    assert not journal.path.exists()


@pytest.mark.parametrize("suffix", ["mcap", "npz", "csv"])
def test_memory_is_bounded_while_recording_and_at_the_end(scans, tmp_path, suffix):
    """15 MB of frames never take more than a few chunks of memory."""
    with open_driver("simulated") as driver:
        recorder = Recorder(tmp_path / f"x.{suffix}", driver)
    frames = scans(100, shape=(16, 16))
    tracemalloc.start()
    try:
        for _ in range(25 if suffix != "csv" else 6):
            for frame in frames:
                recorder.add(frame)
        outcome = recorder.finish()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert outcome.problem == ""
    assert outcome.file.stat().st_size > 8e6
    # a chunk of 1 MB as records, as bytes, unpacked, decoded and copied
    assert peak < 8e6


def test_a_disk_that_refuses_ends_it_with_what_was_stored(scans, tmp_path, monkeypatch):
    """After an error of the disk nothing more is taken, and the numbers add up."""
    with open_driver("simulated") as driver:
        recorder = Recorder(tmp_path / "x.npz", driver)
    for frame in scans(10):
        recorder.add(frame)
    time.sleep(WHOLE_SECOND)

    def refuse(_data: bytes) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(recorder._journal._file, "append", refuse)
    with pytest.raises(RecordingError, match="cannot take more"):  # noqa: PT012
        for frame in scans(100, first=10):
            recorder.add(frame)
            time.sleep(0.02)
    outcome = recorder.finish()
    assert outcome.frames == 10
    assert outcome.lost > 0
    assert "10 frames are kept in" in outcome.problem
    assert f"{outcome.lost} that had come are not" in outcome.problem
    assert look(outcome.file).frames == 10


def test_a_journal_that_was_left_is_not_touched(scans, tmp_path):
    target = tmp_path / "x.npz"
    journal_of(target).write_bytes(b"precious")
    with open_driver("simulated") as driver:
        for force in (False, True):
            with pytest.raises(RecordingError, match="cnnum recover"):
                Recorder(target, driver, force=force)
        (tmp_path / "link.mcap").symlink_to(tmp_path / "nowhere")
        with pytest.raises(RecordingError, match="already exists"):
            Recorder(tmp_path / "link.mcap", driver)
    assert journal_of(target).read_bytes() == b"precious"
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize("linked", [True, False], ids=["links", "no links"])
def test_a_file_is_put_in_its_place_and_never_over_another(recorded, tmp_path, monkeypatch, linked):
    if not linked:

        def refuse(*_: object) -> None:
            raise PermissionError(errno.EPERM, "Operation not permitted")

        monkeypatch.setattr(type(tmp_path), "hardlink_to", refuse)
    out = tmp_path / "out.npz"
    export(look(recorded), out)
    before = out.read_bytes()
    with open_driver("npz", {"path": out}) as driver:
        assert driver.total_frames == 20
    with pytest.raises(RecordingError, match="already exists"):
        export(look(recorded), out)
    assert out.read_bytes() == before
    out.write_text("old")
    export(look(recorded), out, force=True)
    assert out.read_bytes() == before
    assert not list(tmp_path.glob(".*"))


def test_a_file_that_comes_during_the_export_is_kept(recorded, tmp_path):
    out = tmp_path / "out.csv"
    with pytest.raises(RecordingError, match="already exists"):  # noqa: PT012, SIM117
        with written(out, error=RecordingError) as file:
            file.write(b"ours")
            out.write_text("theirs")
    assert out.read_text() == "theirs"
    assert not list(tmp_path.glob(".*"))


def test_every_kind_holds_the_same_frames(recorded, tmp_path):
    once, twice = tmp_path / "once.mcap", tmp_path / "twice.npz"
    export(look(recorded), once)
    export(look(once), twice)
    assert [t for _, t in look(once).stored()] == [t for _, t in look(recorded).stored()]
    with open_driver("npz", {"path": twice}) as npz, open_driver("mcap", {"path": once}) as mcap:
        for one, other in zip(npz.frames(), mcap.frames(), strict=True):
            assert one.values.tobytes() == other.values.tobytes()
            assert (one.sequence, one.time, one.quality) == (
                other.sequence,
                other.time,
                other.quality,
            )
    with pytest.raises(CnnumError, match="kind of recording"):
        export(look(recorded), tmp_path / "x.wav")
