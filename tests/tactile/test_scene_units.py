"""The scenes of the simulated array give newtons: they know its cover."""

import numpy as np
import pytest

from cnnum.drivers.registry import driver_options
from cnnum.scenes.pipeline import load_scene
from cnnum.scenes.scene_file import read_scene

LOADS = ("load_normal", "load_x", "load_y")
TRUE = ("normal_force", "shear_x", "shear_y")
SCENES = ("contact", "demo", "edges", "slip", "tactile", "twist")


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
