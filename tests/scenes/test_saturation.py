"""Taxels at an end of their range: loads say that they are bounds, shapes are not reported."""

import json
from dataclasses import replace

import numpy as np
import pytest

import cnnum
from cnnum.cli.root import main
from cnnum.drivers.recording_file import array_of
from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES, Frame, Quality
from cnnum.programs.library import get_program
from cnnum.programs.machine import ENOUGH
from cnnum.scenes import like_frames
from cnnum.scenes.events import EVENT_RULES, EventDetector
from cnnum.scenes.pipeline import load_scene
from cnnum.scenes.saturation import Saturation

TOUCH = [
    {"kind": "hold", "duration": 0.3},
    {"kind": "press", "duration": 0.3, "load": 1.0},
    {"kind": "pull", "duration": 0.3, "speed": 0.4e-3},
    {"kind": "release", "duration": 0.3},
    {"kind": "hold", "duration": 0.2},
]
WANTS = ["contact", "edge", "load_normal", "edge_count"]


def touched(gain):
    """Return a scene of a sphere that is pressed with 1 N, and its moments."""
    changes = {"needs": WANTS, "array.script": TOUCH, "array.gain": gain}
    scene = load_scene("contact", changes=changes)
    return scene, list(scene.results())


@pytest.mark.parametrize(("gain", "share"), [(160.0, 0.01), (240.0, 0.05), (800.0, 0.25)])
def test_a_load_on_saturated_taxels_is_a_bound(gain, share, caplog):
    """It is never above the true one by more than the program's own error, 4 %, and says so."""
    scene, moments = touched(gain)
    marked = [m for m in moments if m.load_is_bound]
    held = [m for m in moments if m.frame.truth["normal_force"] > 0.9]
    assert max(m.saturated.mean() for m in marked) > share
    for moment in moments:
        limit = scene.driver.calibration.limit
        at_end = (np.abs(moment.frame.values) >= limit).any(axis=-1)
        assert moment.load_is_bound == at_end.any()
        if at_end.any():
            np.testing.assert_array_equal(moment.saturated, at_end)
    for moment in held:
        load, true = float(moment.outputs["load_normal"]), moment.frame.truth["normal_force"]
        assert load < 1.04 * true
        assert moment.load_is_bound or load > 0.94 * true
    assert scene.summary().saturated == len(marked)
    said = [record for record in caplog.records if "limit of their range" in record.message]
    assert len(said) == 1
    assert "no event of edge is reported" in said[0].message


def test_a_sphere_that_saturates_gets_no_edge(caplog):
    """Its clipped load looks like a flat body's: the cells say edge, and no event does."""
    _, moments = touched(400.0)
    taken_in = [m for m in moments if m.outputs["edge_count"] > 0]
    assert len(taken_in) > 30
    assert all(m.load_is_bound for m in taken_in)
    kinds = [event.kind for m in moments for event in m.events]
    assert kinds == ["contact", "release"]
    assert all(m.load_is_bound == e.saturated for m in moments for e in m.events)


HARD = {
    "load": {"array.script": [*TOUCH[:1], {"kind": "press", "duration": 0.3, "load": 9.0},
                              {"kind": "hold", "duration": 3.0}, *TOUCH[3:]]},
    "gain": {"array.gain": 400.0},
}  # fmt: skip


@pytest.mark.parametrize(("how", "rate"), [("load", 10.0), ("gain", 50.0)])
def test_an_array_pressed_to_its_end_is_saturated_and_not_silent(how, rate, caplog):
    """All taxels read one number for seconds: the rail's. Texture says that it cannot work."""
    wants = ["texture", "texture_known", "texture_friction", "friction"]
    scene = load_scene("texture", changes={**HARD[how], "needs": wants, "array.rate": rate})
    moments = list(scene.results())
    limit = scene.driver.calibration.limit
    ends = [(np.abs(m.frame.values) >= limit).any(axis=-1) for m in moments]
    alike = [m for m in moments if (m.frame.values == m.frame.values[0, 0, 0]).all()]
    assert len(alike) > 2.0 * rate
    assert not [event for m in moments for event in m.events]
    assert "nothing shows that the array is alive" not in caplog.text
    assert caplog.text.count("saturated and the program 'texture' cannot work") == 1
    for moment, at_end in zip(moments, ends, strict=True):
        assert not moment.outputs["texture_friction"][at_end].any()
        if at_end.all():
            assert not moment.outputs["texture_known"]
            assert moment.outputs["friction"] == 0.0


