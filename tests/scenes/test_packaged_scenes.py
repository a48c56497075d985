"""Every scene that comes with the package reports, and what it reports is its array's own truth."""

import os
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from played_scenes import BODIES, kinds_of, onset, place_of, played, tell_the_same
from scipy import fft, ndimage

from cnnum.drivers.registry import open_driver
from cnnum.drivers.simulated.cover import CELLS, MARGIN
from cnnum.drivers.simulated.settings import DEFAULT
from cnnum.errors import PhysicsError, RecordingError, SceneError
from cnnum.scenes.arrangement import events_of_everything, warn_of_no_bumps
from cnnum.scenes.pipeline import load_scene
from cnnum.scenes.scene_file import read_scene, scene_names
from cnnum.scenes.scene_record import SceneRecord
from cnnum.tactile.texture import texture as friction_and_roughness


def loads_on_bumps(array):
    """Return the force on every bump at every scan, (scans, rows, cols, 3) N, x, y and normal."""
    rows, cols = (n + 2 * MARGIN for n in array.shape)
    found = []
    for state, _ in array.scans():
        whole = np.zeros((*array.surface.shape, 3))
        if state.load > 0:
            window = array._tractions.window([state])
            whole[window.rows, window.cols] = array._tractions([state], window)[0]
        squares = whole.reshape(rows, CELLS, cols, CELLS, 3).sum(axis=(1, 3))
        found.append(array.surface.cell_area * squares[MARGIN:-MARGIN, MARGIN:-MARGIN])
    return np.array(found)


def test_localize_gives_the_load_on_every_bump():
    """In newtons, with the sign of the pull, at rest and while it slides."""
    loads = [f"bump_load_{axis}" for axis in ("x", "y", "normal")]
    wants = ["bump", "bump_contact", "bump_count", *loads,
             "bump_x", "bump_y", "bump_normal", "bump_row", "bump_column"]  # fmt: skip
    scene, moments, truths = played("localize", needs=wants, **{"array.rate": 50.0})
    own = loads_on_bumps(scene.driver)
    held = [n for n, truth in enumerate(truths) if truth["normal_force"] > 0.05]
    assert len(held) > 100
    for n in held[::3]:
        out, top = moments[n].outputs, own[n, ..., 2].max()
        touched = out["bump_contact"] > 0
        assert out["bump_count"] == touched.sum()
        # a bump counts from a tenth of the largest load on; noise is 1 % of that
        assert touched[own[n, ..., 2] > 0.12 * top].all()
        assert not touched[own[n, ..., 2] < 0.08 * top].any()
        for k, axis in enumerate(("x", "y", "normal")):
            off = np.abs(out[f"bump_load_{axis}"] - own[n, ..., k])[touched].max()
            # noise of 2.5 mV is 3.5e-4 of strain: 0.1 mN of normal load, 0.3 mN of shear, of 20 mN
            assert off < (0.01 if axis == "normal" else 0.08) * top
        pull = np.array([truths[n]["shear_x"], truths[n]["shear_y"]]) / truths[n]["normal_force"]
        found = np.array([out[f"bump_load_{axis}"].sum() for axis in "xy"])
        assert np.abs(found / out["bump_load_normal"].sum() - pull).max() < 0.02
        # without the loads below a tenth of the largest the sum was 8 % low, and the shear 0.05
        whole = float(out["bump_normal"])
        assert whole == pytest.approx(truths[n]["normal_force"], rel=0.015)
        assert np.abs(np.array([out["bump_x"], out["bump_y"]]) / whole - pull).max() < 0.02
        for axis, places in zip(("row", "column"), np.indices(own.shape[1:3]), strict=True):
            middle = np.average(places, weights=own[n, ..., 2])
            # noise of 0.1 mN of 150 mN, on bumps up to two cells from the middle
            assert out[f"bump_{axis}"] == pytest.approx(middle, abs=0.01)
    events = [event for moment in moments for event in moment.events]
    assert [event.kind for event in events] == ["bump", "bump_release"]
    touching = [n for n, truth in enumerate(truths) if truth["contact"]]
    # load begins as t^1.5: 6 standard deviations of the noise are reached in 20 ms, and two frames
    # are asked for
    assert 0 <= events[0].time - moments[touching[0]].frame.time < 0.05
    assert abs(events[1].time - moments[touching[-1]].frame.time) < 0.05
    assert events[0].unit == "N"
    first = moments[events[0].frame].outputs
    assert events[0].where == (float(first["bump_row"]), float(first["bump_column"]))
    # the sphere comes down at (−0.9, −0.4) mm: row 3.2, column 2.9, and one bump is touched first
    assert np.abs(np.array(events[0].where) - [3.5 - 0.4 / 1.5, 3.5 - 0.9 / 1.5]).max() < 0.6


