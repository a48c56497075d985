"""The uniform rectangle, disc and line against quadrature of Johnson's kernels, and two peers."""

import math
from typing import Any

import numpy as np
import pytest

from cnnum.arrays import Floats
from cnnum.errors import PhysicsError
from cnnum.tactile import halfspace

SIZE = (1.4, 0.6)
PLACES = [(0.2, -0.9, 0.4), (0.7, 0.3, 0.2), (0.0, 0.0, 1.0), (-2.0, 0.1, 0.3), (5.0, -7.0, 2.0)]
RATIOS = (-0.4, 0.0, 0.3, 0.5)


def boussinesq(x: Any, y: Any, z: Any, nu: float) -> list[list[Any]]:
    """Restate Johnson 3.19: 2π times the stress under a unit normal load."""
    r, flat = np.sqrt(x * x + y * y + z * z), x * x + y * y
    c, hole = 1 - 2 * nu, (1 - z / r) / flat
    xx = c / flat * (hole * (x * x - y * y) + z * y * y / r**3) - 3 * z * x * x / r**5
    yy = c / flat * (hole * (y * y - x * x) + z * x * x / r**3) - 3 * z * y * y / r**5
    xy = c / flat * (2 * hole * x * y - x * y * z / r**3) - 3 * x * y * z / r**5
    xz, yz, zz = (-3 * part * z * z / r**5 for part in (x, y, z))
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def cerruti(x: Any, y: Any, z: Any, nu: float) -> list[list[Any]]:
    """Restate Johnson 3.76: 2π times the stress under a unit load along x."""
    r = np.sqrt(x * x + y * y + z * z)
    s, c = r + z, 1 - 2 * nu
    more = 1 / (r**3 * s**2) + 2 / (r**2 * s**3)
    xx = -3 * x**3 / r**5 + c * (x / r**3 - 3 * x / (r * s * s) + x**3 * more)
    yy = -3 * x * y * y / r**5 + c * (x / r**3 - x / (r * s * s) + x * y * y * more)
    xy = -3 * x * x * y / r**5 + c * (-y / (r * s * s) + x * x * y * more)
    xz, yz, zz = (-3 * x * part * z / r**5 for part in (x, y, z))
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def johnson_stress(x: Any, y: Any, z: Any, force: tuple[float, ...], nu: float) -> Floats:
    turned = cerruti(y, x, z, nu)
    order = (1, 0, 2)
    along_y = [[turned[i][k] for k in order] for i in order]
    parts = (cerruti(x, y, z, nu), along_y, boussinesq(x, y, z, nu))
    total = sum(f * np.array(part) for f, part in zip(force, parts, strict=True))
    return np.asarray(total) / (2 * np.pi)


def by_quadrature(place: tuple[float, ...], size: tuple[float, float], q: Any, nu: float) -> Floats:
    t, w = np.polynomial.legendre.leggauss(80)
    x, y = place[0] - size[0] / 2 * t[:, None], place[1] - size[1] / 2 * t
    values = johnson_stress(*np.broadcast_arrays(x, y, place[2]), q, nu)
    return (values * w[:, None] * w).sum(axis=(-2, -1)) * size[0] * size[1] / 4


@pytest.mark.parametrize("nu", RATIOS)
@pytest.mark.parametrize("place", PLACES)
def test_stress_at_depth_is_the_integral_of_the_point_kernels(
    place: tuple[float, float, float], nu: float
) -> None:
    q = (0.7, -0.4, 1.1)
    expected = by_quadrature(place, SIZE, q, nu)
    got = halfspace.rectangle_stress(*place, q, size=SIZE, poisson=nu)
    # 80 Gauss points resolve a depth of 0.2 under a width of 1.4 to rounding. But Johnson's
    # (1 - z/r)/ρ² loses digits straight below
    assert np.abs(got - expected).max() < 1e-11


@pytest.mark.parametrize("component", [(0, 0), (0, 1), (0, 2), (2, 2)])
def test_sheared_rectangle_close_to_its_edge(component: tuple[int, int]) -> None:
    """Tanh-sinh quadrature of (4.11) where Gauss points would not do."""
    mp = pytest.importorskip("mpmath")
    i, k = component
    x, y, z = 0.68, 0.1, 0.05

    def kernel(a: Any, b: Any) -> Any:
        place = (x - a, y - b, z)
        r = mp.sqrt(place[0] ** 2 + place[1] ** 2 + z * z)
        return -3 / (2 * mp.pi * r**5) * place[i] * place[k] * place[0]

    expected = mp.quad(kernel, [-0.7, x, 0.7], [-0.3, y, 0.3], maxdegree=6)
    got = halfspace.rectangle_stress(x, y, z, (1, 0, 0), size=SIZE)[i, k]
    # degree 6 leaves 1e-9 on a kernel of width 0.05
    assert got == pytest.approx(float(expected), abs=1e-8)


