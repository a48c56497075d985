"""Several taxels: a load in three directions, from three taxels, nine, or three on a line."""

import numpy as np
import pytest

from cnnum.arrays import Floats
from cnnum.errors import ArrayError
from cnnum.tactile import halfspace
from cnnum.tactile.inverse import locate_load
from cnnum.tactile.inverse.spatial import linear_part, place_part
from cnnum.tactile.taxel import Coupling, Taxel

E, Z, PITCH = 0.87e6, 200e-6, 240e-6
THREE = np.array([[0.0, 0.0], [PITCH, 0.0], [0.0, PITCH]])
GRID = np.stack(np.meshgrid(*[[-PITCH, 0.0, PITCH]] * 2), axis=-1).reshape(-1, 2)
LINE = np.array([[-PITCH, 0.0], [0.0, 0.0], [PITCH, 0.0]])
NOISE = Taxel(Coupling.nominal(depth=Z, youngs_modulus=E)).calibration().strain_noise(2.5e-3)


def seen_by(taxels: Floats, place: Floats, force: Floats) -> Floats:
    offset = taxels - place[:, np.newaxis]
    load = force[:, np.newaxis]
    tensor = halfspace.strain(offset[..., 0], offset[..., 1], Z, load, youngs_modulus=E)
    return tensor[..., 2, :]


def pushes(rng: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    place = rng.uniform(-1.0, 1.0, (count, 2)) * PITCH
    shear = rng.normal(size=(count, 2)) * 3e-4
    return place, np.concatenate([shear, rng.uniform(1e-3, 3e-3, (count, 1))], axis=1)


@pytest.mark.parametrize("taxels", [THREE, GRID], ids=["three", "nine"])
def test_exact_strain_gives_the_exact_load(taxels: Floats) -> None:
    rng = np.random.default_rng(1)
    place = rng.uniform(-1.0, 1.0, (500, 2)) * PITCH
    place[:50] *= np.sqrt(2.0) * Z / np.hypot(*place[:50].T)[:, np.newaxis]  # on a taxel's ring
    force = rng.normal(size=(500, 3)) * 1e-3  # any direction, pulls too
    load = locate_load(seen_by(taxels, place, force), taxels, depth=Z, youngs_modulus=E)
    error = np.hypot(load.x - place[:, 0], load.y - place[:, 1])
    assert error.max() < 1e-9 * Z
    assert np.linalg.norm(load.force - force, axis=1).max() < 1e-9 * np.abs(force).max()
    assert load.determined


@pytest.mark.parametrize("taxels", [THREE, GRID], ids=["three", "nine"])
def test_the_error_covers_95_percent(taxels: Floats) -> None:
    rng = np.random.default_rng(2)
    place, force = pushes(rng, 1500)
    place = np.abs(place) if len(taxels) == 3 else place
    rows = seen_by(taxels, place, force)
    rows = rows + rng.normal(size=rows.shape) * [NOISE[0], NOISE[0], NOISE[1]]
    load = locate_load(rows, taxels, depth=Z, youngs_modulus=E, noise=NOISE)
    error = np.hypot(load.x - place[:, 0], load.y - place[:, 1])
    # 1500 draws know a share of 95 % to 0.56 %: three of those.
    assert np.mean(error <= load.position_error) == pytest.approx(0.95, abs=0.017)
    shares = np.mean(np.abs(load.force - force) <= load.force_error, axis=0)
    np.testing.assert_allclose(shares, 0.95, atol=0.017)
    # 3n values less the 5 that were fitted leave that much of the noise, by weighted mean.
    freedom = np.sqrt(1.0 - 5.0 / rows[0].size)
    weighted = np.sqrt(np.mean(load.residual**2)) / max(NOISE)
    assert weighted == pytest.approx(freedom, rel=0.05)


def test_nine_taxels_place_a_load_within_5_um() -> None:
    rng = np.random.default_rng(3)
    place, force = pushes(rng, 1000)
    rows = seen_by(GRID, place, force)
    rows = rows + rng.normal(size=rows.shape) * [NOISE[0], NOISE[0], NOISE[1]]
    load = locate_load(rows, GRID, depth=Z, youngs_modulus=E, noise=NOISE)
    error = np.hypot(load.x - place[:, 0], load.y - place[:, 1])
    assert np.sqrt(np.mean(error**2)) < 5e-6


@pytest.mark.parametrize("noisy", [False, True])
def test_taxels_on_a_line_give_an_answer_with_its_error(noisy: bool) -> None:
    rng = np.random.default_rng(4)
    place, force = pushes(rng, 600)
    rows = seen_by(LINE, place, force)
    spread: tuple[float, float] | float = 0.0
    if noisy:
        rows = rows + rng.normal(size=rows.shape) * [NOISE[0], NOISE[0], NOISE[1]]
        spread = NOISE
    load = locate_load(rows, LINE, depth=Z, youngs_modulus=E, noise=spread, friction=1.0)
    assert not load.determined
    assert np.isfinite(load.force).all()
    assert not np.isnan(load.force_error).any()
    inside = np.abs(load.force - force) <= load.force_error + 1e-9 * np.abs(force).max()
    assert (inside.mean(axis=0) >= 0.93).all()
    # The component along the line is known, the others are open within the friction cone.
    # Friction below z over the distance bounds it: within ±1.2 z it does so mostly.
    assert np.median(load.force_error[:, 0]) < 4e-4
    assert np.isfinite(load.force_error).all(axis=1).mean() > 0.6
    if not noisy:
        np.testing.assert_allclose(load.force[:, 0], force[:, 0], atol=1e-9 * np.abs(force).max())
        np.testing.assert_allclose(load.x, place[:, 0], atol=1e-9 * Z)
        np.testing.assert_allclose(load.y, place[:, 1], atol=1e-9 * Z)


def test_derivatives_agree_with_differences() -> None:
    rng = np.random.default_rng(5)
    place, spot, force = rng.normal(size=(4, 2)), rng.normal(size=2), rng.normal(size=3)
    weights, step = np.array([1.0, 1.0, 2.0]), 1e-6
    slope = place_part(place - spot, force, weights)
    for axis in (0, 1):
        move = step * np.eye(2)[axis]
        ahead = linear_part(place - spot - move, weights) @ force
        behind = linear_part(place - spot + move, weights) @ force
        # Central differences: step² of truncation, 1e-16/step of rounding.
        np.testing.assert_allclose(slope[:, axis], (ahead - behind) / (2 * step), atol=1e-8)


def test_silence_is_not_a_load() -> None:
    load = locate_load(np.zeros((2, 3, 3)), THREE, depth=Z, youngs_modulus=E, noise=1e-4)
    assert not load.seen.any()
    assert (load.force == 0.0).all()
    assert np.isinf(load.position_error).all()


def test_batch_axes_are_kept() -> None:
    rng = np.random.default_rng(6)
    place, force = pushes(rng, 6)
    rows = seen_by(GRID, place, force)
    whole = locate_load(rows.reshape(2, 3, 9, 3), GRID, depth=Z, youngs_modulus=E)
    assert whole.force.shape == (2, 3, 3)
    one = locate_load(rows[4], GRID, depth=Z, youngs_modulus=E)
    np.testing.assert_allclose(whole.force[1, 1], one.force, rtol=1e-9)


def test_one_taxel_is_refused() -> None:
    with pytest.raises(ArrayError, match="locate"):
        locate_load(np.zeros((1, 3)), np.zeros((1, 2)), depth=Z, youngs_modulus=E)
