"""Tractions from a whole frame, against the loads that made it and the cover's own low-pass."""

import numpy as np
import pytest

from cnnum.arrays import Floats
from cnnum.errors import ArrayError, PhysicsError, UnknownNameError
from cnnum.tactile import halfspace
from cnnum.tactile.inverse import LoadMap, resolution_limit
from cnnum.tactile.inverse.load_map import pushing_only

E, Z, CELL, SIDE = 0.87e6, 200e-6, 200e-6, 8
LINE = (np.arange(SIDE) - (SIDE - 1) / 2) * CELL
TAXELS = np.stack(np.meshgrid(LINE, LINE), axis=-1).reshape(-1, 2)


def frame(traction: Floats) -> Floats:
    """Return the strain by the FFT cover, which shares no sum with the inverse's matrix."""
    cover = halfspace.SurfaceToDepth((SIDE, SIDE), CELL, Z, youngs_modulus=E)
    return cover(traction).reshape(*traction.shape[:-3], -1, 3)


def press() -> Floats:
    traction = np.zeros((SIDE, SIDE, 3))
    traction[3:5, 3:5] = [5e3, 0.0, 2e4]
    return traction


def inverse(noise: float, **options: object) -> LoadMap:
    return LoadMap(TAXELS, (SIDE, SIDE), CELL, Z, E, noise, **options)  # type: ignore[arg-type]


def test_exact_frames_give_the_load_back() -> None:
    found = inverse(1e-12)(frame(press()), regularisation=1e9)
    # The smallest singular value is 1e-3 of the largest: rounding grows to 1e-12 of the load.
    np.testing.assert_allclose(found.traction, press(), atol=1e-6 * 2e4)
    assert found.residual < 1e-2


def test_noise_error_is_the_spread_of_many_frames() -> None:
    rng = np.random.default_rng(1)
    noise, prior = 1e-4, 3e3
    rows = frame(press()) + noise * rng.normal(size=(3000, SIDE * SIDE, 3))
    solver = inverse(noise)
    spread = solver(rows, regularisation=prior).traction.std(axis=0)
    # 3000 draws know a deviation to 1.3 %; four of those, for the largest of 192.
    np.testing.assert_allclose(1.959964 * spread, solver.noise_error(prior), rtol=0.055)


def test_error_falls_with_the_noise_and_the_place_is_right() -> None:
    rng = np.random.default_rng(2)
    errors: list[float] = []
    for noise in (1e-3, 1e-4, 1e-5):
        rows = frame(press()) + noise * rng.normal(size=(20, SIDE * SIDE, 3))
        found = inverse(noise)(rows)
        gap = found.traction - press()
        errors.append(float(np.sqrt(np.mean(gap**2) / np.mean(press() ** 2))))
        # The likeliest prior is the RMS of the load that was there, within a factor two.
        ratio = found.regularisation / np.sqrt(np.mean(press() ** 2))
        assert (ratio > 0.5).all()
        assert (ratio < 2.0).all()
        shear = found.traction[..., 0].sum(axis=(1, 2)) / press()[..., 0].sum()
        assert shear.mean() == pytest.approx(1.0, abs=0.15)
        strongest = found.traction[..., 2].mean(axis=0)
        assert set(np.argsort(strongest.ravel())[-4:]) == {27, 28, 35, 36}
    assert errors[2] < 0.5 * errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.15


@pytest.mark.parametrize("noise", [1e-3, 1e-4, 1e-5])
def test_pushing_only_brings_the_map_nearer(noise: float) -> None:
    rng = np.random.default_rng(3)
    rows = frame(press()) + noise * rng.normal(size=(5, SIDE * SIDE, 3))
    solver = inverse(noise)
    plain, pushed = solver(rows), solver(rows, push_only=True)
    assert pushed.traction[..., 2].min() >= 0.0
    gaps = [np.sqrt(np.mean((found.traction - press()) ** 2)) for found in (plain, pushed)]
    assert gaps[1] < 0.9 * gaps[0]
    total = press()[..., 2].sum()
    off = np.abs(pushed.traction[..., 2].sum(axis=(1, 2)) / total - 1.0)
    # Unbounded, three quarters of the force are lost at 1e-3; bounded, noise adds less than half.
    assert (off < 0.5).all()


def test_pushing_only_is_the_least_under_its_condition() -> None:
    rng = np.random.default_rng(4)
    half = rng.normal(size=(12, 12))
    square, pull = half @ half.T + np.eye(12), rng.normal(size=12)
    positive = np.arange(12) % 3 != 0
    found = pushing_only(square, pull, positive)
    slope = square @ found - pull
    # Karush–Kuhn–Tucker: rounding of a 12×12 system.
    assert (found[positive] >= 0.0).all()
    assert (slope[positive] > -1e-10).all()
    np.testing.assert_allclose(slope[~positive], 0.0, atol=1e-10)
    np.testing.assert_allclose((slope * found)[positive], 0.0, atol=1e-10)
    assert (found[positive] == 0.0).any()


