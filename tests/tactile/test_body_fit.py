"""Fits of a sphere and a flat punch, and silence where the body is another one."""

import numpy as np
import pytest

from cnnum.errors import ProgramError
from cnnum.tactile.indenters import Disc, Rectangle, Ring, Several, frame_under
from cnnum.templates.tactile.contact_mechanics.body_fit import body_fit

REST, FRAMES, MIDDLE = 20, 26, 3.5
PRESSURE, MODULUS = 0.02, 3.0
"""Mean, over the unit of the surface load, and E* in that unit."""

RADII = np.array([2.1, 2.3, 2.6, 3.0])
CENTRES = np.array([(0.2, -0.3), (0.5, 0.5), (-0.4, 0.1), (0.0, 0.0)])
SPHERES = [Disc(a, (x, y), "hertz") for a, (x, y) in zip(RADII, CENTRES, strict=True)]
PUNCHES = [Disc(a, (0.1, -0.2), "punch") for a in RADII]
NARROW = Disc(1.2, (0.3, 0.3), "hertz")
OTHERS = [
    Disc(1.6, (0.0, 0.0), "uniform"),
    Disc(2.8, (-0.3, 0.4), "uniform"),
    Rectangle(4.0, 4.0, 0.3),
    Rectangle(1.5, 5.0, 1.0),
    Ring(1.2, 2.6, (0.1, 0.1)),
    Several((Disc(1.5, (-1.2, 0.2), "hertz"), Disc(1.5, (1.2, 0.2), "hertz"))),
    NARROW,
]
HIDDEN = [Disc(2.1, (0.0, 0.0), "hertz")]
"""Under noise of 15 % of the peak, where all others have 1 %."""


def fitted(fast, run, reads, depth):
    """The last outputs under all bodies, side by side, after rest."""
    bodies = [*SPHERES, *PUNCHES, *OTHERS, *HIDDEN]
    loads = np.stack([PRESSURE * frame_under(body, (8, 8), depth, reads) for body in bodies])
    noise = np.where(np.arange(len(bodies)) < len(bodies) - 1, 0.01, 0.15) * loads.max(axis=(1, 2))
    frames = np.random.default_rng(4).normal(size=(FRAMES, len(bodies), 8, 8, 3))
    frames *= noise[:, None, None, None]
    frames[REST:, ..., 2] -= loads
    program = body_fit.bind(depth=depth, reads=reads, modulus=MODULUS)
    return {name: value[-1] for name, value in run(fast, program, frames).items()}


@pytest.mark.parametrize(("reads", "depth"), [("strain", 1.0), ("stress", 0.75)])
def test_bodies_are_those_of_the_closed_form_or_none(fast, run, reads, depth):
    got = fitted(fast, run, reads, depth)
    spheres, punches, rest = slice(0, 4), slice(4, 8), slice(8, None)
    assert got["sphere_fits"].tolist() == [1.0] * 4 + [0.0] * 12
    assert got["flat_fits"].tolist() == [0.0] * 4 + [1.0] * 4 + [0.0] * 8
    # the filter gives pressures to a few per cent: radii and places to as much
    np.testing.assert_allclose(got["contact_radius"][spheres], RADII, rtol=0.08)
    np.testing.assert_allclose(got["contact_radius"][punches], RADII, rtol=0.1)
    np.testing.assert_allclose(got["body_column"][spheres], MIDDLE + CENTRES[:, 0], atol=0.1)
    np.testing.assert_allclose(got["body_row"][spheres], MIDDLE + CENTRES[:, 1], atol=0.1)
    # Hertz: R = 2 a E*/(π p₀), and p₀ is 1.5 times the mean pressure
    expected = 2.0 * RADII * MODULUS / (np.pi * 1.5 * PRESSURE)
    np.testing.assert_allclose(got["sphere_radius"][spheres], expected, rtol=0.15)
    assert not got["sphere_radius"][4:].any()
    for name in ("body_row", "body_column", "contact_radius"):
        assert not got[name][rest].any(), name
    assert (got["body_left"] > 0.0).all()


def test_a_modulus_that_is_none(fast, run):
    with pytest.raises(ProgramError, match="modulus"):
        run(fast, body_fit.bind(modulus=0.0), np.zeros((1, 8, 8, 3)))