@pytest.mark.parametrize("gain", [80.0, 200.0])
def test_localize_states_no_shear_whose_sign_it_cannot_know(gain):
    """A bump's shear is 0 and not known where a taxel at it, or at its side, is at its end."""
    wants = ["bump_contact", "bump_shear_known", "bump_load_x", "bump_load_y", "bump_x", "bump_y",
             "bump_normal"]  # fmt: skip
    scene = load_scene("localize", changes={"array.gain": gain, "array.rate": 50.0, "needs": wants})
    marked = checked = 0
    own = loads_on_bumps(scene.driver)
    for moment, loads in zip(scene.results(), own, strict=True):
        out, touched = moment.outputs, moment.outputs["bump_contact"] > 0
        known = out["bump_shear_known"] > 0
        whole = (known == touched).all()
        marked += not whole
        assert not out["bump_load_x"][~known].any()
        assert moment.load_is_bound or whole
        if not whole:
            assert out["bump_x"] == out["bump_y"] == 0.0
        if moment.frame.truth["normal_force"] < 0.1:
            continue
        checked += int(known.sum())
        top = loads[..., 2].max()
        for k, axis in enumerate("xy"):
            off = np.abs(out[f"bump_load_{axis}"] - loads[..., k])[known]
            # second neighbours at their end add 1 % each to what holds without any
            assert not off.size or off.max() < 0.1 * top
        # what a taxel at its end cannot show is missing
        assert out["bump_normal"] < 1.01 * loads[..., 2].sum()
    assert checked
    assert marked


def test_bumps_too_close_to_be_told_apart_are_refused():
    with pytest.raises(PhysicsError, match=r"Bumps 2\.5 radii apart over taxels 1\.66667 radii"):
        load_scene("localize", changes={"array.bump_radius": 0.6e-3, "array.thickness": 1e-3})


def test_a_flat_cover_has_no_bumps_to_report(caplog):
    """No event by "everything"; bumps that are asked for are doubted."""
    for name, needs, doubted in (
        ("tactile", ["everything"], False),
        ("contact", ["bump_count"], True),
        ("localize", ["bump"], False),
    ):
        spec = read_scene(name, changes={"needs": needs})
        driver = open_driver(spec.driver, spec.driver_options)
        assert ("bump" in events_of_everything(driver)) == (name == "localize")
        warn_of_no_bumps(spec, driver)
        assert ("has no bumps" in caplog.text) == doubted
        caplog.clear()


@pytest.mark.parametrize(("radius", "thickness"), [(0.2e-3, 0.3e-3), (0.15e-3, 0.15e-3)])
def test_another_cover_of_the_users_is_inverted_as_it_is(radius, thickness):
    """The geometry comes from the array: no parameter says it, by either program."""
    for program in ("localize", "tactile"):
        scene, moments, _ = played(
            "localize",
            **{
                "array.bump_radius": radius,
                "array.thickness": thickness,
                "array.noise": 0.0,
                "program.name": program,
                "array.script": [
                    {"kind": "hold", "duration": 0.2},
                    {"kind": "press", "duration": 0.2, "load": 0.03},
                    {"kind": "pull", "duration": 0.2, "speed": 0.4e-3, "direction": -2.0},
                ],
            },
        )
        own, out = loads_on_bumps(scene.driver)[-1], moments[-1].outputs
        touched = out["bump_contact"] > 0
        for k, axis in enumerate(("x", "y", "normal")):
            off = np.abs(out[f"bump_load_{axis}"] - own[..., k])[touched].max()
            # the inverse is cut at three bumps to each side: 2 %
            assert off < 0.02 * own[..., 2].max()


def test_every_packaged_scene_has_its_test():
    """By its own name in a file of scenes here: a new one is held to its truth, too."""
    files = Path(__file__).parent.glob("test_*_scenes.py")
    text = "".join(file.read_text(encoding="utf-8") for file in files)
    assert [name for name in scene_names() if f'"{name}"' not in text] == []


