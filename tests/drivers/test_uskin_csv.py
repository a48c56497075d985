"""Replay of uSkin trials: small ones made here, and the real ones where they are."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from cnnum.drivers import Driver, open_driver
from cnnum.errors import CodecError, RecordingError, RecordingWarning, SceneError
from cnnum.frame import Quality

HEADER = ",".join(f"txl{n}_{axis}" for n in range(1, 17) for axis in "xyz")


def counts(seed: int, rows: int = 6) -> np.ndarray:
    return np.random.default_rng(seed).integers(15_000, 39_000, (rows, 48))


def write(path: Path, header: str, rows: np.ndarray | list[list[object]]) -> None:
    lines = [header, *(",".join(str(value) for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    """Six rows; row 3 repeats row 2 on both pads, row 5 repeats row 4 on pad 1 only."""
    one, two = counts(1), counts(2)
    one[3], two[3], one[5] = one[2], two[2], one[4]
    write(tmp_path / "xela_sensor1.csv", HEADER, one)
    write(tmp_path / "xela_sensor2.csv", HEADER, two)
    write(tmp_path / "robot_state.csv", "joint,time", [[0.5, 3.0 + 0.016 * n] for n in range(6)])
    write(
        tmp_path / "slip_label.csv", "slip,fail", [[float(n == 4), float(n == 5)] for n in range(6)]
    )
    write(tmp_path / "meta_data.csv", "dropped,notes,frequency_hz", [[0, "some text", 59.8]])
    return tmp_path


def lines_of(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def replay(trial: Path, **options: object) -> Driver:
    return open_driver("uskin-csv", {"path": ".", **options}, base=trial)


def test_both_pads_lie_side_by_side(trial: Path) -> None:
    driver = replay(trial)
    frames = list(driver.frames())
    one, two = counts(1), counts(2)
    assert (driver.shape, driver.channels, driver.unit) == (
        (4, 8),
        ("shear_x", "shear_y", "normal"),
        "count",
    )
    # taxel-major columns, taxels row by row: taxel 7 is row 1, column 2
    assert frames[0].values[1, 2].tolist() == one[0, 18:21].tolist()
    assert frames[0].values[1, 6].tolist() == two[0, 18:21].tolist()


@pytest.mark.parametrize("pad", [1, 2])
def test_one_pad_alone(trial: Path, pad: int) -> None:
    driver = replay(trial, pad=pad)
    frames = list(driver.frames())
    assert driver.shape == (4, 4)
    assert frames[1].values.ravel().tolist() == counts(pad)[1].tolist()


def test_repeated_rows_are_flagged_and_are_no_new_scans(trial: Path) -> None:
    driver = replay(trial)
    frames = list(driver.frames())
    assert [f.quality for f in frames] == [Quality.REPEATED if n == 3 else 0 for n in range(6)]
    assert [f.sequence for f in frames] == [0, 1, 2, 2, 3, 4]
    assert (driver.counters.frames, driver.counters.repeated) == (5, 1)
    alone = list(replay(trial, pad=1).frames())
    assert [f.repeated for f in alone] == [False, False, False, True, False, True]


def test_time_and_labels_stand_beside_the_frame(trial: Path) -> None:
    driver = replay(trial)
    frames = list(driver.frames())
    assert driver.rate == 59.8
    # from the first row; atol: rounding of 3.0 + 0.016 n
    np.testing.assert_allclose([f.time for f in frames], 0.016 * np.arange(6), atol=1e-12)
    truths = [f.truth for f in frames]
    assert [t["slip"] for t in truths if t] == [0, 0, 0, 0, 1, 0]
    assert [t["fail"] for t in truths if t] == [0, 0, 0, 0, 0, 1]


def test_without_robot_state_the_time_comes_from_the_rate(trial: Path) -> None:
    (trial / "robot_state.csv").unlink()
    assert list(replay(trial).frames())[5].time == pytest.approx(5 / 59.8, rel=1e-12)
    (trial / "meta_data.csv").unlink()
    assert list(replay(trial, rate=100).frames())[5].time == pytest.approx(0.05, rel=1e-12)
    with pytest.raises(RecordingError, match="give the option 'rate'"):
        replay(trial)


def test_states_without_a_time_leave_it_to_the_rate(trial: Path) -> None:
    """Their last column, which grows too, is another quantity."""
    write(trial / "robot_state.csv", "joint,v_y", [[0.5, 0.1 * n] for n in range(6)])
    assert list(replay(trial).frames())[5].time == pytest.approx(5 / 59.8, rel=1e-12)
    assert list(replay(trial, rate=100).frames())[5].time == pytest.approx(0.05, rel=1e-12)
    (trial / "meta_data.csv").unlink()
    with pytest.raises(RecordingError, match=r"column 'time' of 'robot_state.csv'.*option 'rate'"):
        replay(trial)


def test_the_time_may_stand_in_any_column(trial: Path) -> None:
    write(trial / "robot_state.csv", "time,v_y", [[3.0 + 0.02 * n, 0.5] for n in range(6)])
    assert list(replay(trial).frames())[5].time == pytest.approx(0.1, rel=1e-9)


PARTS = ("xela_sensor1.csv", "xela_sensor2.csv", "robot_state.csv", "slip_label.csv")


def shorten(file: Path, rows: int) -> None:
    file.write_text("\n".join(lines_of(file)[:-rows]) + "\n", encoding="utf-8")


@pytest.mark.parametrize("shorter", PARTS)
def test_rows_at_the_end_that_a_file_lacks_are_left_out_and_counted(
    trial: Path, shorter: str
) -> None:
    whole = list(replay(trial).frames())
    shorten(trial / shorter, 1)
    longer = ", ".join(f"1 of '{name}'" for name in PARTS if name != shorter)
    with pytest.warns(RecordingWarning, match=f"5 rows are read, .*{re.escape(longer)}") as caught:
        driver = replay(trial)
    assert len(caught) == 1
    frames = list(driver.frames())
    assert driver.counters.dropped == 1
    assert driver.counters.frames + driver.counters.repeated == len(frames) == 5
    for got, expected in zip(frames, whole, strict=False):
        np.testing.assert_array_equal(got.values, expected.values)
        assert (got.time, got.sequence, got.truth) == (
            expected.time,
            expected.sequence,
            expected.truth,
        )


def test_rows_that_no_pad_has_are_no_lost_scans(trial: Path) -> None:
    shorten(trial / "xela_sensor1.csv", 1)
    with pytest.warns(RecordingWarning, match=r"\(1 of 'robot_state.csv', 1 of 'slip_label.csv'\)"):
        driver = replay(trial, pad=1)
    assert len(list(driver.frames())) == 5
    assert driver.counters.dropped == 0


def test_a_file_that_is_not_used_drops_no_rows(trial: Path) -> None:
    shorten(trial / "xela_sensor2.csv", 3)
    driver = replay(trial, pad=1)
    assert len(list(driver.frames())) == 6
    assert driver.counters.dropped == 0


@pytest.mark.parametrize(("rows", "most"), [(6, 1), (250, 2), (400, 4), (900, 5)])
def test_files_differ_by_a_few_rows_at_the_most(tmp_path: Path, rows: int, most: int) -> None:
    """By 1 % of them and by 5, and one in a short trial."""
    one, two = counts(1, rows), counts(2, rows)
    write(tmp_path / "xela_sensor1.csv", HEADER, one)
    write(tmp_path / "xela_sensor2.csv", HEADER, two[:-most])
    with pytest.warns(RecordingWarning, match=f"{most} of 'xela_sensor1.csv'"):
        driver = replay(tmp_path, rate=60)
    assert len(list(driver.frames())) == rows - most
    assert driver.counters.dropped == most
    write(tmp_path / "xela_sensor2.csv", HEADER, two[: -most - 1])
    with pytest.raises(CodecError, match=f"give or take {most}, got {rows - most - 1}"):
        replay(tmp_path, rate=60)


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (1, r"1 trial\(s\), not one: name one of them \('trial 0'\)"),
        (6, r"6 trial\(s\).*'trial 3' and 2 more\)"),
    ],
)
def test_a_folder_of_trials_is_refused_with_their_names(
    tmp_path: Path, count: int, words: str
) -> None:
    for number in range(count):
        (tmp_path / f"trial {number}").mkdir()
        write(tmp_path / f"trial {number}" / "xela_sensor1.csv", HEADER, counts(number))
    with pytest.raises(RecordingError, match=words):
        replay(tmp_path)


def test_without_labels_there_is_no_truth(trial: Path) -> None:
    (trial / "slip_label.csv").unlink()
    assert all(frame.truth is None for frame in replay(trial).frames())


def test_a_second_replay_starts_again(trial: Path) -> None:
    driver = replay(trial)
    twice = [[f.time for f in driver.frames()] for _ in range(2)]
    assert twice[0] == twice[1]
    assert driver.counters.frames == 5


def test_a_count_at_its_end_is_saturated(trial: Path) -> None:
    values = counts(1)
    values[2, 7] = 65535
    write(trial / "xela_sensor1.csv", HEADER, values)
    frames = list(replay(trial).frames())
    assert [bool(f.quality & Quality.SATURATED) for f in frames] == [n == 2 for n in range(6)]
    assert [f.saturated is not None for f in frames] == [n == 2 for n in range(6)]
    high = frames[2].values == 65535
    np.testing.assert_array_equal(frames[2].saturated, high.any(axis=-1))
    assert frames[2].saturated.sum() == 1


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (lambda rows: [rows[0].replace("txl2_y", "txl2_q"), *rows[1:]], "line 1: expected the 48"),
        (lambda rows: [*rows[:3], rows[3] + ",9", *rows[4:]], "line 4: expected 48 fields.*got 49"),
        (
            lambda rows: [*rows[:2], "x" + rows[2][1:], *rows[3:]],
            "line 3: expected a finite.*'txl1_x'",
        ),
        (
            lambda rows: [*rows[:2], "nan" + rows[2][5:], *rows[3:]],
            "line 3: expected a finite.*'nan'",
        ),
        (lambda rows: rows[:1], "no rows"),
        (lambda rows: [], "is empty"),
        (lambda rows: rows[:4], "line 4: expected 6 rows.*got 3"),
    ],
)
def test_a_bad_file_is_named_with_its_line(trial: Path, edit: object, sentence: str) -> None:
    file = trial / "xela_sensor2.csv"
    file.write_text("\n".join(edit(lines_of(file))), encoding="utf-8")  # type: ignore[operator]
    with pytest.raises(CodecError, match=f"xela_sensor2.csv.*{sentence}"):
        replay(trial)


def test_a_missing_file_and_one_that_is_no_text(trial: Path) -> None:
    (trial / "xela_sensor1.csv").write_bytes(b"\xff\x00\x01\xfe")
    with pytest.raises(CodecError, match=r"xela_sensor1\.csv' is not a CSV"):
        replay(trial)
    (trial / "xela_sensor1.csv").unlink()
    with pytest.raises(RecordingError, match=r"xela_sensor1\.csv' cannot be read"):
        replay(trial)


def test_a_clock_that_goes_back_is_refused(trial: Path) -> None:
    times = [0.0, 0.1, 0.2, 0.15, 0.3, 0.4]
    write(trial / "robot_state.csv", "joint,time", [[0, t] for t in times])
    with pytest.raises(CodecError, match=r"robot_state\.csv', line 5"):
        replay(trial)


def test_a_rate_of_nought_is_refused(trial: Path) -> None:
    with pytest.raises(SceneError, match="'rate' must be"):
        replay(trial, rate=0)


RECORDINGS = os.environ.get("CNNUM_RECORDINGS", "")
real = pytest.mark.skipif(not RECORDINGS, reason="CNNUM_RECORDINGS names no folder")

# rows, rows with slip, lost from: as the data set's description gives them
TRIALS = {
    "02-21-14-10-49": (354, set(), None),
    "02-21-17-22-56": (300, set(), None),
    "02-22-11-23-11": (270, {*range(75, 94), *range(135, 158)}, None),
    "02-22-15-15-00": (259, set(range(73, 123)), 123),
}


@real
@pytest.mark.parametrize("name", TRIALS)
def test_a_real_trial(name: str) -> None:
    rows, slip, lost = TRIALS[name]
    path = Path(RECORDINGS) / "uskin_grasp" / name
    driver = open_driver("uskin-csv", {"path": str(path)})
    frames = list(driver.frames())
    assert len(frames) == rows
    assert {n for n, f in enumerate(frames) if f.truth and f.truth["slip"]} == slip
    failed = [n for n, f in enumerate(frames) if f.truth and f.truth["fail"]]
    assert (failed[0] if failed else None) == lost
    # 6–10 % of the rows repeat the one before; both pads must, hence the lower end
    assert 0.05 < driver.counters.repeated / rows < 0.10
    # about 59.8 rows a second by their own clock
    assert (rows - 1) / frames[-1].time == pytest.approx(driver.rate, rel=0.01)
    # raw counts: x and y near 16,000, z near 38,000
    means = np.mean([f.values for f in frames], axis=(0, 1, 2))
    np.testing.assert_allclose(means, [16_000, 16_400, 37_900], rtol=0.02)


@real
def test_a_real_trial_whose_label_lacks_a_row_and_whose_states_lack_the_time(
    tmp_path: Path,
) -> None:
    name = "02-22-15-15-00"
    source, trial = Path(RECORDINGS) / "uskin_grasp" / name, tmp_path / name
    shutil.copytree(source, trial)
    shorten(trial / "slip_label.csv", 1)
    states = [line.rpartition(",")[0] for line in lines_of(trial / "robot_state.csv")]
    (trial / "robot_state.csv").write_text("\n".join(states) + "\n", encoding="utf-8")
    with pytest.warns(RecordingWarning, match="258 rows are read") as caught:
        driver = replay(trial)
    assert "(1 of 'xela_sensor1.csv', 1 of 'xela_sensor2.csv')" in str(caught[0].message)
    frames, whole = list(driver.frames()), list(replay(source).frames())
    assert (len(frames), len(whole), driver.counters.dropped) == (258, 259, 1)
    assert all((a.values == b.values).all() for a, b in zip(frames, whole, strict=False))
    assert [f.truth for f in frames] == [f.truth for f in whole[:-1]]
    # one hundredth of the 4.3 s: the clock of the log is about the rate that it gives
    assert abs(frames[-1].time - whole[-2].time) < 0.043


@real
def test_the_folder_of_the_real_trials_is_refused_with_their_names() -> None:
    with pytest.raises(RecordingError, match=r"4 trial\(s\).*02-21-14-10-49.*02-22-15-15-00"):
        replay(Path(RECORDINGS) / "uskin_grasp")
