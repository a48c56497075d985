"""Families of scenes: their truth against closed forms, their taxels, and their seeds."""

from dataclasses import replace

import numpy as np
import pytest

from cnnum.drivers.simulated import grips as drawing
from cnnum.drivers.simulated import grips as pulls
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.grips import (
    CREEP_TIME,
    FADES,
    LOOSE_TORQUE,
    YOUNGS_MODULUS,
    Array,
    Arrays,
    Bounds,
    Draw,
    Drawn,
    creeping,
    load_of,
    loops,
    mixed,
    stick_slip,
)
from cnnum.drivers.simulated.settings import Command, Phase, Settings
from cnnum.frame import truth_columns
from cnnum.lab.scoring.families import faces
from cnnum.lab.scoring.families.catalogue import FAMILIES, Dragged, spread
from cnnum.tactile.contact import sliding_torque, torsion_slip
from cnnum.tactile.grid import make_grid

NO_INFLUENCE = np.empty(0)  # tractions of a contact on the surface need no taxels
BOUNDS = Bounds(25e-3, load_of(2e-3, 25e-3, YOUNGS_MODULUS), 0.6, YOUNGS_MODULUS)
BY_NAME = {family.name: family for family in FAMILIES}


def drawn(family="constant speed", seed=7, **fixed):
    return Draw.of(family, seed, Array(**fixed))


def followed(hand, rate=1000.0):
    """A sphere pressed on with 1 N or so, then moved by commands: contacts, and their truth."""
    script = (Phase("press", 0.1, load=BOUNDS.load),)
    made = Settings(
        rate=rate,
        script=script,
        friction=BOUNDS.friction,
        radius=BOUNDS.radius,
        youngs_modulus=YOUNGS_MODULUS,
    )
    array = SimulatedArray(made, NO_INFLUENCE)
    moments = list(array.follow([Command(load=BOUNDS.load), *hand]))
    return [state for state, _ in moments], truth_columns([truth for _, truth in moments])


def moved(way, friction=None):
    shares = np.ones(len(way)) if friction is None else friction
    return [
        Command(load=BOUNDS.load, move=(float(step), 0.0), friction=float(share))
        for step, share in zip(np.diff(way, prepend=0.0), shares, strict=True)
    ]


def test_gross_slip_begins_at_mindlin_s_way_with_the_force_of_friction():
    travel = BOUNDS.travel()
    way = 1.5 * travel * np.arange(1, 901) / 900
    _, truth = followed(moved(way))
    onset = int(np.argmax(truth["slip"] > 0)) - 1
    assert way[onset] == pytest.approx(travel, rel=4e-3)  # 257 springs, 600 steps
    force = truth["shear_x"][onset + 1 :]
    np.testing.assert_allclose(force, BOUNDS.friction * BOUNDS.load, rtol=2e-3)


def test_sliding_is_the_way_beyond_mindlin_s():
    travel = BOUNDS.travel()
    for pulling in (pulls.power(1.0), pulls.power(2.0), pulls.force_ramp):
        way = pulling(drawn(rate=500.0), travel).way
        states, _ = followed(moved(way))
        slid = sum(float(np.hypot(*state.slipped)) for state in states)
        assert slid == pytest.approx(way[-1] - travel, rel=4e-3)


def test_friction_at_a_scan_scales_mindlin_s_limits():
    """At a share k of the friction the same contact slips at k μP, after k times the way."""
    travel = BOUNDS.travel()
    way = 1.2 * travel * np.arange(1, 901) / 900
    _, truth = followed(moved(way, np.full(900, 0.7)))
    force = truth["shear_x"]
    assert force.max() == pytest.approx(0.7 * BOUNDS.friction * BOUNDS.load, rel=2e-3)
    full = int(np.argmax(force > 0.999 * force.max())) - 1
    # the force is flat at the top: within a thousandth of it over a hundredth of the way
    assert way[full] == pytest.approx(0.7 * travel, rel=0.02)


def test_powers_of_time_and_force_ramps_go_as_they_say():
    travel, draw = BOUNDS.travel(), drawn(rate=1000.0)
    even, square = (pulls.power(p)(draw, travel).way for p in (1.0, 2.0))
    np.testing.assert_allclose(np.diff(even), even[0], rtol=1e-9)
    np.testing.assert_allclose(square / square[-1], (even / even[-1]) ** 2, rtol=1e-9)
    ramp = pulls.force_ramp(draw, travel).way
    sticks = ramp < 0.98 * travel
    force = 1.0 - (1.0 - ramp[sticks] / travel) ** 1.5  # Mindlin
    np.testing.assert_allclose(np.diff(force), force[0], rtol=1e-6)


