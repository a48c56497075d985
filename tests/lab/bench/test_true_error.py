"""The error that a user has: its two parts, and the delays of reports."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.errors import ArrayError
from cnnum.lab.bench import true_error
from cnnum.lab.bench.charts import CHARTS
from cnnum.lab.bench.programs import known_answers
from cnnum.lab.bench.records import as_row
from cnnum.programs.library import program_names
from cnnum.scenes.scene_file import read_scene, scene_names


@pytest.fixture(scope="module")
def engine() -> Engine:
    return Engine("numba")


def test_the_total_error_is_that_of_the_lattice(engine):
    """Against Love the lattice is off by per cents; the run is off by roundings alone."""
    rows = [
        true_error._under_patches(engine, engine, "halfspace_stress", cells) for cells in (2, 4)
    ]
    for row in rows:
        assert row.error == pytest.approx(row.discretisation, rel=1e-3)
        assert row.arithmetic < 1e-5
        assert row.seconds > 0.0
        assert math.isnan(row.delay_s)
    # the square of the cell, with the patch's edge between cells
    assert rows[1].error < rows[0].error / 3.0
    assert 0.01 < rows[1].error < 0.04


def test_a_wrong_run_shows_in_the_total_and_in_its_own_part(engine, monkeypatch):
    right = true_error.cover_stress
    monkeypatch.setattr(true_error, "cover_stress", lambda load, depth: 1.1 * right(load, depth))
    row = true_error._under_patches(engine, engine, "halfspace_stress", 2)
    assert row.arithmetic > 0.05


@pytest.mark.parametrize(
    ("began", "missed", "early"),
    [(0.6, 0.0, 0.0), (0.7, 0.0, 1.0), (0.05, 1.0, 0.0)],
    ids=["in time", "before", "too late"],
)
def test_reports_have_delays_and_misses(engine, monkeypatch, began, missed, early):
    strain = np.zeros((100, 4, 4, 3))
    strain += 1e-6 * np.random.default_rng(0).normal(size=strain.shape)
    strain[60:, 1:3, 1:3, 2] -= 1e-3
    one = true_error.Trial(strain, {"contact": began})
    monkeypatch.setattr(true_error, "trial", lambda number, rate, touches: one)
    row = true_error._row("contact", "a step", "frames a second", 100.0, engine)
    program = true_error.get_program("contact").bind(depth=0.5)
    reporter = true_error.Reporter("contact", "contact")
    got = true_error._reported(engine, program, reporter, row, 1, None, None)
    assert (got.missed, got.too_early) == (missed, early)
    assert math.isnan(got.delay_s) if missed else 0.0 <= got.delay_s <= 0.05


def test_a_method_that_cannot_is_said_and_another_error_is_raised(engine, monkeypatch):
    some = {name: true_error.REPORTERS[name] for name in ("contact", "slip")}
    monkeypatch.setattr(true_error, "REPORTERS", some)
    rows = list(true_error._events(engine, 50.0, 1, method="euler", step=3.0))
    assert rows
    for row in rows:
        assert isinstance(row, str)
        assert "by euler, step 3.0, has no row" in row

    def broken(*_):
        raise ArrayError("The frames are wrong.")

    monkeypatch.setattr(true_error, "_reported", broken)
    with pytest.raises(ArrayError):
        list(true_error._events(engine, 50.0, 1))


def test_a_trial_knows_when_things_begin():
    one = true_error.trial(0, 50.0)
    assert one.strain.shape[1:] == (8, 8, 3)
    times = [one.began[event] for event in ("contact", "slip", "twist")]
    assert times == sorted(times)
    assert 0.5 <= times[0] < 0.6


@pytest.mark.parametrize(
    ("touches", "event", "after"),
    [
        ("spheres of known friction", "incipient", "contact"),
        ("two fingers", "pull", "contact"),
        ("ridges", "slip", "contact"),
    ],
)
def test_other_touches_know_when_things_begin(touches, event, after):
    one = true_error.trial(0, 50.0, touches)
    assert one.began[after] < one.began[event] < len(one.strain) / 50.0
    assert one.strain.shape[1:3] == ((8, 16) if touches == "two fingers" else (8, 8))


KNOWN = {
    "contact": (known_answers.contact(8, 4), 0.02),
    "body_fit": (known_answers.body_fit(8, 4), 0.06),
    "mindlin_slip": (known_answers.mindlin_slip(8, 2), 0.02),
    "active_contour": (known_answers.active_contour(8, 3), 0.5),
    "edges": (known_answers.outlines("edges", 8, 2), 0.45),
    "edge_enhancement": (known_answers.outlines("edge_enhancement", 8, 2), 0.45),
    "tactile_flow": (known_answers.tactile_flow(6), 0.05),
    "motion_direction": (known_answers.motion_direction(50.0), 1e-3),
    "receptors": (known_answers.receptors_in_time(100.0), 0.02),
    "receptors over the skin": (known_answers.receptors_in_space(8), 0.1),
    "on_off": (known_answers.on_off(50.0), 0.02),
}
"""Frames with a known answer, and errors beyond which a program would be broken."""


@pytest.mark.parametrize("case", KNOWN)
def test_a_program_is_near_its_truth_and_a_stub_is_not(engine, case):
    known, most = KNOWN[case]
    outputs = true_error._every(true_error._plan(engine, known), known)
    off = known.off(outputs, None)
    assert 0.0 < true_error._median(off) < most
    assert np.nanmax(known.off(outputs, outputs)) == 0.0
    for value in (0.0, 0.7):
        stub = {name: np.full_like(each, value) for name, each in outputs.items()}
        wrong = known.off(stub, None)
        assert not true_error._median(wrong) <= 2.0 * true_error._median(off)


def total(engine, known):
    outputs = true_error._every(true_error._plan(engine, known), known)
    return true_error._median(known.off(outputs, None))


def test_more_cells_are_nearer_to_the_continuum(engine):
    """Four times the frames or taxels a wave: the square of it, of what is bent between them."""
    for make, few, many in (
        (known_answers.tactile_flow, 4, 16),
        (known_answers.receptors_in_time, 50.0, 200.0),
    ):
        assert total(engine, make(many)) < total(engine, make(few)) / 8.0


def test_a_row_has_both_parts(engine):
    known = known_answers.tactile_flow(6)
    right = true_error._every(true_error._plan(engine, known), known)
    row = true_error._answered(engine, right, known)
    assert row.error == row.discretisation > 0.02
    assert row.arithmetic == 0.0
    wrong = {name: 1.1 * each for name, each in right.items()}
    row = true_error._answered(engine, wrong, known)
    assert row.arithmetic > 0.05
    assert row.discretisation != row.error
    assert row.seconds > 0.0


def test_bumps_read_the_load_and_the_friction(engine):
    load, friction = known_answers.bumps(4)
    assert (load.name, friction.name) == ("localize", "texture")
    # 2 % that the inverse may leave, the noise and the converter; a wrong ratio makes a third
    for known, most in ((load, 0.05), (friction, 0.03)):
        outputs = true_error._every(true_error._plan(engine, known), known)
        assert 0.0 < known.off(outputs, None) < most
        stub = {name: 0.0 * each for name, each in outputs.items()}
        assert known.off(stub, None) == 1.0


def test_every_tactile_program_has_a_row_or_a_reason():
    """The names that `measure_true_error` writes, or a sentence of what is left out."""
    both = (true_error, known_answers)
    source = "".join(Path(each.__file__).read_text(encoding="utf-8") for each in both)
    code, said = source.split("OMISSIONS = (", 1)[1].split('"""What no row shows', 1)[::-1]
    for name in (*program_names("tactile"), *program_names("tactile.contact_mechanics")):
        assert f'"{name}"' in code or re.search(rf"\b{name}\b", said), name


