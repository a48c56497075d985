"""The spline of the tables against SciPy's, which is not-a-knot too."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from cnnum.tactile.cover.bump import STRETCH, spline

RNG = np.random.default_rng(3)
ROUNDING = 1e-12  # of values near 1; the systems of both have condition numbers below 100


@pytest.mark.parametrize(
    ("knots", "inner"),
    [
        (STRETCH, (7,)),
        (np.cumsum([1, 0.1, 3, 1, 2]), (2, 3)),
        *((np.cumsum(RNG.uniform(0.5, 2, count)), ()) for count in (2, 3, 4)),
    ],
    ids=["tables", "uneven", "two", "three", "four"],
)
def test_it_is_the_spline_of_scipy(knots, inner):
    values = RNG.normal(size=(len(knots), *inner))
    places = RNG.uniform(knots[0] - 0.2, knots[-1] + 0.2, (5, 40))
    got, expected = spline(knots, values)(places), CubicSpline(knots, values)(places)
    assert got.shape == expected.shape
    assert got == pytest.approx(expected, rel=ROUNDING, abs=ROUNDING * np.abs(expected).max())


def test_it_is_exact_on_cubics():
    knots = np.array([0.0, 0.3, 1.0, 1.1, 2.0])
    places = np.linspace(0.0, 2.0, 50)
    assert spline(knots, knots**3 - knots)(places) == pytest.approx(places**3 - places, abs=1e-13)
