"""Scoring runs: the programs on scenes, the command, its tables and its page."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.drivers.simulated.grips import Arrays
from cnnum.engine import Engine
from cnnum.errors import RecordingError, SceneError
from cnnum.lab.scoring import recordings
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.family_tables import played, tables
from cnnum.lab.scoring.levels import LEVELS, level_table, outcome
from cnnum.lab.scoring.recorded import FLAT, HELD_BACK, flat_folders, flat_trial
from cnnum.lab.scoring.subjects import Subject, reports, shipped_level
from cnnum.lab.scoring.suites import Request, score
from cnnum.lab.scoring.table import Column, Table

RECORDINGS = os.environ.get("CNNUM_RECORDINGS", "")
SOME = ("25 Hz", "10 Hz", "twist, 10 Hz")


@pytest.fixture(scope="module")
def engine():
    return Engine()


@pytest.fixture(scope="module")
def trials():
    """A few quick scenes in every family's place: their results do not matter."""
    arrays = Arrays()
    make = {family.name: family.make for family in FAMILIES}
    some = [make[name](arrays, name, seed) for name in SOME for seed in (3, 4)]
    return {family.name: some for family in FAMILIES}


@pytest.fixture(scope="module")
def scenes(engine, trials):
    return played(Subject(engine), {name: trials[name] for name in trials})


def test_trials_side_by_side_are_trials_alone(engine, trials):
    some = trials["grip"]
    together = Subject(engine).play(some)
    for trial, answers in zip(some, together, strict=True):
        (alone,) = Subject(engine).play([trial])
        assert set(answers) >= {"gross_slip", "slip_strength", "twist_sense"}
        for name, values in answers.items():
            assert values.shape == (len(trial.frames),)
            # in single precision, sums in another order
            np.testing.assert_allclose(values, alone[name], rtol=1e-4, atol=1e-5, err_msg=name)


def test_slips_and_twists_of_plain_scenes_are_reported(engine, trials):
    slide, _, twist = (trials["grip"][2 * n] for n in range(3))
    slipped, turned = Subject(engine).play([slide, twist])
    assert slipped["gross_slip"][slide.onset :].any()
    assert not slipped["twist"].any()
    assert set(turned["twist_sense"]) - {0.0} == {float(twist.sense[twist.sense != 0][0])}


def test_constants_reach_the_program(engine, trials):
    slide = trials["grip"][0]
    (plain,) = Subject(engine).play([slide])
    (strict,) = Subject(engine, {"false_reports": 0.5}).play([slide])
    assert 0 < strict["gross_slip"].sum() < plain["gross_slip"].sum()
    np.testing.assert_allclose(plain["slip_strength"], strict["slip_strength"])


def test_a_program_of_one_s_own_is_judged_instead(engine, trials):
    """One that reports wherever there is a load: its flags are judged, and not the library's."""

    @cnnum.program
    def slip(frame):
        strength = abs(frame.normal).max()
        still = 0.0 * strength
        return {
            "gross_slip": strength > 1e-3,
            "slip_x": still,
            "slip_y": still,
            "slip_strength": strength,
        }

    (answers,) = Subject(engine, programs={"slip": slip}).play([trials["grip"][0]])
    normal = np.abs(trials["grip"][0].frames[..., 2]).max(axis=(1, 2))
    np.testing.assert_allclose(answers["slip_strength"], normal, rtol=1e-6)
    assert (answers["gross_slip"] == (normal > 1e-3)).all()
    assert "twist" in answers


def test_a_level_is_the_program_s_own_latch(scenes):
    for trial, answers in zip(scenes.trials["grip"], scenes.answers["grip"], strict=True):
        flags = reports(answers["slip_strength"], shipped_level(), trial.rate)
        np.testing.assert_array_equal(flags, answers["gross_slip"] > 0)


def test_tables_have_a_row_a_family(scenes):
    slips, twists, held = tables(scenes)
    kinds = {
        kind: [f.name for f in FAMILIES if f.kind == kind] for kind in ("slip", "twist", "held")
    }
    for table, kind in ((slips, "slip"), (twists, "twist"), (held, "held")):
        assert [row["family"] for row in table.rows] == kinds[kind]
        assert all(set(row) == {column.key for column in table.columns} for row in table.rows)
    # four slides and two twists
    assert slips.rows[0]["found"] == pytest.approx(4 / 6)


