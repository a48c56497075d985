"""The shape, the axes and the clock of a file are found in its numbers, or asked for."""

import numpy as np
import pytest
from foreign_files import FRAMES, RATE, press

import cnnum

STRIPS = [(1, 8), (2, 4), (4, 2), (1, 10), (2, 5), (1, 15), (3, 5), (5, 3), (2, 8), (4, 6), (8, 4)]


def domes(rows, cols, rng):
    """A press at each of three places, as taxels under a cover see a point load."""
    y, x = np.mgrid[:rows, :cols]
    values = rng.normal(1000.0, 2.0, (FRAMES, rows, cols, 1))
    for begin in (80, 150, 220):
        row, col = rng.uniform(-0.3, rows - 0.7), rng.uniform(-0.3, cols - 0.7)
        depth = rng.uniform(0.7, 1.5)
        dome = (1.0 + ((y - row) ** 2 + (x - col) ** 2) / depth**2) ** -2.5
        grown = np.clip((np.arange(FRAMES) - begin) / 10, 0, 1) * (np.arange(FRAMES) < begin + 50)
        values[..., 0] += 400.0 * grown[:, None, None] * dome * rng.normal(1.0, 0.1, dome.shape)
    return values


@pytest.mark.parametrize("shape", STRIPS)
def test_the_shape_is_that_of_a_press_or_is_asked_for(shape, call, records, tmp_path):
    """Strips of 8, 10 and 15 taxels were 2×4, 2×5 and 3×5 in silence."""
    taxels, seen = shape[0] * shape[1], []
    path, known = tmp_path / "a.npy", ["--set", "rate=100"]
    if taxels % 3 == 0:  # numbers of which three may be a taxel's
        known += ["--set", 'channels=["z"]']
    for seed in range(4):
        made = domes(*shape, np.random.default_rng([seed, *shape]))
        np.save(path, made.reshape(FRAMES, taxels))
        (said,) = records(call("layout", path, *known, "--json").stdout)
        seen.append(tuple(said["layout"].get("shape", ())))
        assert ("may be" in "".join(said["undecided"])) == (not seen[-1])
    usual = {16: (4, 4), 24: (4, 6)}.get(taxels, ())
    assert set(seen) <= {shape, usual}
    assert shape in seen or shape == (8, 4)
    rest = np.random.default_rng(0).normal(1000.0, 2.0, (FRAMES, taxels))
    np.save(path, rest)
    done = call("layout", path, *known, "--write")
    if usual:
        assert done.exit_code == 0
        return
    assert done.exit_code == 1
    assert not path.with_suffix(".toml").exists()
    assert f"shape: {taxels} taxels may be 1×{taxels}, " in done.stdout
    assert f"{shape[0]}×{shape[1]}" in done.stdout
    done = call("layout", path, *known, "--set", f"shape={list(shape)}", "--write")
    assert done.exit_code == 0
    assert cnnum.load_recording(path).shape == shape


def frames_of_pandas(path, index, name):
    """What `to_parquet` makes of a frame with such an index."""
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    values = press(4, 4, offset=1000)
    names = [f"taxel{n}_{axis}" for n in range(16) for axis in "xyz"]
    frame = pd.DataFrame(values.reshape(FRAMES, -1), columns=names, index=index(pd))
    frame.index.name = name
    frame.to_parquet(path)
    return values


STEP = 10_000_000  # ns
INDICES = {
    "dates": lambda pd: pd.date_range("2024-05-03", periods=FRAMES, freq="10ms"),
    "dates of a zone": lambda pd: pd.date_range(
        "2024-05-03", periods=FRAMES, freq="10ms", tz="Europe/Budapest"
    ),
    "dates in ms": lambda pd: pd.date_range("2024-05-03", periods=FRAMES, freq="10ms").as_unit(
        "ms"
    ),
    "differences of times": lambda pd: pd.to_timedelta(np.arange(FRAMES) * STEP, unit="ns"),
}


def test_channels_before_rows_columns_and_frames_of_hdf5(call, tmp_path):
    """(3, 3, 4, n): three channels of 3×4 taxels, or four of 3×3, which is said."""
    h5py = pytest.importorskip("h5py")
    values, path = press(3, 4, offset=900), tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["tactile"], file["t"] = values.transpose(3, 1, 2, 0), np.arange(FRAMES) / RATE
    done = call("layout", path, "--write")
    assert done.exit_code == 0
    assert "order: 3 channels of 3×4 taxels fit, and 4 channels of 3×3, too" in done.stdout
    recording = cnnum.load_recording(path)
    np.testing.assert_array_equal(recording.values, values)
    assert "are right" in call("check", path).stdout


