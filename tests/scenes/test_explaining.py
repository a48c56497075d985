"""Why slip and twist are reported at a time, or are not."""

import json

import numpy as np
import pytest

import cnnum
from cnnum.cli import main
from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.settings import Phase
from cnnum.errors import ReportError, SceneError
from cnnum.report.read_outs import PLACES, draw_explained
from cnnum.scenes.explaining import explained
from cnnum.scenes.pipeline import load_scene

SCRIPT = (
    Phase("hold", 0.5),
    Phase("press", 0.3, load=1.0),
    Phase("hold", 0.4),
    Phase("pull", 1.2, speed=1.5e-3, direction=0.5),
)


@pytest.fixture(scope="module")
def recording():
    with SimulatedOptions(script=SCRIPT, rate=100.0, seed=3).open() as array:
        values = array.calibration.to_strain(np.stack([f.values for f in array.frames()]))
    channels = ("shear_x", "shear_y", "normal")
    return cnnum.Recording(values, rate=100.0, unit="strain", channels=channels)


def scene(recording, program="slip", needs=("slip",)):
    changes = {"needs": list(needs), "program.name": program, "program.parameters": {}}
    engine = cnnum.Engine("numba")
    return load_scene("contact", recording=recording, changes=changes, engine=engine)


def test_the_strength_is_what_its_read_outs_make(recording):
    """By the formula of the page, at rest, in a press, in a pull that sticks and in a slide."""
    opened = scene(recording)
    said = {}
    for time in (0.2, 0.7, 1.3, 2.2):
        (found,) = opened.explain(time)
        at = {name.removeprefix("slip_"): value for name, value in found.read_outs.items()}
        moves = np.cbrt(at["pattern_speed"] ** 2 * at["incoherent_shear"]) * at["ratio"]
        rates = at["trend"] + 0.6 * at["load_rate"] + 0.6 * at["ratio_rate"]
        rates += 0.08 * at["swings"] ** 2
        along = (0.75 * max(1.0 + at["motion_cosine"], 0.0)) ** 2
        along *= min(max(at["alignment"], 0.0) / 0.3, 1.0) * (at["stick_share"] < 0.5)
        assert found.strength == pytest.approx(along * moves / (0.2 + rates), rel=1e-4, abs=1e-6)
        assert found.time == pytest.approx(time)
        said[time] = found
    assert "the rest is still learned" in said[0.2].why
    assert "the load changes" in said[0.7].why
    assert "ratio of shear to load still changes" in said[1.3].why
    assert said[2.2].reported
    assert said[2.2].margin > 1.0 > said[1.3].margin
    assert "slip is reported: the strength is" in str(said[2.2])
    with pytest.raises(SceneError, match="no frame 9 s after"):
        opened.explain(9.0)
    with pytest.raises(SceneError, match="take 'slip', 'twist' or 'tactile'"):
        scene(recording, "contact", ["contact"]).explain(1.0)


def test_the_command_says_the_same(recording, tmp_path, capsys):
    file = tmp_path / "pull.npz"
    recording.save(file)
    with pytest.raises(SystemExit, match="0"):
        main(["explain", str(file), "--at", "2.2", "--engine", "numba", "--json"])
    line, other = map(json.loads, capsys.readouterr().out.splitlines())
    assert (other["kind"], other["reported"]) == ("twist", False)
    assert (line["kind"], line["frame"], line["reported"]) == ("slip", 220, True)
    assert line["margin"] == pytest.approx(line["strength"] / line["level"])
    assert {"slip_trend", "slip_ratio", "slip_stick_share"} <= set(line["read_outs"])


@pytest.mark.parametrize("command", ["explain --at 0", "replay", "view"])
def test_counts_need_a_scene_that_knows_their_scale(command, tmp_path, capsys):
    file, (name, *options) = tmp_path / "raw.npz", command.split()
    values = np.full((9, 4, 4, 3), 16000.0)
    cnnum.Recording(values, rate=60.0, unit="count").save(file)
    with pytest.raises(SystemExit, match="2"):
        main([name, str(file), *options])
    assert "choose a scene for them, as in '--scene uskin_grasp'" in capsys.readouterr().err


def test_a_slip_with_its_shear_beside_the_load_says_so():
    """By the weights of the page: that of the alignment is 0, that of the motion 0.5."""
    names = ("pattern_speed", "incoherent_shear", "trend", "load_rate", "swings", "ratio_rate")
    outputs = {f"slip_{name}": 0.1 for name in names}
    outputs |= {"slip_ratio": 0.2, "slip_stick_share": 0.0, "slip_level": 0.4, "gross_slip": 0.0}
    weights = {"still": 0.2, "swing": 0.6, "look": 0.08, "pull": 0.6}

    def why(**more):
        (said,) = explained({**outputs, **more}, ["slip"], 1.0, 10, weights)
        return said.why

    at_rest = {"slip_strength": 0.0, "slip_motion_cosine": -0.05}
    assert "does not lie where it presses (cosine -0.1)" in why(**at_rest, slip_alignment=-0.1)
    assert "moves little along its shear (cosine -0.05)" in why(**at_rest, slip_alignment=0.29)
    at_rest["slip_motion_cosine"] = 0.9
    assert "cosine" not in why(**at_rest, slip_alignment=0.31)


def test_the_picture_shows_every_read_out_around_the_time(recording, tmp_path):
    """Lines of the SVG are those of the frames: as many points as frames in ±1 s, and the level."""
    with scene(recording) as opened:
        around = opened.explain_between(0.5, 2.5)
        (alone,) = opened.explain(1.5)
    frames = [moment.frame for (moment,) in around]
    assert frames == list(range(50, 240))  # the recording ends at 2.4 s
    (middle,) = around[100]
    assert middle == alone
    assert sum(middle.holds.values()) == pytest.approx(
        0.2
        + middle.read_outs["slip_trend"]
        + 0.08 * middle.read_outs["slip_swings"] ** 2
        + 0.6 * (middle.read_outs["slip_load_rate"] + middle.read_outs["slip_ratio_rate"])
    )
    path = tmp_path / "why.svg"
    draw_explained(path, around, alone.time)
    text = path.read_text()
    names = {name.removeprefix("slip_") for name in alone.read_outs} - set(PLACES)
    assert {"pattern_speed", "trend", "ratio", "stick_share", "torque"} <= names
    assert all(f">{name}</text>" in text for name in names)
    assert "level, 0.4" in text
    assert "1/s" in text
    assert "time, s" in text
    with pytest.raises(ReportError, match="already exists"):
        draw_explained(path, around, alone.time)
