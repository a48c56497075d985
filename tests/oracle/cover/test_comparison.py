"""The comparison with measured covers: that its figures of merit are those of the curves."""

import math

import numpy as np
import pytest

from cnnum.errors import PhysicsError
from cnnum.tactile import halfspace
from cnnum.tactile.cover import MODELS, LayerCover, Model, compare, merit
from cnnum.tactile.cover.comparison import half_space_strain, layer_stress

E = 1.0
POINT = Model("point", half_space_strain)


def test_the_dissertations_own_figures():
    got = merit(POINT, 0.2e-3)
    # grid of 1/33 of the depth with a parabola on top: 1e-4 of a smooth extremum
    assert got.width == pytest.approx(2 * math.sqrt(2) * 0.2e-3, rel=1e-9)
    assert got.amplitude == pytest.approx(3 / (2 * math.pi * 0.2e-3**2), rel=1e-9)
    assert got.inhibition == pytest.approx(5**2.5, rel=1e-3)
    assert got.normal_to_shear == pytest.approx(25 * math.sqrt(5) / 24, rel=1e-3)


def test_averaging_over_needle_and_taxel_is_an_average():
    """The transform against the mean of the point solution over a disc, by quadrature."""
    radius, depth = 0.15e-3, 0.25e-3
    x, w = np.polynomial.legendre.leggauss(16)
    rho, angle = radius * (x + 1) / 2, 2 * np.pi * np.arange(32) / 32
    weight = w * rho / (32 * (w * rho).sum())
    normal, shear = Model("disc", half_space_strain, (radius,)).curves(depth)
    for place in (0.0, 0.1e-3, 0.4e-3, 1.0e-3):
        px = place + rho[:, None] * np.cos(angle)
        py = rho[:, None] * np.sin(angle)
        field = halfspace.strain(px, py, depth, [0, 0, 1.0], youngs_modulus=E)
        mean = np.einsum("rakl,r->kl", field, weight)
        scale = 1e-9 * np.abs(mean).max()  # both rules converge exponentially
        assert normal(np.asarray(place)) == pytest.approx(mean[2, 2], abs=scale)
        assert shear(np.asarray(place)) == pytest.approx(mean[0, 2], abs=scale)


def test_layer_curves_are_those_of_the_layer():
    depth = 0.3e-3
    normal, shear = Model("layer", layer_stress).curves(depth)
    x = np.array([0.0, 0.1e-3, 0.5e-3])
    taxels = np.stack([x, 0 * x], axis=-1)
    wanted = LayerCover(depth, E).stress([0.0, 0.0], taxels, [0, 0, 1.0])
    scale = 1e-8 * np.abs(wanted).max()
    np.testing.assert_allclose(normal(x), wanted[:, 2], atol=scale)
    np.testing.assert_allclose(shear(x), wanted[:, 0], atol=scale)


@pytest.fixture(scope="module")
def rows():
    return compare(thicknesses=(0.2e-3, 0.5e-3))


def test_rows_compare_and_do_not_pass(rows):
    assert len(rows) == 4 * len(MODELS)
    table = {(row.model, row.quantity.split(" ")[0]): row for row in rows}
    theory = table["half-space, strain", "slope"]
    assert theory.got == pytest.approx(2 * math.sqrt(2), rel=1e-6)
    assert theory.ratio == pytest.approx(2 * math.sqrt(2) / 1.14, rel=1e-6)
    assert table["half-space, strain", "exponent"].got == pytest.approx(-2, rel=1e-6)
    # compressive stress has no zero: no width, no inhibition
    assert math.isnan(table["half-space, stress", "slope"].got)
    assert math.isinf(table["half-space, stress", "lateral"].got)


def test_a_bonded_base_explains_more_than_the_half_space(rows):
    """Narrower curves that decline less: nearer to W's slope and A's exponent than theory."""
    table = {(row.model, row.quantity.split(" ")[0]): row for row in rows}
    real = "bonded layer, strain 50 µm above the base; needle and taxel"
    for quantity in ("slope", "exponent"):
        better, theory = table[real, quantity], table["half-space, strain", quantity]
        assert abs(better.ratio - 1) < abs(theory.ratio - 1) / 2


def test_refuses_a_single_thickness():
    with pytest.raises(PhysicsError, match="two thicknesses"):
        compare(thicknesses=(0.2e-3,))
    with pytest.raises(PhysicsError, match="thickness"):
        merit(POINT, 0.0)
