"""Twelve files as other programs write them: a layout, its check and the right event, by nobody."""

import csv
import json

import numpy as np
import pytest
from foreign_files import FILES, FRAMES, PRESSED, RATE, press, times

import cnnum

THREE = """
needs = ["contact"]
[array]
driver = "simulated"
[engine]
name = "numba"
[program]
name = "contact"
[program.parameters]
push = 1.0
reads = "force"
"""
ONE = """
needs = ["onset"]
[array]
driver = "simulated"
[engine]
name = "numba"
[program]
name = "on_off"
[program.parameters]
push = 1.0
"""


@pytest.fixture(params=FILES)
def foreign(request, tmp_path):
    """A file, and what its user knows and it does not say."""
    make, known = FILES[request.param]
    return make(tmp_path), known


def test_a_layout_is_proposed_and_reads_the_file(call, records, foreign):
    path, known = foreign
    done = call("layout", path, "--write", "--json", *known)
    assert done.exit_code == 0, done.stderr
    (said,) = (one for one in records(done.stdout) if one["kind"] == "layout")
    assert (said["frames"], said["written"]) == (FRAMES, str(path.with_suffix(".toml")))
    recording = cnnum.load_recording(path)
    assert recording.rate == pytest.approx(RATE, rel=1e-3)
    rows, cols = recording.shape
    pads = 2 if path.name == "pads.npy" else 1
    moved = np.abs(recording.values[-1] - np.median(recording.values[:90], axis=0))[..., -1]
    row, col = np.argwhere(moved == moved[:, : cols // pads].max())[0]
    # the centre of the press, in rows and columns
    assert row == pytest.approx(0.6 * rows - 0.5, abs=1.0)
    assert col % (cols // pads) == pytest.approx(0.4 * cols / pads - 0.5, abs=1.0)
    shown = call("check", path, "--json")
    assert shown.exit_code == 0, shown.stdout
    sentences = {one["what"]: one["sentence"] for one in records(shown.stdout)}
    assert "and the times agree with it" in sentences["rate"]
    pattern = len(recording.channels) == 3 and rows > 2
    assert ("orders and signs are right" in sentences["order"]) == pattern
    again = call("layout", path, "--write", *known)
    assert again.exit_code == 2
    assert "already exists" in again.stderr


@pytest.mark.one_in(3)
def test_the_event_comes_without_an_edit_by_hand(call, records, foreign, tmp_path):
    path, known = foreign
    assert call("layout", path, "--write", *known).exit_code == 0
    scene = tmp_path / "scene.toml"
    three = len(cnnum.load_recording(path).channels) == 3
    scene.write_text(THREE if three else ONE)
    first, *rest = records(call("replay", path, "--scene", scene, "--json").stdout)
    assert first["kind"] == ("contact" if three else "onset")
    assert PRESSED < first["t"] < PRESSED + 0.1
    assert [one["kind"] for one in rest] == ["summary"]


def test_a_picture_of_a_frame_is_drawn_and_nothing_written(call, tmp_path):
    path = FILES["Contactile"][0](tmp_path)
    done = call("layout", path)
    assert done.exit_code == 0
    *_, top, first, second, third, bottom = done.stdout.strip().splitlines()
    assert top == bottom == "+------+"
    assert "@@" in second
    assert "@@" not in first + third
    assert 'channels = ["x", "y", "z"]' in done.stdout
    assert "# shape: 9 taxels are taken as 3 rows of 3" in done.stdout
    assert not path.with_suffix(".toml").exists()


def test_what_the_file_does_not_say_is_asked_for(call, tmp_path):
    np.save(tmp_path / "a.npy", np.random.default_rng(0).normal(size=(50, 4, 4, 3)))
    done = call("layout", tmp_path / "a.npy", "--write")
    assert done.exit_code == 1
    assert "rate: the file has no times: give it, as in '--set rate=60'" in done.stdout
    assert not (tmp_path / "a.toml").exists()
    done = call("layout", tmp_path / "a.npy", "--set", "rate=60", "--set", "unit=N", "--write")
    assert done.exit_code == 0
    assert "unit:" not in done.stdout
    assert cnnum.load_recording(tmp_path / "a.npy").unit == "N"


WRONG = {
    "none.csv": (None, "There is no file"),
    "empty.csv": (b"", "no table of numbers"),
    "words.csv": (b"some, words\nand, more\n", "no table of numbers"),
    "noise.bin": (
        bytes(range(256)) * 40,
        "neither a table in a text file nor the output of an array",
    ),
    "flat.npy": ("flat", "no array of frames"),
    "cut.mcap": (b"\x89MCAP0\r\n", "not an MCAP file, or has no complete message"),
    "bad.jsonl": (b"{not json\n", "line 1: expected JSON"),
    "page.html": (b"<!DOCTYPE html><html></html>", "no table of numbers"),
    "pointer.npz": (b"version https://git-lfs.github.com/spec/v1\n", "a Git LFS pointer"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_file_of_frames_is_one_sentence(name, call, tmp_path):
    content, said = WRONG[name]
    path = tmp_path / name
    if content == "flat":
        np.save(path, np.zeros(20))
    elif content is not None:
        path.write_bytes(content)
    done = call("layout", path)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.stderr
    assert said in done.stderr


@pytest.mark.parametrize("name", ["a.bag", "a.db3", "bag/metadata.yaml", "a.parquet", "a.jsonl"])
def test_a_pointer_of_git_lfs_is_called_one_in_every_kind_of_file(call, tmp_path, name):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n")
    asked = path.parent if "/" in name else path
    done = call("layout", asked)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "a Git LFS pointer" in done.stderr


DATES = {
    "%d/%m/%Y %H:%M:%S.%f": ("2024-12-31 23:59:58", ""),
    "%m/%d/%Y %I:%M:%S.%f %p": ("2024-12-31 11:59:58", ""),
    "%d.%m.%Y %H:%M:%S,%f": ("2024-05-03 12:00:00", "'%m.%d.%Y %H:%M:%S,%f' fits, too"),
}


@pytest.mark.parametrize("form", DATES)
def test_dates_of_other_forms_have_their_form_proposed(call, tmp_path, form):
    begin, said = DATES[form]
    start = np.datetime64(begin, "us").astype(object)
    values = press(3, 4, offset=900)
    names = [f"r{row}_c{col}_{axis}" for row in range(3) for col in range(4) for axis in "xyz"]
    lines = [";".join(["when", *names])]
    for n, frame in enumerate(values):
        stamp = (start + np.timedelta64(10_000 * n, "us").astype(object)).strftime(form)
        lines.append(";".join([stamp, *(f"{value:.1f}" for value in frame.ravel())]))
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines) + "\n")
    done = call("layout", path, "--write")
    assert done.exit_code == 0, done.stdout
    assert said in done.stdout
    assert f'time_format = "{form}"' in done.stdout
    recording = cnnum.load_recording(path)
    assert recording.rate == pytest.approx(RATE)
    assert len(recording) == FRAMES


def test_pads_of_two_sizes_are_named_and_one_is_proposed(call, tmp_path):
    lines = []
    for n in range(60):
        message = {"message": n}
        for sensor, taxels in enumerate((16, 24), 1):
            data = ",".join(f"{32_768 + n % 3 + k:04X}" for k in range(3 * taxels))
            message[str(sensor)] = {
                "sensor": sensor, "time": 1.0 + 0.01 * n, "model": "x", "taxels": taxels,
                "data": data, "calibrated": None,
            }  # fmt: skip
        lines.append(json.dumps(message))
    path = tmp_path / "xela.jsonl"
    path.write_text("\n".join(lines) + "\n")
    done = call("layout", path, "--write")
    assert done.exit_code == 0, done.stderr
    assert "pads of 4×4 and 4×6 taxels" in done.stdout
    assert cnnum.load_recording(path).shape == (4, 4)
    done = call("layout", path, "--set", "shape=[4, 6]", "--write", "--force")
    assert done.exit_code == 0, done.stderr
    assert cnnum.load_recording(path).shape == (4, 6)


def xsensor(path, head, separator=",", form="{:.2f}", end="\n"):
    """Blocks of rows, each behind a head of its own, as XSensor's text exports have them."""
    lines = []
    for n, frame in enumerate(press(8, 10, axes=1, size=200, offset=20, noise=0.6)[..., 0]):
        lines += [*head(n), ""]
        lines += [separator.join(form.format(value) for value in row) for row in frame]
        lines.append("")
    path.write_text(end.join(lines), newline="")


def long_head(n):
    clock = f"TIME:,12:00:{n / RATE:06.3f}"
    return [
        f"FRAME:,{n + 1}", "SENSOR:,HX210", "DATE:,2024-05-03", clock, "UNITS:,mmHg", "ROWS:,8",
        "COLUMNS:,10",
    ]  # fmt: skip


def wide_head(n):
    return [
        f"Frame:,{n + 1}", f"Date:,2024-05-03,Time:,12:00:{n / RATE:06.3f}", "Units:,N/cm2",
        "Rows:,8,Columns:,10", "Average pressure:,12.3", "Peak pressure:,40.1",
    ]  # fmt: skip


XSENSOR = {  # head, separator, format of a number, end of a line, unit that comes, words for people
    "a head of many lines": (long_head, ",", "{:.2f}", "\n", "count", "the file says 'mmHg'"),
    "several in a line": (wide_head, ",", "{:.2f}", "\r\n", "count", "the file says 'N/cm2'"),
    "tabs": (
        lambda n: [f"FRAME {n + 1} of 300", f"TIME {n / RATE:.3f} s", "UNITS kPa"],
        "\t", "{:.1f}", "\n", "kPa", "",
    ),
    "ms and semicolons": (
        lambda n: [f"Frame;{n + 1}", f"Time;{1000 * n / RATE:.0f}"],
        ";", "{:.0f}", "\n", "count", "the file does not say it",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", XSENSOR)
def test_blocks_of_xsensor_are_read_without_an_edit(call, records, tmp_path, kind):
    head, separator, form, end, unit, undecided = XSENSOR[kind]
    path = tmp_path / "session.csv"
    xsensor(path, head, separator, form, end)
    done = call("layout", path, "--write", "--json")
    assert done.exit_code == 0, done.stderr
    assert undecided in done.stdout
    recording = cnnum.load_recording(path)
    assert (len(recording), recording.shape, recording.unit) == (FRAMES, (8, 10), unit)
    assert recording.rate == pytest.approx(RATE, rel=1e-3)
    expected = press(8, 10, axes=1, size=200, offset=20, noise=0.6)
    # rounded as the file has it
    assert (
        np.abs(recording.values - expected).max()
        <= {"{:.2f}": 0.005, "{:.1f}": 0.05}.get(form, 0.5) + 1e-9
    )
    assert call("check", path).exit_code == 0
    scene = tmp_path / "scene.toml"
    scene.write_text(ONE)
    first, *_ = records(call("replay", path, "--scene", scene, "--json").stdout)
    assert first["kind"] == "onset"
    assert PRESSED < first["t"] < PRESSED + 0.1


def columns(path, cells, names, head="t"):
    heads = [head, *(f"r{r}_c{c}_{name}" for r in range(4) for c in range(4) for name in names)]
    path.write_text("\n".join([",".join(heads), *(",".join(row) for row in cells)]) + "\n")


def test_a_column_with_a_word_is_a_column(call, tmp_path):
    """One of an error of Excel was left out, and 47 columns were a row of 47 taxels."""
    values, path = press(4, 4), tmp_path / "a.csv"
    cells = [
        [f"{n / RATE:.3f}", *(f"{v:.0f}" for v in row.ravel())] for n, row in enumerate(values)
    ]
    for n, word in enumerate(("#VALUE!", "undefined", "inf", "-Inf")):
        cells[100 + n][5 + n] = word
    columns(path, cells, "xyz")
    done = call("layout", path, "--write")
    assert done.exit_code == 0, done.stderr
    recording = cnnum.load_recording(path)
    assert (recording.shape, len(recording.channels)) == ((4, 4), 3)
    assert [int((~np.isfinite(one)).sum()) for one in recording.values[100:104]] == [1] * 4
    cells[50][9] = "broken"  # a word that nobody knows has its line
    columns(path, cells, "xyz")
    done = call("layout", path, "--write", "--force")
    assert done.exit_code == 2
    assert "line 52" in done.stderr
    assert "broken" in done.stderr


def test_names_of_channels_of_two_words_are_names_of_channels(call, tmp_path):
    """The normal channel was left out beside "shear_x" and "shear_y"."""
    values, path = press(4, 4), tmp_path / "a.csv"
    cells = [
        [f"{10.0 * n:.0f}", *(f"{v:.0f}" for v in row.ravel())] for n, row in enumerate(values)
    ]
    columns(path, cells, ("shear_x", "shear_y", "normal"), "time (ms)")
    done = call("layout", path, "--write")
    assert done.exit_code == 0, done.stderr
    recording = cnnum.load_recording(path)
    assert recording.channels == cnnum.frame.FORCE_AXES
    assert recording.rate == pytest.approx(RATE)
    np.testing.assert_allclose(recording.values, np.round(values), atol=0.51)


def test_taxels_before_channels_and_frames_last_are_read(call, tmp_path):
    values, path = press(4, 4), tmp_path / "a.npz"
    stamps = np.arange(len(values)) / RATE
    np.savez(path, tactile=np.moveaxis(values.reshape(-1, 16, 3), 0, -1), stamps=stamps)
    done = call("layout", path, "--write")
    assert done.exit_code == 0, done.stderr
    np.testing.assert_array_equal(cnnum.load_recording(path).values, values)


def bridge(folder, values, times):
    """What a bridge of ROS to a browser sends."""
    lines = [
        {
            "op": "publish",
            "msg": {
                "header": {"stamp": {"secs": 1_700_000_000, "nsecs": round(1e9 * t)}},
                "taxels": [dict(zip("xyz", one, strict=True)) for one in frame.reshape(-1, 3)],
            },
        }
        for frame, t in zip(values, times, strict=True)
    ]
    (folder / "a.jsonl").write_text("\n".join(map(json.dumps, lines)))
    return folder / "a.jsonl"


def json_list(folder, values, times, indent=None):
    lines = [{"time": t, "data": f.ravel().tolist()} for f, t in zip(values, times, strict=True)]
    (folder / "a.json").write_text(json.dumps(lines, indent=indent))
    return folder / "a.json"


def channels_first(folder, values, times):
    """Four columns might be four channels, and three channels three rows."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "a.h5", "w") as file:
        file["tactile"], file["t"] = values.transpose(0, 3, 1, 2), times
    return folder / "a.h5"


@pytest.mark.parametrize(
    "write",
    [bridge, json_list, lambda *args: json_list(*args, indent=2), channels_first],
    ids=["stamps of ROS", "list", "list over lines", "channels first"],
)
def test_messages_with_stamps_lists_and_channels_before_four_columns(call, tmp_path, write):
    values, times = press(4, 4, offset=1000.0)[:90], np.arange(90) / 100.0
    path = write(tmp_path, values, times)
    assert call("layout", path, "--write").exit_code == 0
    recording = cnnum.load_recording(path)
    np.testing.assert_allclose(recording.values, values, atol=1e-9)
    assert recording.rate == pytest.approx(100.0)


REFUSED = {
    "a row a taxel": (
        ["time,taxel,x,y,z", *(f"{n / 100},{k},1,2,{n}" for n in range(20) for k in range(16))],
        "several rows per frame: 'taxel' repeats 16 values",
    ),
    "a row a sensor": (
        ["t,side,x0,x1,x2", *(f"{n / 100},{k},1,2,{n}" for n in range(20) for k in ("l", "r"))],
        "several rows per frame: 'side' repeats 2 values",
    ),
    "a row a taxel of a sensor": (
        ["t,side,taxel,z", *(f"{n / 9},{k // 4},{k % 4},{n}" for n in range(20) for k in range(8))],
        "several rows per frame: 'side' repeats 2 values",
    ),
    "units below names": (
        ["t,P1,P2", "[s],[kPa],[kPa]", *(f"{n / 100},{n},3" for n in range(20))],
        "line 2: units ([s], …) below the names",
    ),
    "two levels of names": (
        ["taxel,0,0,0,1,1,1", "axis,x,y,z,x,y,z", *(f"{n / 100},1,2,3,4,5,6" for n in range(20))],
        "line 2: a second row of names",
    ),
    "two columns of a name": (
        ["t,t0_x,t0_y,t0_y", *(f"{n / 100},{n % 3},2,{n}" for n in range(20))],
        "two different columns with the name 't0_y'",
    ),
    "Arduino's monitor": (
        [f"12:00:00.{10 * n:03d} -> {n},2,3" for n in range(20)],
        "Arduino's serial monitor",
    ),
}


REFUSED |= {
    "a row a taxel, by frames": (
        ["frame,taxel,x,y,z", *(f"{n},{k},1,2,{n}" for n in range(20) for k in range(16))],
        "several rows per frame: 'taxel' repeats 16 values",
    ),
    "a row a taxel, without names": (
        [f"{n / 100},{k},1,2,{n}" for n in range(20) for k in range(16)],
        "several rows per frame: '2' repeats 16 values",
    ),
    "a row a taxel, of which some are lost": (
        [
            "t,taxel,x,y,z",
            *(f"{n / 100},{k},1,2,{n % 7}" for n in range(20) for k in range(16) if (n + k) % 31),
        ],
        "several rows per frame: 'taxel' repeats 16 values",
    ),
    "a quotation mark that is not closed": (
        ['t,"x,y', *(f"{n / 100},1,{n % 7}.{'0' * 400}" for n in range(400))],
        "shows no table of numbers",
    ),
    "a column a frame": (
        [f"p{k}," + ",".join(f"{n}.5" for n in range(40)) for k in range(9)],
        "The first column names the rows, as 'p1', as where a frame is a column",
    ),
    "lists as Python prints them": (
        [f"[{n / 100}, 31, 30, {n % 7}, 33, 34, 35, 36, 37, 38, 39, 40]" for n in range(40)],
        "other signs beside their numbers, as in '[0.0'",
    ),
    "two separators": (
        [f"{n / 100};31 30 {n % 7} 33 34 35 36" for n in range(40)],
        "other signs beside their numbers, as in '0.0;31'",
    ),
    "a log": (
        [f"[INFO] [{n / 100}] [skin]: 31,30,{n % 7},33,34,35" for n in range(40)],
        "other signs beside their numbers, as in '[INFO] [0.0] [skin]: 31'",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_tables_that_would_be_misread_are_one_sentence(call, tmp_path, name):
    lines, said = REFUSED[name]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    done = call("layout", tmp_path / "a.csv")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


def lines_of(head, times, fields=str, frames=None, separator=","):
    """A table with three numbers of each of twelve taxels, or with those that are given."""
    values = np.rint(press(3, 4, offset=900)).reshape(FRAMES, -1) if frames is None else frames
    rows = [[time(n) for time in times] + [fields(v) for v in row] for n, row in enumerate(values)]
    return [separator.join(row) for row in [head, *rows]]


def day(n, form, month):
    when = np.datetime64("2024-08-03T23:59:58") + np.timedelta64(10 * n, "ms")
    return when.astype(object).strftime(form).replace("August", month).replace("Aug", month)


TXLS = [f"txl{n}_{axis}" for n in range(12) for axis in "xyz"]
WRITTEN = {
    "month, decimal comma": (
        lambda: lines_of(
            ["Zeit", *TXLS], [lambda n: day(n, "%d. %b %Y %H:%M:%S,%f", "Aug")],
            lambda v: f"{v:.1f}".replace(".", ","), separator=";",
        ), "utf-8",
    ),
    "month in words of blanks, tabs": (
        lambda: lines_of(
            ["temps", *TXLS], [lambda n: day(n, "%d %B %Y %H:%M:%S.%f", "août")],
            lambda v: f"{v:.1f}".replace(".", ","), separator="\t",
        ), "utf-8",
    ),
    "text of Windows": (
        lambda: lines_of(["Zeit (µs)", *TXLS], [lambda n: f"{10_000 * n}"]), "cp1252"
    ),
    "two sensors": (
        lambda: lines_of(
            ["t", *(f"S{k}_T{n}_{axis}" for k in (1, 2) for n in range(12) for axis in "xyz")],
            [lambda n: f"{n / 100}"],
            frames=np.tile(np.rint(press(3, 4, offset=900)).reshape(FRAMES, -1), 2),
        ), "utf-8",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITTEN)
def test_tables_of_other_countries_and_of_two_sensors(call, tmp_path, name):
    lines, encoding = WRITTEN[name]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines()) + "\n", encoding)
    done = call("layout", path, "--write")
    assert done.exit_code == 0, done.stdout + done.stderr
    taken = "# values: the columns from 'S1_T0_x' to 'S1_T11_z' are taken, and not those from 'S2"
    assert (taken in done.stdout) == (name == "two sensors")
    recording = cnnum.load_recording(path)
    np.testing.assert_array_equal(recording.values, np.rint(press(3, 4, offset=900)))
    assert recording.times == pytest.approx(np.arange(FRAMES) / RATE, abs=1e-9)


PLACES = [(row, col) for row in range(6) for col in range(8)]


def pressures():
    """(frames, 6, 8) counts of one channel."""
    return np.rint(press(6, 8, axes=1, offset=30, size=150))[..., 0]


def named(names, clock="t", time=lambda n: f"{n / 100}", begin="", empty=0):
    """A table of pressures, with empty columns at its end."""

    def write(folder):
        rows = lines_of([begin + clock, *names], [time], frames=pressures().reshape(FRAMES, -1))
        path = folder / "a.csv"
        path.write_text("\n".join([rows[0], *(row + empty * "," for row in rows[1:])]) + "\n")
        return path

    return write


def lines_of_json(content):
    def write(folder):
        objects = zip(times().tolist(), pressures().tolist(), strict=True)
        path = folder / "a.jsonl"
        path.write_text("\n".join(json.dumps({"t": t, **content(one)}) for t, one in objects))
        return path

    return write


def arrays_of_rows(folder):
    np.savez(folder / "a.npz", t=times(), **{f"row{n}": pressures()[:, n] for n in range(6)})
    return folder / "a.npz"


def matlab(folder):
    """What MATLAB 7.3 writes of (frames, rows, columns): HDF5 with the axes reversed."""
    h5py = pytest.importorskip("h5py")
    path = folder / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["pressure"], file["t"] = pressures().T, times()[np.newaxis]
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
    return path


def digits(n):
    return day(n, "%Y%m%d%H%M%S%f", "Aug")


NUMBERED = [f"s{n}" for n in range(48)]
READ = {
    "one channel of a multiple of three": named(NUMBERED),
    "columns before rows": named([f"c{col}_r{row}" for row, col in PLACES]),
    "words of both": named([f"Column {col + 1} Row {row + 1} (kPa)" for row, col in PLACES]),
    "x and y of a place": named([f"x{col}_y{row}" for row, col in PLACES]),
    "numbers with zeros before": named([f"r{row:02d}c{col:02d}" for row, col in PLACES]),
    "numbers in brackets": named([f"pad.taxels[{n}].force.z" for n in range(48)]),
    "dates in digits": named(NUMBERED, "stamp", digits),
    "differences of pandas": named(NUMBERED, "t", lambda n: f"0 days 00:00:{n / 100:09.6f}"),
    "rostopic": named(NUMBERED, "time,id", lambda n: f"{17 * 10**17 + n * 10**7},skin", begin="%"),
    "an empty column with a name": named([*NUMBERED, "note"], empty=1),
    "a field a taxel": lines_of_json(
        lambda one: {f"p{n}": v for n, v in enumerate(v for row in one for v in row)}
    ),
    "a field a row": lines_of_json(lambda one: {f"row{n}": row for n, row in enumerate(one)}),
    "an array a row": arrays_of_rows,
    "MATLAB": matlab,
}


@pytest.mark.parametrize("name", READ)
def test_pressures_of_six_rows_and_eight_columns_are_found(call, tmp_path, name):
    """Others were 4×4 taxels of three channels, turned by their names, or with wrong times."""
    path = READ[name](tmp_path)
    done = call("layout", path, "--write")
    assert done.exit_code == 0, done.stdout + done.stderr
    recording = cnnum.load_recording(path)
    np.testing.assert_array_equal(recording.values[..., 0], pressures())
    assert recording.times == pytest.approx(np.arange(FRAMES) / RATE, abs=1e-6)


def three_fields(content):
    def write(folder):
        path = folder / "a.jsonl"
        frames = zip(times().tolist(), np.rint(press(4, 4, offset=900)).tolist(), strict=True)
        path.write_text("\n".join(json.dumps({"t": t, **content(one)}) for t, one in frames))
        return path

    return write


def three_arrays(folder):
    made = np.rint(press(4, 4, offset=900))
    np.savez(
        folder / "a.npz", t=times(), **{f"force_{a}": made[..., n] for n, a in enumerate("xyz")}
    )
    return folder / "a.npz"


def one_array_a_number(folder):
    values = np.rint(press(4, 4, offset=900)).reshape(FRAMES, 16, 3)
    np.savez(
        folder / "a.npz",
        time=times(),
        gain=np.ones(4),
        **{f"taxel{n}_{axis}": values[:, n, k] for n in range(16) for k, axis in enumerate("xyz")},
    )
    return folder / "a.npz"


PARTS = {
    "a field a channel": three_fields(
        lambda one: {a: [v[n] for row in one for v in row] for n, a in enumerate("xyz")}
    ),
    "a field a taxel": three_fields(
        lambda one: {
            f"taxel{n}": dict(zip("xyz", v, strict=True))
            for n, v in enumerate(v for row in one for v in row)
        }
    ),
    "an array a channel": three_arrays,
    "an array a number": one_array_a_number,
}


@pytest.mark.parametrize("name", PARTS)
def test_parts_of_a_frame_are_put_together(call, tmp_path, name):
    """One channel, or one taxel, was taken for the frame in silence."""
    path = PARTS[name](tmp_path)
    assert call("layout", path, "--write").exit_code == 0
    recording = cnnum.load_recording(path)
    np.testing.assert_array_equal(recording.values, np.rint(press(4, 4, offset=900)))


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv.gz", b"\x1f\x8b\x08", "is compressed: unpack it"),
        ("a.xlsx", b"PK\x03\x04", "save the sheet as CSV"),
        ("a.mat", b"MATLAB 5.0 MAT-file", "save it there with '-v7.3'"),
        ("a.pkl", b"\x80\x04\x95", "numpy.savez"),
        (
            "a.json",
            b'{"t": [0, 1, 2], "p": [[1, 2], [3, 4], [5, 6]]}',
            "holds all frames in one message",
        ),
    ],
)
def test_files_of_other_kinds_are_called_so(call, tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    done = call("layout", tmp_path / name)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


@pytest.mark.parametrize("head", ["t,taxel,z", "taxel,x,y,z"])
def test_rows_that_may_be_of_one_taxel_each_are_said_to_be_frames(call, tmp_path, head):
    rows = [[(16 * n + k) / 1600, k, n % 5, n % 7] for n in range(20) for k in range(16)]
    rows = [row[head.startswith("taxel") :][: len(head.split(","))] for row in rows]
    text = "\n".join([head, *(",".join(map(str, row)) for row in rows)])
    (tmp_path / "a.csv").write_text(text + "\n")
    done = call("layout", tmp_path / "a.csv")
    assert "rows: each is taken as a frame, and 'taxel' counts 16 values again" in done.stdout


def test_lines_longer_than_a_field_of_csv_may_be_are_read(call, tmp_path):
    values = np.random.default_rng(0).uniform(size=(5, 90, 90, 1))
    names = ",".join(f"r{n // 90}_c{n % 90}" for n in range(8100))
    rows = [",".join(f"{x:.15f}" for x in frame) for frame in values.reshape(5, -1)]
    assert len(rows[0]) > csv.field_size_limit()
    (tmp_path / "a.csv").write_text("\n".join([names, *rows]) + "\n")
    assert call("layout", tmp_path / "a.csv", "--set", "rate=60", "--write").exit_code == 0
    recording = cnnum.load_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(recording.values, values, atol=1e-14)


def test_times_among_the_numbers_of_a_frame_are_no_taxel(call, tmp_path):
    np.save(tmp_path / "a.npy", np.column_stack([times(), pressures().reshape(FRAMES, -1)]))
    done = call("layout", tmp_path / "a.npy", "--set", "rate=100")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "number 0 of a frame rises from frame to frame, as a time does" in done.stderr


def test_one_of_two_clocks_is_said_to_be_taken(call, tmp_path):
    """As is any suffix of a table in text."""
    lines = lines_of(
        ["host_time", "device_us", *TXLS], [lambda n: f"{n / 100}", lambda n: f"{10_003 * n}"]
    )
    (tmp_path / "a.out").write_text("\n".join(lines) + "\n")
    done = call("layout", tmp_path / "a.out", "--write")
    assert done.exit_code == 0, done.stderr
    assert "# time: 'host_time' is taken of 'host_time', 'device_us'" in done.stdout


def test_seconds_and_nanoseconds_in_two_columns_are_asked_about(call, tmp_path):
    """The seconds alone have a rate of 120 Hz for 100."""
    head = ["header.stamp.sec", "header.stamp.nanosec", *TXLS]
    lines = lines_of(head, [lambda n: f"{17 + n // 100}", lambda n: f"{n % 100 * 10_000_000}"])
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    done = call("layout", tmp_path / "a.csv")
    assert done.exit_code == 1
    assert "the times are in two columns: make one of them" in done.stdout
    assert call("layout", tmp_path / "a.csv", "--set", "rate=100", "--write").exit_code == 0
    recording = cnnum.load_recording(tmp_path / "a.csv")
    np.testing.assert_array_equal(recording.values, np.rint(press(3, 4, offset=900)))


CUT = {
    "r{0}_c{1}": ([(row, 0) for row in range(8)], (8, 1)),
    "p_r{0}_c{1}": ([(row, col) for row in range(4) for col in (1, 2)], (4, 2)),
    "r{0}c{1}": ([(row, col) for row in (0, 2, 3) for col in (0, 1)], (3, 2)),
    "ch{0}": ([(n,) for n in range(0, 16, 2)], None),
    "taxel {0}": ([(n,) for n in (0, 1, 2, 5, 6, 9, 13, 14, 15)], None),
}


@pytest.mark.parametrize("name", CUT)
def test_columns_cut_from_a_table_keep_their_grid_or_are_asked_about(call, tmp_path, name):
    """Every second column of a 4×4 array was proposed as t0 to t7, and refused by its reader."""
    places, shape = CUT[name]
    rng = np.random.default_rng(0)
    values = 900 + 40 * np.arange(len(places)) + rng.integers(0, 5, (FRAMES, len(places)))
    values[150:, 3] += 300  # a press
    head = ["t", *(name.format(*place) for place in places)]
    lines = lines_of(head, [lambda n: f"{n / 100}"], frames=values)
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    done = call("layout", tmp_path / "a.csv", "--write", "--set", 'channels=["z"]')
    assert done.exit_code == (1 if shape is None else 0)
    if shape is None:
        assert "leave out numbers, so that they seem to be a part of an array" in done.stdout
        shape = (1, len(places))
        known = ["--set", f"shape={list(shape)}", "--set", 'channels=["z"]']
        assert call("layout", tmp_path / "a.csv", "--write", *known).exit_code == 0
    recording = cnnum.load_recording(tmp_path / "a.csv")
    assert recording.shape == shape
    np.testing.assert_array_equal(recording.values.reshape(FRAMES, -1), values)


@pytest.mark.filterwarnings("default::cnnum.errors.RecordingWarning")
@pytest.mark.parametrize("cut", [0, 2, 30])
def test_a_last_line_that_was_cut_off_is_left_out(call, tmp_path, cut):
    """Also within its last number, where no other is so short; a whole line may lack its end."""
    path = tmp_path / "a.csv"
    text = "\n".join(lines_of(["t", *TXLS], [lambda n: f"{n / 100}"]))
    path.write_text(text[: len(text) - cut])
    done = call("layout", path)
    assert done.exit_code == 0
    assert f"Recording({FRAMES - (cut > 0)} frames" in done.stdout
    assert ("ends within line" in done.stderr) == (cut > 0)
    assert ("its last number is shorter than all others" in done.stderr) == (cut == 2)


def test_words_and_times_that_come_often_are_no_fault(call, tmp_path):
    """A coarse clock, and a row of missing values below the first."""
    rows = [f"{n // 10 / 10},{n % 7},{n % 9},3,{n % 3}" for n in range(200)]
    text = "\n".join(["t,p1,p2,p3,p4", rows[0], "0.0,NA,NA,NA,NA", *rows[1:]])
    (tmp_path / "a.csv").write_text(text)
    done = call("layout", tmp_path / "a.csv")
    assert done.exit_code == 0
    assert 'time = "t"' in done.stdout
    assert "shape = [2, 2]" in done.stdout