def test_the_picture_has_a_panel_a_program():
    numbers = dict.fromkeys(("error", "discretisation", "arithmetic"), 0.1)
    field = dict(case="a", truth="t", knob="cells", setting=1.0, engine="e", precision="float32",
                 method="auto", **numbers, delay_s=math.nan, missed=math.nan,
                 too_early=math.nan, seconds=1e-5, spread=0.0)  # fmt: skip
    event = field | dict.fromkeys(numbers, math.nan) | {
        "knob": "frames a second", "delay_s": 0.02, "missed": 0.5, "too_early": 0.25,
    }  # fmt: skip
    other = field | {"knob": "frames a second"}  # of the same name and knob as the reports
    each_row = (field, other, event)
    rows = [as_row(true_error.TrueError(**each)) for each in each_row]  # type: ignore[arg-type]
    figure = CHARTS["truth"](rows)
    drawn = [axes for part in figure.subfigs for axes in part.axes]
    titles = [axes.get_title() for axes in drawn if axes.get_title()]
    assert [title[0] for title in titles] == ["a", "a", "a"]
    texts = [text.get_text() for axes in drawn for text in axes.texts]
    assert texts == ["1", "1", "1/s"]
    # below the delays, 20 ms, what is missed and too early, in per cent
    delays, misses = drawn[2:]
    assert [list(line.get_ydata()) for line in delays.lines] == [[20.0]]
    assert [list(line.get_ydata()) for line in misses.lines if len(line.get_ydata())] == [
        [50.0], [25.0]
    ]  # fmt: skip
    assert [axes.get_ylabel() for axes in (delays, misses)] == ["delay, ms", "share, %"]


def test_a_report_counts_once_its_flag_has_lasted():
    flags = [False, True, True, False, True, True, True, True]
    assert true_error._lasting(flags, 2).tolist() == [0, 0, 0, 0, 0, 0, 1, 1]
    assert true_error._lasting(flags, 0).tolist() == [float(flag) for flag in flags]
    # 0.1 s of the rule of edges, and none of contacts
    steady = {name: true_error.REPORTERS[name].steady for name in ("edges", "contact")}
    assert steady == {"edges": 0.1, "contact": 0.0}


def test_every_program_of_an_event_has_reports():
    """The programs of the packaged scenes, but for one that is made of others."""
    programs = {read_scene(name).program_name for name in scene_names()}
    assert programs - {"tactile"} <= set(true_error.REPORTERS)
