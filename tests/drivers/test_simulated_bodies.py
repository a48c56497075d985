"""Bodies of the simulated array against closed forms: punches, faces with a relief, two fingers."""

import numpy as np
import pytest

from cnnum.drivers.registry import open_driver
from cnnum.drivers.simulated.array import SimulatedArray, SimulatedOptions
from cnnum.drivers.simulated.settings import Phase
from cnnum.errors import PhysicsError, SceneError
from cnnum.tactile.contact import contact_modulus
from cnnum.tactile.indenters import Disc, frame_under

E, FRICTION, PITCH = 0.87e6, 0.6, 1.5e-3
G = E / 3
PRESS = (Phase("press", 0.05, load=1.0),)
FLAT = ("punch", "bar", "ring", "two bodies")


def clean(**changes):
    """Return an array without noise, offsets and rounding."""
    quiet = {"noise": 0.0, "offset": 0.0, "bits": 0, "script": PRESS, "start": (0.0, 0.0)}
    return SimulatedArray(SimulatedOptions(**{**quiet, **changes}))


def textured(**changes):
    bumps = {"cover": "bumpy", "bump_radius": 0.2e-3, "thickness": 0.2e-3, "body": "textured"}
    return clean(**{**bumps, **changes})


def states(array):
    return [state for state, _ in array.scans()]


@pytest.mark.parametrize(("width", "depth"), [(3e-3, 1e-3), (4.5e-3, 1e-3), (6e-3, 1.5e-3)])
def test_a_punch_strains_the_taxels_as_hankels_solution(width, depth):
    """Boussinesq's pressure by its closed form: the driver solves it on cells, and shifts it."""
    array = clean(body="punch", width=width, thickness=depth, start=(0.2e-3, -0.1e-3))
    found = -array.strain(states(array)[-1:])[0][..., 2]
    disc = Disc(width / 2 / PITCH, (0.2e-3 / PITCH, -0.1e-3 / PITCH), "punch")
    signal = frame_under(disc, array.shape, depth / PITCH, "strain")
    true = 1.5 / E * signal / (np.pi * (width / 2) ** 2)
    # cells of a fifth of the pitch, of a pressure that is infinite at its rim
    assert np.abs(found - true).max() < 0.03 * true.max()


@pytest.mark.parametrize("body", FLAT)
def test_tractions_add_up_to_the_forces(body):
    pull = (*PRESS, Phase("pull", 0.1, speed=0.3e-3, direction=0.7))
    array = clean(body=body, script=pull)
    state = states(array)[-1]
    window = array._tractions.window([state])
    whole = array._tractions([state], window)[0].sum(axis=(0, 1)) * array.surface.cell_area
    assert whole[2] == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(whole[:2], array._springs.force(state), rtol=1e-9)
    assert np.hypot(*whole[:2]) > 0.05


@pytest.mark.parametrize("body", FLAT)
def test_all_of_a_flat_face_sticks_until_all_of_it_slides(body):
    """At friction's limit, by Ciavarella's principle; a round one after Q/(2 G* a)."""
    speed = 0.2e-3
    pull = (*PRESS, Phase("pull", 2.0, speed=speed, direction=0.7))
    array = clean(body=body, script=pull)
    truths = [truth for _, truth in array.scans()][11:]
    force = np.array([np.hypot(t["shear_x"], t["shear_y"]) for t in truths])
    slips = np.array([t["slip"] for t in truths]) > 0
    # but for the scan in which sliding begins, too slowly to count
    assert sum(t["incipient"] for t in truths) <= 1
    first = int(np.argmax(slips))
    np.testing.assert_allclose(force[slips][1:], FRICTION, rtol=1e-6)
    steps = np.diff(force[: first - 1])
    np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
    if body == "punch":
        stiffness = 2 * (4 * G / 1.5) * 4.5e-3 / 2
        # the outline on cells of a 25th of the pitch: 1 % of the area
        assert steps[0] == pytest.approx(stiffness * speed / 200.0, rel=0.02)
    assert truths[-1]["slip_direction"] == pytest.approx(0.7, abs=1e-9)


def test_a_turn_of_a_round_face_is_reissners_and_sagocis():
    """T = 16 G a³ β/3 while it sticks, and μ P π a/4 when all of it slides."""
    a = 2.25e-3
    angle = 1.0
    turn = (*PRESS, Phase("twist", 1.0, angle=angle))
    truths = [truth for _, truth in clean(body="punch", width=2 * a, script=turn).scans()]
    first = truths[12]
    assert first["torque"] == pytest.approx(16 * G * a**3 * first["twist"] / 3, rel=0.03)
    assert truths[-1]["torque"] == pytest.approx(FRICTION * np.pi * a / 4, rel=0.03)
    loose = [t["stick_radius"] / t["contact_radius"] for t in truths[11:]]
    assert (np.diff(loose) <= 1e-12).all()  # the rim gives way first, and never comes back
    assert truths[-1]["twist_slip"] == 1


