"""Maps of traction: against direct sums, waves, Hamilton's sphere, and the loads themselves."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import integrate

from cnnum.errors import ArrayError, PhysicsError, UnknownNameError
from cnnum.tactile import halfspace
from cnnum.tactile.contact import root_average
from cnnum.tactile.grid import make_grid
from cnnum.tactile.halfspace import SurfaceToDepth

ORDER = ("xx", "yy", "zz", "yz", "xz", "xy")


def some_traction(*shape: int) -> Any:
    return np.random.default_rng(7).normal(size=(*shape, 3))


@pytest.mark.parametrize("depth", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("nu", [0.2, 0.5])
def test_convolution_is_the_sum_over_cells(depth: float, nu: float) -> None:
    load, spacing = some_traction(5, 7), (0.9, 0.6)
    grid = make_grid((5, 7), spacing)
    expected = np.zeros((5, 7, 3, 3))
    for i, j in np.ndindex(5, 7):
        expected += halfspace.rectangle_stress(
            grid.x - grid.x[j],
            (grid.y - grid.y[i])[:, None],
            depth,
            load[i, j],
            size=(0.6, 0.9),
            poisson=nu,
        )
    got = halfspace.surface_load_stress(load, spacing=spacing, depth=depth, poisson=nu)
    # rounding of an FFT of 13 by 9 numbers of order one
    np.testing.assert_allclose(got, expected, rtol=0, atol=2e-14)


def test_columns_run_along_x_and_rows_along_y() -> None:
    load = np.zeros((9, 9, 3))
    load[4, 4] = (0, 0, 1)
    stress = SurfaceToDepth((9, 9), 1.0, 1.0)(load)
    # a pressure pushes shear outwards: σ_xz = -3xz²p/(2πr⁵) is odd in x alone
    assert stress[4, 6, 0] < 0 < stress[4, 2, 0]
    assert stress[6, 4, 1] < 0 < stress[2, 4, 1]
    np.testing.assert_allclose(stress[2, 4, 0], 0, atol=1e-16)
    np.testing.assert_allclose(stress[4, 6, 1], 0, atol=1e-16)


def test_the_surface_around_the_map_is_free() -> None:
    """A periodic sum would show the load at the other side as well."""
    load = np.zeros((16, 16, 3))
    load[0, 0] = (0, 0, 1)
    zz = SurfaceToDepth((16, 16), 1.0, 1.5, components=("zz",))(load)[..., 0]
    assert zz[15, 15] == pytest.approx(
        halfspace.rectangle_stress(15.0, 15.0, 1.5, (0, 0, 1), size=(1.0, 1.0))[2, 2], rel=1e-9
    )


def test_batches_components_and_strains() -> None:
    load = some_traction(2, 3, 6, 5)
    full = halfspace.surface_load_stress(load, spacing=0.5, depth=0.4, poisson=0.3)
    assert full.shape == (2, 3, 6, 5, 3, 3)
    few = SurfaceToDepth((6, 5), 0.5, 0.4, 0.3, components=("zz", "xy"))(load)
    np.testing.assert_allclose(few[..., 0], full[..., 2, 2], rtol=0, atol=1e-14)
    np.testing.assert_allclose(few[..., 1], full[..., 0, 1], rtol=0, atol=1e-14)
    one = halfspace.surface_load_stress(load[1, 2], spacing=0.5, depth=0.4, poisson=0.3)
    np.testing.assert_allclose(full[1, 2], one, rtol=0, atol=1e-14)
    strain = halfspace.surface_load_strain(
        load, spacing=0.5, depth=0.4, youngs_modulus=2.0, poisson=0.3
    )
    expected = halfspace.strain_from_stress(full, youngs_modulus=2.0, poisson=0.3)
    np.testing.assert_allclose(strain, expected, rtol=0, atol=1e-14)


def test_taxel_stress_does_not_depend_on_poissons_ratio() -> None:
    load = some_traction(6, 6)
    soft, hard = (SurfaceToDepth((6, 6), 0.5, 0.4, nu)(load) for nu in (0.5, 0.1))
    np.testing.assert_allclose(soft, hard, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"depth": -1.0}, PhysicsError),
        ({"spacing": 0.0}, PhysicsError),
        ({"poisson": 0.6}, PhysicsError),
        ({"youngs_modulus": -1.0}, PhysicsError),
        ({"shape": (0, 4)}, ArrayError),
        ({"components": ("zx",)}, UnknownNameError),
        ({"components": ()}, ArrayError),
    ],
)
def test_bad_covers_are_refused(change: dict[str, Any], error: type[Exception]) -> None:
    good: dict[str, Any] = {"shape": (4, 4), "spacing": 1.0, "depth": 1.0}
    SurfaceToDepth(**good)
    with pytest.raises(error):
        SurfaceToDepth(**(good | change))


def test_bad_maps_are_refused() -> None:
    cover = SurfaceToDepth((4, 5), 1.0, 1.0)
    with pytest.raises(ArrayError, match=r"\(\.\.\., 4, 5, 3\)"):
        cover(np.zeros((5, 4, 3)))
    with pytest.raises(PhysicsError, match="NaN"):
        cover(np.full((4, 5, 3), math.nan))


def test_hertz_pressure_and_friction_give_hamiltons_stress() -> None:
    """Compare with ContactMechanics (Hamilton 1983) and see h² fall by four."""
    pytest.importorskip("ContactMechanics")
    from ContactMechanics.ReferenceSolutions import Hertz as Peer

    errors = []
    for n in (24, 48):
        grid = make_grid((n, n), 3.0 / n)
        hertz = root_average(grid, (0.0, 0.0), 1.0)
        load = hertz[..., None] * np.array([0.4, 0.0, 1.0])
        got = halfspace.surface_load_stress(load, spacing=3.0 / n, depth=0.5, poisson=0.3)
        x, y = np.meshgrid(grid.x, grid.y)
        z = np.full_like(x, 0.5)
        normal = Peer.stress_Cartesian(x, y, z, poisson=0.3)
        pulled = Peer.stress_for_tangential_loading(x, y, z, poisson=0.3)
        expected = [a + 0.4 * b for a, b in zip(normal, pulled, strict=True)]
        pairs = zip(("xx", "yy", "zz", "yz", "xz", "xy"), expected, strict=True)
        errors.append(
            max(
                np.abs(got[..., "xyz".index(ij[0]), "xyz".index(ij[1])] - part).max()
                for ij, part in pairs
            )
        )
    # cells of a sixteenth of the radius at half a radius' depth
    assert errors[1] < 2e-3
    assert 3.0 < errors[0] / errors[1] < 5.0


def inverse_transform(factor: Any, x: float, y: float, scale: float) -> Any:
    """Sum waves over all directions (trapezoid) and wave numbers (Laguerre, e^{-kz})."""
    nodes, weights = np.polynomial.laguerre.laggauss(60)
    k, phi = (nodes / scale)[:, None], np.arange(64) * 2 * np.pi / 64
    kx, ky = k * np.cos(phi), k * np.sin(phi)
    waves = factor(kx, ky) * np.exp(1j * (kx * x + ky * y) + k * scale)[..., None, None]
    area = k * weights[:, None] / scale * 2 * np.pi / 64
    return (waves * area[..., None, None]).sum(axis=(0, 1)) / (4 * np.pi**2)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.4)])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_transfer_is_the_transform_of_the_point_load(place: tuple[float, float], nu: float) -> None:
    z = 0.8
    stress = inverse_transform(lambda kx, ky: halfspace.stress_transfer(kx, ky, z), *place, z)
    strain = inverse_transform(
        lambda kx, ky: halfspace.strain_transfer(kx, ky, z, youngs_modulus=2.0, poisson=nu),
        *place,
        z,
    )
    point = halfspace.stress(*place, z, np.eye(3), poisson=nu)[:, :, 2].T
    bent = halfspace.strain(*place, z, np.eye(3), youngs_modulus=2.0, poisson=nu)[:, :, 2].T
    # 60 Laguerre points resolve e^{ikx} for |x| < z
    np.testing.assert_allclose(stress, point, rtol=0, atol=1e-10)
    np.testing.assert_allclose(strain, bent, rtol=0, atol=1e-10)


def test_filters_are_those_of_the_transfer_and_their_subordination() -> None:
    k, z = np.linspace(0, 9, 10), 0.6
    factors = halfspace.stress_transfer(k, 0.0, z)
    np.testing.assert_allclose(halfspace.low_pass(k, z), -factors[:, 2, 2].real, rtol=1e-14)
    strains = halfspace.strain_transfer(k, 0.0, z, youngs_modulus=1.5)
    np.testing.assert_allclose(
        halfspace.band_pass(k, z), -strains[:, 2, 2].real, rtol=0, atol=1e-15
    )
    # diffusion waves e^{-k²t}, read out with the weight of the harmonic extension
    for one in (0.5, 3.0):
        total = integrate.quad(
            lambda t, one=one: (
                z / (2 * math.sqrt(math.pi) * t**1.5) * math.exp(-z * z / 4 / t - one * one * t)
            ),
            0,
            math.inf,
        )[0]
        # the quadrature's own error is 1e-10 there
        assert halfspace.harmonic_extension(one, z) == pytest.approx(total, rel=1e-8)


def test_strain_of_a_uniform_pressure_is_that_of_a_very_large_disc() -> None:
    factor = halfspace.strain_transfer(0.0, 0.0, 1.0, youngs_modulus=2.0, poisson=0.3)
    disc = halfspace.circle_axis_stress(1.0, np.eye(3), radius=1e9, poisson=0.3)
    strain = halfspace.strain_from_stress(disc, youngs_modulus=2.0, poisson=0.3)
    # a disc lacks z/a = 1e-9 to infinity
    np.testing.assert_allclose(factor.real, strain[:, :, 2].T, rtol=0, atol=1e-8)
    assert not factor.imag.any()


def test_the_band_passes_no_mean_and_peaks_at_one_over_z() -> None:
    k = np.linspace(0, 5, 5001)
    passed = halfspace.band_pass(k, 0.5)
    assert passed[0] == 0
    assert k[passed.argmax()] == pytest.approx(2.0, abs=1e-3)
    assert passed.max() == pytest.approx(1 / math.e, rel=1e-6)