@pytest.mark.one_in(5)  # the first has all events; the others are parts of it
@pytest.mark.parametrize("name", ["tactile", "demo", "contact", "slip", "twist"])
def test_a_sphere_that_is_pulled_and_turned_is_reported(name):
    sense = -1 if name == "twist" else 1
    script = [asdict(replace(phase, angle=sense * phase.angle)) for phase in DEFAULT]
    scene, moments, truths = played(name, **({"array.script": script} if sense < 0 else {}))
    events = {(event.kind, event.phase): event for moment in moments for event in moment.events}
    wanted = {
        "contact": {("contact", None), ("release", None)},
        "slip": {("slip", "gross")},
        "twist": {("twist", None)},
    }
    known = wanted["contact"] | wanted["slip"] | wanted["twist"]
    assert set(events) == wanted.get(name, known)
    assert len(kinds_of(moments)) == len(events)
    if ("contact", None) in events:
        begins, ends = events["contact", None], events["release", None]
        # a load that begins as t^1.5 leaves the noise after 20 ms
        assert 0 <= begins.time - onset(moments, truths, "contact") < 0.03
        last = max(m.frame.time for m, t in zip(moments, truths, strict=True) if t["contact"])
        assert abs(ends.time - last) < 0.03
        # where it was, and not where the last noise is: it was 2.5 cells off
        assert np.abs(ends.where - place_of(scene, truths[ends.frame])).max() < 1.0
        # from (−0.9, −0.4) mm: one pitch is 1.5 mm, and one taxel is touched first
        assert np.abs(np.array(begins.where) - [3.5 - 0.4 / 1.5, 3.5 - 0.9 / 1.5]).max() < 0.6
        assert begins.unit == "N"
    if ("slip", "gross") in events:
        slip, since = events["slip", "gross"], onset(moments, truths, "slip")
        assert slip.direction == pytest.approx(0.5, abs=0.03)
        # 0.3 mm of sliding, the aim of docs/scoring.md
        assert 0 <= slip.time - since < 0.3e-3 / 0.8e-3
        assert slip.strength > 2 * max(strengths(moments, truths, "slip"))
        # it has just exceeded its level
        assert 0.4 < slip.strength < 0.6
        assert (slip.motion, slip.sense) == ("slide", None)
        assert not moments[-1].outputs["gross_slip"]
        for flag in ("slip_pivots", "slip_centred", "slip_sense"):
            assert not any(moment.outputs[flag] for moment in moments)
    if ("twist", None) in events:
        twist, truth = events["twist", None], truths[events["twist", None].frame]
        assert twist.sense == np.sign(truth["twist_rate"]) == sense
        assert np.abs(twist.where - place_of(scene, truth)).max() < 0.3
        assert 0 <= twist.time - onset(moments, truths, "twist_rate") < 0.2
        assert twist.strength > 2 * max(strengths(moments, truths, "twist"))
        assert 0.1 < twist.strength < 0.15
        assert not moments[-1].outputs["twist"]
    for m, truth in zip(moments, truths, strict=True):
        out = m.outputs
        if "load_normal" not in out or truth["normal_force"] < 0.5:
            continue
        assert float(out["load_normal"]) == pytest.approx(truth["normal_force"], rel=0.08)
        # docs/programs/contact.md: the place within 0.1 cells, a pull within 7 % of the largest
        place = np.array([out["contact_row"], out["contact_column"]])
        assert np.abs(place - place_of(scene, truth)).max() < 0.15
        if name == "tactile":
            pull = [truth["shear_x"], truth["shear_y"]]
            assert np.hypot(out["load_x"] - pull[0], out["load_y"] - pull[1]) < 0.1 * 0.96
            used = np.hypot(*pull) / truth["normal_force"]
            assert float(out["friction_used"]) == pytest.approx(used, abs=0.06)
            assert out["shear_known"]
            touched = out["contact_map"] > 0
            assert out["contact_area"] == touched.sum() > 0
            middle = np.argwhere(touched).mean(axis=0)
            # cells that are touched at all lie evenly around it, to half a cell
            assert np.abs(middle - place_of(scene, truth)).max() < 0.5


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", ["twist", "demo"])
def test_a_second_turn_has_its_own_sense_and_place(name):
    """1.2 and 2.2 cells away from the first, and the other way round."""
    script = [
        {"kind": "hold", "duration": 0.4},
        {"kind": "press", "duration": 0.3, "load": 1.0},
        {"kind": "hold", "duration": 0.3},
        {"kind": "twist", "duration": 1.0, "angle": 0.4},
        {"kind": "relax", "duration": 0.3},
        {"kind": "pull", "duration": 1.0, "speed": 4e-3, "direction": 0.5},
        {"kind": "relax", "duration": 0.3},
        {"kind": "hold", "duration": 0.3},
        {"kind": "twist", "duration": 1.0, "angle": -0.4},
    ]
    changes = {"array.script": script, "array.rate": 100.0, "needs": ["twist"]}
    scene, moments, truths = played(name, **changes)
    events = [event for moment in moments for event in moment.events]
    assert [(event.kind, event.sense) for event in events] == [("twist", 1), ("twist", -1)]
    places = [place_of(scene, truths[event.frame]) for event in events]
    assert np.abs(np.subtract(*places)).min() > 0.9
    for event, place in zip(events, places, strict=True):
        assert np.abs(event.where - place).max() < 0.3


def strengths(moments, truths, kind):
    """Return the strengths of a kind in the frames before it happens."""
    first = next(n for n, t in enumerate(truths) if t["slip" if kind == "slip" else "twist_rate"])
    return [float(moment.outputs[f"{kind}_strength"]) for moment in moments[:first]]


SEEN = {
    "active_contour": "outline", "contact": "contact", "demo": "contact", "tactile": "contact",
    "localize": "bump", "on_off": "onset", "receptors": "pressure", "grasp_code": "grasp_slip",
    "edges": "edge", "edge_enhancement": "edge", "slip": "slip",
}  # fmt: skip
"""Events of scenes that any body makes; a sphere has no edge, and other scenes go by patterns."""

SCENES = [name for name in scene_names() if name != "uskin_grasp"]


