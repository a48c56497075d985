"""The simulated array: equilibrium, closed forms under the cover, noise, and its truth."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import dblquad

from cnnum.drivers import open_driver
from cnnum.drivers.serial_array import SerialOptions
from cnnum.drivers.simulated.array import SimulatedArray, SimulatedOptions
from cnnum.drivers.simulated.cover import FARTHEST, Layout, flat_influence
from cnnum.drivers.simulated.settings import DEFAULT, Phase
from cnnum.drivers.simulated.springs import State, Tractions
from cnnum.errors import PhysicsError, SceneError
from cnnum.frame import Frame, Quality
from cnnum.tactile.grid import make_grid
from cnnum.tactile.taxel import SIDES

PRESS = (Phase("press", 0.05, load=1.0),)
SLIDE = (*PRESS, Phase("pull", 0.5, speed=1e-3, direction=0.3))
SPIN = (*PRESS, Phase("twist", 0.5, angle=-0.3))


def clean(**changes: object) -> SimulatedArray:
    """Return an array without noise, offsets and rounding."""
    quiet = {"noise": 0.0, "offset": 0.0, "bits": 0, "script": PRESS, "start": (0.0, 0.0)}
    return SimulatedArray(SimulatedOptions(**{**quiet, **changes}))  # type: ignore[arg-type]


def last(array: SimulatedArray) -> Frame:
    return list(array.frames())[-1]


def end(array: SimulatedArray) -> State:
    return list(array.scans())[-1][0]


@pytest.fixture(scope="module")
def scene() -> list[Frame]:
    return list(open_driver("simulated").frames())


@pytest.mark.parametrize("script", [SLIDE, SPIN])
@pytest.mark.parametrize("start", [(0.0, 0.0), (0.37e-3, -0.11e-3)])
def test_the_tractions_balance_the_loads(
    script: tuple[Phase, ...], start: tuple[float, float]
) -> None:
    array = clean(script=script, start=start)
    state = end(array)
    layout = Layout((8, 8), 1.5e-3)
    grid = layout.surface
    tractions = Tractions(array._springs, grid)
    window = tractions.window([state])
    (cells,) = tractions([state], window) * grid.cell_area
    force = array._springs.force(state)
    x = grid.x[window.cols] - state.position[0]
    y = grid.y[window.rows][:, None] - state.position[1]
    torque = (x * cells[..., 1] - y * cells[..., 0]).sum()
    # points 0.1 mm apart see a contact of 2.5 mm radius, whose traction ends like a square root:
    # (0.1/2.5)^1.5 = 0.8 %
    scale = array._springs.pair.friction * state.load
    assert cells[..., 2].sum() == pytest.approx(state.load, rel=1e-12)
    np.testing.assert_allclose(cells[..., :2].sum(axis=(0, 1)), force, atol=0.008 * scale)
    expected = array._springs.torque(state)
    assert torque == pytest.approx(expected, abs=0.008 * scale * state.contact_radius)


def test_below_the_middle_the_strain_is_hertzs() -> None:
    # Johnson, Contact Mechanics, 3.45, ν = 0.5: ε_zz = (σ_z - σ_r)/E on the axis
    array = clean(shape=(7, 7))
    state = end(array)
    ratio = 1.0e-3 / state.contact_radius
    peak = 1.5 * state.load / (np.pi * state.contact_radius**2)
    sigma_z = -1 / (1 + ratio**2)
    sigma_r = -1.5 * (1 - ratio * np.arctan(1 / ratio)) + 0.5 / (1 + ratio**2)
    expected = peak * (sigma_z - sigma_r) / 0.87e6
    strain = array.strain([state])[0]
    # a traction uniform on cells of h = 0.3 mm is one smoothed over h: at the depth z = 1 mm,
    # where the strain varies over z, that costs h²/(24 z²) = 0.4 %
    assert strain[3, 3, 2] == pytest.approx(expected, rel=4e-3)
    np.testing.assert_allclose(strain[3, 3, :2], 0.0, atol=1e-12)


def test_the_voltages_are_read_back_as_that_strain() -> None:
    array = clean(script=SLIDE)
    strain = array.calibration.to_strain(last(array).values)
    # exact but for rounding: the bridges are linear and nothing is added
    np.testing.assert_allclose(strain, array.strain([end(array)])[0], rtol=0, atol=1e-12)


def test_the_frame_holds_the_shear_force() -> None:
    # σ_xz = (2E/3) ε_xz, and over the whole plane it adds up to -Q. A window of ±12 mm lacks the
    # tail of the point load's 3 Q x² z / (2π r⁵). The quadrature knows it.
    array = clean(shape=(16, 16), script=(*PRESS, Phase("pull", 1.0, speed=0.4e-3)))
    state = end(array)
    stress = 2 / 3 * 0.87e6 * array.calibration.to_strain(last(array).values)[..., 0]
    z, half = 1.0e-3, 12e-3
    where = state.position[0]

    def kernel(y: float, x: float) -> float:
        return 3 * x * x * z / (2 * np.pi * (x * x + y * y + z * z) ** 2.5)

    seen = 4 * dblquad(kernel, 0, half, 0, half, epsabs=1e-6)[0]
    force = array._springs.force(state)[0]
    # taxels 1.5 mm apart below 1 mm of cover leave e^(-2π z/pitch) = 1.5 % of waves shorter
    # than two of them; the contact's width changes the tail by (2.5/12)² of its 12 %
    assert -stress.sum() * 1.5e-3**2 == pytest.approx(seen * force, rel=0.02)
    assert abs(where) < 0.3e-3


def test_turning_the_pull_turns_the_frame() -> None:
    along_x = clean(script=(*PRESS, Phase("pull", 0.3, speed=1e-3)))
    along_y = clean(script=(*PRESS, Phase("pull", 0.3, speed=1e-3, direction=np.pi / 2)))
    one, other = (array.strain([end(array)])[0] for array in (along_x, along_y))
    turned = one.swapaxes(0, 1)[..., [1, 0, 2]]
    # mirror symmetry holds to rounding; a strain is about 0.1
    np.testing.assert_allclose(turned, other, atol=1e-9)


def test_a_twist_turns_the_shear_around_the_contact() -> None:
    array = clean(shape=(7, 7), script=(*PRESS, Phase("twist", 0.5, angle=0.3)))
    shear = -array.strain([end(array)])[0][..., :2]
    grid = make_grid((7, 7), 1.5e-3)
    turning = grid.x * shear[..., 1] - grid.y[:, None] * shear[..., 0]
    near = np.hypot(grid.x, grid.y[:, None]) < 3e-3
    near[3, 3] = False
    # positive turns x towards y (rows downwards)
    assert (turning[near] > 0).all()
    np.testing.assert_allclose(shear[3, 3], 0.0, atol=1e-9)


def test_the_noise_is_table_3_iis() -> None:
    script = (Phase("press", 0.05, load=0.5), Phase("hold", 1.0))
    noisy = clean(noise=2.5e-3, script=script, seed=7)
    quiet = clean(script=script, seed=7)
    pairs = zip(noisy.frames(), quiet.frames(), strict=True)
    noise = np.array([a.values - b.values for a, b in pairs])
    count = noise.size
    # 53,760 values: the spread of a spread is 1/√(2n) = 0.3 %, of a mean 1/√n; five of each
    assert noise.std() == pytest.approx(2.5e-3, rel=5 / np.sqrt(2 * count))
    assert abs(noise.mean()) < 5 * 2.5e-3 / np.sqrt(count)
    together = np.corrcoef(noise[:-1].ravel(), noise[1:].ravel())[0, 1]
    assert abs(together) < 5 / np.sqrt(count)


def test_the_converter_rounds_and_saturates() -> None:
    array = clean(bits=12)
    values = last(array).values
    steps = values / (5.0 / 4096)
    np.testing.assert_array_equal(steps, np.rint(steps))
    loud = clean(bits=12, gain=1000.0)
    assert last(loud).quality == Quality.SATURATED
    assert np.abs(last(loud).values).max() <= 2.5


def test_a_seed_gives_the_same_bits_and_another_does_not() -> None:
    runs = [
        np.array([f.values for f in open_driver("simulated", options).frames()]).tobytes()
        for options in ({"seed": 3, "script": [{"kind": "press", "duration": 0.3, "load": 1}]},) * 2
    ]
    assert runs[0] == runs[1]
    array = clean(seed=3, noise=2e-3)
    twice = [np.array([f.values for f in array.frames()]).tobytes() for _ in range(2)]
    assert twice[0] == twice[1]
    other = clean(seed=4, noise=2e-3)
    assert np.array([f.values for f in other.frames()]).tobytes() != twice[0]


def flagged(scene: list[Frame], name: str) -> list[tuple[int, int]]:
    on = np.array([0, *(int(f.truth[name]) if f.truth else 0 for f in scene), 0])
    edges = np.flatnonzero(np.diff(on)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def test_the_default_scene_goes_in_order(scene: list[Frame]) -> None:
    (touch,), (near,), (slip,) = (flagged(scene, n) for n in ("contact", "incipient", "slip"))
    (twist,) = flagged(scene, "twist_slip")
    assert touch[0] < near[0] < near[1] == slip[0] < slip[1] < twist[0] < twist[1] < touch[1]
    assert len(scene) == 2000
    assert scene[0].values.shape == (8, 8, 4)
    assert (scene[0].channels, scene[0].unit) == (SIDES, "V")
    assert [f.sequence for f in scene] == list(range(2000))
    np.testing.assert_allclose([f.time for f in scene], np.arange(2000) / 200, rtol=1e-12)
    assert {f.quality for f in scene} == {Quality.GOOD}


def test_the_default_scenes_truth_is_consistent(scene: list[Frame]) -> None:
    truths = [f.truth for f in scene if f.truth]
    assert len(truths) == len(scene)
    friction = 0.6
    for t in truths:
        assert 0 <= t["stick_radius"] <= t["contact_radius"]
        # the springs' force is off by one part in 257² at most
        assert np.hypot(t["shear_x"], t["shear_y"]) <= friction * t["normal_force"] * 1.001
        assert bool(t["contact"]) == (t["normal_force"] > 0)
        if t["slip"]:
            assert t["slip_direction"] == pytest.approx(0.5, abs=1e-9)
            assert t["stick_radius"] == 0
        if t["incipient"]:
            assert 0 < t["stick_radius"] < t["contact_radius"] / 2
    way = np.diff([[t["x"], t["y"]] for t in truths], axis=0)
    slips = np.array([t["slip"] for t in truths[1:]], dtype=bool)
    # 0.8 mm/s at 200 Hz, but for the scan in which sliding begins
    np.testing.assert_allclose(np.hypot(*way[slips][1:].T), 4e-6, rtol=1e-9)
    assert np.hypot(*way[~slips].T).max() < 4e-6
    assert max(t["twist"] for t in truths) == pytest.approx(0.6, rel=1e-9)


def test_incipient_slip_begins_where_cattaneo_and_mindlin_say(scene: list[Frame]) -> None:
    (first, _), *_ = flagged(scene, "incipient")
    truth = scene[first].truth
    assert truth is not None
    # c < a/2 is Q > 7/8 μP; a scan more is 4 of the 236 µm to sliding, 1.7 % of the way
    share = np.hypot(truth["shear_x"], truth["shear_y"]) / (0.6 * truth["normal_force"])
    assert 7 / 8 - 0.01 < share < 7 / 8 + 0.02


def test_a_bumpy_cover_reads_more_below_its_bumps() -> None:
    flat, bumpy = (clean(cover=cover) for cover in ("flat", "bumpy"))
    one, other = (-a.strain([end(a)])[0][..., 2] for a in (flat, bumpy))
    # the load comes down on the feet, straight above the taxels
    assert other[3:5, 3:5].min() > one[3:5, 3:5].max()


def test_an_influence_is_the_half_spaces() -> None:
    layout = Layout((3, 4), 1.5e-3)
    flat = flat_influence(layout, 0.8e-3, 1e6)
    surface, taxels = layout.surface, layout.taxels
    # by equilibrium and Hooke: far away a cell is a point load, -3/(4πE) (2 z² - ρ²) z/r⁵ …
    row, col, i, j = 1, 2, 3, 24
    x, y, z = taxels.x[col] - surface.x[j], taxels.y[row] - surface.y[i], 0.8e-3
    r = np.sqrt(x * x + y * y + z * z)
    # ν = 0.5: ε_xz = 3 σ_xz / (2E), σ_xz = -3 x z · z / (2π r⁵)
    expected = 1.5 / 1e6 * -3 * x * z * z / (2 * np.pi * r**5) * surface.cell_area
    # a cell of 0.3 mm at r: its second moment, (0.3/r)²/24 times the kernel's curvature of ~ 30
    assert flat[row, col, i, j, 2, 0] == pytest.approx(expected, rel=0.05)


def test_the_simulation_goes_over_a_real_terminal(device: Any, link: Path) -> None:
    sent = list(clean(script=SLIDE, noise=2e-3).frames())
    device.serve(sent, 400.0)
    with SerialOptions(str(link), timeout=10.0, reconnects=0).open() as array:
        source = array.frames()
        got = [next(source) for _ in sent]
        assert (array.shape, array.channels, array.unit) == ((8, 8), SIDES, "V")
        assert array.counters.dropped == 0
    for one, other in zip(got, sent, strict=True):
        np.testing.assert_array_equal(one.values, other.values.astype(np.float32))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"shape": [0, 8]}, "'shape' must be"),
        ({"rate": 0}, "'rate' must be at least 0.001"),
        ({"friction": -1.0}, r"'friction' must be at least 1e-06 and below 1e\+06"),
        ({"bump_radius": 1e-3}, "'bump_radius' must be"),
        ({"bits": 40}, "'bits' must be"),
        ({"cover": "hilly"}, "'cover' must be one of 'flat', 'bumpy'"),
        ({"script": []}, "'script' must be phases with a press"),
        ({"script": [{"kind": "press", "duration": 1}]}, "'load' must be given for a 'press'"),
        ({"script": [{"kind": "hold", "duration": 1, "load": 1}]}, "'load' must be left out"),
        ({"script": [{"kind": "press", "duration": 0, "load": 1}]}, "'duration' must be"),
        ({"script": [{"kind": "fling", "duration": 1}]}, "'kind' must be one of"),
        ({"noise": float("nan")}, "'noise' must be"),
    ],
)
def test_what_cannot_be_simulated_is_named(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(SceneError, match=f"Driver 'simulated': .*{sentence}"):
        open_driver("simulated", options)


def test_a_contact_too_wide_or_gone_is_named() -> None:
    with pytest.raises(PhysicsError, match=r"radius reaches 12\.\d+ mm"):
        clean(script=(Phase("press", 0.1, load=120.0),))
    away = clean(script=(*PRESS, Phase("roll", 10.0, speed=2e-3)))
    with pytest.raises(PhysicsError, match="left the array"):
        list(away.frames())


def test_vibration_swings_the_load_and_nothing_slips() -> None:
    shake = Phase("vibrate", 0.5, frequency=20.0, amplitude=0.1)
    truths = [truth for _, truth in clean(script=(*PRESS, shake)).scans()][10:]
    loads = np.array([t["normal_force"] for t in truths])
    time = np.arange(1, 101) / 200
    # the last scan ends the swing
    np.testing.assert_allclose(
        loads[:-1], (1 + 0.1 * np.sin(2 * np.pi * 20 * time))[:-1], rtol=1e-9
    )
    assert not any(t["slip"] or t["incipient"] for t in truths)


def test_closing_ends_the_frames() -> None:
    array = clean(script=DEFAULT)
    source = array.frames()
    assert next(source).sequence == 0
    array.close()
    assert list(source) == []


def test_a_press_comes_down_at_a_constant_speed() -> None:
    truths = [truth for _, truth in clean(script=(Phase("press", 0.5, load=1.0),)).scans()]
    # approach a²/R grows linearly
    depth = np.array([t["contact_radius"] ** 2 / 25e-3 for t in truths])
    np.testing.assert_allclose(depth, depth[-1] * np.arange(1, 101) / 100, rtol=1e-9)
    assert all(a < b for a, b in pairwise(depth))


def test_turns_are_counted_from_each_touch() -> None:
    again = (*SPIN, Phase("release", 0.05), *PRESS)
    truths = [truth for _, truth in clean(script=again).scans()]
    assert min(t["twist"] for t in truths) < -0.25
    assert truths[-1]["twist"] == 0.0


def test_a_contact_far_beyond_the_rim_is_refused() -> None:
    """Six pitches: what is farther away, taxels no longer feel."""
    edge = (4 + FARTHEST) * 1.5e-3
    radius = end(clean()).contact_radius
    inside = clean(start=(edge - 1.01 * radius, 0.0))
    assert len(list(inside.frames())) == inside.total_frames
    with pytest.raises(PhysicsError, match="left the array"):
        list(clean(start=(edge - 0.5 * radius, 0.0)).frames())


@pytest.mark.one_in(6)
@pytest.mark.parametrize("cover", ["flat", "bumpy", "layer"])
@pytest.mark.parametrize("body", ["sphere", "two bodies"])
def test_a_body_that_goes_over_the_rim_reads_as_within_a_larger_array(
    cover: str, body: str
) -> None:
    """The middle taxels of a larger array, whose own rim is not reached, read the same."""
    script = (*PRESS, Phase("pull", 0.4, speed=10e-3, direction=0.3))
    bumps = {"bump_radius": 0.2e-3, "thickness": 0.2e-3} if cover == "bumpy" else {}
    strain = []
    for side in (4, 10):
        array = clean(shape=(side, side), cover=cover, body=body, script=script, rate=40.0, **bumps)
        states = [state for state, _ in array.scans()]
        parts = [array.strain(states[n : n + 4]) for n in range(0, len(states), 4)]
        strain.append(np.concatenate(parts))
    inner = strain[1][:, 3:7, 3:7]
    assert np.abs(states[-1].position).max() > 2e-3  # the centre, where the array ends at 3 mm
    # cells are sharpened by their neighbours, of which the last of a surface have fewer
    np.testing.assert_allclose(strain[0], inner, atol=1e-6 * np.abs(inner).max())
