"""From counts to physical values, taxel by taxel: offset, gain, matrix and tare."""

import logging

import numpy as np
import pytest
from force_scene import force_scene

import cnnum
from cnnum.errors import CalibrationError
from cnnum.frame import FORCE_AXES, Frame
from cnnum.programs.library import get_program
from cnnum.scenes.conversion import ByArrayCalibration
from cnnum.scenes.events import EventRule, with_units
from cnnum.scenes.push_watch import PushWatch
from cnnum.tactile.array_calibration import ArrayCalibration

RNG = np.random.default_rng(3)
SHAPE = (4, 5)
RAW = RNG.normal(16000.0, 100.0, (6, *SHAPE, 3))
GAINS = {
    "one": np.array(0.01),
    "a channel": np.array([0.01, 0.02, 0.03]),
    "a matrix": RNG.normal(0, 0.01, (3, 3)),
    "a taxel": RNG.normal(0.01, 0.001, (*SHAPE, 3)),
    "a matrix a taxel": RNG.normal(0, 0.01, (*SHAPE, 3, 3)),
}


def by_hand(raw, gain, offset):
    """gain · (raw − offset), taxel by taxel."""
    values = np.empty_like(raw)
    for cell in np.ndindex(raw.shape[:3]):
        own = gain[cell[1:]] if gain.ndim >= 3 else gain
        above = (raw - offset)[cell]
        values[cell] = own @ above if own.ndim == 2 else own * above
    return values


@pytest.mark.parametrize("name", GAINS)
@pytest.mark.parametrize("wanted", [FORCE_AXES, ("normal",), ("normal", "shear_x")])
def test_values_are_those_by_hand(name, wanted):
    offset = RNG.normal(16000.0, 5.0, (*SHAPE, 3))
    calibration = ArrayCalibration(GAINS[name], offset, "N")
    expected = by_hand(RAW, GAINS[name], offset)
    # the same products, summed in another order: some roundings of numbers up to 10
    assert np.abs(calibration.apply(RAW) - expected).max() < 1e-12
    read = ByArrayCalibration(calibration, SHAPE, FORCE_AXES).reader(wanted)
    places = [FORCE_AXES.index(channel) for channel in wanted]
    for raw, values in zip(RAW, expected[..., places], strict=True):
        assert np.abs(read(Frame(raw, FORCE_AXES, "count", 0, 0.0)) - values).max() < 1e-12


def test_tare_is_the_mean_of_the_first_frames():
    calibration = ArrayCalibration(0.5, unit="N", tare=4)
    expected = 0.5 * (RAW - RAW[:4].mean(axis=0))
    assert np.abs(calibration.apply(RAW) - expected).max() < 1e-9
    read = ByArrayCalibration(calibration, SHAPE, FORCE_AXES).reader(FORCE_AXES)
    got = [read(Frame(raw, FORCE_AXES, "count", 0, 0.0)) for raw in RAW]
    assert np.abs(np.array(got)[3:] - expected[3:]).max() < 1e-9
    assert not got[0].any()
    with pytest.raises(CalibrationError, match="at least 4 frames"):
        calibration.apply(RAW[:3])


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"gain": 2.0}, "must state the resulting 'unit'"),
        ({"gain": [1.0, np.nan], "unit": "N"}, "finite"),
        ({"gain": None, "unit": "N"}, "nothing"),
        ({"tare": -1}, "'tare' must be a number of frames"),
        ({"tare": 1.5}, "'tare' must be a number of frames"),
        ({"gain": [1.0, 2.0], "unit": "N"}, r"'gain' must be one number, or .* got \(2,\)"),
        (
            {"offset": [1.0, 2.0]},
            r"'offset' must be .* the shape \(3,\) or \(4, 5, 3\)",
        ),
    ],
)
def test_what_fits_no_array_is_one_sentence(parts, said):
    with pytest.raises(CalibrationError, match=said):
        ArrayCalibration(**parts).apply(RAW)