def test_texture_is_right_where_it_says_that_it_knows():
    """With a few taxels at their end, the others' friction is as good as without: 5 %."""
    wants = ["texture", "texture_friction", "texture_rubs"]
    scene = load_scene("texture", changes={"array.gain": 115.0, "needs": wants})
    known = []
    for moment in scene.results():
        if moment.outputs["texture_rubs"]:
            found = moment.outputs["texture_friction"]
            assert moment.saturated is None or not found[moment.saturated].any()
            known.append(int((found > 0).sum()))
            np.testing.assert_allclose(found[found > 0], 0.6, rtol=0.05)
    assert known
    assert 20 < max(known) < 60


def test_contact_says_whether_it_knows_the_shear():
    changes = {"needs": ["shear_known", "load_x"], "array.script": TOUCH, "array.gain": 240.0}
    moments = list(load_scene("contact", changes=changes).results())
    pressed = [m for m in moments if m.frame.truth["normal_force"] > 0.05]
    assert {m.load_is_bound for m in pressed} == {False, True}
    for moment in pressed:
        assert bool(moment.outputs["shear_known"]) is not moment.load_is_bound
    assert not any(m.outputs["shear_known"] for m in moments[:40])


def test_the_run_says_it_in_words_and_in_records(capsys):
    command = ["run", "contact", "--set=array.gain=800.0", "--frames", "200"]
    for more in ([], ["--json"]):
        with pytest.raises(SystemExit) as ended:
            main([*command, *more])
        assert ended.value.code == 0
    words, records = capsys.readouterr().out.split("{", 1)
    assert "saturated: loads in them are lower bounds" in words
    assert json.loads(records.splitlines()[-1])["saturated"] > 50


def test_fields_that_are_saved_say_which_loads_are_bounds(tmp_path):
    _, moments = touched(240.0)
    changes = {"needs": WANTS, "array.script": TOUCH, "array.gain": 240.0}
    record = load_scene("contact", changes=changes).collect()
    bound = np.array([m.load_is_bound for m in moments])
    np.testing.assert_array_equal(record.load_is_bound, bound)
    assert bound.any()
    assert not bound.all()
    record.save(tmp_path / "record.npz")
    record.save(tmp_path / "record.csv")
    record.save(tmp_path / "record.nc")
    with np.load(tmp_path / "record.npz") as saved:
        np.testing.assert_array_equal(saved["load_is_bound"], bound)
    rows = (tmp_path / "record.csv").read_text().splitlines()
    assert rows[0].startswith("time,frame,load_is_bound,")
    assert [row.split(",")[2] == "1" for row in rows[1:]] == bound.tolist()


def frame(number, *cells, flagged=True, values=0.0, knows=True):
    """Return a frame of 4×4 taxels of which some stand at their end."""
    mask = np.zeros((4, 4), dtype=bool)
    for cell in cells:
        mask[cell] = True
    quality = Quality.SATURATED if cells and flagged else Quality.GOOD
    return Frame(
        np.broadcast_to(np.asarray(values, dtype=np.float64), (4, 4, 3)).copy(),
        FORCE_AXES,
        "V",
        number,
        0.01 * number,
        quality,
        saturated=mask if cells and knows else None,
    )


def mask(watch, shown, size=0.0):
    """Return the taxels at their end in a frame that is taken in."""
    seen = watch.look(shown, size)
    watch.take(seen)
    return None if seen is None else seen.found


