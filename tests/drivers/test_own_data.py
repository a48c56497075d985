"""Data of one's own: arrays in memory, and files whose columns a small TOML names."""

import warnings

import numpy as np
import pytest

import cnnum
from cnnum.drivers import text_table
from cnnum.drivers.own_data.proposal import propose
from cnnum.drivers.registry import open_driver
from cnnum.errors import CnnumError, CodecError

AXES = ("x", "y", "z")
LAYOUT = 'shape = [2, 3]\nchannels = ["x", "y", "z"]\n'


@pytest.fixture
def values():
    return np.random.default_rng(1).normal(1e4, 5.0, (7, 2, 3, 3))


def table(header, rows):
    lines = [",".join(header), *(",".join(map(repr, row)) for row in rows)]
    return "\n".join(lines) + "\n"


def frames_csv(recording, path, **options):
    pytest.importorskip("pandas")
    recording.to_dataframe().to_csv(path, **options)
    return path


WAYS = {
    "mcap": lambda one, folder: one.save(folder / "own.mcap"),
    "npz": lambda one, folder: one.save(folder / "own.npz"),
    "csv": lambda one, folder: one.save(folder / "own.csv"),
    "h5": lambda one, folder: pytest.importorskip("h5py") and one.save(folder / "own.h5"),
    "hdf5": lambda one, folder: pytest.importorskip("h5py") and one.save(folder / "own.hdf5"),
    "data frame": lambda one, folder: frames_csv(one, folder / "own.csv"),
    "data frame without index": lambda one, folder: frames_csv(
        one, folder / "own.csv", index=False
    ),
}


@pytest.mark.parametrize("first", WAYS)
def test_own_files_keep_all_and_need_no_layout(values, first, tmp_path):
    """Numbers of scans, losses, repeats, marks, the time of day, the exact rate, and the truth."""
    values[2, 1, 0, 1] = np.nan
    whole = cnnum.Recording(
        values,
        rate=9.994,
        unit="strain",
        channels=AXES,
        times=[0.0, 0.1, 0.1, 0.4, 3600.0, 3600.1, 3600.2],
        sequence=[7, 8, 8, 12, 2**53 + 1, 2**53 + 2, 2**53 + 3],
        quality=[0, 0, 2, 1, 1, 0, 8],
        truth={"slip": [0, 0, 1, np.nan, 1, 0, 0]},
        saturated=values[..., 2] > 1e4,
        wall_ns=1_700_000_000_123_456_789 + np.arange(7) * 16_666_667,
    )
    again = cnnum.load_recording(WAYS[first](whole, tmp_path))
    assert again == whole
    (tmp_path / "second").mkdir()
    assert cnnum.load_recording(WAYS["csv"](again, tmp_path / "second")) == whole


def test_a_recording_without_a_time_of_day_has_none_after_it_was_saved(values, tmp_path):
    whole = cnnum.Recording(values, rate=60.0, channels=AXES)
    for suffix in ("mcap", "npz", "csv"):
        assert cnnum.load_recording(whole.save(tmp_path / f"own.{suffix}")) == whole


def test_own_csv_files_have_no_limit(values, tmp_path, monkeypatch):
    """90 s of 8×8 taxels at 100 Hz are 37 MiB; tables that are held as text end at 32."""
    whole = cnnum.Recording(values, rate=100.0, unit="strain", channels=AXES)
    path = whole.save(tmp_path / "own.csv")
    monkeypatch.setattr(text_table, "LARGEST", 100)
    monkeypatch.setattr(text_table, "MOST_ROWS", 2)
    with pytest.raises(CnnumError, match="beyond any file of its kind"):
        text_table.read_table(path)
    assert cnnum.load_recording(path) == whole


def written_csv(path, values, times):
    rows = np.column_stack([times, values.reshape(len(times), -1)])
    path.write_text(table(["s", *map(str, range(18))], rows.tolist()))


def written_h5(path, values, times):
    with pytest.importorskip("h5py").File(path, "w") as file:
        file["v"], file["s"] = values, times[:, np.newaxis]


PAUSED = {
    "csv": written_csv,
    "npz": lambda path, values, times: np.savez(path, v=values, s=times),
    "h5": written_h5,
}


