"""Silicon and electronics against Table 3.I, the circuit itself, and the noise that was put in."""

import numpy as np
import pytest

from cnnum.errors import ArrayError, PhysicsError
from cnnum.tactile.taxel import Bridge, Heat, Piezoresistor, Readout, von_mises

# ΔR/R of Table 3.I has three digits: half a unit of the last one.
TABLE = 5e-4


@pytest.mark.parametrize(
    ("force", "side", "expected"),
    [
        ((0.0, 0.0, 10e-3), "all", -0.114),
        ((10e-3, 0.0, 0.0), "left", 0.162),
        ((10e-3 / np.sqrt(2.0), 10e-3 / np.sqrt(2.0), 0.0), "left", 0.114),
    ],
)
def test_bridges_change_as_in_table_3_i(
    force: tuple[float, float, float], side: str, expected: float
) -> None:
    change = Bridge().resistance_change(force)
    bridges = change if side == "all" else change[:1]
    np.testing.assert_allclose(bridges, expected, atol=TABLE)


def test_stresses_of_table_3_i_give_its_resistance_changes() -> None:
    silicon = Piezoresistor()
    change = silicon.resistance_change([-203.5e6, 290e6, 205e6], [-38.2e6, 55.6e6, 39.3e6])
    np.testing.assert_allclose(change, [-0.114, 0.162, 0.114], atol=TABLE)
    # π11 and π12 together are 4 % of π44: that much, and not more, the simple form leaves out.
    exact = silicon.resistance_change([290e6], [55.6e6], exact=True)
    assert 0.0 < abs(exact[0] / change[1] - 1.0) < 0.07
    assert silicon.longitudinal + silicon.transversal == pytest.approx(5.5e-11)  # π11 + π12


def test_sensitivity_is_the_published_2_9_mv_per_mn_per_volt() -> None:
    volts = Bridge().voltages([0.0, 0.0, 1e-3])
    # "2.9" of the text: half a unit of its last digit.
    np.testing.assert_allclose(-volts * 1e3 / 5.0, 2.9, atol=0.05)


def test_half_bridge_agrees_with_its_two_resistors() -> None:
    bridge = Bridge(linear=False, transversal=1e9)
    force = np.array([1e-3, -2e-3, 3e-3])
    resistor = 1e3 * (1.0 + bridge.resistance_change(force))
    divider = 5.0 * resistor / (resistor + 1e3) - 2.5
    np.testing.assert_allclose(bridge.voltages(force), divider, rtol=1e-12)  # rounding only
    small = 1e-4 * force  # ΔR/R of 1e-5: the linear law is as near as that
    linear = Bridge(transversal=1e9)
    np.testing.assert_allclose(linear.voltages(small), bridge.voltages(small), rtol=2e-5)


@pytest.mark.parametrize("bridge", [Bridge(), Bridge(transversal=2e9), Bridge(linear=False)])
def test_force_is_read_back_from_the_voltages(bridge: Bridge) -> None:
    force = np.random.default_rng(1).uniform(-3e-3, 3e-3, (50, 2, 3, 3))
    np.testing.assert_allclose(bridge.force(bridge.voltages(force)), force, atol=1e-15)


def test_force_follows_3_11_with_the_half_bridge_factor() -> None:
    bridge = Bridge()
    left, right, top, bottom = volts = np.array([1e-3, -2e-3, 0.5e-3, 3e-3])
    scale = 4.0 / (5.0 * 138.1e-11)
    expected = [
        scale / bridge.shear * (right - left),
        scale / bridge.shear * (top - bottom),
        scale / bridge.normal * (left + right + top + bottom) / 2.0,
    ]
    np.testing.assert_allclose(bridge.force(volts), expected, rtol=1e-12)


def test_shear_shortens_the_bridge_in_front() -> None:
    left, right, top, bottom = Bridge().voltages([1e-3, 0.0, 0.0])
    assert right < 0.0 < left
    assert top == bottom == 0.0
    assert Bridge().voltages([0.0, 1e-3, 0.0])[2] < 0.0


def test_von_mises_of_known_states() -> None:
    states = [[7.0, 0.0, 0.0], [5.0, 5.0, 5.0], [3.0, -3.0, 0.0]]
    np.testing.assert_allclose(von_mises(states), [7.0, 0.0, 3.0 * np.sqrt(3.0)], atol=1e-12)