def test_parts_of_a_pull_use_that_share_of_friction():
    travel = BOUNDS.travel()
    for seed in range(5):
        way = pulls.part(0.3, 0.7)(drawn(seed=seed), travel).way
        _, truth = followed(moved(way))
        used = truth["shear_x"][-1] / (BOUNDS.friction * BOUNDS.load)
        assert 0.29 < used < 0.71
        assert not truth["slip"].any()


HAND = Drawn(mass=0.1, stiffness=1500.0, speed=1e-3, limit=0.5, travel=1e-6, kinetic=0.6)


def test_friction_falls_from_static_to_kinetic_with_speed():
    assert HAND.friction(0.0) == 1.0
    assert HAND.friction(FADES) == pytest.approx(0.8)  # half of the possible fall
    assert HAND.friction(1e3 * FADES) == pytest.approx(0.6, abs=1e-3)


def test_a_slip_on_a_spring_jumps_by_twice_the_missing_force():
    """An undamped mass that is let go at μ_s P under μ_k P swings by 2 (μ_s − μ_k) P/k."""
    hand = replace(HAND, damping=0.0, kinetic=0.7, stiffness=300.0)
    times = np.arange(1, 2501) * 1e-3
    way, _ = stick_slip(hand, times)
    jump = 2 * 0.3 * hand.limit / hand.stiffness
    # friction fades over 1 mm/s where the jump reaches 0.3·0.5/√(300·0.1) = 27 mm/s
    starts = int(np.argmax(way > 0.2 * jump))
    assert way[starts + 60] - way[starts - 60] == pytest.approx(jump, rel=0.15)
    assert times[starts] * hand.speed == pytest.approx(hand.limit / hand.stiffness, rel=0.03)


def test_the_object_follows_the_hand_in_jumps():
    times = np.arange(1, 4001) * 1e-3
    way, share = stick_slip(HAND, times)
    behind = HAND.speed * times - way
    assert behind.max() <= 1.02 * HAND.limit / HAND.stiffness
    speed = np.diff(way) * 1000
    assert (np.abs(speed) < 0.5 * HAND.speed).mean() > 0.6  # it rests most of the time
    assert speed.max() > 5 * HAND.speed
    assert share.min() < 0.75
    assert share.max() == 1.0


def test_loose_torque_is_where_half_the_radius_sticks():
    torque = LOOSE_TORQUE * float(sliding_torque(1.0, 2e-3, 0.5))
    stick = torsion_slip(1.0, 2e-3, torque, 0.5).stick_radius
    assert stick == pytest.approx(1e-3, rel=1e-4)  # five digits are given


SHAPES = ("punch", "ring", "bar", "two_bodies", "ridges", "rough")