def test_higher_levels_find_less_and_later_and_report_less(scenes):
    rows = level_table(scenes).rows
    assert [row["level"] for row in rows] == sorted({*LEVELS, shipped_level()})
    found = [row["found"] for row in rows]
    assert found == sorted(found, reverse=True)
    slid = [row["slid_mm"] for row in rows]
    assert slid == sorted(slid)
    assert slid[0] < slid[-1]
    assert outcome(scenes, "grip", 1e6).false == 0


def run(*arguments):
    return CliRunner().invoke(main, ["score", *map(str, arguments)])


TABLE = Table(
    "slips",
    "Scenes that slip",
    "How to read it.",
    (Column("family", "family"), Column("found", "found", 2, least=0.95)),
    [{"family": "ring & bar", "found": 0.5}, {"family": "bar", "found": 1.0}],
)


@pytest.fixture
def quick(monkeypatch):
    asked = []

    def scored(request, engine, advance=str, gathered=None):
        asked.append(request)
        return [TABLE]

    monkeypatch.setattr("cnnum.lab.scoring.score", scored)
    return asked


def test_the_command_prints_a_line_a_row(quick, tmp_path):
    page = tmp_path / "score.html"
    result = run("--suite", "families", "--json", "--out", page)
    assert result.exit_code == 0, result.output
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert lines[0] == {"table": "slips", "family": "ring & bar", "found": 0.5}
    text = page.read_text()
    assert "ring &amp; bar" in text
    assert 'class="no"' in text
    assert "found (≥ 0.95)" in text
    assert "1 of 2 aims reached" in text
    assert "http" not in text.split("<body>")[1].split("<script")[0]  # it needs nothing else


def test_strict_fails_when_an_aim_is_missed(quick):
    assert run("--suite", "families").exit_code == 0
    result = run("--suite", "families", "--strict")
    assert result.exit_code == 1
    assert "1 of 2 aims reached" in result.stdout


def test_the_command_asks_for_what_it_was_given(quick, monkeypatch, tmp_path):
    monkeypatch.setenv("CNNUM_RECORDINGS", str(tmp_path))
    run()
    run("--quick", "--seed", 7, "--leave-one-out", "--objects", "5, 7")
    plain, asked = quick
    assert plain.suites == ("families", "recordings")
    assert (plain.objects, plain.leave_one_out) == (None, False)
    assert plain.seed == 1_000_000
    assert (asked.count, asked.seed, asked.objects) == (1, 7, ("5", "7"))
    assert asked.leave_one_out
    monkeypatch.delenv("CNNUM_RECORDINGS")
    run()
    assert quick[-1].suites == ("families",)


def test_wrong_input_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setenv("CNNUM_RECORDINGS", str(tmp_path))
    for arguments, word in [
        (("--suite", "recordings"), FLAT),
        (("--suite", "nothing"), "families"),
        (("--quick", "--count", 3), "both"),
        (("--out", tmp_path / "none" / "x.html"), "none"),
    ]:
        result = run(*arguments)
        assert result.exit_code == 2
        assert word in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1
    monkeypatch.delenv("CNNUM_RECORDINGS")
    assert "CNNUM_RECORDINGS" in run("--suite", "recordings").stderr
    with pytest.raises(SceneError, match="CNNUM_RECORDINGS"):
        Request(("recordings",))


RATE, ROWS = 40.0, 400
GRASPED, SLIPS = 60, (200, 280)


