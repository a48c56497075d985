"""Taxel frames together with pictures, and LeRobot's layout 3.0."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.errors import ArrayError, MissingExtraError, RecordingError
from cnnum.recordings.lerobot import Episode, packed, read_lerobot, read_states, write_lerobot
from cnnum.recordings.recording import Recording


def recording(frames: int = 450, rate: float = 150.0) -> Recording:
    values = np.broadcast_to(np.arange(frames, dtype=float)[:, None, None, None], (frames, 2, 2, 3))
    return Recording(values, rate=rate, unit="N")


def jittered(frames: int, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    times = 5.0 + np.cumsum(rng.uniform(0.5, 1.5, frames)) / 150.0
    quality = rng.choice([0, 0, 0, 1, 2], frames)
    return Recording(rng.integers(0, 4096, (frames, 2, 2, 3)), times=times, quality=quality)


def numbers(touch) -> np.ndarray:
    rows = zip(touch.frames[..., 0, 0, 0], touch.new, strict=True)
    return np.concatenate([row[len(row) - new :] for row, new in rows])


def test_every_taxel_frame_of_a_pictures_time_stands_in_its_row() -> None:
    touch = packed(recording(), 30.0)
    assert touch.frames.shape == (91, 5, 2, 2, 3)
    # picture k is at the time of frame 5 k: the four before it came since picture k - 1
    np.testing.assert_array_equal(
        touch.frames[1:90, :, 0, 0, 0], 5.0 * np.arange(1, 90)[:, None] + np.arange(-4, 1)
    )
    assert touch.frames[0, :, 0, 0, 0].tolist() == [0.0] * 5
    assert touch.new.tolist() == [1] + [5] * 89 + [4]


@pytest.mark.parametrize("fps", [30.0, 29.97, 7.0, 150.0, 400.0])
def test_no_frame_is_lost_at_any_rate(fps: float) -> None:
    touch = packed(recording(rate=100.0), fps)
    np.testing.assert_array_equal(numbers(touch), np.arange(450.0))


def test_a_gap_is_reported_and_not_filled() -> None:
    whole = recording(300)
    kept = np.r_[0:100, 200:300]
    holed = Recording(whole.values[kept], rate=150.0, unit="N", times=whole.times[kept])
    touch = packed(holed, 30.0)
    # no frame came in 19 pictures' time: they say so, and show the last that had come
    assert (touch.new == 0).sum() == 19
    assert set(touch.frames[touch.new == 0][:, -1, 0, 0, 0]) == {99.0}


def test_rates_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ArrayError, match="picture rate"):
        packed(recording(), 0.0)
    with pytest.raises(ArrayError, match="at most 1000 taxel frames"):
        packed(recording(), 0.1)


@pytest.fixture
def episodes(tmp_path: Path) -> list[Episode]:
    pytest.importorskip("pyarrow")
    result = []
    for number in range(4):
        touch = jittered(200 + 40 * number, number)
        at = np.arange(0.0, 5.0, 0.01)
        states = {
            "observation.state": (at, {"elbow": np.sin(at), "wrist": at}),
            "action": (at, {"grip": number + at}),
        }
        events = {"slip": [0.51, 0.52, 1.0], "contact": [0.0]}
        result.append(Episode(touch, ("grip", "lift")[number % 2], states, events))
    return result


def test_episodes_are_read_again_as_they_were(episodes: list[Episode], tmp_path: Path) -> None:
    folder = tmp_path / "set"
    rows = write_lerobot(episodes[:2], folder, 30.0, robot="arm")
    assert rows + write_lerobot(episodes[2:], folder, 30.0, append=True) > rows
    for number, episode in ((1, episodes[1]), (3, episodes[3])):  # of each file of data
        again = Recording.from_lerobot(folder, number)
        np.testing.assert_array_equal(again.values, episode.recording.values)
        times = episode.recording.times - episode.recording.times[0]
        np.testing.assert_array_equal(again.times, times)
        np.testing.assert_array_equal(again.quality, episode.recording.quality)
    with pytest.raises(RecordingError, match="has 4 episodes: choose one"):
        cnnum.load_recording(folder)
    with pytest.raises(RecordingError, match="has 4 episodes, none with number 4"):
        cnnum.load_recording(folder / "episode-000004")
    others = [Episode(jittered(200, 9))]
    with pytest.raises(RecordingError, match=r"same features, but 'observation\.state' differs"):
        write_lerobot(others, folder, 30.0, append=True)
    with pytest.raises(RecordingError, match="30 pictures per second, not 25"):
        write_lerobot(episodes, folder, 25.0, append=True)
    with pytest.raises(RecordingError, match=r"already exists; .*give --append"):
        write_lerobot(episodes, folder, 30.0)
    assert len(list(tmp_path.iterdir())) == 1


def test_an_episode_is_read_without_the_others(tmp_path: Path) -> None:
    """The rows of another one, in the same file, may even be damaged."""
    parquet = pytest.importorskip("pyarrow.parquet")
    touches = [jittered(60, number) for number in range(3)]
    write_lerobot([Episode(touch) for touch in touches], tmp_path / "set", 30.0)
    (file,) = (tmp_path / "set/data").rglob("*.parquet")
    column = parquet.ParquetFile(file).metadata.row_group(1).column(0)
    begin = column.dictionary_page_offset or column.data_page_offset
    held = file.read_bytes()
    file.write_bytes(held[:4] + bytes(begin - 4) + held[begin:])
    for number in (1, 2):
        own = Recording.from_lerobot(tmp_path / "set", number)
        np.testing.assert_array_equal(own.values, touches[number].values.astype(np.float32))
    with pytest.raises(RecordingError, match="cannot be read"):
        Recording.from_lerobot(tmp_path / "set", 0)


def test_the_tables_are_lerobots(episodes: list[Episode], tmp_path: Path) -> None:
    """Layout 3.0: `make lerobot` lets the library itself read such a set."""
    parquet = pytest.importorskip("pyarrow.parquet")
    pandas = pytest.importorskip("pandas")
    folder = tmp_path / "set"
    write_lerobot(episodes[:3], folder, 30.0, robot="arm")
    write_lerobot(episodes[3:], folder, 30.0, append=True)
    info = json.loads((folder / "meta/info.json").read_text())
    known = (info["codebase_version"], info["total_episodes"], info["fps"], info["robot_type"])
    assert known == ("v3.0", 4, 30, "arm")
    tasks = pandas.read_parquet(folder / "meta/tasks.parquet")
    assert tasks["task_index"].to_dict() == {"grip": 0, "lift": 1}
    listed = parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [own["tasks"] for own in listed] == [["grip"], ["lift"]] * 2
    for before, after in pairwise(listed):
        assert before["dataset_to_index"] == after["dataset_from_index"]
    rows = []
    for own in listed:
        name = info["data_path"].format(
            chunk_index=own["data/chunk_index"], file_index=own["data/file_index"]
        )
        table = parquet.read_table(folder / name).to_pylist()
        rows += [row for row in table if row["episode_index"] == own["episode_index"]]
    assert [row["index"] for row in rows] == list(range(info["total_frames"]))
    for row in rows:  # the newest of the rows of 0.01 s that had come at the picture
        newest = 0.01 * np.floor(round(row["frame_index"] / 30 / 0.01, 6))
        assert row["action"] == pytest.approx(row["episode_index"] + newest, abs=1e-6)
    for name, feature in info["features"].items():
        column = np.array([row[name] for row in rows], np.float64)
        assert list(column.shape[1:] or (1,)) == feature["shape"]
        stats = json.loads((folder / "meta/stats.json").read_text())[name]
        # float32 and sums of squares: seven digits of the largest value
        limit = 1e-7 * max(1.0, np.abs(column).max())
        want = {"mean": column.mean(axis=0), "std": column.std(axis=0), "max": column.max(axis=0)}
        for key, value in want.items():
            np.testing.assert_allclose(np.squeeze(stats[key]), np.squeeze(value), atol=limit)
    events = np.array([row["observation.tactile_events"] for row in rows])
    assert events.sum(axis=0).tolist() == [12, 4]
    (slip,) = np.flatnonzero(events[: listed[0]["length"], 0] > 1)  # 0.51 and 0.52 s
    assert slip == 16


def test_the_shell_writes_states_and_the_events_of_a_scene(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    depth = np.interp(np.arange(200) / 100.0, [0.5, 0.7, 1.3, 1.5], [0.0, 1.0, 1.0, 0.0])
    rng = np.random.default_rng(3)
    values = 1000.0 + rng.normal(size=(200, 4, 4, 3))
    values[:, 1:3, 1:3, 2] -= 500.0 * depth[:, None, None]
    touch = Recording(values.astype(np.float32), rate=100.0, unit="count")
    touch.save(tmp_path / "a.npz")
    at = np.arange(0.0, 2.1, 0.05)
    lines = ["timestamp,action.grip"] + [f"{t:.2f},{2 * t:.2f}" for t in at]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    scene = tmp_path / "touch.toml"
    scene.write_text('needs = ["contact"]\n[array]\ndriver = "simulated"\n')
    arguments = ["lerobot", tmp_path / "a.npz", tmp_path / "set", "--scene", scene]
    arguments += ["--table", tmp_path / "a.csv", "--task", "press"]
    result = CliRunner().invoke(main, [str(part) for part in arguments])
    assert result.exit_code == 0, result.stderr
    features = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]
    assert features["action"]["names"] == ["grip"]
    assert features["observation.tactile_events"]["names"] == ["contact", "release"]
    want = [
        (event.kind, event.frame) for event in cnnum.load_scene(scene, recording=touch).events()
    ]
    again = read_lerobot(tmp_path / "set")
    found = cnnum.load_scene(scene, recording=again).events()
    assert want
    assert [(event.kind, event.frame) for event in found] == want
    wrong = CliRunner().invoke(main, [str(part) for part in (*arguments, "--table", "b.csv")])
    assert wrong.exit_code == 2
    assert "--table is given 2 times for 1 recordings" in wrong.stderr


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("timestamp,action.a\n0,1\n0.1\n", "Line 3"),
        ("time,action.a\n0,1\n", "must begin with a line of names"),
        ("timestamp,grip\n0,1\n", "must begin with a line of names"),
        ("timestamp,action.a\n0,1\n0.1,x\n", "Line 3"),
        ("timestamp,action.a\n1,1\n0,1\n", "times rising"),
        ("timestamp,action.a\n1,nan\n", "must be finite"),
        ("timestamp,action.a,action.a\n1,2,3\n", "each once"),
        ("timestamp,timestamp,action.a\n1,2,3\n", "each once"),
        ("timestamp,action.\xe9\n1,2\n", "not a table in UTF-8"),
        ("", "must begin with a line of names"),
    ],
)
def test_tables_that_are_none_are_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "a.csv").write_bytes(text.encode("latin-1"))
    with pytest.raises(RecordingError, match=says):
        read_states(tmp_path / "a.csv")


def test_tables_as_programs_write_them_are_read(tmp_path: Path) -> None:
    """With a mark of UTF-8, a blank line at the end, and ends of lines of Windows."""
    (tmp_path / "a.csv").write_text("\ufefftimestamp, action.a\r\n0,1\r\n\r\n1,2\r\n\r\n")
    ((times, columns),) = read_states(tmp_path / "a.csv").values()
    assert (times.tolist(), columns["a"].tolist()) == ([0.0, 1.0], [1.0, 2.0])


@pytest.mark.parametrize("name", ["videos/observation.images/chunk-000/file-000.mp4", "README.md"])
def test_a_set_with_files_of_others_is_not_replaced(tmp_path: Path, name: str) -> None:
    pytest.importorskip("pyarrow")
    folder = tmp_path / "set"
    write_lerobot([Episode(recording())], folder, 30.0)
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("mine")
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    with pytest.raises(RecordingError, match="holds other files, and is never emptied"):
        write_lerobot([Episode(recording())], folder, 30.0, append=True)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


@pytest.mark.parametrize(
    ("episode", "says"),
    [
        (Episode(recording(), " "), "must be said in words"),
        (Episode(recording(), states={"index": ([0, 4], {"a": [0, 1]})}), "no other feature has"),
        (
            Episode(recording(), states={"observation.tactile": ([0, 4], {"a": [0, 1]})}),
            "no other feature has",
        ),
        (Episode(recording(), states={"action": ([0, 4], {})}), "must have columns"),
        (Episode(recording(), states={"action": ([0, 4], {"a": [1]})}), "one number per time"),
        (Episode(recording(), states={"action": ([0, 4], {"a": [1, np.nan]})}), "must be finite"),
        (Episode(recording(), states={"action": ([0, 4], {"a": ["b", 1]})}), "must be numbers"),
        (Episode(recording(), events={"slip": [np.nan]}), "must be finite"),
        (Episode(recording(), events={"slip": [3.5]}), "within the episode"),
        (recording(), "of the type Episode"),
    ],
)
def test_episodes_that_cannot_be_written_are_refused(tmp_path: Path, episode, says: str) -> None:
    pytest.importorskip("pyarrow")
    with pytest.raises((ArrayError, RecordingError), match=says):
        write_lerobot([episode], tmp_path / "set", 30.0)
    assert not (tmp_path / "set").exists()


def test_taxels_that_are_no_number_leave_the_statistics_to_the_others(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    values = np.array(recording().values)
    values[100:200, 0, 0, 0] = np.nan
    values[:, 1, 1, 2] = np.nan
    write_lerobot([Episode(Recording(values, rate=150.0))], tmp_path / "set", 30.0)
    text = (tmp_path / "set/meta/stats.json").read_text()
    stats = json.loads(text, parse_constant=lambda name: pytest.fail(name))
    lasts = np.array(stats["observation.tactile"]["mean"])[-1]
    assert lasts[1, 1, 2] == 0.0
    kept = np.r_[0:100, 200:450]
    seen = kept[np.isin(kept, np.r_[np.arange(0, 446, 5), 449])]  # the newest of each picture
    assert lasts[0, 0, 0] == pytest.approx(seen.mean(), rel=1e-6)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"codebase_version": "v2.1"}, "layout 'v2.1'"),
        ({"features": {"observation.tactile": "x"}}, "does not describe the features"),
        ({"total_episodes": -1}, "must give 'total_episodes', got -1"),
        ({"total_frames": "x"}, "must give 'total_frames'"),
    ],
)
def test_descriptions_that_are_damaged_are_refused(tmp_path: Path, change, says: str) -> None:
    pytest.importorskip("pyarrow")
    folder = tmp_path / "set"
    write_lerobot([Episode(recording())], folder, 30.0)
    info = json.loads((folder / "meta/info.json").read_text())
    (folder / "meta/info.json").write_text(json.dumps(info | change))
    for attempt in (
        lambda: Recording.from_lerobot(folder),
        lambda: write_lerobot([Episode(recording())], folder, 30.0, append=True),
    ):
        with pytest.raises(RecordingError, match=says):
            attempt()
    for number in (-1, "x", 0.5):
        with pytest.raises(RecordingError, match="a whole number from 0 on"):
            Recording.from_lerobot(folder, number)


def test_states_must_cover_the_episode(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    short = {"action": ([0.0, 1.0], {"a": [0.0, 1.0]})}
    with pytest.raises(ArrayError, match=r"'action' must cover the episode, 0 to 3 s"):
        write_lerobot([Episode(recording(), states=short)], tmp_path / "set", 30.0)
    assert not (tmp_path / "set").exists()


def test_without_pyarrow_the_library_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"'pyarrow'.*pip install '\.\[lerobot\]'"):
        write_lerobot([Episode(recording())], tmp_path / "set", 30.0)
    assert not (tmp_path / "set").exists()
