"""The scenes of the simulated array give newtons: they know its cover."""

import re
from pathlib import Path

import numpy as np
import pytest

import cnnum.scenes
from cnnum.drivers.registry import driver_options, open_driver
from cnnum.scenes.arrangement import bound, program_of, warn_of_other_cover
from cnnum.scenes.pipeline import load_scene
from cnnum.scenes.scene_file import read_scene

LOADS = ("load_normal", "load_x", "load_y")
TRUE = ("normal_force", "shear_x", "shear_y")
SCENES = ("contact", "demo", "edges", "slip", "tactile", "twist")
SHIPPED = Path(cnnum.scenes.__file__).parent


@pytest.fixture(scope="module")
def demo():
    """Loads reported and true, (frames, 3), and the events of the first contact."""
    scene = load_scene("demo", changes={"needs": ["contact", *LOADS]})
    moments = [moment for moment in scene.results() if moment.values is not None]
    stated = np.array([[float(m.outputs[name]) for name in LOADS] for m in moments])
    true = np.array([[float(m.frame.truth[name]) for name in TRUE] for m in moments])
    return stated, true, [event for m in moments for event in m.events]


def test_loads_are_newtons(demo):
    stated, true, _ = demo
    held = true[:, 0] > 0.5
    # as `contact` is for spheres of 1.5 to 2.5 cells on 8×8: docs/programs/contact.md
    off = stated[held, 0] / true[held, 0] - 1.0
    assert np.abs(off).max() < 0.1
    pull = np.hypot(true[:, 1], true[:, 2])
    pulled = held & (pull > 0.3)
    assert np.hypot(*(stated - true)[pulled, 1:].T).max() < 0.1 * pull.max()


def test_a_contact_is_as_strong_as_what_presses(demo):
    stated, _, events = demo
    contact = next(event for event in events if event.kind == "contact")
    assert contact.strength == pytest.approx(stated[contact.frame, 0], rel=1e-6)
    assert 0.0 < contact.strength < 0.1  # newtons, two frames after the touch


@pytest.mark.parametrize("name", SCENES)
def test_scenes_know_the_simulated_cover(name):
    spec = read_scene(name)
    array = driver_options("simulated", spec.driver_options)
    assert spec.parameters["depth"] == pytest.approx(array.thickness / array.pitch, abs=5e-4)
    # a load of one cell strains as 3/2E of its pressure, which is a force over pitch²
    newtons = 2 / 3 * array.youngs_modulus * array.pitch**2
    assert spec.parameters["unit"] == pytest.approx(newtons, rel=1e-3)


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.toml")), ids=lambda path: path.stem)
def test_no_scene_of_ours_warns_of_itself(path, caplog):
    """`tactile_flow`, whose flow needs no cover, warned of the bumps of its own array."""
    if read_scene(path.stem).driver == "simulated":
        load_scene(path.stem, changes={"engine.name": "numba"}).close()
    assert not caplog.text


PRESS = [
    {"kind": "hold", "duration": 0.5},
    {"kind": "press", "duration": 0.3, "load": 1.0},
    {"kind": "pull", "duration": 0.6, "speed": 0.8e-3},
    {"kind": "hold", "duration": 0.1},
]


def pressed(**changes):
    given = {"needs": [*LOADS, "friction_used"], "array.script": PRESS, "array.rate": 25.0}
    return load_scene("contact", changes={**given, **changes})


@pytest.mark.parametrize(
    "cover",
    [
        {"array.thickness": 0.5e-3},
        {"array.thickness": 2e-3},
        {"array.youngs_modulus": 2.4e6},
    ],
    ids=str,
)
def test_loads_are_newtons_under_other_flat_covers(cover, caplog):
    """The array gives depth and modulus to the program; 11 % is the bound of `contact` from one
    cell of radius on, and 1.2 is that of the stiffest cover.
    """
    held = [m for m in pressed(**cover).results() if m.frame.truth["normal_force"] > 0.9]
    assert len(held) > 12
    for moment in held:
        out, truth = moment.outputs, moment.frame.truth
        assert out["load_normal"] == pytest.approx(1.0, abs=0.11)
        assert abs(out["load_x"] - truth["shear_x"]) < 0.06
        assert abs(out["load_y"] - truth["shear_y"]) < 0.06
        assert abs(out["friction_used"] - truth["shear_x"]) < 0.1
    thin = cover.get("array.thickness", 1.0) < 0.5 * 1.5e-3
    assert bool(caplog.text) == thin


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"array.thickness": 0.5e-3}, "0.333 pitches thick, and below 0.5 loads a third less"),
        ({"array.cover": "layer"}, "the array has a layer on a rigid base"),
        ({"array.cover": "bumpy"}, "the array has a cover with bumps: take 'localize'"),
        ({"array.thickness": 5e-3}, "3.33 pitches thick"),
        ({"program.parameters.depth": 0.5}, "'program.parameters.depth' is 0.5, and 0.6667"),
        ({"program.parameters.depth": "1.5 mm"}, "'program.parameters.depth' is 1, and 0.6667"),
    ],
    ids=str,
)
def test_what_a_program_cannot_know_of_a_cover_is_said(changes, why, caplog):
    """Once, when the scene is loaded; slip and twist ask nothing of the cover, and nothing is."""
    assert (
        told(caplog, "contact", **changes).count("and shapes from the program 'tactile' are not")
        == 1
    )
    assert why in caplog.text
    assert not told(caplog, "slip", **changes)