@pytest.mark.one_in(19)  # of 75, of which no two in a row are of one body
@pytest.mark.parametrize(("name", "body"), [(n, b) for n in SCENES for b in ("sphere", *BODIES)])
def test_every_scene_takes_every_body_by_its_name(name, body):
    """With the sizes of the scene or of the driver, also where it goes over the rim."""
    _, moments, truths = played(name, **{"array.body": body})
    assert any(truth["contact"] for truth in truths)
    free = [n for n, truth in enumerate(truths) if not truth["contact"]]
    assert len(free) > 50
    flat = body != "sphere" or not name.startswith("edge")
    assert SEEN.get(name) in (None, *kinds_of(moments)) or not flat


@pytest.mark.parametrize("name", SCENES)
def test_a_textured_face_needs_bumps(name):
    spec = read_scene(name, changes={"array.body": "textured"})
    if spec.driver_options.get("cover") == "bumpy":
        open_driver(spec.driver, spec.driver_options).close()
    else:
        with pytest.raises(SceneError, match="'cover' must be 'bumpy' under the body 'textured'"):
            open_driver(spec.driver, spec.driver_options)


@pytest.mark.one_in(2)  # not the scene's own friction and rate, which a constant would pass
@pytest.mark.parametrize(("rate", "friction"), [(100.0, 0.25), (200.0, 0.6)])
def test_texture_measures_the_friction_and_the_roughness_of_a_face(rate, friction):
    needs = ["texture", "texture_friction", "texture_roughness", "friction", "texture_rubs"]
    changes = {"array.friction": friction, "array.rate": rate}
    scene, moments, truths = played("texture", needs=needs, **changes)
    own = loads_on_bumps(scene.driver)
    true = friction_and_roughness(own[..., [0, 1, 2]], window=128)
    (event,) = (event for moment in moments for event in moment.events)
    assert event.kind == "texture"
    # a window of 128 samples, 15 ms apart, after the slide began, less the few that it may hide
    slides = onset(moments, truths, "slip")
    assert 1.5 < event.time - slides < 128 * 0.015 + 0.1
    assert event.strength == pytest.approx(truths[event.frame]["friction"], rel=0.05)
    held = (k for k, t in enumerate(truths) if t["slip"] and t["normal_force"] > 1.99)
    n = max(held) - 2
    found = moments[n].outputs
    np.testing.assert_allclose(found["texture_friction"], true.friction[n], rtol=0.05)
    # noise of 0.3 mN in 30 mN of shear adds 1 to 2 % to a roughness
    off = found["texture_roughness"] - true.roughness[n]
    assert np.abs(off).max() < 2.5
    assert true.roughness[n].mean() > 5.0
    rubbed = [float(m.outputs["friction"]) for m in moments if m.outputs["texture_rubs"]]
    # docs/programs/texture.md
    assert 0.985 * friction < min(rubbed) <= max(rubbed) < 1.01 * friction
    assert not moments[-1].outputs["texture_rubs"]
    # the last window without the release in it is held
    assert float(moments[-1].outputs["friction"]) == pytest.approx(friction, rel=0.02)


def test_texture_of_a_face_that_only_sticks_is_not_reported():
    script = [
        {"kind": "hold", "duration": 0.3},
        {"kind": "press", "duration": 0.3, "load": 2.0},
        {"kind": "pull", "duration": 0.05, "speed": 0.4e-3},
        {"kind": "hold", "duration": 1.4},
    ]
    _, moments, truths = played("texture", **{"array.script": script})
    assert not any(truth["slip"] for truth in truths)
    assert kinds_of(moments) == []


def test_grasp_code_reads_what_the_object_between_two_fingers_does():
    _, moments, truths = played("grasp_code")
    events = [event for moment in moments for event in moment.events]
    assert [event.kind for event in events] == [
        "grasp_squeeze", "grasp_slip", "grasp_squeeze", "grasp_tilt", "grasp_twist",
        "grasp_squeeze",
    ]  # fmt: skip
    ended = ("squeeze", "slip", "tilt", "twist")
    assert not any(moments[-1].outputs[f"grasp_{kind}"] for kind in ended)
    # the script's phases: a motion is reported after 0.1 s, a squeeze once rubber has moved on
    begins = [0.3, 0.9, 1.7, 2.1, 3.3, 4.1]
    for event, begin in zip(events, begins, strict=True):
        assert 0.1 <= event.time - begin < 0.3
        truth = truths[event.frame]
        own = np.array([truth["shear_x"], truth["shear_y"]])
        # the other finger's x runs the other way in space
        other = np.array([-truth["other_shear_x"], truth["other_shear_y"]])
        together, apart = np.linalg.norm(own + other) / 2, np.linalg.norm(own - other) / 2
        match event.kind:
            case "grasp_slip":
                assert together > 0.1 > 10 * apart
                way = np.arctan2(*(own + other)[::-1])
            case "grasp_tilt":
                assert apart > 0.1 > 10 * together
                way = np.arctan2(*own[::-1])
            case "grasp_twist":
                assert truth["torque"] < -1e-4 < truth["other_torque"]
                assert event.sense == -1  # all squeezes press rubber outwards
                assert max(together, apart) < 0.05
                continue
            case _:
                # pressed, and pulled by less than a quarter of the load: rubber is pressed out
                assert event.sense == 1
                assert max(together, apart) < 0.25 * truth["normal_force"] + 0.05
                continue
        # one bit a component knows the quarter of the plane, and says its middle
        quarter = np.arctan2(np.sign(np.sin(way)), np.sign(np.cos(way)))
        assert event.direction == pytest.approx(quarter, abs=1e-3)
        # all taxels of a finger have the signs of its pull: bits 0 and 1 of each, x and y
        late = event.frame + 80
        signs = [truths[late][name] > 0.0 for name in ("shear_x", "shear_y")]
        other_signs = [truths[late][f"other_{name}"] > 0.0 for name in ("shear_x", "shear_y")]
        code = sum(0x55 << k for k in (0, 1) if signs[k])
        code += sum(0x55 << 8 + k for k in (0, 1) if other_signs[k])
        assert moments[late].outputs["grasp_code"] == code


