"""The simulated array's cover as a layer on a rigid base, and covers that creep."""

import numpy as np
import pytest
from scipy.integrate import quad

from cnnum.arrays import Floats
from cnnum.drivers import open_driver
from cnnum.drivers.simulated.array import SimulatedArray, SimulatedOptions
from cnnum.drivers.simulated.cover import Layout, flat_influence, layer_influence
from cnnum.drivers.simulated.settings import Phase
from cnnum.errors import SceneError
from cnnum.tactile.contact import hertz
from cnnum.tactile.cover import LayerCover, StandardLinearSolid
from cnnum.tactile.grid import make_grid
from cnnum.tactile.halfspace import rectangle_strain

LAYOUT = Layout((3, 4), 1.5e-3)
E = 0.87e6
RATE = 100.0
TOUCH = (Phase("press", 1 / RATE, load=0.5), Phase("hold", 1.0))
RISE = (Phase("press", 0.3, load=0.5), Phase("pull", 0.2, speed=1e-3))


def clean(**changes: object) -> SimulatedArray:
    """Return a small array without noise, offsets and rounding."""
    quiet = {"noise": 0.0, "offset": 0.0, "bits": 0, "shape": (4, 4), "rate": RATE}
    return SimulatedArray(SimulatedOptions(**{**quiet, **changes}))  # type: ignore[arg-type]


def volts(array: SimulatedArray) -> Floats:
    return np.array([frame.values for frame in array.frames()])


def strain(array: SimulatedArray) -> Floats:
    return array.calibration.to_strain(volts(array))


@pytest.mark.parametrize(("thickness", "share"), [(1e-3, 5e-6), (0.5e-3, 2e-5), (0.2e-3, 4e-4)])
def test_a_cell_is_the_layers_point_loads_spread_over_it(thickness: float, share: float) -> None:
    """`share` is the error that `layer.POINTS` promises, of the largest strain of each kind."""
    height = 50e-6
    got = layer_influence(LAYOUT, thickness, E, height)
    layer = LayerCover(thickness, E, taxel_depth=thickness - height)
    taxels, surface = LAYOUT.taxels, LAYOUT.surface
    # 24 points a side see cells of 0.3 mm at a depth of 0.15 mm to (0.5 + 1.1)^-48 < 1e-9
    x, w = np.polynomial.legendre.leggauss(24)
    nodes: Floats = np.asarray(x * surface.dx / 2, dtype=np.float64)
    weights = np.multiply.outer(w, w) / 4 * surface.cell_area
    peak = np.abs(got).max(axis=(0, 1, 2, 3))
    for row, col, i, j in ((1, 1, 12, 12), (1, 2, 10, 18), (0, 3, 15, 21), (2, 0, 3, 9)):
        across, down = nodes + float(surface.x[j]), nodes + float(surface.y[i])
        load = np.stack(np.meshgrid(across, down), axis=-1)
        taxel = [taxels.x[col], taxels.y[row]]
        points = layer.strain(load[:, :, None], taxel, np.eye(3))
        wanted = np.einsum("yx,yxlc->lc", weights, points)
        assert (np.abs(got[row, col, i, j] - wanted) < share * peak).all()


def test_a_thick_layer_is_the_half_space() -> None:
    depth = 1e-3
    flat = flat_influence(LAYOUT, depth, E)
    off = [
        np.abs(layer_influence(LAYOUT, h, E, h - depth) - flat)[..., 2, :].max()
        / np.abs(flat).max()
        for h in (16e-3, 32e-3, 64e-3)
    ]
    # the base answers like loads 2h away, whose strain falls with the square of the distance:
    # a quarter a doubling, in the end
    assert 3.4 < off[0] / off[1] < 4.2
    assert 3.6 < off[1] / off[2] < 4.2
    # a load 2h away strains (z / 2h)² as much as one at z; the base mirrors a load as a few
    for h, left in zip((16e-3, 32e-3, 64e-3), off, strict=True):
        assert left < 3 * (depth / (2 * h)) ** 2