def test_a_taxel_that_is_stuck_from_the_start_is_named_and_bounds_nothing(caplog):
    watch = Saturation((4, 4))
    for number in range(ENOUGH + 4):
        assert mask(watch, frame(number, (1, 2))) is None
    assert "declare them dead with 'frames.dead = [[1, 2]]'" in caplog.text
    found = mask(watch, frame(30, (1, 2), (3, 3)))
    assert np.argwhere(found).tolist() == [[3, 3]]
    declared = Saturation((4, 4), dead=[(1, 2)])
    assert mask(declared, frame(0)) is None
    assert mask(declared, frame(1, (1, 2))) is None


def test_without_a_mask_every_taxel_is_doubted():
    """Of a driver that says only that there is one, all of them may be it."""
    watch = Saturation((4, 4))
    assert mask(watch, frame(0)) is None
    assert mask(watch, frame(1, (0, 0), knows=False)).all()
    # a calibration's limit knows which, and needs no flag
    limited = Saturation((4, 4), limit=2.4)
    assert mask(limited, frame(0)) is None
    values = np.ones((4, 4, 3))
    values[2, 1, 0] = -2.5
    high = frame(1, (0, 0), flagged=False, values=values, knows=False)
    assert np.argwhere(mask(limited, high, 2.5)).tolist() == [[2, 1]]


def test_a_release_waits_until_all_taxels_are_within_their_range():
    """A load that reads as 0 because its taxels stand at their end is none that is gone."""
    detector = EventDetector(EVENT_RULES["contact"])
    place = {"contact_row": 1.0, "contact_column": 1.0}
    on = {"contact": 1.0, "load_normal": 2.0, **place}
    off = {"contact": 0.0, "load_normal": 0.0, **place}
    (begins,) = detector.update(0.0, 0, on, saturated=True)
    assert begins.load_is_bound
    assert begins.record()["load_is_bound"] is True
    assert "strength at least 2" in str(begins)
    assert detector.update(0.1, 1, off, saturated=True) == ()
    (ends,) = detector.update(0.2, 2, off)
    assert (ends.kind, ends.load_is_bound) == ("release", False)
    assert "load_is_bound" not in ends.record()


@pytest.mark.parametrize(
    ("share", "start", "gains", "least", "most"),
    [
        (0.1, [-0.9e-3, -0.4e-3], (200.0, 300.0), 0.64, 0.96),
        (0.25, [0.0, 0.0], (500.0, 800.0), 0.0, 0.31),
    ],
)
def test_a_bound_is_as_far_below_the_load_as_the_page_says(share, start, gains, least, most):
    """In docs/bad-frames.md; a tenth is 6 or 7 taxels of 64, a quarter 15 to 17."""
    found = []
    for gain in gains:
        script = [{"kind": "hold", "duration": 0.5}, *TOUCH[1:]]
        changes = {"needs": ["load_normal"], "array.script": script, "array.start": start,
                   "array.rate": 100.0, "array.gain": gain}  # fmt: skip
        for moment in load_scene("contact", changes=changes).results():
            true = moment.frame.truth["normal_force"]
            if true > 0.95 and np.abs(moment.saturated.mean() - share) < 0.02:
                found.append(float(moment.outputs["load_normal"]) / true)
    assert least <= min(found)
    assert max(found) < most
    # the page does not say more than is so: these gains reach both ends
    assert min(found) < least + 0.03
    assert max(found) > most - 0.03


def test_texture_does_not_know_the_friction_of_a_saturated_taxel():
    """It takes no frame of a taxel at its end into the window of that taxel."""
    rng = np.random.default_rng(3)
    plan = Engine("numba").compile(
        get_program("texture").bind(rate=60.0, push=1.0, window=8),
        (4, 4),
        channels=(*FORCE_AXES, "saturated"),
    )
    stream = plan.stream()
    for number in range(60):
        values = 1e-3 * rng.normal(size=(4, 4, 4))
        values[..., 3] = 0.0
        if number >= 20:
            values[..., 2] += 1.0
            values[..., 0] += 0.6
            values[0, :, 2], values[0, :, 0] = 1.0, 0.1  # a rail cuts the shear off
            values[0, :, 3] = 1.0
        out = stream.push(values)
    assert not out["texture_friction"][0].any()
    assert not out["texture_frames"][0].any()
    assert out["texture_friction"][1:] == pytest.approx(0.6, rel=0.01)
    assert out["friction"] == pytest.approx(0.6, rel=0.01)