def labelled_trials():
    folder = Path(os.environ.get("CNNUM_RECORDINGS", "nowhere"))
    return sorted(path.parent for path in folder.rglob("xela_sensor1.csv"))


@pytest.mark.skipif(not labelled_trials(), reason="needs the recordings")
def test_recorded_grasps_are_reported_by_their_labels():
    """A slip within 0.1 s of its label's begin, and none in a grasp that holds."""
    told = []
    for trial in labelled_trials():
        scene = load_scene("uskin_grasp", changes={"array.path": str(trial)})
        moments = list(scene.results())
        tell_the_same(moments)
        events = [event for moment in moments for event in moment.events]
        assert scene.summary().bad_frames == 0
        assert {event.kind for event in events} <= {"slip"}
        for event in events:
            # the level of the scene's rate, just exceeded; the pull is a unit vector
            assert 0.4 < event.strength < 1.0
            pull = [moments[event.frame].outputs[f"slip_{axis}"] for axis in "xy"]
            assert np.hypot(*pull) == pytest.approx(1.0, abs=1e-5)
        slips = [m.frame.time for m in moments if m.frame.truth["slip"]]
        told.append(bool(slips))
        assert bool(events) == bool(slips)
        if slips:
            # the video that the labels are from has 30 pictures a second
            assert slips[0] - 1 / 30 <= events[0].time <= slips[0] + 0.1
    assert any(told)
    assert not all(told)


def test_a_recorded_grasp_asks_for_its_recording():
    """The only packaged scene without an array of its own: `run` says what to give it."""
    with pytest.raises(RecordingError, match=r"'array\.path'"):
        load_scene("uskin_grasp")


def test_receptors_reports_what_each_channel_of_the_skin_feels():
    """It is pressed from 0.42 s on, shaken from 1.02, pulled from 1.52, let go from 2.12 s on."""
    scene, moments, truths = played("receptors")
    events = [event for moment in moments for event in moment.events]
    times = {kind: [e.time for e in events if e.kind == kind] for kind in {e.kind for e in events}}
    held = [m.frame.time for m, t in zip(moments, truths, strict=True) if t["contact"]]
    # a load that begins as t^1.5 leaves the noise after 10 ms; a flag ends 50 ms after its signal
    (begins,), (ends,) = times["pressure"], times["pressure_end"]
    assert 0 <= begins - held[0] < 0.02
    assert -0.02 < ends - held[-1] < 0.1
    # the load swings by a fifth at 125 Hz; a hand that lifts off of a sudden is felt as a jerk
    shaken, jerk = times["vibration"]
    assert 0 <= shaken - 1.02 < 0.01
    assert 0 < times["vibration_end"][0] - 1.22 < 0.1
    assert 0 <= jerk - 2.12 < 0.01
    # RA-I speaks while the push changes, and is silent while it is held
    moves = list(zip(times["motion"], times["motion_end"], strict=True))
    still = [(0.85, 1.0), (1.35, 1.5), (2.05, 2.1)]
    assert not any(begin < b and end > a for begin, end in moves for a, b in still)
    assert any(begin < 0.45 and end > 0.72 for begin, end in moves)
    (stretch,) = (event for event in events if event.kind == "stretch")
    truth = truths[stretch.frame]
    assert 0.0 < stretch.time - 1.52 < 0.15
    assert stretch.direction == pytest.approx(
        np.arctan2(truth["shear_y"], truth["shear_x"]), abs=0.05
    )
    (stretch_ends,) = times["stretch_end"]
    assert 2.12 < stretch_ends < 2.35
    # 10 standard deviations of the noise are a report's level, which a slow push has just exceeded
    begun = ("pressure", "motion", "vibration")
    assert all(10 < e.strength < 30 for e in events if e.kind in begun)
    # the strength of a stretch is all shear over its noise in the second half of the rest of 0.4 s
    # at 1 kHz; a field moves no shear off the array, and a hold of 0.1 s is ten time constants
    pulls = np.array([[m.outputs[f"stretch_{axis}"] for axis in "xy"] for m in moments])
    shear = -np.array([m.values[..., :2].sum(axis=(0, 1)) for m in moments])
    np.testing.assert_allclose(
        pulls[2000:2100].mean(axis=0),
        (shear[2000:2100] - shear[:400].mean(axis=0)).mean(axis=0),
        rtol=0.01,
    )
    noise = np.sqrt(np.square(pulls[200:400]).sum(axis=1).mean())
    strength = [float(m.outputs["sa2_strength"]) for m in moments[2000:2100]]
    np.testing.assert_allclose(strength, np.hypot(*pulls[2000:2100].T) / noise, rtol=1e-3)
    # it is felt ahead of the pull, which goes towards 0.5 rad
    felt = [float(moments[2050].outputs[f"sa2_{axis}"]) for axis in ("row", "column")]
    ahead = felt - place_of(scene, truths[2050])
    assert np.arctan2(*ahead) == pytest.approx(0.5, abs=0.1)
    # where: in the middle of what is felt, of a pull ahead of it; at the end, where it was last
    for name, begin, end, most, strong in (
        ("sa1", 0.85, 1.0, 0.1, 1000), ("ra1", 0.6, 0.7, 0.3, 25), ("pc", 1.1, 1.2, 0.7, 5),
        ("sa2", 2.0, 2.1, 1.2, 200),
    ):  # fmt: skip
        for moment, truth in zip(moments, truths, strict=True):
            if begin <= moment.frame.time < end:
                place = [moment.outputs[f"{name}_{axis}"] for axis in ("row", "column")]
                assert np.abs(place - place_of(scene, truth)).max() < most
                assert moment.outputs[f"{name}_strength"] > strong
    for event in events:
        assert np.abs(event.where - place_of(scene, truths[event.frame])).max() < 1.2