@pytest.mark.parametrize("name", [None, "when", "time_ms"])
@pytest.mark.parametrize("index", INDICES)
def test_parquet_of_pandas_is_read_with_the_times_of_its_index(index, name, call, tmp_path):
    path = tmp_path / "a.parquet"
    values = frames_of_pandas(path, INDICES[index], name)
    done = call("layout", path, "--write")
    assert done.exit_code == 0, done.stdout + done.stderr
    recording = cnnum.load_recording(path)
    np.testing.assert_array_equal(recording.values, values)
    assert recording.times == pytest.approx(np.arange(FRAMES) / RATE, abs=1e-9)


@pytest.mark.parametrize("shape", [(1, 8), (8, 1)])
def test_a_strip_with_an_axis_for_its_one_row_is_not_asked_about(call, tmp_path, shape):
    np.savez(tmp_path / "a.npz", taxels=press(*shape), t=np.arange(FRAMES) / RATE)
    assert call("layout", tmp_path / "a.npz", "--write").exit_code == 0
    np.testing.assert_array_equal(cnnum.load_recording(tmp_path / "a.npz").values, press(*shape))


def test_parquet_without_its_library_names_the_extra(call, tmp_path, monkeypatch):
    from cnnum.recordings import hdf5_file

    (tmp_path / "a.parquet").write_bytes(b"PAR1" + bytes(40) + b"PAR1")
    monkeypatch.setattr(hdf5_file, "find_spec", lambda _: None)
    done = call("layout", tmp_path / "a.parquet")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "lerobot" in done.stderr


AXES = {
    "taxels of a square last": ((4, 4, 1), lambda v: v[..., 0].transpose(1, 2, 0), 500),
    "numbers before frames": ((4, 4, 3), lambda v: v.reshape(500, 48).T, 500),
    "as many frames as a square": ((4, 4, 3), lambda v: v[:400].reshape(400, 48).T, 400),
    "a frame of more numbers than frames": ((12, 32, 1), lambda v: v[:20].reshape(20, 384), 20),
    "few taxels before frames": ((2, 5, 1), lambda v: v.reshape(500, 10).T, 500),
    "channels before frames": ((3, 4, 3), lambda v: v.transpose(3, 0, 1, 2), 500),
    "channels first and frames last": ((3, 4, 3), lambda v: v.transpose(3, 1, 2, 0), 500),
}


@pytest.mark.parametrize("name", AXES)
def test_the_axis_of_the_frames_is_found(name, call, tmp_path):
    shape, turn, frames = AXES[name]
    random = np.random.default_rng(3)
    made = 50.0 * random.normal(size=shape) + np.cumsum(random.normal(size=(500, *shape)), axis=0)
    path = tmp_path / "a.npy"
    np.save(path, turn(made))
    more = [] if shape != (2, 5, 1) else ["--set", "shape=[2, 5]"]
    done = call("layout", path, "--set", "rate=100", "--write", *more)
    assert done.exit_code == 0, done.stderr
    assert "# order: " in done.stdout
    held = cnnum.load_recording(path)
    np.testing.assert_array_equal(held.values, made[:frames])


CLOCKS = {
    "elapsed_ms": (1000.0, "ms"),
    "millis": (1000.0, "ms"),
    "Zeit [s]": (1.0, "s"),
    "zeit_ms": (1000.0, "ms"),
    "epoch": (1.0, "s"),
    "tick": (1000.0, "ms"),
    "micros": (1e6, "us"),
}


def table(path, name, times):
    loads = np.random.default_rng(0).integers(0, 99, (len(times), 4))
    rows = [f"{t!r},{','.join(map(str, row))}" for t, row in zip(times, loads, strict=True)]
    path.write_text("\n".join([f"{name},t1,t2,t3,t4", *rows]) + "\n")


@pytest.mark.parametrize("name", CLOCKS)
def test_times_are_known_by_their_usual_names(name, call, tmp_path):
    scale, unit = CLOCKS[name]
    begin = 1.7e9 if name == "epoch" else 0.0
    table(tmp_path / "a.csv", name, [begin + round(scale * n / 100, 3) for n in range(60)])
    done = call("layout", tmp_path / "a.csv", "--write")
    assert done.exit_code == 0, done.stdout
    assert f'time_unit = "{unit}"' in done.stdout
    assert cnnum.load_recording(tmp_path / "a.csv").rate == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("name", "times", "said"),
    [
        (
            "t",
            range(60),
            "'t' counts up by one: if these are ms, give '--set time=t --set time_unit",
        ),
        ("time", [5] * 60, "the times in 'time' are none, as it is the same in every row"),
        ("wann", range(0, 600, 10), "'wann' rises from row to row: if it is the time, give"),
    ],
)
def test_a_column_that_may_be_the_times_is_named(name, times, said, call, tmp_path):
    table(tmp_path / "a.csv", name, times)
    done = call("layout", tmp_path / "a.csv")
    assert done.exit_code == 1
    assert said in done.stdout
    if name != "time":
        done = call("layout", tmp_path / "a.csv", "--set", f"time={name}", "--write")
        assert (done.exit_code, "rate:" in done.stdout) == (0, False)
        assert 'time_unit = "ms"' in done.stdout