@pytest.mark.parametrize("kind", PAUSED)
def test_a_pause_is_a_gap_and_changes_no_rate(kind, tmp_path):
    values = np.random.default_rng(1).normal(1e4, 5.0, (60, 2, 3, 3))
    times = np.arange(60) / 60.0
    times[30:] += 3600.0
    path = tmp_path / f"theirs.{kind}"
    PAUSED[kind](path, values, times)
    names = [str(n) for n in range(18)] if kind == "csv" else "v"
    path.with_suffix(".toml").write_text(f'{LAYOUT}values = {names!r}\ntime = "s"\n')
    recording = cnnum.load_recording(path)
    assert recording.rate == pytest.approx(60.0)
    assert recording.quality.tolist() == [int(n == 30) for n in range(60)]
    assert recording.sequence[30] - recording.sequence[29] == 216001
    with open_driver("file", {"path": str(path)}) as driver:
        list(driver.frames())
        assert (driver.counters.frames, driver.counters.dropped) == (60, 216000)
    # as a pause of a recording in memory is, through every kind of file
    whole = cnnum.Recording(values, rate=60.0, times=times)
    assert cnnum.load_recording(whole.save(tmp_path / "own.mcap")).quality[30] == 1


@pytest.mark.parametrize("suffix", ["mcap", "npz", "csv"])
def test_a_recording_comes_back_bit_for_bit(values, suffix, tmp_path):
    values[3, 0, 0, 0] = np.nan
    times = np.array([0.0, 0.01, 0.02, 0.05, 0.06, 0.07, 0.08])
    whole = cnnum.Recording(
        values, rate=99.5, unit="N", channels=AXES, times=times, truth={"slip": times > 0.03},
        quality=[0, 0, 0, 1, 0, 0, 0],
    )  # fmt: skip
    back = cnnum.load_recording(whole.save(tmp_path / f"own.{suffix}"))
    assert np.array_equal(back.values, values, equal_nan=True)
    assert np.array_equal(back.times, times)
    assert np.array_equal(back.truth["slip"], times > 0.03)
    assert back.quality.tolist() == [0, 0, 0, 1, 0, 0, 0]
    assert (back.unit, back.channels) == ("N", ("shear_x", "shear_y", "normal"))
    assert back.rate == 99.5
    with pytest.raises(CnnumError, match="already exists; choose another name"):
        whole.save(tmp_path / f"own.{suffix}")


def saved(kind, values, folder):
    """Write values as others would; return the file."""
    flat, times = values.reshape(len(values), -1), 20.0 * np.arange(len(values)) + 1000.0
    path = folder / f"theirs.{kind}"
    if kind == "npy":
        np.save(path, values)
        layout = "rate = 50.0\n"
    elif kind == "npz":
        np.savez(path, taxels=values.transpose(0, 3, 1, 2), ms=times, held=times > 1050)
        layout = 'values = "taxels"\norder = "channels-first"\ntime = "ms"\ntime_unit = "ms"\n'
        layout += 'truth = ["held"]\n'
    elif kind == "h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["trial/taxels"], file["trial/s"] = flat, times / 1000.0
        layout = 'values = "trial/taxels"\ntime = "trial/s"\n'
    else:
        header = ["s", *(f"t{n}_{channel}" for n in range(1, 7) for channel in AXES)]
        rows = [[time, *row] for time, row in zip(times / 1e3, flat, strict=True)]
        path.write_text(table(header, [[float(v) for v in row] for row in rows]))
        layout = 'values = "t{n}_{channel}"\nfirst = 1\ntime = "s"\n'
    path.with_suffix(".toml").write_text(LAYOUT + layout)
    return path


@pytest.mark.parametrize("kind", ["csv", "npy", "npz", "h5"])
def test_files_of_others_are_read_by_their_layout(kind, values, tmp_path):
    recording = cnnum.load_recording(saved(kind, values, tmp_path))
    assert np.array_equal(recording.values, values)
    assert recording.rate == pytest.approx(50.0)
    assert recording.times == pytest.approx(np.arange(7) / 50.0)
    if kind == "npz":
        assert recording.truth["held"].tolist() == [0, 0, 0, 1, 1, 1, 1]


def test_columns_by_a_list_and_one_axis(tmp_path):
    (tmp_path / "p.csv").write_text(table(["b", "a", "note"], [[1.0, 2.0, 9.0], [3.0, 4.0, 9.0]]))
    layout = 'shape = [1, 2]\nchannels = ["z"]\nvalues = ["a", "b"]\nrate = 10\n'
    (tmp_path / "q.toml").write_text(layout)
    driver = open_driver("file", {"path": "p.csv", "layout": "q.toml"}, base=tmp_path)
    frames = list(driver.frames())
    assert [frame.values.ravel().tolist() for frame in frames] == [[2.0, 1.0], [4.0, 3.0]]
    assert frames[0].channels == ("normal",)
    assert driver.counters.frames == 2