def test_the_calibration_of_a_thick_layer_is_the_half_spaces() -> None:
    thick = clean(cover="layer", thickness=60e-3, taxel_height=59e-3, script=RISE)
    flat = clean(cover="flat", thickness=1e-3, script=RISE)
    # 60 mm less 59 mm is 1 mm to rounding, 1e-15 of 60
    assert thick.calibration.alpha_normal == pytest.approx(flat.calibration.alpha_normal, rel=1e-9)
    assert thick.calibration.beta_ns == pytest.approx(flat.calibration.beta_ns, rel=1e-9)
    assert thick.calibration.depth == pytest.approx(1e-3, rel=1e-9)
    one, other = volts(thick), volts(flat)
    # the base answers with 3 (z / 2h)² = 0.02 % of a point load's peak at most; a contact twice as
    # wide as the taxels are deep has a fifth of that
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-3 * np.abs(other).max())


def test_the_voltages_of_a_layer_are_read_back_as_its_strain() -> None:
    array = clean(cover="layer", thickness=0.7e-3, script=RISE)
    states = [state for state, _ in array.scans()]
    # exact but for rounding, and for the sums of chunks and of all at once
    np.testing.assert_allclose(strain(array), array.strain(states), rtol=0, atol=1e-12)


def test_at_one_depth_a_layer_strains_less_the_thinner_it_is() -> None:
    depth = 0.5e-3
    covers = [clean(thickness=depth, script=RISE)]
    for thickness in (1e-3, 0.7e-3, 0.55e-3, 0.52e-3, 0.51e-3):
        height = thickness - depth
        layer = clean(cover="layer", thickness=thickness, taxel_height=height, script=RISE)
        covers.append(layer)
    state = list(covers[0].scans())[-1][0]
    total = [float(np.abs(cover.strain([state])[..., 2]).sum()) for cover in covers]
    # the base forbids normal strain, and the nearer it is the more (far ones change the shape)
    assert total == sorted(total, reverse=True)
    # ν = 0.5: ε_zz = -div u along the base, which grows with the height; at 10 and 20 µm in
    # proportion but for the height's share of the thickness, 2 to 4 %
    assert total[-2] / total[-1] == pytest.approx(2.0, rel=0.04)


def ramped(solid: StandardLinearSolid, since: float) -> float:
    """Return the growth of strain `since` a load came up in one scan: the mean of steps."""

    def growth(ago: float) -> float:
        return E * float(solid.creep(since + ago))

    return float(quad(growth, 0, 1 / RATE, epsabs=1e-13)[0]) * RATE


@pytest.mark.parametrize("cover", ["flat", "layer"])
@pytest.mark.parametrize(("creep", "time"), [(0.4, 0.25), (0.1, 0.003)])
def test_a_held_load_creeps_as_the_solid_does(cover: str, creep: float, time: float) -> None:
    array = clean(cover=cover, creep=creep, creep_time=time, script=TOUCH)
    solid = StandardLinearSolid(E, (1 - creep) * E, time)
    curve = [ramped(solid, n / RATE) for n in range(101)]
    held = clean(cover=cover, script=TOUCH)
    elastic = held.strain([list(held.scans())[-1][0]])[0]
    wanted = np.array(curve)[:, None, None, None] * elastic
    # both are exact, but for the rounding of volts and sums, and the quadrature's 1e-12
    np.testing.assert_allclose(strain(array), wanted, atol=1e-10 * np.abs(elastic).max())
    assert curve[-1] > 1 + 0.9 * creep / (1 - creep)