@pytest.mark.in_full("test_programs_that_read_the_marks_run_in_whole_numbers")
@pytest.mark.parametrize(
    ("name", "flag"), [("body_fit", "sphere_fits"), ("mindlin_slip", "mindlin_holds")]
)
def test_laws_of_contact_are_not_asked_of_a_clipped_pressure(name, flag):
    """They hold for a sphere within range, and say nothing once a taxel is at its end."""
    script = [*TOUCH[:2], {"kind": "hold", "duration": 0.5}]
    scene = load_scene(
        "contact",
        changes={
            "needs": [flag],
            "program": {"name": name},
            "program.parameters.depth": 0.667,
            "array.script": script,
            "array.gain": 245.0,
            "array.radius": 40e-3,
        },
    )
    bound = get_program(name).bind(rate=scene.driver.rate, depth=0.667)
    # the same values, without the marks: clipped only a little, they pass for a sphere's
    unmarked = scene.engine.compile(bound, (8, 8), [flag]).stream()
    for moment in scene.results():
        shown = unmarked.push(moment.values[..., :3])
    assert moment.load_is_bound
    assert not moment.outputs[flag]
    assert shown[flag]


def test_a_program_that_goes_through_all_channels_meets_no_marks():
    """The channel of marks is no reading."""
    from cnnum.programs.machine import FrameFields

    seen = []

    def look(frame: FrameFields) -> dict[str, object]:
        seen.append(frame.channels)
        return {"sum": sum(frame.channel(name) for name in frame.channels).sum()}

    cnnum.program(look).trace((4, 4), (*FORCE_AXES, "saturated"))
    assert seen == [FORCE_AXES]


def far(cells=(), loaded=(), number=0, nan=False):
    """Return a frame of 6×6 taxels with some at their end of 1 V, and some that feel a load."""
    values = np.zeros((6, 6, 3))
    for cell in cells:
        values[cell] = 1.0
    for cell in loaded:
        values[cell] = 0.2
    if nan:
        values[0, 0, 0] = np.nan
    return Frame(values, FORCE_AXES, "V", number, 0.02 * number)


def test_a_taxel_that_breaks_later_is_named_and_holds_nothing_back(caplog):
    """It stands at its end with no load around it; a load that comes near makes it a bound."""
    watch, bad = Saturation((6, 6), limit=1.0), (4, 4)
    for number in range(40):
        assert mask(watch, far(number=number)) is None
    found = [mask(watch, far([bad], number=number), 1.0) for number in range(40, 120)]
    doubted = [n for n, at_end in enumerate(found) if at_end is not None]
    assert doubted == list(range(50))  # 1 s
    assert "declare them dead with 'frames.dead = [[4, 4]]'" in caplog.text
    # a load elsewhere is a load, and the broken taxel still none
    assert mask(watch, far([bad], [(0, 0), (0, 1)], 120), 1.0) is None
    here = mask(watch, far([bad, (0, 0)], [(0, 1), (1, 1)], 121), 1.0)
    assert np.argwhere(here).tolist() == [[0, 0]]
    assert mask(watch, far([bad], [(4, 3)], 122), 1.0)[bad]


def test_a_held_load_stays_a_bound_however_long():
    """Its neighbours feel it through the cover."""
    watch = Saturation((6, 6), limit=1.0)
    for number in range(40):
        mask(watch, far(number=number))
    for number in range(40, 400):
        assert mask(watch, far([(2, 2), (2, 3)], [(2, 4)], number), 1.0).sum() == 2


def test_a_frame_that_is_refused_changes_nothing(caplog):
    """It neither counts as rest nor says anything: only what is taken in does."""
    watch = Saturation((6, 6), limit=1.0)
    for number in range(ENOUGH + 1):
        mask(watch, far(number=number))
    for number in range(20, 200):
        assert watch.look(far([(1, 1)], number=number, nan=True), 1.0).found[1, 1]
    assert not caplog.text
    assert mask(watch, far([(1, 1)], number=200), 1.0)[1, 1]