FORMS = {
    "mark of Excel": ("\ufeffa,b\r\n1.5,2\r\n", ""),
    "spaces": ("a, b\n1.5, 2\n", ""),
    "semicolons": ("a;b\n1.5;2\n", 'separator = ";"\n'),
    "tabs": ("a\tb\n1.5\t2\n", 'separator = "\\t"\n'),
    "decimal commas": ("a;b\n1,5;2\n", 'separator = ";"\ndecimal = ","\n'),
    "single quotes": ("a;'b'\n'1,5' ;'2,0'\n", 'separator = ";"\ndecimal = ","\n'),
    "single quotes and commas": ("'a',b\n'1,5','2,0'\n", 'decimal = ","\n'),
    "quotes and blanks": ("'a' \"b\"\n'1,5' 2\n", 'separator = " "\ndecimal = ","\n'),
    "lines before": ("# of a logger\n\na,b\n1.5,2\n", "skip = 2\n"),
    "no header": ("1.5,2\n", "header = false\n"),
    "columns by number": ("9,2,1.5\n", 'header = false\nvalues = ["3", "2"]\n'),
    "all columns but the time's": ("0,1.5,2\n", 'header = false\ntime = "1"\n'),
}


@pytest.mark.parametrize("name", FORMS)
def test_forms_of_csv_that_programs_write(name, tmp_path):
    text, more = FORMS[name]
    (tmp_path / "p.csv").write_text(text, newline="")
    named = "" if "header" in more else 'values = ["a", "b"]\n'
    layout = f'shape = [1, 2]\nchannels = ["z"]\nrate = 10\n{named}{more}'
    (tmp_path / "p.toml").write_text(layout)
    assert cnnum.load_recording(tmp_path / "p.csv").values.ravel().tolist() == [1.5, 2.0]


def test_an_empty_field_is_a_value_that_is_missing(tmp_path):
    (tmp_path / "p.csv").write_text("a,b\n1,2\n,2\n")
    (tmp_path / "p.toml").write_text(
        'shape = [1, 2]\nchannels = ["z"]\nrate = 10\nvalues = ["a", "b"]\n'
    )
    recording = cnnum.load_recording(tmp_path / "p.csv")
    assert np.array_equal(recording.values.ravel(), [1, 2, np.nan, 2], equal_nan=True)


WRONG = {
    "no rate": ("", "'rate' must be given, or 'time'"),
    "unknown key": ("rat = 3\n", "Unknown option 'rat'"),
    "wrong pattern": (
        'rate = 1\nvalues = "t{channel}"\n',
        "name 2×3×3 = 18 different columns, got 3",
    ),
    "missing column": ('rate = 1\nvalues = "q{n}_{channel}"\n', "'q0_x', found none of that name"),
    "near column": ('rate = 1\nvalues = "t{n}_{channel}"\n', "a similar one is 't"),
    "no such time": ('values = "t{n}_{channel}"\nfirst = 1\ntime = "when"\n', "a column 'when'"),
    "axis twice": ('rate = 1\nchannels = ["x", "x", "z"]\n', "name each of the 3 channels once"),
    "no TOML": ("rate = \n", "is not TOML"),
    "pads": ("rate = 1\npads = 9\n", "'pads' must be 1 to the 3 columns"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_layout_is_one_sentence(name, values, tmp_path):
    more, said = WRONG[name]
    path = saved("csv", values, tmp_path)
    layout = LAYOUT.replace('channels = ["x", "y", "z"]\n', "") if "channels" in more else LAYOUT
    path.with_suffix(".toml").write_text(layout + more)
    with pytest.raises(CnnumError) as caught:
        cnnum.load_recording(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["csv", "npy", "h5"])
def test_a_file_of_another_shape_or_kind_is_said(kind, values, tmp_path):
    path = saved(kind, values, tmp_path)
    text = path.with_suffix(".toml").read_text()
    path.with_suffix(".toml").write_text(text.replace("[2, 3]", "[3, 3]"))
    with pytest.raises(CnnumError, match=r"t7_x|\(frames, 3, 3, 3\), .* or \(frames, 27\)"):
        cnnum.load_recording(path)
    path.with_suffix(".toml").write_text(text)
    path.write_bytes(b"not at all")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(CnnumError, match="theirs"):
            cnnum.load_recording(path)


def test_a_missing_layout_says_how_to_write_one(tmp_path, values):
    np.save(tmp_path / "own.npy", values)
    with pytest.raises(CnnumError, match=r"no layout '.*own.toml'.* write one with shape = "):
        cnnum.load_recording(tmp_path / "own.npy")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a;b\n1;2\n", 'a layout can set separator = ";"'),
        ("a;b\n1,5;2,5\n", 'a layout can set separator = ";"'),
        ('a,b\n"1,5",2\n', "a layout can set decimal = ','"),
        ("1.5,2\n3,4\n", "a layout can set header = false"),
        ("a,b\n1,two\n", "line 2: expected a number in the column 'b', got 'two'"),
        ("a,b\n1\n", "line 2: expected 2 fields as in line 1, got 1"),
    ],
)
def test_another_form_is_named(text, said, tmp_path):
    (tmp_path / "p.csv").write_text(text)
    (tmp_path / "p.toml").write_text(
        'shape = [1, 2]\nchannels = ["z"]\nrate = 10\nvalues = ["a", "b"]\n'
    )
    with pytest.raises(CnnumError) as caught:
        cnnum.load_recording(tmp_path / "p.csv")
    assert said in str(caught.value)