@pytest.mark.parametrize("distance", [5.0, 19.9 * 0.7, 20.1 * 0.7, 60.1 * 0.7, 1e3, 1e6])
@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_far_away_it_is_as_exact_as_nearby(distance: float, nu: float) -> None:
    place = (0.6 * distance, -0.48 * distance, 0.64 * distance)
    q = (0.7, -0.4, 1.1)
    expected = by_quadrature(place, SIZE, q, nu)
    got = halfspace.rectangle_stress(*place, q, size=SIZE, poisson=nu)
    # corners cancel to (20)² roundings where the Gauss points take over
    assert np.abs(got - expected).max() < 2e-13 * np.abs(expected).max()


@pytest.mark.parametrize("nu", RATIOS)
def test_displacement_is_the_integral_of_the_point_load(nu: float) -> None:
    t, w = np.polynomial.legendre.leggauss(60)
    q = np.array([0.7, -0.4, 1.1])
    for place in PLACES:
        x, y = place[0] - SIZE[0] / 2 * t[:, None], place[1] - SIZE[1] / 2 * t
        point = halfspace.displacement(x, y, place[2], q, youngs_modulus=2.0, poisson=nu)
        expected = np.einsum("abi,a,b->i", point, w, w) * SIZE[0] * SIZE[1] / 4
        got = halfspace.rectangle_displacement(*place, q, size=SIZE, youngs_modulus=2.0, poisson=nu)
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("nu", RATIOS)
def test_strain_is_hookes(nu: float) -> None:
    q = (0.7, -0.4, 1.1)
    x, y, z = np.array(PLACES).T
    stress = halfspace.rectangle_stress(x, y, z, q, size=SIZE, poisson=nu)
    expected = halfspace.strain_from_stress(stress, youngs_modulus=2.0, poisson=nu)
    got = halfspace.rectangle_strain(x, y, z, q, size=SIZE, youngs_modulus=2.0, poisson=nu)
    # two ways to the same sum: a few roundings of the largest term
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-14)


def test_on_the_surface_the_traction_comes_back() -> None:
    q = np.array([0.7, -0.4, 1.1])
    for nu in RATIOS:
        inside = halfspace.rectangle_stress([0.1, -0.69], 0.29, 0.0, q, size=SIZE, poisson=nu)
        outside = halfspace.rectangle_stress([0.1, 2.0], 0.31, 0.0, q, size=SIZE, poisson=nu)
        np.testing.assert_allclose(inside[:, 2], np.broadcast_to(-q, (2, 3)), rtol=0, atol=1e-15)
        np.testing.assert_allclose(outside[:, 2], 0, atol=1e-15)
        assert np.isfinite(halfspace.rectangle_stress(5.0, 0.3, 0.0, q, size=SIZE)).all()


@pytest.mark.parametrize("place", [(0.7, 0.0), (0.7, 0.3), (0.2, -0.3)])
def test_where_the_traction_jumps_the_stress_is_refused(place: tuple[float, float]) -> None:
    with pytest.raises(PhysicsError, match="outline"):
        halfspace.rectangle_stress(*place, 0.0, (1, 0, 0), size=SIZE)
    moved = halfspace.rectangle_displacement(
        *place, 0.0, (1, 1, 1), size=SIZE, youngs_modulus=1.0, poisson=0.2
    )
    assert np.isfinite(moved).all()


@pytest.mark.parametrize("size", [(0.0, 1.0), (1.0, -1.0), (math.nan, 1.0)])
def test_a_rectangle_has_a_size(size: tuple[float, float]) -> None:
    with pytest.raises(PhysicsError):
        halfspace.rectangle_stress(0.0, 0.0, 1.0, (0, 0, 1), size=size)


# The peers sum Love's formula over 128 pixels by FFT: rounding of the sum, not of the formula.
PEER_TOLERANCE = 1e-12