SCENE = force_scene("raw.npy")


@pytest.fixture
def folder(tmp_path):
    counts = np.random.default_rng(0).normal(16000.0, 3.0, (90, 4, 4, 3))
    counts[45:, 1:3, 1:3, 2] += 300.0
    np.save(tmp_path / "raw.npy", counts)
    (tmp_path / "raw.toml").write_text("shape = [4, 4]\nrate = 60.0\n")
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def contact(folder, **calibration):
    changes = {"calibration": calibration} if calibration else None
    engine = cnnum.Engine("numba")
    scene = cnnum.load_scene(folder / "scene.toml", engine=engine, changes=changes)
    return next(scene.events())


def test_a_scene_reports_newtons_of_counts(folder):
    raw = contact(folder)
    assert raw.unit == "count"
    assert raw.strength == pytest.approx(1200.0, rel=0.01)  # four taxels of 300 counts
    matrix = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.02]]
    known = contact(folder, gain=matrix, unit="N", tare=20)
    assert known.unit == "N"
    assert known.strength == pytest.approx(24.0, rel=0.01)
    assert "strength 23.9" in str(known)
    assert str(known).endswith(" N")


def test_a_calibration_file_of_a_whole_array(folder):
    file = folder / "pad.toml"
    file.write_text('kind = "array calibration"\ngain = 0.02\nunit = "N"\ntare = 20\n')
    assert contact(folder, file="pad.toml").strength == pytest.approx(24.0, rel=0.01)
    file.write_text('kind = "array calibration"\ngian = 0.02\n')
    with pytest.raises(CalibrationError, match="unknown key 'gian'"):
        contact(folder, file="pad.toml")


@pytest.mark.parametrize(
    ("program", "parameters", "units"),
    [
        ("tactile", {}, ("strain", "score")),
        ("tactile", {"unit": 1.3}, ("N", "score")),
        ("mindlin_slip", {}, ("strain", "share")),
    ],
)
def test_every_strength_has_a_unit(program, parameters, units):
    rules = (
        EventRule("contact", "contact", strength="load_normal"),
        EventRule("slip", "gross_slip", strength="slip_strength"),
        EventRule("edge", "edge_count"),
    )
    made = with_units(rules, get_program(program).bind(**parameters), "strain")
    assert [rule.unit for rule in made] == [*units, ""]


def watched(push, sign, program="contact"):
    watch = PushWatch(get_program(program).bind(push=push), FORCE_AXES)
    noise = np.random.default_rng(1)
    for number in range(80):
        values = noise.normal(0.0, 1.0, (8, 8, 3))
        values[3:5, 3:5, 2] += sign * 100.0 * (number > 20)
        watch.look(values, number / 30.0)
    return watch.said


@pytest.mark.parametrize("push", [-1.0, 1.0])
def test_pushes_that_read_as_pulls_are_said_once(push, caplog):
    with caplog.at_level(logging.WARNING, "cnnum"):
        assert watched(push, -push)
    (record,) = caplog.records
    assert f"set program.parameters.push={-push:g}" in record.getMessage()


def test_pushes_the_right_way_round_are_not(caplog):
    assert not watched(1.0, 1.0)
    assert not watched(-1.0, -1.0)
    assert not watched(1.0, -1.0, program="slip")  # the release of a held object
    assert not caplog.records


def test_the_simulated_touch_is_no_pull(call_demo):
    assert "wrong way round" not in call_demo("-1.0")
    assert call_demo("1.0").count("wrong way round") == 1


@pytest.fixture
def call_demo():
    from click.testing import CliRunner

    from cnnum.cli import main

    def call(push):
        options = ["--engine", "numba", "--frames", "400"]
        setting = ["--set", f"program.parameters.push={push}"]
        return CliRunner().invoke(main, ["run", "contact", *options, *setting]).stderr

    return call
