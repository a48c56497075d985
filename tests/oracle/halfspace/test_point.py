"""The point load against the dissertation's formulas, differentiated with thirty digits."""

import math
from typing import Any

import numpy as np
import pytest

from cnnum.errors import ArrayError, PhysicsError
from cnnum.tactile import halfspace

mp = pytest.importorskip("mpmath")

E, FORCE = 2.3, (0.7, -0.4, 1.1)
RATIOS = (-0.9, 0.0, 0.3, 0.499999, 0.5)
PLACES = (
    (0.3, -0.8, 0.5),
    (0.0, 0.0, 2.0),  # straight below
    (1.0, 2.0, 0.0),  # on the surface
    (3e4, -1e4, 1.0),  # far away, nearly on the surface
    (1e-9, 2e-9, 3e-9),
    (1e-8, 0.0, 1.0),  # nearly straight below
)
# Thirty digits against doubles: the rest is the rounding of some ten operations.
TOLERANCE = 5e-15


def printed_displacement(x: Any, y: Any, z: Any, nu: Any) -> list[Any]:
    """Restate (4.9) of the dissertation."""
    Q, R, F = (mp.mpf(part) for part in FORCE)
    r = mp.sqrt(x * x + y * y + z * z)
    across = (2 * r * (nu * r + z) + z * z) / (r**3 * (r + z) ** 2) * (x * Q + y * R)
    shear = (2 * (1 - nu) * r + z) / (r * (r + z))
    side = z / r**3 - (1 - 2 * nu) / (r * (r + z))
    down = (2 * (1 - nu) / r + z * z / r**3) * F
    down += ((1 - 2 * nu) / (r * (r + z)) + z / r**3) * (x * Q + y * R)
    factor = (1 + nu) / (2 * mp.pi * mp.mpf(E))
    u_x = side * x * F + shear * Q + across * x
    return [factor * part for part in (u_x, side * y * F + shear * R + across * y, down)]


def strain_by_differentiation(place: tuple[float, float, float], nu: float) -> list[list[Any]]:
    start = [mp.mpf(part) for part in place]
    size = mp.sqrt(sum(part**2 for part in start))

    def gradient(i: int, k: int) -> Any:
        def along(t: Any) -> Any:
            moved = [part + (t if n == k else 0) for n, part in enumerate(start)]
            return printed_displacement(*moved, mp.mpf(nu))[i]

        return mp.diff(along, 0, h=size * mp.mpf(10) ** -20)

    g = [[gradient(i, k) for k in range(3)] for i in range(3)]
    return [[(g[i][k] + g[k][i]) / 2 for k in range(3)] for i in range(3)]


def stress_by_hooke(strain: list[list[Any]], nu: float) -> np.ndarray:
    """Restate (4.6) of the dissertation."""
    nu = mp.mpf(nu)
    spread = nu / (1 - 2 * nu) * sum(strain[i][i] for i in range(3))
    stress = [
        [mp.mpf(E) / (1 + nu) * (strain[i][k] + (spread if i == k else 0)) for k in range(3)]
        for i in range(3)
    ]
    return np.array(stress, dtype=float)


@pytest.fixture(autouse=True)
def _sixty_digits():
    with mp.workdps(60):
        yield


@pytest.mark.parametrize("nu", RATIOS)
@pytest.mark.parametrize("place", PLACES)
def test_displacement_is_the_printed_one(place: tuple[float, float, float], nu: float) -> None:
    expected = printed_displacement(*(mp.mpf(part) for part in place), mp.mpf(nu))
    got = halfspace.displacement(*place, FORCE, youngs_modulus=E, poisson=nu)
    scale = max(abs(float(part)) for part in expected)
    assert np.abs(got - np.array(expected, dtype=float)).max() <= TOLERANCE * scale


@pytest.mark.parametrize("nu", RATIOS)
@pytest.mark.parametrize("place", PLACES)
def test_strain_is_the_displacements_gradient(place: tuple[float, float, float], nu: float) -> None:
    expected = np.array(strain_by_differentiation(place, nu), dtype=float)
    got = halfspace.strain(*place, FORCE, youngs_modulus=E, poisson=nu)
    assert np.abs(got - expected).max() <= TOLERANCE * np.abs(expected).max()


@pytest.mark.parametrize("nu", RATIOS[:-1])
@pytest.mark.parametrize("place", PLACES)
def test_stress_follows_from_hooke(place: tuple[float, float, float], nu: float) -> None:
    strain = strain_by_differentiation(place, nu)
    expected = stress_by_hooke(strain, nu)
    got = halfspace.stress(*place, FORCE, poisson=nu)
    assert np.abs(got - expected).max() <= TOLERANCE * np.abs(expected).max()
    energy = (expected * np.array(strain, dtype=float)).sum() / 2
    found = halfspace.strain_energy_density(*place, FORCE, youngs_modulus=E, poisson=nu)
    assert found == pytest.approx(energy, rel=4 * TOLERANCE)


def test_incompressible_stress_and_energy_are_the_printed_ones() -> None:
    """Restate (4.11) and (4.13)."""
    x, y, z = np.array(PLACES[:4]).T
    r = np.sqrt(x**2 + y**2 + z**2)
    place, pull = np.stack([x, y, z], axis=-1), np.array(PLACES[:4]) @ np.array(FORCE)
    outer = place[:, :, None] * place[:, None, :]
    expected = -3 / (2 * np.pi * r**5)[:, None, None] * outer * pull[:, None, None]
    got = halfspace.stress(x, y, z, FORCE)
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert (np.abs(got - expected) / scale).max() < TOLERANCE
    energy = 9 * pull**2 / (8 * E * np.pi**2 * r**6)
    got = halfspace.strain_energy_density(x, y, z, FORCE, youngs_modulus=E)
    # relative: the dissertation's r⁵ and r⁶ round as well
    np.testing.assert_allclose(got, energy, rtol=20 * TOLERANCE)