def write(path, header, rows):
    lines = [",".join(header), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def flat(tmp_path):
    """Made-up grasps of some objects, one of them held back: rows repeat four times."""
    rng = np.random.default_rng(0)
    names = [f"txl{n}_{axis}" for n in range(1, 17) for axis in "xyz"]
    for number, name in enumerate(("5", "7", "9")):
        folder = tmp_path / FLAT / "train" / f"data_sample_{number}"
        folder.mkdir(parents=True)
        (folder / "meta_data.csv").write_text(f"object_name,frequency_hz\n{name},{RATE}\n")
        row = np.arange(ROWS)
        slips = (row >= SLIPS[0]) & (row < SLIPS[1])
        moves = np.cumsum(np.where(slips, 10e-3, 0.0)) / RATE
        marker = np.stack([moves, 0 * moves, 0 * moves], axis=-1)
        write(folder / "marker.csv", [f"marker1_position_{axis}" for axis in "xyz"], marker)
        for pad in (1, 2):
            load = 400.0 * (row >= GRASPED)[:, None] * np.hanning(18)[1:-1]
            shakes = np.where(slips, 60.0, 2.0)[:, None, None] * rng.normal(size=(ROWS, 16, 3))
            # a scan never repeats the one before, even at rest
            counts = 20000.0 + shakes
            counts[..., 2] += load
            counts[..., 0] += 0.3 * load
            counts = np.repeat(counts[::4], 4, axis=0).round()
            write(folder / f"xela_sensor{pad}.csv", names, counts.reshape(ROWS, -1))
    return tmp_path


def test_objects_are_held_back_unless_named(flat):
    assert "9" in HELD_BACK
    assert [folder.object for folder in flat_folders(flat, None)] == ["5", "7"]
    assert [folder.object for folder in flat_folders(flat, ("9",))] == ["9"]
    assert [folder.object for folder in flat_folders(flat, ("all",))] == ["5", "7", "9"]
    # their sensor files are not even opened
    for pad in (1, 2):
        (flat / FLAT / "train" / "data_sample_2" / f"xela_sensor{pad}.csv").unlink()
    assert len(recordings.read(flat, None, str)[0]) == 2
    with pytest.raises(RecordingError):
        recordings.read(flat, ("4",), str)


def test_a_grasp_is_read_with_labels_from_its_marker(flat):
    trial = flat_trial(flat_folders(flat, None)[0])
    assert trial.rate == 10.0
    assert trial.frames.shape == (ROWS / 4, 4, 8, 3)
    np.testing.assert_array_equal(trial.rows, np.arange(0, ROWS, 4))
    inside = (trial.rows > SLIPS[0] + 6) & (trial.rows < SLIPS[1] - 6)
    outside = (trial.rows < SLIPS[0] - 6) | (trial.rows > SLIPS[1] + 6)
    assert (trial.slips[inside] == 1).all()
    assert (trial.slips[outside] == 0).all()
    assert trial.rows[trial.scored][0] == GRASPED


def test_recordings_are_scored_with_each_object_left_out(flat, engine, monkeypatch):
    monkeypatch.setattr(recordings, "GRID", recordings.GRID[::8])
    made = score(Request(("recordings",), recordings=flat), engine)
    scores, found, turns, levels = made
    assert all(row["slides"] is not None and row["within"] > 0.5 for row in turns.rows[:1])
    assert [column.key for column in scores.columns][2:4] == ["object_5", "object_7"]
    rows = {row["score"]: row for row in scores.rows}
    assert rows["incoherent change, 1 frame"]["pooled"] > 0.9
    assert "constants chosen without the object" in rows
    assert [row["group"] for row in found.rows] == ["5", "7", "all objects"]
    assert [row["slips"] for row in found.rows] == [1, 1, 2]
    shipped = next(row for row in levels.rows if row["group"] == shipped_level())
    assert {**shipped, "group": "all objects"} == found.rows[-1]


@pytest.mark.skipif(
    not Path(RECORDINGS, "uskin_grasp").is_dir(), reason="CNNUM_RECORDINGS names no trials"
)
def test_the_labelled_trials_reach_their_aims(engine, tmp_path):
    (tmp_path / "uskin_grasp").symlink_to(Path(RECORDINGS, "uskin_grasp").resolve())
    scores, found, trials = score(Request(("recordings",), recordings=tmp_path), engine)
    assert scores.rows[0]["uskin"] > 0.96
    (row,) = found.rows
    assert (row["slips"], row["found"], row["quiet"]) == (3, 3, 2)
    assert row["quiet_reported"] <= 1
    assert row["rows"] <= 10
    assert len(trials.rows) == 4
