"""Tables in text files as programs write them: headers, times, words, signs, and their faults."""

import json
import re
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cnnum
from cnnum.drivers.own_data.proposal import propose
from cnnum.drivers.text_table import by_format, nanoseconds
from cnnum.errors import CnnumError, RecordingWarning

LAYOUT = 'shape = [1, 2]\nchannels = ["z"]\nvalues = ["a", "b"]\n'
TIMED = LAYOUT + 'time = "t"\n'


def load(folder, text, layout, name="p.csv"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    path.with_suffix(".toml").write_text(layout)
    return cnnum.load_recording(path)


HEADERS = {
    "a header as NumPy writes it": "# a,b\n1.5,2\n3,4\n",
    "without the blank": "#a,b\n1.5,2\n3,4\n",
    "behind two signs": "## a,b\n1.5,2\n3,4\n",
    "comments before and between": "# of a logger\n# at night\na,b\n# start\n1.5,2\n#\n3,4\n",
    "a comment of words before the header of NumPy": "# notes, of all, kinds\n# a,b\n1.5,2\n3,4\n",
    "a comma at the end of each row": "a,b\n1.5,2,\n3,4,\n",
    "at the end of all lines": "a,b,\n1.5,2,\n3,4,\n",
    "several, as a spreadsheet's": "a,b,,,\n1.5,2,,,\n3,4,,,\n,,,,\n",
    "rows of nothing": "a,b\n1.5,2\n\n3,4\n\n",
    "a sheet as Unicode text": "a,b\n1.5,2\n3,4\n".encode("utf-16"),
    "lines of a Mac of old": "a,b\r1.5,2\r3,4\r",
    "names in quotes": '"a","b"\n"1.5","2"\n"3","4"\n',
}


@pytest.mark.parametrize("name", HEADERS)
def test_headers_and_ends_of_rows(name, tmp_path):
    recording = load(tmp_path, HEADERS[name], LAYOUT + "rate = 10.0\n")
    assert recording.values.reshape(2, 2).tolist() == [[1.5, 2.0], [3.0, 4.0]]


def test_a_last_field_that_is_missing_is_no_comma_too_many(tmp_path):
    recording = load(tmp_path, "a,b\n1.5,\n3,4\n", LAYOUT + "rate = 10.0\n")
    assert np.isnan(recording.values[0, 0, 1, 0])


def test_blanks_between_fields_and_other_comments(tmp_path):
    text = "% a log\n  a   b\n  1.5 \t2\n3  4\n"
    layout = LAYOUT + 'rate = 10.0\nseparator = " "\ncomment = "%"\n'
    assert load(tmp_path, text, layout).values.reshape(2, 2).tolist() == [[1.5, 2.0], [3.0, 4.0]]


WORDS = ["NA", "N/A", "#N/A", "NaN", "NaT", "NULL", "null", "None", "none", "-", "--", "?", "<NA>"]


@pytest.mark.parametrize("word", ["", " ", *WORDS, "1.#QNAN", "-1.#IND"])
def test_words_for_a_missing_value(word, tmp_path):
    values = load(tmp_path, f"a,b\n1,2\n{word},2\n", LAYOUT + "rate = 10.0\n").values
    assert np.array_equal(values.ravel(), [1, 2, np.nan, 2], equal_nan=True)


@pytest.mark.parametrize("word", ["two", "1_000", "0x10", "NA2", "1.2.3", "1,5", "16.5 mN"])
def test_other_words_are_refused_with_the_line(word, tmp_path):
    with pytest.raises(CnnumError, match=r"p\.csv', line 3: expected a number in the column 'a'"):
        load(tmp_path, f'a,b\n1,2\n"{word}",2\n', LAYOUT + "rate = 10.0\n")


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_decimal_commas_in_quotes(separator, tmp_path):
    text = f'a{separator}b\n"1,5"{separator}"2,0"\n"3,25"{separator}"4,0"\n'
    layout = LAYOUT + f'rate = 10.0\ndecimal = ","\nseparator = {json.dumps(separator)}\n'
    assert load(tmp_path, text, layout).values.ravel().tolist() == [1.5, 2.0, 3.25, 4.0]


NUMBERS = {  # how 16300.5 and 950 are written, the separator, and keys of the layout
    "English": ("16,300.5", "950", ",", {"thousands": ","}),
    "English without parts": ("16,300", "950", ",", {"thousands": ","}),
    "German": ("16.300,5", "950", ";", {"thousands": ".", "decimal": ",", "separator": ";"}),
    "Swiss": ("16'300.5", "950", ";", {"thousands": "'", "separator": ";"}),
    "French": ("16\u202f300,5", "950", "\t", {"decimal": ",", "separator": "\t"}),
    "ISO": ("16 300.5", "950", ";", {"thousands": " ", "separator": ";"}),
    "millions": ("1,016,300", "1,000,950", ",", {"thousands": ","}),
    "decimal commas": ("16,30", "9,5", ",", {"decimal": ","}),
    "decimal commas of three digits": ("0,163", "0,950", ";", {"decimal": ",", "separator": ";"}),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_signs_between_thousands_are_read_and_proposed(name, tmp_path):
    """In quotes they looked like decimal commas: 16,300 became 16.3."""
    large, small, separator, keys = NUMBERS[name]
    rows = [(f"{n / 50:.2f}", *([large, small, small, large])) for n in range(40)]
    comma = keys.get("decimal") == ","
    rows = [(row[0].replace(".", ",") if comma else row[0], *row[1:]) for row in rows]
    path = tmp_path / "a.csv"
    quoted = [separator.join(f'"{text}"' for text in row) for row in rows]
    path.write_text("\n".join([separator.join(["t", "p0", "p1", "p2", "p3"]), *quoted]) + "\n")
    proposal = propose(path)
    assert {key: proposal.table.get(key) for key in keys} == keys
    assert not [said for said in proposal.undecided if "thousands" in said]
    path.with_suffix(".toml").write_text(proposal.text())
    sign, part = proposal.table.get("thousands", ""), proposal.table.get("decimal", ".")
    expected = [
        float((text.replace(sign, "") if sign else text).replace(part, "."))
        for text in (large, small, small, large)
    ]
    values = cnnum.load_recording(path).values
    assert values[5].ravel().tolist() == expected
    assert max(expected) > 1000.0 or name.startswith("decimal")


def test_thousands_that_may_be_decimals_are_said(tmp_path):
    rows = "\n".join(f'{n / 50:.2f},"16,{300 + n}","17,{100 + n}"' for n in range(40))
    (tmp_path / "a.csv").write_text(f"t,p0,p1\n{rows}\n")
    proposal = propose(tmp_path / "a.csv")
    assert proposal.table["thousands"] == ","
    with pytest.raises(CnnumError, match=r"set decimal = ',' or thousands = ','"):
        load(tmp_path, 'a,b\n"16,300","17,100"\n', 'shape = [1, 2]\nchannels=["z"]\nrate=9.0\n'
             'values=["a", "b"]\n')  # fmt: skip


def test_a_header_that_comes_again_is_left_out_and_said(tmp_path):
    text = "t,a,b\n0,1,2\n0.1,3,4\nt,a,b\n0.2,5,6\n"
    with pytest.warns(RecordingWarning, match="line 4: the header occurs again"):
        assert load(tmp_path, text, TIMED).values.ravel().tolist() == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize(
    ("first", "second", "form"),
    [
        ("03. Mai 2024 12:00:00,10", "03. Mai 2024 12:00:00,35", "%d. %b %Y %H:%M:%S,%f"),
        ("03 Dez 2024 12:00:00.10", "03 Dez 2024 12:00:00.35", "%d %b %Y %H:%M:%S.%f"),
        ("3-août-2024 12:00:00.10", "3-août-2024 12:00:00.35", "%d-%b-%Y %H:%M:%S.%f"),
        ("May 03, 2024 12:00:00.10", "May 03, 2024 12:00:00.35", "%b %d, %Y %H:%M:%S.%f"),
    ],
)
def test_dates_with_names_of_months_are_proposed_and_read(first, second, form, tmp_path):
    path = tmp_path / "a.csv"
    head, loads = [f"p{n}" for n in range(16)], map(str, range(16))
    end = ";" + ";".join(loads)
    path.write_text(f"when;{';'.join(head)}\n{first}{end}\n{second}{end}\n")
    proposal = propose(path)
    assert proposal.table["time_format"] == form
    path.with_suffix(".toml").write_text(proposal.text())
    assert cnnum.load_recording(path).times == pytest.approx([0.0, 0.25])


def test_a_row_that_its_writer_did_not_end_is_left_out_and_said(tmp_path):
    text = "t,a,b\n0,1,2\n0.1,3,4\n0.2,5"
    with pytest.warns(RecordingWarning, match="ends within line 4, which is left out"):
        assert len(load(tmp_path, text, TIMED)) == 2
    assert len(load(tmp_path, text + ",6", TIMED)) == 3


TIMES = {
    "with a blank": ("2024-05-03 12:00:00", "2024-05-03 12:00:00.25"),
    "as ISO 8601 has it": ("2024-05-03T12:00:00.000Z", "2024-05-03T14:00:00.250+02:00"),
    "in ns": ("2024-05-03 12:00:00.000000001", "2024-05-03 12:00:00.250000001"),
    "with slashes": ("2024/05/03 12:00:00", "2024/05/03 12:00:00.25"),
    "short": ("20240503T120000.00", "20240503T120000.25"),
    "of day": ("11:59:59.9", "12:00:00.15"),
    "over midnight": ("23:59:59.9", "00:00:00.15"),
    "of half a day": ("11:59:59.9 AM", "12:00:00.15 PM"),
    "with a comma": ('"11:59:59,9"', '"12:00:00,15"'),
    "in seconds": ("17.5", "17.75"),
    "from 1970": ("1714737600.5", "1714737600.75"),
}


@pytest.mark.parametrize("name", TIMES)
def test_times_as_loggers_write_them(name, tmp_path):
    first, second = TIMES[name]
    recording = load(tmp_path, f"t,a,b\n{first},1,2\n{second},3,4\n", TIMED)
    assert recording.times == pytest.approx([0.0, 0.25], abs=1e-9)
    assert recording.rate == pytest.approx(4.0)


def test_a_form_of_dates_that_the_layout_names(tmp_path):
    text = "t;a;b\n03.05.2024 12:00:00.00;1;2\n03.05.2024 12:00:00.25;3;4\n"
    layout = TIMED + 'separator = ";"\ntime_format = "%d.%m.%Y %H:%M:%S.%f"\n'
    assert load(tmp_path, text, layout).times.tolist() == [0.0, 0.25]
    with pytest.raises(CnnumError, match=r"line 2: expected a time in the column 't'.*'time_form"):
        load(tmp_path, text, TIMED + 'separator = ";"\n')


@given(st.datetimes(), st.sampled_from([" ", "T"]), st.integers(0, 999))
def test_dates_are_read_to_the_nanosecond(when, between, nano):
    text = f"{when.isoformat(between, 'microseconds')}{nano:03}"
    since = np.datetime64(when, "us").astype(np.int64)
    assert nanoseconds(text) == int(since) * 1000 + nano
    assert by_format("%Y-%m-%d %H:%M:%S.%f")(f"{when:%Y-%m-%d %H:%M:%S.%f}") in (
        int(since) * 1000,
        None,  # strftime writes years before 1000 with fewer digits
    )


FAULTS = {
    "a date alone": ("t,a,b\n2024-05-03,1,2\n2024-05-04,3,4\n", r"line 2: expected a time"),
    "a later line": ("t,a,b\n12:00:00,1,2\nsoon,3,4\n", r"line 3: expected a time .* got 'soon'"),
    "all equal": ("t,a,b\n5,1,2\n5,3,4\n5,5,6\n", r"times 't' are all equal.*set 'rate'"),
    "no clock": ("t,a,b\n3,1,2\n1,1,3\n4,1,4\n1,1,5\n5,1,6\n", r"line 3: the times 't' go back"),
    "a time that is missing": ("t,a,b\n0,1,2\nNA,3,4\n", r"line 3: expected a finite number"),
    "a torn row": ("t,a,b\n0,1,2\n0.1,3\n", r"line 3: expected 3 fields as in line 1, got 2"),
    "a longer row": ("t,a,b\n0,1,2\n0.1,3,4,5\n", r"line 3: expected 3 fields .* got 4"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named_with_the_line(name, tmp_path):
    text, said = FAULTS[name]
    with pytest.raises(CnnumError) as caught:
        load(tmp_path, text, TIMED)
    assert re.search(said, str(caught.value)), caught.value
    assert "\n" not in str(caught.value)


def test_a_clock_that_is_set_back_keeps_its_frames_and_says_so(tmp_path):
    times = np.arange(100) / 50.0
    times[40:] -= 7.0
    rows = "".join(f"{t!r},{n},2\n" for n, t in enumerate(times.tolist()))
    with pytest.warns(RecordingWarning, match=r"p\.csv', line 42: the clock goes back by 6\.98 s"):
        recording = load(tmp_path, "t,a,b\n" + rows, TIMED)
    assert recording.times == pytest.approx(np.arange(100) / 50.0, abs=1e-9)
    assert recording.quality.tolist() == [int(n == 40) for n in range(100)]


def test_rows_that_came_twice_are_repeats(tmp_path):
    rows = "".join(f"{n / 60.0!r},{n},2\n" * 2 for n in range(60))
    recording = load(tmp_path, "t,a,b\n" + rows, TIMED)
    assert recording.rate == pytest.approx(60.0)
    assert recording.quality.tolist() == [0, 2] * 60


POINTERS = {
    "Git LFS": b"version https://git-lfs.github.com/spec/v1\noid sha256:aa\nsize 12345\n",
    "git-annex": b"/annex/objects/MD5E-s12345--aa.h5\n",
}


@pytest.mark.parametrize("suffix", ["csv", "npy", "npz", "h5", "hdf5", "mcap", "txt"])
@pytest.mark.parametrize("of", POINTERS)
def test_a_pointer_in_place_of_the_data_is_called_one(of, suffix, tmp_path):
    (tmp_path / "p.toml").write_text(LAYOUT + "rate = 10.0\n")
    (tmp_path / f"p.{suffix}").write_bytes(POINTERS[of])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(CnnumError, match=f"it is a {of} pointer instead of the data"):
            cnnum.load_recording(tmp_path / f"p.{suffix}")


def test_a_pointer_in_place_of_a_template_and_of_a_trials_file(tmp_path):
    (tmp_path / "one.toml").write_bytes(POINTERS["Git LFS"])
    with pytest.raises(CnnumError, match="git lfs pull"):
        cnnum.load_template(tmp_path / "one.toml")
    (tmp_path / "xela_sensor1.csv").write_bytes(POINTERS["Git LFS"])
    (tmp_path / "xela_sensor2.csv").write_bytes(POINTERS["Git LFS"])
    with pytest.raises(CnnumError, match="git lfs pull"):
        cnnum.load_recording(tmp_path)


@pytest.mark.parametrize(("name", "spoilt"), [("a", False), ("µ", False), ("a", True)])
def test_bytes_of_windows_far_down_are_read_and_in_a_number_their_line_is_said(
    name, spoilt, tmp_path
):
    """One after 64 KiB was said to be no UTF-8; names that are keep their µ."""
    rows = [f"{n},{n}.5" for n in range(9000)]
    note = b"7\xb0,1" if spoilt else b"# 21 \xb0C, caf\xe9"
    text = b"\n".join([f"{name},b".encode(), *map(str.encode, rows), note, b"1,2", b""])
    assert text.index(note) > 1 << 16
    layout = LAYOUT.replace('"a"', f'"{name}"') + "rate = 10.0\n"
    if spoilt:
        with pytest.raises(CnnumError, match="line 9002: expected a number in the column 'a', got"):
            load(tmp_path, text, layout)
    else:
        recording = load(tmp_path, text, layout)
        assert recording.values[-2:].ravel().tolist() == [8999.0, 8999.5, 1.0, 2.0]


def test_blocks_of_lines_may_be_text_of_windows(tmp_path):
    heads = [f"Zeit: {n / 10} (20 °C)\n1,2\n3,4\n" for n in range(5)]
    layout = 'shape = [2, 2]\nchannels = ["z"]\nblock = true\ntime = "Zeit"\n'
    recording = load(tmp_path, "".join(heads).encode("cp1252"), layout)
    assert (len(recording), recording.rate) == (5, pytest.approx(10.0))