def test_creep_is_off_unless_asked_for() -> None:
    plain, off = clean(script=RISE), clean(script=RISE, creep=0.0, creep_time=0.01)
    on = clean(script=RISE, creep=0.01)
    assert volts(plain).tobytes() == volts(off).tobytes()
    assert volts(plain).tobytes() != volts(on).tobytes()
    # the elastic strain goes to the bridges as it is
    first = [state for state, _ in plain.scans()][:32]
    assert plain.read(plain.strain(first)).volts.tobytes() == volts(plain)[:32].tobytes()


def test_a_second_call_begins_at_rest_with_the_same_bits() -> None:
    array = clean(script=RISE, creep=0.4, noise=2e-3, seed=3)
    source = array.frames()
    for _ in range(40):
        next(source)
    assert volts(array).tobytes() == volts(array).tobytes()
    again = clean(script=RISE, creep=0.4, noise=2e-3, seed=3)
    assert volts(array).tobytes() == volts(again).tobytes()


@pytest.mark.parametrize("chunk", [1, 7, 1000])
def test_creep_goes_on_from_chunk_to_chunk(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    array = clean(script=RISE, creep=0.4, noise=2e-3, seed=3)
    usual = volts(array)
    monkeypatch.setattr("cnnum.drivers.simulated.array.CHUNK", chunk)
    # noise is drawn in the same order; the sums over other windows round otherwise
    np.testing.assert_allclose(volts(array), usual, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"creep": 1.0}, "'creep' must be a share, 0 or more and below 1, got 1.0"),
        ({"creep": -0.1}, "'creep' must be"),
        ({"creep": float("nan")}, "'creep' must be"),
        ({"creep_time": 0}, "'creep_time' must be seconds above 0"),
        ({"cover": "layer", "taxel_height": 1e-3}, "'taxel_height' must be above 0, below the"),
        ({"cover": "layer", "taxel_height": 0.0}, "'taxel_height' must be"),
        ({"cover": "layer", "thickness": 0.07e-3}, "'thickness' must be at least 0.05 pitches"),
    ],
)
def test_what_cannot_be_simulated_is_named(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(SceneError, match=f"Driver 'simulated': .*{sentence}"):
        open_driver("simulated", options)


@pytest.mark.parametrize(("thickness", "share"), [(0.7e-3, 0.007), (2e-3, 0.004)])
def test_a_flat_cover_is_strained_as_by_a_smooth_traction(thickness: float, share: float) -> None:
    """Against Hertz's pressure, and friction all around, on cells of a thirtieth of a pitch.

    The array's own cells, six times as wide, leave 0.6 % under 0.7 mm, and 0.3 % under 2 mm. If
    their means were spread evenly they would leave 2.3 and 1.2 %.
    """
    load = 0.16
    script = (Phase("press", 0.05, load=load), Phase("twist", 0.05, angle=3.0))
    array = clean(thickness=thickness, radius=20e-3, script=script, start=(0.1e-3, 0.3e-3))
    *_, state = (state for state, _ in array.scans())
    assert state.stick_radius == 0.0
    got = array.strain([state])[0]

    taxels, fine = Layout((4, 4), 1.5e-3).taxels, make_grid((56, 56), 0.05e-3)
    x, y = np.meshgrid(fine.x, fine.y)
    away = np.maximum(np.hypot(x, y), 1e-12)
    pressure = hertz(load, 20e-3, E / 0.75).pressure(away)
    swirl = pressure * SimulatedOptions().friction / away
    traction = np.stack([-swirl * y, swirl * x, pressure], axis=-1)
    places = np.stack(np.meshgrid(taxels.x, taxels.y), axis=-1) - state.position
    wanted = np.zeros((4, 4, 3))
    for row, col in np.ndindex(4, 4):
        here = places[row, col, 0] - x, places[row, col, 1] - y, thickness
        cell = rectangle_strain(*here, traction, size=(fine.dx, fine.dy), youngs_modulus=E)
        wanted[row, col] = cell[..., 2].sum(axis=(0, 1))
    off = np.abs(got - wanted).max(axis=(0, 1)) / np.abs(wanted).max(axis=(0, 1))
    assert (off < share).all()
