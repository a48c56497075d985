"""`cnnum recover`: whole recordings of the frames left, and never one over another."""

import csv

import numpy as np
import pytest

import cnnum
from cnnum.drivers import open_driver


@pytest.fixture
def torn(call, tmp_path):
    """A recording of three chunks, the middle one damaged and the end cut off."""
    from itertools import islice

    from cnnum.recordings.layout import Layout
    from cnnum.recordings.mcap_chunks import ChunkMaker, beginning

    path, data = tmp_path / "torn.mcap", beginning()
    with open_driver("simulated", {"seed": 3, "shape": [4, 4]}) as driver:
        scans = list(islice(driver.frames(), 30))
        maker = ChunkMaker(Layout.of(scans[0], driver.rate, driver.calibration))
    for first in range(0, 30, 10):
        for frame in scans[first : first + 10]:
            maker.add(frame, frame.sequence)
        chunk = maker.end()
        data += chunk if first != 10 else chunk[:5000] + b"????" + chunk[5004:]
    path.write_bytes(data + b"\x06torn")
    return path


def test_what_is_whole_is_recovered_and_the_rest_is_counted(call, records, torn):
    before = torn.read_bytes()
    result = call("recover", torn, "--json")
    assert result.exit_code == 0, result.stderr
    (report,) = records(result.stdout)
    assert (report["frames"], report["gaps"], report["missing"]) == (20, 1, 10)
    assert (report["damaged_places"], report["whole"]) == (2, False)
    assert report["unreadable_bytes"] > 5000
    out = torn.with_name("torn.recovered.mcap")
    assert report["file"] == str(out)
    again = call("recover", out, out.with_name("again.mcap"), "--json")
    (report,) = records(again.stdout)
    assert (report["frames"], report["unreadable_bytes"], report["whole"]) == (20, 0, True)
    with open_driver("mcap", {"path": out}) as tape:
        assert [frame.sequence for frame in tape.frames()] == [*range(10), *range(20, 30)]
        assert tape.counters.dropped == 10
        assert tape.calibration is not None
    assert torn.read_bytes() == before


def test_other_kinds_can_be_made(call, torn, tmp_path):
    assert call("recover", torn, tmp_path / "x.npz").exit_code == 0
    with open_driver("npz", {"path": tmp_path / "x.npz"}) as tape:
        assert tape.total_frames == 20
        assert tape.calibration is not None
    assert call("recover", torn, tmp_path / "x.csv").exit_code == 0
    with (tmp_path / "x.csv").open(newline="") as file:
        assert len(list(csv.reader(file))) == 21


def test_nothing_is_replaced(call, torn, tmp_path):
    before, other = torn.read_bytes(), tmp_path / "other.mcap"
    other.write_text("precious")
    assert "--force" in call("recover", torn, other).stderr
    assert other.read_text() == "precious"
    for force in ([], ["--force"]):
        result = call("recover", torn, torn, *force)
        assert result.exit_code == 2
        assert "choose another name for OUT" in result.stderr
    assert call("recover", torn, other, "--force").exit_code == 0
    assert torn.read_bytes() == before


@pytest.mark.parametrize(
    ("name", "said"),
    [("missing.mcap", "cannot be read"), ("text.mcap", "no complete chunk"), ("torn.mcap", "kind")],
)
def test_what_cannot_be_recovered_is_one_sentence(call, torn, tmp_path, name, said):
    (tmp_path / "text.mcap").write_text("hello")
    result = call("recover", tmp_path / name, tmp_path / ("x.wav" if said == "kind" else "x.csv"))
    assert result.exit_code == 2
    assert said in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize("folder", [".", "/", "..", "{}"])
def test_a_folder_is_no_recording(call, tmp_path, monkeypatch, folder):
    monkeypatch.chdir(tmp_path)
    result = call("recover", folder.format(tmp_path))
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("always::cnnum.errors.RecordingWarning")
def test_replay_says_what_it_cannot_read(call, torn):
    result = call("replay", torn, "--set", 'needs=["contact"]', "--engine", "numba")
    assert result.exit_code == 0, result.stderr
    assert " 5 bytes at its end are not readable" in result.stderr
    assert "'cnnum recover'" in result.stderr


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".h5"])
def test_what_can_be_read_as_it_is_needs_no_recovery(call, tmp_path, suffix):
    path = tmp_path / f"whole{suffix}"
    values = np.random.default_rng(0).normal(size=(20, 4, 4, 3))
    cnnum.Recording(values, rate=100.0).save(path)
    result = call("recover", path, tmp_path / "out.mcap")
    assert result.exit_code == 2
    assert "needs no recovery: its 20 frames can be read as they are" in result.stderr
    assert not (tmp_path / "out.mcap").exists()
