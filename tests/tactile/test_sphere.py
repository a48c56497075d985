"""What taxels feel of a sphere, against waves."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j1

from cnnum.engine import Engine
from cnnum.programs import program
from cnnum.tactile.indenters import Disc
from cnnum.templates.tactile.contact_mechanics.sphere_response import (
    pushed_by,
    turned_by,
)

SIZES = [(0.8, 0.47), (1.3, 0.67), (1.8, 1.33)]
AWAY = np.linspace(0.05, 4.0, 64)
"""Pitches from the axis at which maps are compared."""


def felt(radius, depth, away=AWAY, reads="strain"):
    """Return the program's maps at 64 distances, in float64."""

    @program
    def seen(frame):
        """All maps of `sphere`."""
        a = frame.shear_x.max()
        pushed = pushed_by(frame.normal, a, depth, reads)
        names = ("signal", "by_radius", "by_away")
        maps = {n: getattr(pushed, n) for n in names}
        return {**maps, "turned": turned_by(frame.normal, a, depth)}

    plan = Engine("reference").compile(seen, (8, 8), channels=("shear_x", "normal"))
    frame = np.stack([np.full(64, radius), away**2], axis=-1).reshape(8, 8, 2)
    return {name: np.ravel(v) for name, v in plan.stream(()).push(frame).items()}


@pytest.mark.parametrize(("radius", "depth"), SIZES)
def test_pressed_as_its_waves_add_up_to(radius, depth):
    """The arc sine is good to 7e-5, and a mean pressure of 1 is a largest one of 1.5 (Hertz)."""
    true = Disc(radius, (0.0, 0.0), "hertz").normal(AWAY, 0.0 * AWAY, depth, "strain") / 1.5
    assert np.abs(felt(radius, depth)["signal"] - true).max() <= 7e-5 * depth / radius + 1e-6
    # stress needs no arc sine
    true = Disc(radius, (0.0, 0.0), "hertz").normal(AWAY, 0.0 * AWAY, depth, "stress") / 1.5
    assert np.abs(felt(radius, depth, reads="stress")["signal"] - true).max() <= 1e-6


@pytest.mark.parametrize(("reads", "within"), [("strain", 5e-4), ("stress", 1e-5)])
@pytest.mark.parametrize(("radius", "depth"), SIZES)
def test_slopes_are_those_of_the_map(radius, depth, reads, within):
    """Central differences, good to 2e-6; the arc sine's ripple tilts strain by up to 3e-4."""
    got, step = felt(radius, depth, reads=reads), 1e-3
    wide, slim = (felt(radius + s * step, depth, reads=reads)["signal"] for s in (1, -1))
    assert got["by_radius"] == pytest.approx((wide - slim) / (2 * step), abs=within)
    ways = (np.sqrt(AWAY**2 + s * step) for s in (1, -1))
    out, back = (felt(radius, depth, way, reads)["signal"] for way in ways)
    assert got["by_away"] == pytest.approx((out - back) / (2 * step), abs=within)


@pytest.mark.parametrize(("radius", "depth"), SIZES)
def test_turned_as_its_waves_add_up_to(radius, depth):
    """Reissner and Sagoci's traction is (2/π) (sin ka − ka cos ka)/k of J₁(kρ) for each radian."""

    def wave(k, rho):
        return (
            (np.sin(k * radius) / k - radius * np.cos(k * radius))
            * np.exp(-k * depth)
            * j1(k * rho)
        )

    true = [
        2 / np.pi * rho * quad(wave, 0.0, 40.0 / depth, args=(rho,), limit=500)[0]
        for rho in AWAY[::9]
    ]
    # the quadrature's own tolerance
    assert felt(radius, depth)["turned"][::9] == pytest.approx(true, abs=1e-7)
