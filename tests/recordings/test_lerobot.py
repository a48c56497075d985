"""Taxel frames together with pictures, and LeRobot's layout."""

import json
from pathlib import Path

import numpy as np
import pytest

from cnnum.errors import ArrayError, MissingExtraError, RecordingError
from cnnum.recordings.lerobot import packed, write_lerobot
from cnnum.recordings.recording import Recording


def recording(frames: int = 450, rate: float = 150.0) -> Recording:
    values = np.broadcast_to(np.arange(frames, dtype=float)[:, None, None, None], (frames, 2, 2, 3))
    return Recording(values, rate=rate, unit="N")


def test_every_taxel_frame_of_a_pictures_time_stands_in_its_row() -> None:
    touch = packed(recording(), 30.0)
    assert touch.frames.shape == (90, 5, 2, 2, 3)
    numbers = touch.frames[..., 0, 0, 0]
    # picture k is at the time of frame 5 k: the four before it came since picture k - 1
    np.testing.assert_array_equal(numbers[1:], 5.0 * np.arange(1, 90)[:, None] + np.arange(-4, 1))
    assert numbers[0].tolist() == [0.0] * 5
    assert touch.new.tolist() == [1] + [5] * 89


def test_rates_that_do_not_divide_lose_no_frame() -> None:
    touch = packed(recording(rate=100.0), 30.0)
    seen = np.concatenate(
        [row[-new:] for row, new in zip(touch.frames[..., 0, 0, 0], touch.new, strict=True)]
    )
    np.testing.assert_array_equal(seen, np.arange(len(seen)))
    assert set(touch.new[1:].tolist()) == {3, 4}


def test_a_gap_is_reported_and_not_filled() -> None:
    whole = recording(300)
    kept = np.r_[0:100, 200:300]
    holed = Recording(whole.values[kept], rate=150.0, unit="N", times=whole.times[kept])
    touch = packed(holed, 30.0)
    # no frame came in 19 pictures' time: they say so, and show the last that had come
    assert (touch.new == 0).sum() == 19
    assert set(touch.frames[touch.new == 0][:, -1, 0, 0, 0]) == {99.0}


def test_the_layout_is_lerobots(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = write_lerobot(recording(), tmp_path / "set", 30.0, task="grip", robot="arm")
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert (rows, info["total_frames"], info["fps"], info["codebase_version"]) == (
        90, 90, 30, "v2.1",
    )  # fmt: skip
    name = info["data_path"].format(episode_chunk=0, episode_index=0)
    table = parquet.read_table(tmp_path / "set" / name)
    assert set(table.column_names) == set(info["features"])
    for column, feature in info["features"].items():
        values = np.array(table[column].to_pylist())
        assert list(values.shape[1:] or (1,)) == feature["shape"]
    assert np.array(table["observation.tactile"].to_pylist())[7, :, 0, 0, 0].tolist() == [
        31.0, 32.0, 33.0, 34.0, 35.0,
    ]  # fmt: skip
    (episode,) = (tmp_path / "set/meta/episodes.jsonl").read_text().splitlines()
    assert json.loads(episode) == {"episode_index": 0, "tasks": ["grip"], "length": 90}
    stats = json.loads((tmp_path / "set/meta/episodes_stats.jsonl").read_text())["stats"]
    assert stats["timestamp"]["max"] == [pytest.approx(89 / 30, rel=1e-6)]
    with pytest.raises(RecordingError, match="holds other files"):
        write_lerobot(recording(), tmp_path / "set", 30.0)


def test_rates_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ArrayError, match="picture rate"):
        packed(recording(), 0.0)
    with pytest.raises(ArrayError, match="at most 1000 taxel frames"):
        packed(recording(), 0.1)


def test_without_pyarrow_the_library_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"'pyarrow'.*pip install '\.\[lerobot\]'"):
        write_lerobot(recording(), tmp_path / "set", 30.0)
    assert not (tmp_path / "set").exists()