def test_spikes_of_the_receptors_are_address_events(tmp_path):
    """Each is where the charge of a leaky cell under its channel's output reaches the threshold."""
    needs = ["ra1", "ra1_spikes", "ra1_spike_time", "ra1_spike_gap", "ra1_first"]
    start, threshold = (-2.4e-3, -1.9e-3), 1e-4
    changes = {"array.rate": 200.0, "array.start": start, "program.parameters.threshold": threshold}
    record = load_scene("receptors", changes={"needs": needs, **changes}).collect(frames=144)
    count, gap = np.abs(record["ra1_spikes"]), record["ra1_spike_gap"]
    assert (count > 1).sum() > 50
    assert not gap[count < 2].any()
    output = record["ra1"].copy()
    output[:80] = 0.0  # a cell takes no charge while 0.4 s of rest are learned
    push = 0.5 * (output[1:] + output[:-1])
    for cell in np.ndindex(*push.shape[1:]):
        at = (slice(None), *cell)
        reached = charges(record.times, push[at], *(
            record[f"ra1_{name}"][at] for name in ("spikes", "spike_time", "spike_gap")
        ))  # fmt: skip
        # float32, which is 1e-7 of the push, and some pushes are seven thresholds
        np.testing.assert_allclose(reached[:-1], threshold, rtol=5e-6)
        assert abs(reached[-1]) < threshold
    events = record.address_events("ra1")
    assert events.size == count.sum() > 400
    assert events["p"].all()  # it is only pushed
    assert (np.diff(events["t"]) >= 0).all()
    assert events["t"][0] > 0.42e6
    record.save(tmp_path / "spikes.txt")
    rows = np.loadtxt(tmp_path / "spikes.txt")
    np.testing.assert_allclose(rows[:, 0], 1e-6 * events["t"], atol=1e-9)
    for column, name in enumerate("xyp", 1):
        np.testing.assert_array_equal(rows[:, column], events[name])
    # where the sphere came down, the first one fires
    first = record["ra1_first"][-1]
    place = np.unravel_index(np.argmin(np.where(first < 0, np.inf, first)), first.shape)
    assert np.hypot(*(np.array(place) - 3.5 - np.array(start[::-1]) / 1.5e-3)) < 1.0
    for row, column in np.argwhere(first >= 0):
        own = events["t"][(events["x"] == column) & (events["y"] == row)]
        # times are whole µs
        assert first[row, column] == pytest.approx(1e-6 * (own[0] - events["t"][0]), abs=2e-6)
    assert (first > 0).sum() > 5
    with pytest.raises(SceneError, match="one channel"):
        SceneRecord(["ra1"]).save(tmp_path / "none.txt")


def charges(times, push, count, first, gap):
    """Return the charge of a leaky cell at each of its spikes, and at the end.

    It is the sum of all that came since the silence of 1 ms after the spike before, of which a part
    of 1/e is left after 10 ms; `push` is constant between two times.
    """
    spikes = [time + begin + n * wait
              for time, many, begin, wait in zip(times, np.abs(count), first, gap, strict=True)
              for n in range(round(many))]  # fmt: skip
    since = [-np.inf, *(time + 1e-3 for time in spikes)]
    return [
        push @ np.diff(np.exp((np.clip(times, begin, end) - end) / 1e-2))
        for begin, end in zip(since, [*spikes, times[-1]], strict=True)
    ]


