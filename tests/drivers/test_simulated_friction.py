"""The springs against the closed forms: they know their limits only, not these solutions."""

import numpy as np
import pytest

from cnnum.drivers.simulated.settings import Command
from cnnum.drivers.simulated.springs import Pair, Springs, State, _k_less_e, abel
from cnnum.tactile.contact import (
    hertz,
    partial_slip,
    shear_compliance,
    sliding_torque,
    tangential_displacement,
    torsion_slip,
)

LOAD, FRICTION = 1.0, 0.6
PAIR = Pair(radius=25e-3, youngs_modulus=0.87e6, friction=FRICTION)
CONTACT = hertz(LOAD, PAIR.radius, PAIR.normal_modulus)
A = float(CONTACT.contact_radius)
SPRINGS = Springs(PAIR, reach=1.02 * A)


def test_limits_of_twist_are_elliptic_integrals():
    """Against SciPy's, which lose digits of the difference where the ratio is close to 1."""
    from scipy.special import ellipe, ellipkm1

    ratio = np.concatenate([np.geomspace(1e-9, 0.999, 400), [1.0]])
    expected = ellipkm1(ratio**2) - ellipe(1 - ratio**2)
    assert _k_less_e(ratio) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def pressed(load: float = LOAD, springs: Springs = SPRINGS) -> State:
    return springs.step(springs.rest((0.0, 0.0)), Command(load))


def pulled(distance: float, state: State, steps: int = 40) -> State:
    for _ in range(steps):
        state = SPRINGS.step(state, Command(LOAD, move=(distance / steps, 0.0)))
    return state


def sliding_begins() -> float:
    compliance = shear_compliance(PAIR.youngs_modulus)
    return float(tangential_displacement(CONTACT, LOAD, LOAD, FRICTION, compliance))


@pytest.mark.parametrize("share", [0.1, 0.4, 0.7, 0.9, 0.99])
def test_a_pull_is_cattaneo_and_mindlins(share: float) -> None:
    force = share * FRICTION * LOAD
    compliance = shear_compliance(PAIR.youngs_modulus)
    distance = float(tangential_displacement(CONTACT, LOAD, force, FRICTION, compliance))
    state = pulled(distance, pressed())
    # The rim lies between two of the 257 springs: the force is off by about one part in 257²,
    # the stick radius by up to one spacing.
    assert SPRINGS.force(state)[0] == pytest.approx(force, rel=1e-3)
    exact = partial_slip(CONTACT, LOAD, force, FRICTION)
    assert state.stick_radius == pytest.approx(float(exact.stick_radius), abs=SPRINGS.spacing)
    rho, transform = abel(SPRINGS.s)
    traction = PAIR.tangential_modulus * state.shear[0] @ transform
    # both rims are kinks of square-root kind: √(spacing/a) of the peak there, less elsewhere
    peak = FRICTION * float(CONTACT.peak_pressure)
    off = np.abs(traction - exact.traction(rho)) / peak
    assert off.max() < np.sqrt(SPRINGS.spacing / A)
    assert np.sqrt((off**2).mean()) < 0.01


def test_the_force_never_passes_friction_and_the_rest_is_slip() -> None:
    state = pulled(3 * sliding_begins(), pressed())
    assert SPRINGS.force(state)[0] == pytest.approx(FRICTION * LOAD, rel=1e-3)
    assert state.stick_radius == 0.0
    # beyond the beginning of sliding the contact moves on the cover as the sphere does
    assert state.position[0] == pytest.approx(2 * sliding_begins(), rel=1e-3)
    assert state.position[1] == 0.0


def test_slip_goes_where_the_pull_goes() -> None:
    state = pressed()
    for _ in range(100):
        state = SPRINGS.step(state, Command(LOAD, move=(-6e-6, 8e-6)))
    assert np.arctan2(state.slipped[1], state.slipped[0]) == pytest.approx(np.arctan2(4, -3))
    assert np.arctan2(*SPRINGS.force(state)[::-1]) == pytest.approx(np.arctan2(4, -3))


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_reversed_pull_is_mindlin_and_deresiewiczs(share: float) -> None:
    # Johnson, Contact Mechanics, 7.3: going back from Q* the contact behaves like a new one of
    # twice the size, δ* - δ = 2 δ₁((Q* - Q)/2).
    turn = share * sliding_begins()
    there = pulled(turn, pressed())
    back = pulled(-turn, there)
    highest, force = float(SPRINGS.force(there)[0]), float(SPRINGS.force(back)[0])
    compliance = shear_compliance(PAIR.youngs_modulus)
    half = float(
        tangential_displacement(CONTACT, LOAD, (highest - force) / 2, FRICTION, compliance)
    )
    # the forces carry the springs' discretisation, one part in 257² each
    assert 2 * half == pytest.approx(turn, rel=2e-3)
    assert force < 0


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9, 0.98])
def test_a_twist_is_lubkins(share: float) -> None:
    torque = share * float(sliding_torque(LOAD, A, FRICTION))
    exact = torsion_slip(LOAD, A, torque, FRICTION)
    state, steps = pressed(), 40
    for _ in range(steps):
        turn = exact.twist(PAIR.shear_modulus) / steps
        state = SPRINGS.step(state, Command(LOAD, turn=turn))
    # see the pull
    assert SPRINGS.torque(state) == pytest.approx(torque, rel=1e-3)
    assert state.stick_radius == pytest.approx(exact.stick_radius, abs=SPRINGS.spacing)
    rho, transform = abel(SPRINGS.s)
    traction = 4 * PAIR.shear_modulus * rho * (state.twist @ transform)
    off = np.abs(traction - exact.traction(rho)) / exact.peak_traction
    assert off.max() < np.sqrt(SPRINGS.spacing / A)
    assert np.sqrt((off**2).mean()) < 0.01


