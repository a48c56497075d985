"""A layer on a rigid base: against the half-space, thin-layer theory, Navier and equilibrium."""

import numpy as np
import pytest

from cnnum.errors import PhysicsError
from cnnum.tactile import halfspace
from cnnum.tactile.cover import (
    FlatCover,
    LayerCover,
    layer_displacement_transfer,
    layer_stress_transfer,
    layer_waves,
)

E = 0.87e6
H = 0.5e-3
ORIGIN = np.zeros(2)
KX = np.array([300.0, 1000.0, -2000.0, 4000.0]) * 2
KY = np.array([700.0, -200.0, 400.0, 0.0]) * 2


@pytest.mark.parametrize("poisson", [0.5, 0.3, -0.4])
def test_thick_layer_is_the_half_space(poisson):
    z = 0.4 * H
    thick = layer_stress_transfer(KX, KY, z, thickness=200 * H, poisson=poisson)
    # at kh > 100 the base is e^{-200} away: rounding alone is left
    np.testing.assert_allclose(thick, halfspace.stress_transfer(KX, KY, z), atol=1e-12)


@pytest.mark.parametrize("poisson", [0.5, 0.3])
def test_traction_on_top_is_the_load(poisson):
    top = layer_stress_transfer(KX, KY, 0.0, thickness=H, poisson=poisson)
    np.testing.assert_allclose(top, np.broadcast_to(-np.eye(3), top.shape), atol=1e-12)


@pytest.mark.parametrize("poisson", [0.5, 0.3])
def test_nothing_moves_on_the_base(poisson):
    shape = {"thickness": H, "youngs_modulus": E, "poisson": poisson}
    top = layer_displacement_transfer(KX, KY, 0.0, **shape)
    base = layer_displacement_transfer(KX, KY, H, **shape)
    assert np.abs(base).max() < 1e-15 * np.abs(top).max()


@pytest.mark.parametrize("depth", [0.2 * H, 0.6 * H])
def test_hooke_and_equilibrium_by_differentiation(depth):
    """Stress is Hooke's of the displacement, and its divergence vanishes (Navier)."""
    poisson, step = 0.3, 1e-4 * H
    shear = E / (2 * (1 + poisson))
    lame = 2 * shear * poisson / (1 - 2 * poisson)
    ik = 1j * np.stack([KX, KY])[:, :, None]

    def u(z):
        return layer_displacement_transfer(
            KX, KY, z, thickness=H, youngs_modulus=E, poisson=poisson
        )

    def down(z):
        return layer_stress_transfer(KX, KY, z, thickness=H, poisson=poisson)

    du = (u(depth + step) - u(depth - step)) / (2 * step)
    here = u(depth)
    volume = ik[0] * here[:, 0] + ik[1] * here[:, 1] + du[:, 2]
    side = [shear * (du[:, i] + ik[i] * here[:, 2]) for i in range(2)]
    stress = np.stack([*side, lame * volume + 2 * shear * du[:, 2]], axis=1)
    # the difference's own error is (k step)² / 6 of the value: below 1e-7
    np.testing.assert_allclose(stress, down(depth), atol=1e-6)

    across = shear * (ik[0] * here[:, 1] + ik[1] * here[:, 0])
    normal = [lame * volume + 2 * shear * ik[i] * here[:, i] for i in range(2)]
    dz = (down(depth + step) - down(depth - step)) / (2 * step)
    rows = [
        ik[0] * normal[0] + ik[1] * across + dz[:, 0],
        ik[0] * across + ik[1] * normal[1] + dz[:, 1],
        ik[0] * down(depth)[:, 0] + ik[1] * down(depth)[:, 1] + dz[:, 2],
    ]
    scale = np.hypot(KX, KY).max()
    assert np.abs(rows).max() < 1e-6 * scale


@pytest.mark.parametrize("reach", [0.02, 0.005])
def test_thin_incompressible_layer_is_lubrication(reach):
    """u_z = -h³ ∇²p / 3G; the next term is 9/5 (kh)² of it."""
    waves = layer_waves(reach / H, 0.0, thickness=H)
    assert waves.down_p == pytest.approx(H**3 * (reach / H) ** 2 / 3, rel=2 * reach**2)


@pytest.mark.parametrize("poisson", [0.3, 0.0])
def test_thin_compressible_layer_is_a_column(poisson):
    """Under an even pressure the strain is that of a column that cannot widen."""
    waves = layer_waves(0.0, 0.3 * H, thickness=H, poisson=poisson)
    confined = (1 - 2 * poisson) / (2 * (1 - poisson))
    assert waves.strain_p == pytest.approx(-confined, rel=1e-9)  # stops at kh = 1e-6
    assert waves.down_p == pytest.approx(confined * 0.7 * H, rel=1e-9)
    assert waves.slide_q == pytest.approx(0.7 * H, rel=1e-9)


def test_incompressible_base_feels_no_normal_strain():
    waves = layer_waves(np.array([10.0, 1e3, 1e4]), H, thickness=H)
    np.testing.assert_allclose(waves.strain_p, 0, atol=1e-15)
    np.testing.assert_allclose(waves.strain_q, 0, atol=1e-15)


@pytest.mark.parametrize("poisson", [0.5, 0.35])
def test_point_load_on_a_thick_layer_is_boussinesq_and_cerruti(poisson):
    rng = np.random.default_rng(0)
    taxels, force = rng.normal(size=(40, 2)) * H, rng.normal(size=(40, 3))
    flat = FlatCover(H, E, poisson)
    thick = LayerCover(1e4 * H, E, poisson, taxel_depth=H)
    for name in ("stress", "strain"):
        wanted = getattr(flat, name)(ORIGIN, taxels, force)
        got = getattr(thick, name)(ORIGIN, taxels, force)
        # a base at 10⁴ depths changes 1e-8 of the largest value
        np.testing.assert_allclose(got, wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("force", [(0, 0, 1.0), (1.0, 0, 0), (0, 1.0, 0)])
def test_load_comes_back_from_the_base(force):
    cover = LayerCover(H, E)
    x = np.linspace(-20, 20, 101) * H
    taxels = np.stack(np.meshgrid(x, x), axis=-1)
    stress = cover.stress(ORIGIN, taxels, force)
    # equal weights integrate a smooth field that has faded at the rim, but for a 1e-4 of it
    total = -stress.sum(axis=(0, 1)) * (x[1] - x[0]) ** 2
    np.testing.assert_allclose(total, force, atol=5e-5)
    moment = np.einsum("yx,yxi->i", -stress[..., 2], taxels) * (x[1] - x[0]) ** 2
    # a force on top acts at the height h over the base
    np.testing.assert_allclose(moment, np.asarray(force)[:2] * H, atol=1e-4 * H)


def test_poles_and_far_away():
    cover = LayerCover(H, E)
    far = cover.stress(ORIGIN, [[0.0, 0.0], [1.0, 0.0]], [0, 0, 1.0])
    assert far[0, 2] < 0
    assert (far[1] == 0).all()
    with pytest.raises(PhysicsError, match="thickness"):
        LayerCover(H, E, taxel_depth=2 * H)
    with pytest.raises(PhysicsError, match="depth"):
        layer_waves(1.0, 2 * H, thickness=H)