def test_on_off_tells_what_comes_from_what_goes():
    # beside the middle, where nothing else lies; its path is the shipped scene's
    scene, moments, truths = played("on_off", **{"array.start": [1.2e-3, -0.9e-3]})
    events = [event for moment in moments for event in moment.events]
    assert [event.kind for event in events] == ["onset", "offset"]
    held = [m.frame.time for m, t in zip(moments, truths, strict=True) if t["contact"]]
    lifts = next(
        m.frame.time
        for m, t, before in zip(moments[1:], truths[1:], truths, strict=False)
        if t["normal_force"] < before["normal_force"]
    )
    assert 0 <= events[0].time - held[0] < 0.02
    assert 0 <= events[1].time - lifts < 0.03
    for event in events:
        assert np.abs(event.where - place_of(scene, truths[event.frame])).max() < 0.4
        assert 10 < event.strength < 40  # the level, which a press of 0.1 s has just exceeded
    at = next(n for n, m in enumerate(moments) if m.frame.time >= lifts) - 2
    held_still = moments[at].outputs
    rows, cols = np.indices(scene.driver.shape)
    row, col = place_of(scene, truths[at])
    far = np.hypot(rows - row, cols - col) * scene.driver.pitch / 3e-3
    # strain under the rim: ON within the punch, OFF around it
    assert held_still["on_sustained"][far < 0.8].min() > 0
    around = (far > 1.5) & (far < 1.8)
    assert held_still["off_sustained"][around].min() > 0
    # a taxel answers with one sign, and neither before anything comes
    assert not held_still["off_sustained"][far < 0.8].any()
    assert not held_still["on_sustained"][around].any()
    # it is the signal that receptors spread by 0.25 cells², less what the surround does by 2 more
    curve = (
        -2 * np.cos(np.pi * np.arange(8) / 8)[:, None] - 2 * np.cos(np.pi * np.arange(8) / 8) + 4
    )
    signal = np.mean([m.values[..., 0] for m in moments[:80]], axis=0)
    signal = signal - np.mean([m.values[..., 0] for m in moments[at - 20 : at]], axis=0)
    waves = fft.dctn(signal, norm="ortho") / (1 + 0.25 * curve)
    exact = fft.idctn(waves - waves / (1 + 2 * curve), norm="ortho")
    answer = held_still["on_sustained"] - held_still["off_sustained"]
    # a frame's noise of 3.5e-4, of which receptors let a third through
    assert np.abs(answer - exact).max() < 0.05 * exact.max()
    # 0.8 s are 8 time constants of the adaptation
    noise = 0.05 * held_still["on_sustained"].max()
    for name in ("on_transient", "off_transient"):
        assert held_still[name].max() < noise
    quiet = [m.outputs for m in moments if m.frame.time < held[0]]
    for name in ("on_sustained", "off_sustained", "on_transient", "off_transient"):
        assert max(out[name].max() for out in quiet) < noise
    # the transient answers are those to the press, and to its end
    for name, begin in (("on_transient", held[0]), ("off_transient", lifts)):
        during = next(m.outputs for m in moments if m.frame.time >= begin + 0.08)
        assert during[name][far < 0.8].mean() > 4 * noise
        assert during[name][far < 0.8].min() > during[name][far > 1.2].max()
    assert not moments[-1].outputs["comes"]
    assert not moments[-1].outputs["goes"]


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("thickness", "modulus"), [(1e-3, 0.87e6), (0.5e-3, 3e6), (3e-3, 0.5e6)])
def test_active_contour_keeps_to_a_body_that_is_dragged(thickness, modulus):
    cover = {"array.thickness": thickness, "array.youngs_modulus": modulus}
    scene, moments, truths = played("active_contour", **cover)
    events = [event for moment in moments for event in moment.events]
    assert [event.kind for event in events] == ["outline", "outline_lost"]
    held = [m.frame.time for m, t in zip(moments, truths, strict=True) if t["contact"]]
    assert 0 <= events[0].time - held[0] < 0.03
    assert abs(events[1].time - held[-1]) < 0.03
    pitch = scene.driver.pitch
    # taxels whose middle lies below the bar
    rows, cols = (pitch * (at - 3.5) for at in np.indices(scene.driver.shape))
    turn, checked = 0.4, []
    for moment, truth in zip(moments, truths, strict=True):
        if truth["normal_force"] < 0.99 or moment.number % 20:
            continue
        x, y = cols - truth["x"], rows - truth["y"]
        along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        inside = moment.outputs["contour_inside"] > 0
        sides = ((along, 1.5e-3), (across, 3e-3))
        far = np.hypot(*(np.maximum(np.abs(at) - half, 0.0) for at, half in sides))
        deep = np.minimum(*(half - np.abs(at) for at, half in sides))
        # within half a pitch of the outline a taxel may count either way
        assert inside[deep > 0.5 * pitch].all()
        assert not inside[far > pitch].any()
        rim = inside & ~ndimage.binary_erosion(inside, np.ones((3, 3)), border_value=1)
        np.testing.assert_array_equal(moment.outputs["contour"] > 0, rim)
        for name, places in (("row", rows), ("column", cols)):
            middle = 3.5 + np.average(places[inside]) / pitch
            assert moment.outputs[f"contour_{name}"] == pytest.approx(middle, abs=1e-5)
        checked.append(np.average(cols[inside]))
        assert checked[-1] == pytest.approx(truth["x"], abs=0.5 * pitch)
    assert checked[-1] - checked[0] > 1.5e-3  # it went along