@pytest.mark.parametrize("nu", RATIOS)
def test_the_load_comes_back_through_any_hemisphere_and_plane(nu: float) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(40)
    phi = np.arange(40) * 2 * np.pi / 40
    for radius in (0.2, 5.0):
        c = (nodes[:, None] + 1) / 2
        normal = np.stack(
            np.broadcast_arrays(
                np.sqrt(1 - c * c) * np.cos(phi), np.sqrt(1 - c * c) * np.sin(phi), c
            ),
            axis=-1,
        )
        stress = halfspace.stress(*np.moveaxis(radius * normal, -1, 0), FORCE, poisson=nu)
        area = radius**2 * weights[:, None, None] / 2 * 2 * np.pi / 40
        total = (np.einsum("abij,abj->abi", stress, normal) * area).sum(axis=(0, 1))
        # σ(ν) has 1/(1 + cosθ)³: forty Gauss points resolve it to rounding
        np.testing.assert_allclose(total, -np.array(FORCE), rtol=0, atol=1e-13)
    t = (nodes + 1) * np.pi / 4  # ρ = z tan t
    rho = 0.7 * np.tan(t)[:, None]
    stress = halfspace.stress(rho * np.cos(phi), rho * np.sin(phi), 0.7, FORCE, poisson=nu)
    area = rho * (0.7 / np.cos(t) ** 2 * weights * np.pi / 4)[:, None] * 2 * np.pi / 40
    total = (stress[..., 2] * area[..., None]).sum(axis=(0, 1))
    np.testing.assert_allclose(total, -np.array(FORCE), rtol=0, atol=1e-12)


@pytest.mark.parametrize("nu", RATIOS)
def test_stress_is_in_equilibrium(nu: float) -> None:
    place, h = np.array([0.4, -0.3, 0.6]), 1e-2
    total = np.zeros(3)
    for k in range(3):
        for n, weight in ((1, 45), (2, -9), (3, 1)):
            for sign in (1, -1):
                moved = place + sign * n * h * np.eye(3)[k]
                total += sign * weight / (60 * h) * halfspace.stress(*moved, FORCE, poisson=nu)[k]
    size = np.abs(halfspace.stress(*place, FORCE, poisson=nu)).max() / 0.6
    # sixth-order differences at h = 1e-2: (h/r)^6 times the seventh derivative's factor
    assert np.abs(total).max() < 1e-7 * size


def test_figures_of_merit_of_the_dissertation() -> None:
    """Check 4.3.3: the Mexican hat's width, depth and its ratio to the shear strain."""
    z, force = 0.2e-3, (0.0, 0.0, 1.0)

    def strain(x: Any) -> np.ndarray:
        return halfspace.strain(x, 0.0, z, force, youngs_modulus=E)

    assert abs(strain(math.sqrt(2) * z)[2, 2]) < 1e-14 * abs(strain(0.0)[2, 2])
    x = np.linspace(0, 6, 6001) * z
    hat = -strain(x)[:, 2, 2]
    assert x[hat.argmax()] == 0
    assert x[hat.argmin()] == pytest.approx(2 * z, rel=1e-12)
    assert hat.max() == pytest.approx(3 / (2 * math.pi * E * z**2), rel=1e-14)
    assert hat.max() / -hat.min() == pytest.approx(5**2.5, rel=1e-13)
    shear = np.abs(strain(x)[:, 0, 2])
    assert x[shear.argmax()] == pytest.approx(z / 2, rel=1e-12)
    assert hat.max() / shear.max() == pytest.approx(25 * math.sqrt(5) / 24, rel=1e-13)


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ("poisson", -1.0),
        ("poisson", 0.51),
        ("youngs_modulus", 0.0),
        ("z", -1e-9),
        ("x", math.nan),
        ("force", (0.0, math.inf, 1.0)),
        ("z", 0.0),
        ("y", "far"),
    ],
)
@pytest.mark.parametrize("name", ["displacement", "stress", "strain", "strain_energy_density"])
def test_bad_parameters_are_refused(name: str, change: str, value: Any) -> None:
    good: dict[str, Any] = {
        "x": 0.0,
        "y": 0.0,
        "z": 1.0,
        "force": FORCE,
        "youngs_modulus": E,
        "poisson": 0.3,
    }
    getattr(halfspace, name)(**good)
    with pytest.raises(PhysicsError):
        getattr(halfspace, name)(**(good | {change: value}))


def test_a_force_has_three_components() -> None:
    with pytest.raises(ArrayError, match="3 components"):
        halfspace.stress(0.0, 0.0, 1.0, (1.0, 2.0))


def test_everything_broadcasts() -> None:
    x, z = np.linspace(-1, 1, 5), np.array([0.5, 1.0])[:, None]
    force = np.ones((3, 1, 1, 3))
    modulus = np.array([1.0, 2.0, 4.0])[:, None, None]
    kind = {"youngs_modulus": modulus, "poisson": np.array([0.5, 0.3])[:, None]}
    assert halfspace.displacement(x, 0.0, z, force, **kind).shape == (3, 2, 5, 3)
    assert halfspace.stress(x, 0.0, z, force, **kind).shape == (3, 2, 5, 3, 3)
    whole = halfspace.strain(x, 0.0, z, force, **kind)
    one = halfspace.strain(x[3], 0.0, 1.0, (1, 1, 1), youngs_modulus=4.0, poisson=0.3)
    np.testing.assert_array_equal(whole[2, 1, 3], one)