def test_frames_add_up() -> None:
    solver = inverse(1e-4)
    one, two = press(), np.roll(press(), 2, axis=0)
    parts = [solver(frame(load), regularisation=1e3).traction for load in (one, two)]
    both = solver(frame(one + two), regularisation=1e3).traction
    np.testing.assert_allclose(both, parts[0] + parts[1], atol=1e-8 * np.abs(both).max())


def test_only_wanted_loads_and_channels() -> None:
    traction = press() * [0.0, 0.0, 1.0]
    solver = inverse(1e-12, loads=("normal",), channels=("shear_x", "normal"))
    found = solver(frame(traction)[:, [0, 2]], regularisation=1e9)
    np.testing.assert_allclose(found.traction[..., 0], traction[..., 2], atol=1e-5 * 2e4)


def test_resolution_widens_with_the_noise() -> None:
    widths = [inverse(noise).resolution(3e3)[..., 2] for noise in (1e-8, 1e-4, 1e-3)]
    assert widths[0].min() == pytest.approx(CELL, rel=1e-3)
    assert (widths[1] >= CELL * (1.0 - 1e-12)).all()
    assert (widths[2] > widths[1]).all()


@pytest.mark.parametrize("ratio", [1.01, 3.0, 100.0, 1e6])
def test_resolution_limit_is_where_the_cover_meets_the_noise(ratio: float) -> None:
    strain = np.pi * Z / resolution_limit(Z, ratio)  # kz
    assert strain > 1.0
    assert strain * np.exp(1.0 - strain) * ratio == pytest.approx(1.0, rel=1e-9)
    stress = np.pi * Z / resolution_limit(Z, ratio, quantity="stress")
    assert (1.0 + stress) * np.exp(-stress) * ratio == pytest.approx(1.0, rel=1e-9)
    assert resolution_limit(Z, ratio, pitch=1.0) == 1.0


def test_waves_beyond_the_limit_are_lost_and_before_it_kept() -> None:
    # A wave of pressure along a row of strips. The ratio is of the wave's amplitude, which N
    # taxels know √(N/2) better than one does; the prior takes a wave of any length as likely.
    count, ratio = 80, 100.0
    cell = 0.1 * Z
    line = (np.arange(count) - (count - 1) / 2) * cell
    taxels = np.stack(np.meshgrid(line, np.zeros(1)), axis=-1).reshape(-1, 2)
    peak = 1.5 / E * np.exp(-1.0) * 1e4  # normal strain of a 10 kPa wave with kz = 1
    noise, prior = peak / ratio * np.sqrt(count / 2), 1e4 / np.sqrt(2.0) * np.sqrt(count / 2)
    solver = LoadMap(taxels, (1, count), (40 * Z, cell), Z, E, noise, ("normal",), ("normal",))
    limit = float(resolution_limit(Z, ratio))
    kept: list[float] = []
    for half in (2.0 * limit, limit, 0.5 * limit):
        wave = 1e4 * np.sin(np.pi * line / half + 0.4)
        traction = np.zeros((1, count, 3))
        traction[..., 2] = wave
        tensor = sum(
            halfspace.rectangle_strain(
                taxels[:, 0] - x,
                taxels[:, 1],
                Z,
                [0.0, 0.0, p],
                size=(cell, 40 * Z),
                youngs_modulus=E,
            )[:, 2, :]
            for x, p in zip(line, wave, strict=True)
        )
        found = solver(np.asarray(tensor)[:, 2:], regularisation=prior).traction[0, :, 0]
        middle = slice(20, -20)
        kept.append(float(found[middle] @ wave[middle] / (wave[middle] @ wave[middle])))
    assert kept[0] > 0.9
    assert 0.2 < kept[1] < 0.8  # at the limit, half of it: up to the row's ends
    assert kept[2] < 0.1


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(PhysicsError, match="noise"):
        inverse(0.0)
    with pytest.raises(UnknownNameError, match="pressure"):
        inverse(1e-4, loads=("pressure",))
    with pytest.raises(ArrayError, match="strain"):
        inverse(1e-4)(np.zeros((3, 3)))
    with pytest.raises(PhysicsError):
        resolution_limit(Z, 1.0)
    with pytest.raises(UnknownNameError):
        resolution_limit(Z, 2.0, quantity="force")