ACROSS = pytest.mark.parametrize("way", [2.2, 0.0])
"""rad, the way of a face out and back, its ridges across it; 0 is that of the packaged scene."""


def directed(name, kind, way):
    """Return the events of a kind of a scene, and the truth of each frame."""
    script = read_scene(name).driver_options["script"]
    turned = [{**phase, "direction": way + phase.get("direction", 0.0)} if phase["kind"] == "pull"
              else phase for phase in script]  # fmt: skip
    _, moments, truths = played(name, **{"array.script": turned, "array.angle": way})
    events = [event for moment in moments for event in moment.events]
    assert [event.kind for event in events] == [kind, f"{kind}_end"] * 2
    slides = [t["slip"] for t in truths]
    stops = [m.frame.time for m, t, on in zip(moments[1:], truths[1:], slides, strict=False)
             if on and not t["slip"]]  # fmt: skip
    for event, stop in zip(events[1::2], stops, strict=True):
        # the mean goes back over 0.2 s and its flag lasts for 0.1 s; four times as long is silence
        assert 0 < event.time - stop < 0.9
    return events[::2], moments, truths


def unit_vector(direction):
    return np.array([np.cos(direction), np.sin(direction)])


@pytest.mark.one_in(2)
@ACROSS
def test_tactile_flow_follows_a_face_that_slides(way):
    """Out and back, across its ridges: a face shows no motion along them."""
    events, moments, truths = directed("tactile_flow", "flow", way)
    for event, direction in zip(events, (way, way + np.pi), strict=True):
        since = onset_after(moments, truths, "slip", event.time - 0.2)
        assert 0 < event.time - since < 0.2
        assert abs(np.angle(np.exp(1j * (event.direction - direction)))) < 0.15
        # while it still gains speed
        assert 0.4 < event.strength / (4.0 / 1.5) < 1.1
    slides = [n for n, t in enumerate(truths) if t["slip"] and truths[n - 80]["slip"]]
    assert len(slides) > 150
    for n in slides[::10]:
        flow = np.array([float(moments[n].outputs[f"flow_{axis}"]) for axis in "xy"])
        speed = truths[n]["slip_speed"] / 1.5e-3
        along = unit_vector(truths[n]["slip_direction"])
        # slopes are 4 % low, Hertz's law sharpens the ridges, and the readings are noisy
        assert flow @ along == pytest.approx(speed, rel=0.09)
        assert np.linalg.norm(flow - (flow @ along) * along) < 0.1 * speed
        assert float(moments[n].outputs["flow_speed"]) == pytest.approx(np.hypot(*flow), rel=1e-5)


@pytest.mark.one_in(2)
@ACROSS
def test_motion_direction_says_which_way_a_face_slides(way):
    events, moments, truths = directed("motion_direction", "drift", way)
    for event, direction in zip(events, (way, way + np.pi), strict=True):
        since = onset_after(moments, truths, "slip", event.time - 0.2)
        assert 0 < event.time - since < 0.2
        assert abs(np.angle(np.exp(1j * (event.direction - direction)))) < 0.1
        assert 0.05 < event.strength < 0.1  # `sure`, which it has just exceeded
    # a wave of 6 cells at 4 mm/s, late by the angle of a low-pass of 0.1 s: sin 2φ sin k, over the
    # pairs of neighbours along an axis, 7 of 8
    late = np.arctan(0.1 * 2 * np.pi / 6 * 4.0 / 1.5)
    share = 7 / 8 * np.sin(2 * late) * np.sin(2 * np.pi / 6 * unit_vector(way))
    slides = [n for n, t in enumerate(truths) if t["slip"] and truths[n - 150]["slip"]]
    assert len(slides) > 100
    for n in slides[::10]:
        out, sign = moments[n].outputs, np.cos(truths[n]["slip_direction"] - way)
        found = np.array([float(out[f"motion_{axis}"]) for axis in "xy"])
        # three quarters of a period are in the means: 10 %
        assert np.abs(found - sign * share).max() < 0.12 * np.abs(share).max()
        assert float(out["motion_strength"]) == pytest.approx(np.hypot(*found), rel=1e-5)


def onset_after(moments, truths, flag, begin):
    """Return the first time from a moment on at which the truth has a flag, s."""
    times = (m.frame.time for m, t in zip(moments, truths, strict=True) if t[flag])
    return next(time for time in times if time > begin)