def told(caplog, name, **changes):
    """Return what a scene says of its cover before anything is compiled."""
    caplog.clear()
    spec = read_scene(name, changes=changes)
    driver = open_driver(spec.driver, spec.driver_options)
    warn_of_other_cover(
        bound(program_of(spec), spec, driver, unit="strain"), spec, driver, "strain"
    )
    return caplog.text


def test_a_scene_of_ones_own_keeps_its_word(caplog):
    """As a recording of the array has to give the same; what contradicts the cover is said."""
    asked = dict(bound_of({"program.parameters.unit": 2.0, "array.thickness": 0.5e-3}))
    assert (asked["unit"], asked["depth"]) == (2.0, pytest.approx(1 / 3))
    table = {"name": "contact", "parameters": {"unit": 1.0}}
    assert "depth" not in dict(bound_of({"program": table, "array.thickness": 0.5e-3}))
    pressed(program=table).close()
    assert "depth' is 0.5 unless it is set, and 0.6667 by the array: set it to that" in caplog.text
    assert "newtons" not in caplog.text  # it has said its unit


@pytest.mark.parametrize(("thickness", "modulus"), [(1e-3, 0.87e6), (0.8e-3, 2.1e6)])
def test_a_scene_that_says_nothing_of_its_cover_is_told_what_is_missing(thickness, modulus, caplog):
    """The sentence has both numbers; a scene that takes them gives newtons, and hears nothing."""
    changes = {"array.thickness": thickness, "array.youngs_modulus": modulus}
    told(caplog, "contact", program={"name": "contact"}, **changes)
    said = r"depth' is 0\.5 unless it is set, and (\S+) by the array: set it to that, and "
    found = re.search(said + r"'program\.parameters\.unit' to (\S+) for newtons", caplog.text)
    assert found
    said = {"depth": float(found[1]), "unit": float(found[2])}
    caplog.clear()
    scene = pressed(program={"name": "contact", "parameters": said}, **changes)
    held = [m for m in scene.results() if m.frame.truth["normal_force"] > 0.9]
    assert held
    for moment in held:
        assert moment.outputs["load_normal"] == pytest.approx(1.0, abs=0.11)
    assert not caplog.text


def test_a_recording_does_not_tell_its_cover_and_a_packaged_scene_says_so(tmp_path, caplog):
    """One of a cover of 2 mm, replayed by a scene of 1 mm, read 0.6 N for 1 N and said nothing."""
    strain = np.random.default_rng(0).normal(0.0, 1e-5, (20, 8, 8, 3))
    cnnum.Recording(strain, rate=25.0, unit="strain").save(tmp_path / "press.npz")
    array = {"driver": "npz", "path": str(tmp_path / "press.npz")}
    said = "the array does not state its cover"
    for scene in ("contact", "demo", "edges", "active_contour"):
        assert told(caplog, scene, array=array).count(said) == 1
    assert "depth' (0.667) and 'program.parameters.unit' (1.305)" in told(
        caplog, "contact", array=array
    )
    yours = {"program.parameters.depth": 4 / 3, "program.parameters.unit": 1.305}
    assert not told(caplog, "contact", array=array, **yours)
    for scene in ("slip", "twist", "on_off"):  # they ask for none
        assert not told(caplog, scene, array=array)


def test_loads_that_taxels_carry_themselves_ask_for_no_cover(caplog):
    table = {"name": "contact", "parameters": {"reads": "force"}}
    assert not told(caplog, "contact", program=table)


def test_edges_below_a_cover_that_hides_them_are_not_lost_in_silence(caplog):
    """Of 1.33 pitches all is found, of 1.67 a third (`SHARP_UP_TO`)."""
    for thickness, lost in ((2e-3, False), (2.5e-3, True)):
        for name in ("edges", "contact", "edge_enhancement"):
            text = told(caplog, name, **{"array.thickness": thickness})
            assert ("misses edges" in text) == (lost and name == "edges")


def bound_of(changes):
    spec = read_scene("contact", changes=changes)
    driver = open_driver(spec.driver, spec.driver_options)
    return bound(program_of(spec), spec, driver, unit="strain").parameters