def test_a_broken_taxel_lets_a_press_be_released(caplog):
    """One that sticks after the rest held back each release and edge to the end of the run."""
    script = [{"kind": "hold", "duration": 2.0}, *TOUCH[1:]]
    scene = load_scene("contact", changes={"needs": WANTS, "array.script": script})
    path, kinds = scene.path(), []
    limit = scene.driver.calibration.limit
    for number, whole in enumerate(scene.driver.frames()):
        values = whole.values.copy()
        if number > 40:
            values[0, 7] = 1.1 * limit
        spoilt = replace(whole, values=values)
        kinds += [event.kind for event in path.step(number, spoilt).events]
    assert kinds == ["contact", "release"]
    assert "frames.dead = [[0, 7]]" in caplog.text


def test_where_it_is_not_known_which_no_number_is_said(caplog):
    watch = Saturation((4, 4), withheld=["event of edge"])
    mask(watch, frame(0))
    mask(watch, frame(1, (0, 0), knows=False))
    assert "some taxels are at the limit of their range (it is not known which)" in caplog.text
    assert "no event of edge is reported" in caplog.text


def test_the_phase_that_is_withheld_is_named(caplog):
    """Of a clipped pressure the incipient slip is not reported, and gross slip is."""
    watch = load_scene("contact", changes={"needs": ["slip"], "program": {"name": "mindlin_slip"},
                                           "program.parameters.depth": 0.667})  # fmt: skip
    path = watch.path()
    mask(path.saturation, replace(frame(0, values=9.0), values=np.full((8, 8, 3), 9.0)), 9.0)
    mask(path.saturation, replace(frame(0), values=np.zeros((8, 8, 3))), 0.0)
    mask(path.saturation, replace(frame(1), values=np.full((8, 8, 3), 9.0)), 9.0)
    assert "no event of incipient slip is reported" in caplog.text


@pytest.mark.parametrize("name", ["texture", "body_fit", "mindlin_slip"])
def test_programs_that_read_the_marks_run_in_whole_numbers(name, monkeypatch):
    """Their frames have one more channel than the array, in the frames that give ranges, too."""
    parameters = {} if name == "texture" else {"program.parameters.depth": 0.667}
    wants = {"texture": "friction", "body_fit": "sphere_fits", "mindlin_slip": "mindlin_holds"}
    changes = {
        "needs": [wants[name]],
        "program": {"name": name},
        "array.shape": [4, 4],
        "engine.name": "reference",
        "engine.precision": "q15",
        **parameters,
    }
    monkeypatch.setattr(like_frames, "MOST", 40)
    with load_scene("contact", changes=changes) as scene:
        moment = next(iter(scene.results()))
    assert moment.values.shape == (4, 4, 4)
    assert np.isfinite(moment.outputs[wants[name]])


@pytest.mark.parametrize("suffix", [".mcap", ".npz", ".csv"])
def test_a_replay_marks_the_taxels_of_the_live_run(tmp_path, suffix):
    """An array that knows which, and has no calibration whose limit would say it again."""
    rng = np.random.default_rng(5)
    values = 1e-3 * rng.normal(size=(50, 5, 6, 3))
    marks = np.zeros((50, 5, 6), dtype=bool)
    marks[25:, 1:3, 2] = True
    values[25:, 1:4, 1:4, 2] += 1.0
    live = cnnum.Recording(values, rate=100.0, unit="N", saturated=marks)
    held = cnnum.load_recording(live.save(tmp_path / f"live{suffix}"))
    np.testing.assert_array_equal(held.saturated, marks)
    assert (held.quality == np.where(marks.any(axis=(1, 2)), Quality.SATURATED, 0)).all()
    assert cnnum.load_recording(held.save(tmp_path / f"again{suffix}")) == held
    table = array_of(tmp_path / f"again{suffix}")
    scene = load_scene("demo", changes={"needs": ["contact"], "array": table})
    for number, moment in enumerate(scene.results()):
        found = np.zeros((5, 6)) if moment.saturated is None else moment.saturated
        np.testing.assert_array_equal(found, marks[number])
