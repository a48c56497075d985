"""Flat, ridged and hairy covers: equilibrium, limits and the direction that each prefers."""

import numpy as np
import pytest

from cnnum.errors import PhysicsError
from cnnum.tactile import halfspace
from cnnum.tactile.cover import FlatCover, HairCover, RidgeCover

E = 0.87e6
Z = 0.2e-3
RIDGE = RidgeCover(Z, E, width=0.5e-3, height=0.26e-3)
HAIR = HairCover(radius=40e-6, length=0.3e-3, above=0.15e-3, youngs_modulus=E)


@pytest.mark.parametrize("poisson", [0.5, 0.3])
def test_flat_cover_is_the_half_space(poisson):
    load, taxels, force = [1e-4, 2e-4], np.array([[0.0, 0.0], [3e-4, -1e-4]]), [0.2, 0.3, 1.0]
    away = taxels - load
    cover = FlatCover(Z, E, poisson)
    material = {"youngs_modulus": E, "poisson": poisson}
    place = (away[:, 0], away[:, 1], Z, force)
    stress, strain = halfspace.stress(*place, **material), halfspace.strain(*place, **material)
    np.testing.assert_array_equal(cover.stress(load, taxels, force), stress[..., 2])
    np.testing.assert_array_equal(cover.strain(load, taxels, force), strain[..., 2])


@pytest.mark.parametrize("force", [(0, 0, 1.0), (0.4, 0, 0), (0, 0.7, 0), (0.3, -0.2, 1.0)])
def test_ridge_hands_on_force_and_moment(force):
    aside = 0.1e-3
    places, traction = RIDGE.traction([aside, 0.0], force)
    area = RIDGE.width * RIDGE.length / len(places)
    np.testing.assert_allclose(traction.sum(axis=0) * area, force, atol=1e-12)
    # ∫ p over linear pressure: cells' centres, and within a cell the slope's own h²/12
    pressure = traction[:, 2].reshape(8, 8)
    steps = RIDGE.width / 8, RIDGE.length / 8
    across = (pressure.sum(axis=0) * places[:8, 0]).sum() * area
    along = (pressure.sum(axis=1) * places[::8, 1]).sum() * area
    assert across == pytest.approx(force[2] * aside + force[0] * RIDGE.height, abs=1e-15)
    assert along == pytest.approx(force[1] * RIDGE.height, abs=1e-15)
    assert steps[0] > 0


def test_narrow_low_ridge_is_flat():
    thin = RidgeCover(Z, E, width=1e-6, height=1e-9, spread=1e-6)
    flat = FlatCover(Z, E)
    taxels, force = np.array([[0.0, 0.0], [1e-4, 2e-4]]), [0.2, 0.3, 1.0]
    # a foot of 1/100 of the depth: (1/100)² off
    for name in ("stress", "strain"):
        wanted = getattr(flat, name)([0.0, 1e-4], taxels, force)
        got = getattr(thin, name)([0.0, 1e-4], taxels, force)
        np.testing.assert_allclose(got, wanted, atol=1e-3 * np.abs(wanted).max())


def test_ridge_prefers_a_direction():
    """Fig. 6.7: along the ridge as over a flat cover; across it the place does not matter."""
    taxel, force = np.zeros(2), [0, 0, 1.0]
    along = RIDGE.stress(np.stack([np.zeros(3), [0, 4e-4, 8e-4]], axis=-1), taxel, force)[:, 2]
    assert abs(along[2]) < 0.05 * abs(along[0])
    across = RIDGE.stress(np.stack([[0, 4e-4, 8e-4], np.zeros(3)], axis=-1), taxel, force)[:, 2]
    assert abs(across[2]) > 0.5 * abs(across[0])
    # a shear force across presses one side: its normal stress is odd, and beats the flat cover's
    sides = np.array([[-2e-4, 0.0], [2e-4, 0.0]])
    shear = RIDGE.stress(taxel, sides, [1.0, 0, 0])[:, 2]
    assert shear[0] == pytest.approx(-shear[1], rel=1e-9)
    assert shear[1] < 0


def test_wide_rod_catches_what_a_disc_does():
    wide = HairCover(radius=9e-3, length=0.3e-3, above=3e-3, youngs_modulus=E)
    force = np.array([0.2, -0.1, 1.0])
    caught, moment = wide.caught([0.0, 0.0], force)
    # the closed forms of a loaded disc on its axis; by reciprocity the disc's share of a point
    c = 3e-3 / np.hypot(3e-3, 9e-3)
    assert caught[2] == pytest.approx(force[2] * (1 - c**3), rel=1e-6)
    np.testing.assert_allclose(caught[:2], force[:2] * (1 - 1.5 * c + 0.5 * c**3), rtol=1e-6)
    assert moment[0] > wide.length * caught[0]


def test_share_of_the_rod_is_the_disc_by_reciprocity():
    """A disc at depth catches as much of a point load as a loaded disc makes at a point."""
    force = np.array([0, 0, 1.0])
    caught, _ = HAIR.caught([0.0, 0.0], force)
    disc = halfspace.circle_axis_stress(HAIR.above, force, radius=HAIR.radius)
    assert caught[2] == pytest.approx(-disc[2, 2], rel=1e-9)  # Gauss points on a smooth field


def test_foot_carries_what_the_rod_caught():
    force, load = np.array([0.3, -0.2, 1.0]), np.array([20e-6, 10e-6])
    caught, moment = HAIR.caught(load, force)
    x, w = np.polynomial.legendre.leggauss(12)
    rho, angle = HAIR.radius * (x + 1) / 2, 2 * np.pi * np.arange(16) / 16
    places = rho[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    weight = w * HAIR.radius / 2 * rho * 2 * np.pi / 16
    stress = HAIR.stress(load, places, force)
    np.testing.assert_allclose(-np.einsum("rai,r->i", stress, weight), caught, rtol=1e-9)
    back = -np.einsum("ra,raj,r->j", stress[..., 2], places, weight)
    np.testing.assert_allclose(back, moment, rtol=1e-9)


def test_longer_rods_feel_shear_more():
    """6.2.2: the length of the rod sets the shear sensitivity, the normal one stays."""
    rim = np.array([[-35e-6, 0.0], [35e-6, 0.0]])
    swings, means = [], []
    for length in (0.1e-3, 0.2e-3, 0.4e-3):
        rod = HairCover(HAIR.radius, length, HAIR.above, E)
        normal = rod.stress([0.0, 0.0], rim, [0.5, 0, 1.0])[:, 2]
        swings.append(normal[0] - normal[1])
        means.append(normal.mean())
    assert swings[0] < swings[1] < swings[2]
    np.testing.assert_allclose(means, means[0], rtol=1e-9)
    assert HAIR.lever == pytest.approx(30)


def test_beside_the_foot_the_cover_is_flat():
    taxel, force = np.array([0.4e-3, 0.1e-3]), [0.2, 0.0, 1.0]
    flat = FlatCover(HAIR.depth, E)
    np.testing.assert_array_equal(
        HAIR.stress([0.0, 0.0], taxel, force), flat.stress([0.0, 0.0], taxel, force)
    )
    with pytest.raises(PhysicsError, match="radius"):
        HairCover(0.0, 1e-3, 1e-3, E)