def test_an_even_face_on_bumps_is_a_bed_of_hertz_contacts():
    array = textured(relief=0.0, script=(Phase("press", 0.05, load=2.0),))
    state = states(array)[-1]
    at, force = array._springs.forces(state)
    np.testing.assert_allclose(force[2], 2.0 / 64, rtol=1e-9)
    approach = (3 * 2.0 / 64 / (4 * contact_modulus(E) * 0.2e-3**0.5)) ** (2 / 3)
    stiffness = 2 * (4 * G / 1.5) * np.sqrt(0.2e-3 * approach)
    np.testing.assert_allclose(at.stiffness, stiffness, rtol=1e-6)


@pytest.mark.parametrize(("direction", "angle"), [(0.0, 0.0), (2.5, 0.9)])
def test_a_relief_leans_the_force_of_every_bump(direction, angle):
    """T/N stays within tan(atan μ ± atan slope), reaches both ends, and follows the relief."""
    relief, period, speed = 20e-6, 2.4e-3, 4e-3
    script = (
        Phase("press", 0.05, load=2.0),
        Phase("pull", 1.5, speed=speed, direction=direction),
    )
    array = textured(relief=relief, period=period, angle=angle, script=script)
    slid = [(s, t) for s, t in array.scans() if t["slip"]][2:]
    ratio = []
    for state, _ in slid:
        _, force = array._springs.forces(state)
        assert force[2].sum() == pytest.approx(2.0, rel=1e-9)
        ratio.append(np.hypot(*force[:2]) / force[2])
    across = abs(np.cos(direction - angle))
    steepest = 2 * np.pi * relief / period * across
    low, high = (np.tan(np.arctan(FRICTION) + s * np.arctan(steepest)) for s in (-1, 1))
    ratio = np.array(ratio)
    assert low - 1e-9 < ratio.min() < low + 0.01
    assert high - 0.01 < ratio.max() < high + 1e-9
    # one bump meets the same slope again after a period across the ridges
    every = round(period / across / (speed / 200.0))
    np.testing.assert_allclose(ratio[every:], ratio[:-every], atol=4e-3)


def test_two_fingers_are_one_and_its_mirror():
    """The same motion in space, in axes whose x is turned round: of a tilt the opposite one."""
    for kind in ("pull", "tilt"):
        script = (*PRESS, Phase(kind, 0.2, speed=0.4e-3, direction=0.7))
        array = clean(fingers=2, shape=(4, 5), body="punch", width=3e-3, script=script)
        assert array.shape == (4, 10)
        assert array.pads == 2
        strain = array.strain(states(array)[-1:])[0]
        one, two = strain[:, :5], strain[:, 5:][:, ::-1] * [-1.0, 1.0, 1.0]
        if kind == "pull":
            np.testing.assert_allclose(two, one, atol=1e-12)
            continue
        # a push is even, and a pull odd: turned half round a tilt is the same pull
        np.testing.assert_allclose(two[::-1, ::-1] * [-1.0, -1.0, 1.0], one, atol=1e-12)
    twist = (*PRESS, Phase("twist", 0.2, angle=0.05))
    array = clean(fingers=2, script=twist)
    truth = [truth for _, truth in array.scans()][-1]
    assert truth["other_torque"] == -truth["torque"] != 0.0


def test_a_relaxed_hand_leaves_no_force():
    script = (
        *PRESS,
        Phase("pull", 0.3, speed=0.4e-3, direction=0.7),
        Phase("twist", 0.3, angle=0.1),
        Phase("relax", 0.6),
    )
    for body in FLAT:
        truths = [truth for _, truth in clean(body=body, script=script).scans()]
        assert np.hypot(truths[-1]["shear_x"], truths[-1]["shear_y"]) < 1e-3
        assert abs(truths[-1]["torque"]) < 1e-3 * max(abs(t["torque"]) for t in truths)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"body": "cube"}, "'body' must be one of"),
        ({"body": "textured"}, "'cover' must be 'bumpy' under the body 'textured'"),
        ({"body": "bar", "width": 1e-5}, "'width' must be"),
        ({"fingers": 3}, "'fingers' must be"),
        (
            {"script": [{"kind": "press", "duration": 1, "load": 1.0},
                        {"kind": "tilt", "duration": 1, "speed": 1e-3}]},
            "without a 'tilt' unless 'fingers' is 2",
        ),
        (
            {"body": "ring", "script": [{"kind": "press", "duration": 1, "load": 1.0},
                                        {"kind": "roll", "duration": 1, "speed": 1e-3}]},
            "only a sphere rolls",
        ),
    ],
)  # fmt: skip
def test_bodies_that_cannot_be_are_named(options, sentence):
    with pytest.raises(SceneError, match=sentence):
        open_driver("simulated", options)


def test_a_body_is_asked_for_its_own_sizes_alone():
    """A ring has no length and a bar no relief: what it does not take is not looked at."""
    for body in ("sphere", "punch", "ring"):
        assert open_driver("simulated", {"body": body, "length": 1.0, "period": 1.0}).shape
    with pytest.raises(SceneError, match="'length' must be a fifth of the pitch"):
        open_driver("simulated", {"body": "two bodies", "length": 1.0})
    with pytest.raises(SceneError, match="'period' must be a fifth of the pitch"):
        open_driver("simulated", {"body": "textured", "cover": "bumpy", "period": 1.0})


def test_a_face_that_leaves_the_array_is_named():
    away = clean(body="bar", start=(12e-3, 0.0))
    with pytest.raises(PhysicsError, match="left the array"):
        list(away.frames())