def love_surface(nu: float, modulus: float) -> Floats:
    x, y = np.arange(64)[:, None] - 31.5, np.arange(64) - 27.5
    return halfspace.rectangle_displacement(
        x, y, 0.0, (0, 0, 1e4), size=(8, 16), youngs_modulus=modulus, poisson=nu
    )[..., 2]


def test_love_agrees_with_contactmechanics() -> None:
    peer = pytest.importorskip("ContactMechanics")
    force = np.zeros((128, 128))
    force[28:36, 20:36] = -1e4
    substrate = peer.FreeFFTElasticHalfSpace((64, 64), 2e6, (64.0, 64.0))
    expected = substrate.evaluate_disp(force)[:64, :64]
    got = love_surface(0.5, 2e6 * 0.75)
    assert np.abs(got - expected).max() < PEER_TOLERANCE * expected.max()


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_love_agrees_with_tamaas(nu: float) -> None:
    peer = pytest.importorskip("tamaas")
    model = peer.Model(peer.model_type.basic_2d, [64.0, 64.0], [64, 64])
    model.E, model.nu = 1.5e6, nu
    peer.ModelFactory.registerNonPeriodic(model, "dcfft")
    model.traction[28:36, 20:36] = 1e4
    model.operators["dcfft"](model.traction, model.displacement)
    expected = np.asarray(model.displacement)
    assert np.abs(love_surface(nu, 1.5e6) - expected).max() < PEER_TOLERANCE * expected.max()


@pytest.mark.parametrize("nu", RATIOS)
def test_a_disc_on_its_axis_is_a_ring_of_point_loads(nu: float) -> None:
    a, q = 0.8, (0.7, -0.4, 1.1)
    t, w = np.polynomial.legendre.leggauss(40)
    rho, phi = a * (t[:, None] + 1) / 2, np.arange(24) * 2 * np.pi / 24
    for z in (0.3, 1.0, 4.0):
        values = halfspace.stress(rho * np.cos(phi), rho * np.sin(phi), z, q, poisson=nu)
        area = (rho * a / 2 * w[:, None] * 2 * np.pi / 24)[..., None, None]
        got = halfspace.circle_axis_stress(z, q, radius=a, poisson=nu)
        np.testing.assert_allclose(got, (values * area).sum(axis=(0, 1)), rtol=0, atol=1e-13)


def test_a_disc_far_below_is_a_point_and_on_the_surface_its_traction() -> None:
    q = np.array([0.7, -0.4, 1.1])
    deep = halfspace.circle_axis_stress(1e5, q, radius=1.0, poisson=0.3)
    point = halfspace.stress(0.0, 0.0, 1e5, np.pi * q, poisson=0.3)
    # the first term left out is (a/z)² = 1e-10 of the normal one; the shear is of that order
    np.testing.assert_allclose(deep, point, rtol=0, atol=1e-9 * abs(point[2, 2]))
    assert deep[0, 0] == pytest.approx(point[0, 0], rel=1e-9)
    top = halfspace.circle_axis_stress(0.0, q, radius=1.0, poisson=0.3)
    np.testing.assert_allclose(top[2], -q, rtol=1e-15)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_a_long_thin_rectangle_is_flamants_line(nu: float) -> None:
    x, z, load = np.array([-1.0, 0.0, 0.7]), np.array([0.5, 1.0, 2.0]), np.array([0.7, -0.4, 1.1])
    line = halfspace.line_load_stress(x, z, load, poisson=nu)
    width = 1e-3
    strip = halfspace.rectangle_stress(x, 0.0, z, load / width, size=(width, 2e4), poisson=nu)
    # width² / (24 r²) from the strip, r / length from its ends
    np.testing.assert_allclose(strip, line, rtol=0, atol=3e-4)
    np.testing.assert_allclose(strip[:, 2], line[:, 2], rtol=0, atol=1e-6)


def test_a_line_load_comes_back_through_a_half_cylinder() -> None:
    t, w = np.polynomial.legendre.leggauss(30)
    theta, load = np.pi / 2 * t, np.array([0.7, -0.4, 1.1])
    normal = np.stack([np.sin(theta), np.zeros(30), np.cos(theta)], axis=-1)
    stress = halfspace.line_load_stress(3 * normal[:, 0], 3 * normal[:, 2], load, poisson=0.4)
    total = np.einsum("aij,aj,a->i", stress, normal, w) * 3 * np.pi / 2
    np.testing.assert_allclose(total, -load, rtol=1e-13)
    with pytest.raises(PhysicsError, match="line"):
        halfspace.line_load_stress(0.0, 0.0, load)