def test_overload_is_flagged_beyond_the_yield_stress() -> None:
    bridge = Bridge()
    both = [10e-3 / np.sqrt(2.0), 10e-3 / np.sqrt(2.0), 0.0]
    assert bridge.von_mises_bound(both) >= 269.9e6  # the bound of Table 3.I
    silicon = Bridge(largest_force=float("inf"))
    forces = [[0.0, 0.0, 12e-3], [0.0, 0.0, 13e-3], [8e-3, 0.0, 0.0], [9e-3, 0.0, 0.0]]
    assert silicon.overloaded(forces).tolist() == [False, True, False, True]


def test_overload_is_flagged_beyond_the_force_that_broke_sensors() -> None:
    forces = [[0.0, 0.0, 3e-3], [3e-3, 0.0, 3.9e-3], [3e-3, 0.0, 4.1e-3], [0.0, -6e-3, 0.0]]
    assert Bridge().overloaded(forces).tolist() == [False, False, True, True]


def test_converter_rounds_to_half_a_step_and_flags_its_ends() -> None:
    readout = Readout(gain=1.0, noise=0.0, limit=1.0, bits=8)
    volts = np.linspace(-1.2, 1.2, 4 * 500).reshape(500, 1, 4)
    read, saturated = readout.read(volts)
    free = ~saturated
    assert np.abs(read[free] - volts[free]).max() <= readout.step / 2 + 1e-15
    assert saturated[np.abs(volts) >= 1.0].all()
    assert not saturated[np.abs(volts) < 1.0 - 2.0 * readout.step].any()
    assert np.unique(read).size == 256
    plain, cut = Readout(gain=1.0, limit=1.0, bits=None).read(volts)
    np.testing.assert_array_equal(cut, np.abs(volts) >= 1.0)
    np.testing.assert_array_equal(plain, np.clip(volts, -1.0, 1.0))


def test_noise_is_white_and_as_large_as_said() -> None:
    readout = Readout(bits=None)
    read, _ = readout.read(np.zeros((5000, 2, 2, 4)), rng=np.random.default_rng(3))
    # 80 000 draws: their deviation is known to 0.25 %; four of those.
    assert read.std() == pytest.approx(2.5e-3, rel=0.01)
    neighbours = np.mean(read[1:] * read[:-1]) / read.var()
    assert abs(neighbours) < 4.0 / np.sqrt(80000)
    again, _ = readout.read(np.zeros((5000, 2, 2, 4)), rng=np.random.default_rng(3))
    np.testing.assert_array_equal(read, again)


def test_offsets_and_heat_add_up() -> None:
    offsets = np.arange(8.0).reshape(1, 2, 4) * 1e-2
    readout = Readout(bits=None, offsets=offsets, heat=Heat(10e-3, 100.0))
    read, _ = readout.read(np.zeros((3, 1, 2, 4)), time=[0.0, 100.0, np.inf])
    expected = offsets + 10e-3 * np.exp([0.0, -1.0, -np.inf])[:, None, None, None]
    np.testing.assert_allclose(read, expected, rtol=1e-14)


@pytest.mark.parametrize(
    ("build", "error"),
    [
        (lambda: Bridge(normal=0.0), PhysicsError),
        (lambda: Bridge(supply=-5.0), PhysicsError),
        (lambda: Readout(gain=0.0), PhysicsError),
        (lambda: Readout(bits=0), PhysicsError),
        (lambda: Readout(offsets=np.zeros(3)), ArrayError),
        (lambda: Heat(1.0, 0.0), PhysicsError),
        (lambda: Bridge().voltages([1.0, 2.0]), ArrayError),
        (lambda: Bridge().voltages([1.0, 2.0, np.nan]), ArrayError),
        (lambda: Readout(heat=Heat(1.0)).read(np.zeros((1, 1, 4)), time=-1.0), PhysicsError),
    ],
)
def test_what_cannot_be_is_refused(build: object, error: type[Exception]) -> None:
    with pytest.raises(error):
        build()  # type: ignore[operator]


def test_a_shear_across_changes_bridges_as_in_3_8() -> None:
    """+F_y α_ts on the left, −F_y α_ts on the right, −F_x α_ts on top, +F_x α_ts at the bottom."""
    bridge = Bridge(transversal=1e9)
    half = 0.5 * bridge.piezoresistor.pi_44
    s, t = bridge.shear, bridge.transversal
    np.testing.assert_allclose(bridge.resistance_change([1, 0, 0]), half * np.array([-s, s, -t, t]))
    np.testing.assert_allclose(bridge.resistance_change([0, 1, 0]), half * np.array([t, -t, s, -s]))