def test_a_twist_has_the_sense_of_its_torque() -> None:
    state = SPRINGS.step(pressed(), Command(LOAD, turn=-0.01))
    assert SPRINGS.torque(state) < 0


def test_a_growing_grip_sticks_and_keeps_the_force() -> None:
    springs = Springs(PAIR, reach=1.4 * A)
    state = pressed(springs=springs)
    for _ in range(60):
        state = springs.step(state, Command(LOAD, move=(2 * sliding_begins() / 60, 0.0)))
    force = springs.force(state)[0]
    for load in np.linspace(LOAD, 1.5 * LOAD, 30)[1:]:
        state = springs.step(state, Command(float(load)))
        assert state.stick_radius == state.contact_radius
        assert state.slipped.tolist() == [0.0, 0.0]
    assert springs.force(state)[0] == pytest.approx(force, rel=1e-12)


def test_a_hand_that_gives_way_leaves_no_force() -> None:
    state = pulled(2 * sliding_begins(), pressed())
    where = state.position
    for _ in range(200):
        state = SPRINGS.step(state, Command(LOAD, give=0.1))
    assert abs(SPRINGS.force(state)[0]) < 1e-3 * FRICTION * LOAD
    assert state.position.tolist() == where.tolist()


def test_rolling_moves_the_contact_without_slip() -> None:
    state = pressed()
    for _ in range(50):
        state = SPRINGS.step(state, Command(LOAD, roll=(2e-5, 1e-5)))
    np.testing.assert_allclose(state.position, [1e-3, 0.5e-3], rtol=1e-12)
    assert state.stick_radius == state.contact_radius
    assert SPRINGS.force(state).tolist() == [0.0, 0.0]


def test_shear_and_torque_together_stay_within_friction() -> None:
    state = pressed()
    for _ in range(200):
        state = SPRINGS.step(state, Command(LOAD, move=(5e-6, 0.0), turn=2e-3))
    use = np.hypot(
        SPRINGS.force(state)[0] / (FRICTION * LOAD),
        SPRINGS.torque(state) / float(sliding_torque(LOAD, A, FRICTION)),
    )
    assert 0.8 < use < 1.1


@pytest.mark.parametrize(("move", "turn"), [(5e-6, 2e-3), (5e-6, 5e-4), (2e-6, 4e-3)])
def test_sliding_and_turning_at_once_is_coulombs_within_the_model(move: float, turn: float) -> None:
    state = pressed()
    for _ in range(400):
        state = SPRINGS.step(state, Command(LOAD, move=(move, 0.0), turn=turn))
    axis = (np.arange(400) + 0.5) / 200 * A - A
    x, y = axis, axis[:, None]
    pull = FRICTION * CONTACT.pressure(np.hypot(x, y)) * (A / 200) ** 2
    v_x, v_y = move - turn * y, turn * x
    speed = np.hypot(v_x, v_y)
    force = (pull * v_x / speed).sum() / (FRICTION * LOAD)
    limit = float(sliding_torque(LOAD, A, FRICTION))
    torque = (pull * (x * v_y - y * v_x) / speed).sum() / limit
    # the stated error of the mixture: a third of each limit
    assert SPRINGS.force(state)[0] / (FRICTION * LOAD) == pytest.approx(force, abs=1 / 3)
    assert SPRINGS.torque(state) / limit == pytest.approx(torque, abs=1 / 3)


def test_nothing_is_left_when_nothing_touches() -> None:
    state = SPRINGS.step(pulled(sliding_begins(), pressed()), Command(0.0))
    assert (state.contact_radius, state.stick_radius, state.load) == (0.0, 0.0, 0.0)
    assert not state.shear.any()


def test_abels_transform_of_hertzs_line_is_hertzs_pressure() -> None:
    s = np.linspace(0.0, 1.2 * A, 400)
    line = PAIR.normal_modulus * np.maximum(A**2 - s**2, 0) / PAIR.radius
    rho, transform = abel(s)
    off = np.abs(line @ transform - CONTACT.pressure(rho)) / float(CONTACT.peak_pressure)
    # the pressure has a vertical tangent at the rim, where √(spacing/a) is the best there is
    assert off.max() < np.sqrt((s[1] - s[0]) / A)
    # elsewhere the pieces are straight where the line is a parabola: less than their length
    assert off[rho < 0.9 * A].max() < 0.2 * (s[1] - s[0]) / A