BAD = {
    "two axes": ({"values": np.zeros((3, 3)), "rate": 1}, "frames, rows, cols, channels"),
    "no frame": ({"values": np.zeros((0, 2, 2, 3)), "rate": 1}, "at least one of each"),
    "rate 0": ({"values": np.zeros((3, 2, 2, 3)), "rate": 0}, "above 0 Hz"),
    "no axes": ({"values": np.zeros((3, 2, 2, 4)), "rate": 1}, "each of the 4 channels once"),
    "times": ({"values": np.zeros((2, 2, 2)), "rate": 1, "times": [1, 0]}, "no earlier than"),
    "truth": ({"values": np.zeros((2, 2, 2)), "rate": 1, "truth": {"a": [1]}}, "one number a"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_recording_is_one_sentence(name):
    parts, said = BAD[name]
    with pytest.raises(CnnumError, match=said):
        cnnum.Recording(**parts)


@pytest.mark.parametrize(
    ("order", "turn"),
    [
        ("", lambda v: v),
        ("frames taxels channels", lambda v: v),
        ("channels taxels frames", lambda v: v.transpose(2, 1, 0)),
        ("taxels frames channels", lambda v: v.transpose(1, 0, 2)),
    ],
)
def test_a_list_of_taxels_is_read_in_any_order_that_is_said(tmp_path, order, turn):
    values = np.random.default_rng(0).normal(size=(50, 6, 3))
    np.save(tmp_path / "a.npy", turn(values))
    (tmp_path / "a.toml").write_text(f'shape = [2, 3]\nrate = 60.0\norder = "{order}"\n')
    found = cnnum.load_recording(tmp_path / "a.npy").values
    np.testing.assert_array_equal(found, values.reshape(50, 2, 3, 3))


@pytest.mark.parametrize("suffix", [".parquet", ".bag", ".db3", ".npz", ".h5", ".csv", ".mcap"])
def test_a_pointer_of_git_lfs_is_called_one_before_a_layout_is_asked_for(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_text(
        f"version https://git-lfs.github.com/spec/v1\noid sha256:{'4' * 64}\nsize 12345\n"
    )
    with pytest.raises(cnnum.CnnumError, match="a Git LFS pointer"):
        cnnum.load_recording(path)


def test_a_folder_with_a_layout_that_is_no_bag_is_one_sentence(tmp_path):
    (tmp_path / "bags").mkdir()
    (tmp_path / "bags.toml").write_text('shape = [1, 2]\nchannels = ["z"]\nrate = 10\n')
    with pytest.raises(cnnum.CnnumError, match="a folder with bags of ROS 1 or ROS 2"):
        open_driver("file", {"path": "bags", "layout": "bags.toml"}, base=tmp_path)


def test_a_lone_line_of_times_and_numbers_is_no_table(tmp_path):
    (tmp_path / "a.csv").write_text("12:00:00.25,13 12:00:00.5,2,3,\n")
    with pytest.raises(CodecError, match="no table of numbers"):
        propose(tmp_path / "a.csv")