@pytest.mark.parametrize("shape", SHAPES)
def test_faces_press_with_the_whole_load_and_shear_up_to_friction(shape):
    face = getattr(faces, shape)(drawn())
    for load in (0.1, 0.5, 1.0):
        assert face.pressure(load).sum() == pytest.approx(load, rel=1e-6)
    shear = [face.shear(way) for way in (0.0, 0.3, 0.7, 1.0)]
    assert shear[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(shear[-1], face.pressure(1.0), atol=1e-12)
    assert np.diff([part.sum() for part in shear]).min() > 0
    # nowhere more than friction: half floats have three digits
    assert all(
        (part <= face.pressure(1.0) + 1e-3 * face.pressure(1.0).max()).all() for part in shear
    )


def test_a_flat_face_sticks_as_one_and_a_rough_one_does_not():
    for shape, slipping in (("punch", 0.0), ("rough", 0.2)):
        face = getattr(faces, shape)(drawn())
        pressed = face.pressure(1.0)
        some = pressed > 0.01 * pressed.max()
        used = face.shear(0.5)[some] / pressed[some]
        assert (used > 0.99).mean() >= slipping
        assert (used.std() < 1e-9) == (shape == "punch")


def test_a_dragged_face_slides_as_a_whole_with_the_force_of_friction():
    draw = drawn()
    face, grid = faces.punch(draw), make_grid((50, 50), 0.3e-3)
    body = Dragged(face, draw, 0.4, 0.1e-3)
    middle = []
    for way in (0.1e-3, 0.5e-3):
        maps = body.tractions(grid, 1.0, way) * grid.cell_area
        assert maps[..., 2].sum() == pytest.approx(0.4)
        shear = np.hypot(*maps[..., :2].sum(axis=(0, 1)))
        assert shear == pytest.approx(0.4 * draw.bounds.friction)
        x, y = np.meshgrid(grid.x, grid.y)
        middle.append([(maps[..., 2] * at).sum() / 0.4 for at in (x, y)])
    slid = np.subtract(*middle[::-1])
    along = (np.cos(draw.direction), np.sin(draw.direction))
    np.testing.assert_allclose(slid, np.multiply(0.4e-3, along), atol=1e-9)


def test_point_forces_keep_their_sum_and_their_place():
    grid, rng = make_grid((20, 20), 1.0), np.random.default_rng(3)
    x, y = rng.uniform(-8, 8, (2, 50))
    forces = rng.normal(size=(50, 3)) ** 2
    maps = spread(grid, x, y, forces)
    np.testing.assert_allclose(maps.sum(axis=(0, 1)), forces.sum(axis=0))
    np.testing.assert_allclose((maps[..., 0] * grid.x).sum(), (forces[:, 0] * x).sum())
    np.testing.assert_allclose((maps[..., 0] * grid.y[:, None]).sum(), (forces[:, 0] * y).sum())


def test_strain_creeps_at_the_rate_that_it_says():
    steps = np.ones((4000, 1, 1, 3))
    crept = creeping(steps, 0.05, 1000.0)[:, 0, 0, 0]
    assert crept[100] - crept[0] == pytest.approx(0.05 * 0.1, rel=0.03)  # 100 ms of 2 s
    times = np.arange(1, 4001) / 1000.0
    np.testing.assert_allclose(crept, 1 + 0.05 * CREEP_TIME * (1 - np.exp(-times / CREEP_TIME)))


def test_loops_are_as_wide_as_they_say():
    sweep = np.concatenate([np.linspace(0, 1, 200), np.linspace(1, 0, 200)])[:, None, None, None]
    made = loops(sweep, 0.05)[:, 0, 0, 0]
    up, down = made[100], made[299]  # at the same strain
    assert down - up == pytest.approx(0.05, abs=1e-9)


def test_crosstalk_takes_from_four_neighbours():
    read = np.zeros((1, 5, 5, 3))
    read[0, 2, 2] = 1.0
    made = mixed(read, 0.05)[0, ..., 0]
    assert made[2, 2] == pytest.approx(0.95)
    assert made[1, 2] == made[2, 3] == pytest.approx(0.0125)
    assert made[1, 1] == 0.0


QUICK = ("10 Hz", "4×4 taxels", "twist, 10 Hz")


@pytest.mark.parametrize("name", QUICK)
def test_a_seed_gives_the_same_scene(name):
    family = BY_NAME[name]
    one, again, other = (family.make(Arrays(), name, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.frames, again.frames)
    np.testing.assert_array_equal(one.slips, again.slips)
    assert one.frames.shape != other.frames.shape or (one.frames != other.frames).any()


def test_families_of_one_seed_differ():
    assert drawn("grip").speed != drawn("ring").speed
    assert drawn("grip").bounds == drawn("grip").bounds


@pytest.fixture(scope="module")
def scenes():
    """A scene of every family, at the lowest rate: it takes a third of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "RATES", (60.0,))
        yield made()


def made():
    arrays = Arrays()
    return {f.name: f.make(arrays, f.name, 3) for f in FAMILIES if f.name != "1000 Hz"}


def test_scenes_are_true_to_their_kind(scenes):
    for name, trial in scenes.items():
        kind = BY_NAME[name].kind
        assert trial.slides == (kind == "slip"), name
        assert bool(trial.sense.any()) == (kind == "twist"), name
        assert np.isfinite(trial.frames).all(), name
        if kind == "slip":
            assert 0.4e-3 < trial.slid[-1] < 1.4e-3, name
            assert abs(trial.direction) <= np.pi, name
            assert not trial.slid[: trial.onset].any(), name


def test_held_scenes_last_as_long_as_they_say(scenes):
    held = [trial for name, trial in scenes.items() if BY_NAME[name].kind == "held"]
    assert len(held) >= 6
    assert all(3.0 < trial.seconds <= 6.0 for trial in held)


def test_taxels_do_what_their_family_says(scenes):
    frames = scenes["saturation"].frames
    largest = np.abs(frames).max()
    assert (np.abs(frames) > 0.9 * largest).mean() > 0.002  # many stand at the limit
    still = scenes["2 dead taxels"].frames.std(axis=0).max(axis=-1)
    assert (still == 0).sum() == 2
    rest = scenes["heavy-tailed noise"].frames[:20, ..., 2]
    plain = scenes["constant speed"].frames[:20, ..., 2]

    def tails(values):
        values = (values - values.mean(axis=0)).reshape(-1)
        return (values**4).mean() / (values**2).mean() ** 2

    assert tails(rest) > tails(plain) + 0.5
