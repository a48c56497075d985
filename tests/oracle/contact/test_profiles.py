"""Hertz, punch, partial slip and twist: displacements under their tractions, by quadrature.

One check is that "the stuck part moves as one". There the traction is integrated with the surface
displacement of a ring of point loads. Its complete elliptic integrals are in no formula under test.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import integrate, special

from cnnum.arrays import Floats
from cnnum.errors import PhysicsError
from cnnum.tactile import contact

LOAD, RADIUS, MODULUS, FRICTION = 0.5, 5e-3, 1.2e6, 0.6


def ring_potential(r: float, s: Floats) -> Floats:
    """Return the integral over a ring of radius s of 1/distance to a point at radius r."""
    return 4 * s / (r + s) * special.ellipkm1(((r - s) / (r + s)) ** 2)


def ring_swirl(r: float, s: Floats) -> Floats:
    """Return the same, weighted with the cosine between the two circumferential directions."""
    rest = ((r - s) / (r + s)) ** 2
    m = 1 - rest
    return 4 * s / (r + s) * ((2 - m) * special.ellipkm1(rest) - 2 * special.ellipe(m)) / m


def integral(kernel: Any, profile: Callable[[Floats], Any], r: float, a: float, c: float) -> float:
    """Integrate over s = a sin t by double exponential points, split where it is singular."""
    splits = [t for t in (math.asin(min(r / a, 1.0)), math.asin(c / a)) if 0 < t < math.pi / 2]
    edges = [0.0, *sorted(splits), math.pi / 2]
    total = 0.0
    for low, high in pairwise(edges):
        u = np.linspace(-3.0, 3.0, 121)
        share = 1 / (1 + np.exp(-np.pi * np.sinh(u)))
        weight = (high - low) * np.pi * np.cosh(u) * share * (1 - share) * 0.05
        s = a * np.sin(low + (high - low) * share)
        live = (np.abs(s - r) > 1e-14 * a) & (s < a)
        s, t = s[live], (low + (high - low) * share)[live]
        total += float((profile(s) * kernel(r, s) * a * np.cos(t) * weight[live]).sum())
    return total


@pytest.fixture
def sphere() -> contact.Hertz:
    return contact.hertz(LOAD, RADIUS, MODULUS)


def test_hertz_agrees_with_contactmechanics(sphere: contact.Hertz) -> None:
    pytest.importorskip("ContactMechanics")
    from ContactMechanics.ReferenceSolutions import Hertz as Peer

    a, p0 = Peer.radius_and_pressure(LOAD, RADIUS, MODULUS)
    # the same closed forms: rounding
    assert sphere.contact_radius == pytest.approx(a, rel=1e-14)
    assert sphere.peak_pressure == pytest.approx(p0, rel=1e-14)
    assert sphere.approach == pytest.approx(Peer.penetration(LOAD, RADIUS, MODULUS), rel=1e-14)


def test_hertz_pressure_bends_the_surface_to_the_sphere(sphere: contact.Hertz) -> None:
    a = float(sphere.contact_radius)
    for r in (0.05 * a, 0.5 * a, 0.95 * a):
        moved = integral(ring_potential, sphere.pressure, r, a, 0.0) / (math.pi * MODULUS)
        # the part that points within 1e-14 of the logarithm leave out
        assert moved == pytest.approx(float(sphere.approach) - r * r / (2 * RADIUS), rel=1e-7)
    total = integrate.quad(lambda r: 2 * math.pi * r * float(sphere.pressure(r)), 0, a)[0]
    assert total == pytest.approx(LOAD, rel=1e-8)


def test_a_flat_punch_sinks_as_a_whole() -> None:
    a = 1e-3
    sunk = float(contact.punch_indentation(LOAD, a, MODULUS))
    for r in (0.1 * a, 0.7 * a):
        moved = integral(
            ring_potential, lambda s: contact.punch_pressure(s, LOAD, a), r, a, 0.0
        ) / (math.pi * MODULUS)
        assert moved == pytest.approx(sunk, rel=1e-7)
    assert contact.punch_pressure(a, LOAD, a) == math.inf
    assert contact.punch_pressure(1.01 * a, LOAD, a) == 0


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_partial_slip_moves_the_stuck_disc_as_one(sphere: contact.Hertz, share: float) -> None:
    """At ν = 0, where Cattaneo's tractions displace the surface as a pressure does, 2G for E*."""
    pull, shear_modulus, a = share * FRICTION * LOAD, 3e5, float(sphere.contact_radius)
    slip = contact.partial_slip(sphere, LOAD, pull, FRICTION)
    c = float(slip.stick_radius)
    softness = contact.shear_compliance(2 * shear_modulus, 0.0)
    delta = float(contact.tangential_displacement(sphere, LOAD, pull, FRICTION, softness))

    def moved(r: float) -> float:
        return integral(ring_potential, slip.traction, r, a, c) / (2 * math.pi * shear_modulus)

    for r in (0.1 * c, 0.6 * c, 0.99 * c):
        assert moved(r) == pytest.approx(delta, rel=1e-7, abs=0)
    # outside it lags behind the sphere: that is slip, against the friction's direction
    lag = [delta - moved(r) for r in np.linspace(c, a, 4)[1:]]
    assert 0 < lag[0] < lag[1] < lag[2]
    total = integrate.quad(lambda r: 2 * math.pi * r * float(slip.traction(r)), 0, a, points=[c])
    assert total[0] == pytest.approx(pull, rel=1e-8, abs=0)
    assert c / a == pytest.approx((1 - share) ** (1 / 3), rel=1e-14)


def test_partial_slip_is_bounded_by_friction_and_by_its_limits(sphere: contact.Hertz) -> None:
    rho = np.linspace(0, 1.2, 400) * sphere.contact_radius
    limit = FRICTION * sphere.pressure(rho)
    for share in (0.01, 0.6, 1.0, 3.0):
        slip = contact.partial_slip(sphere, LOAD, share * FRICTION * LOAD, FRICTION)
        traction = slip.traction(rho)
        outside = rho >= slip.stick_radius
        np.testing.assert_allclose(traction[outside], limit[outside], rtol=1e-12)
        assert (traction <= limit * (1 + 1e-12)).all()
        assert (traction >= 0).all()
    assert contact.partial_slip(sphere, LOAD, 9.9, FRICTION).stick_radius == 0
    # a small force moves the sphere as if nothing slipped: δ = Q (2 - ν) / (8 a G)
    tiny = contact.tangential_displacement(sphere, LOAD, 1e-9, FRICTION, 2e-6)
    assert tiny == pytest.approx(1e-9 * 2e-6 / 8 / float(sphere.contact_radius), rel=1e-8)
    edge = contact.tangential_displacement(sphere, LOAD, FRICTION * LOAD, FRICTION, 2e-6)
    whole = 3 * FRICTION * LOAD / (16 * float(sphere.contact_radius)) * 2e-6
    assert edge == pytest.approx(whole, rel=1e-14)


def test_the_stuck_shear_moves_the_disc_as_one() -> None:
    """Mindlin at ν = 0: δ = Q/(4aG)."""
    a, shear_modulus = 1e-3, 3e5
    for r in (0.2 * a, 0.8 * a):
        moved = integral(
            ring_potential, lambda s: contact.stuck_traction(s, LOAD, a), r, a, 0.0
        ) / (2 * math.pi * shear_modulus)
        assert moved == pytest.approx(LOAD / (4 * a * shear_modulus), rel=1e-7)


def test_reissner_sagoci_turns_the_disc_as_one() -> None:
    a, shear_modulus, torque = 1e-3, 3e5, -2e-4
    beta = float(contact.stuck_twist(torque, a, shear_modulus))
    assert torque == pytest.approx(16 / 3 * shear_modulus * a**3 * beta, rel=1e-14)

    def traction(rho: float) -> Any:
        return contact.stuck_torsion_traction(rho, torque, a)

    for r in (0.2 * a, 0.8 * a):
        moved = integral(ring_swirl, traction, r, a, 0.0) / (2 * math.pi * shear_modulus)
        assert moved == pytest.approx(beta * r, rel=1e-7, abs=0)
    total = (
        a
        * integrate.quad(
            lambda t: (
                2
                * math.pi
                * (a * math.sin(t)) ** 2
                * float(traction(a * math.sin(t)))
                * math.cos(t)
            ),
            0,
            math.pi / 2,
        )[0]
    )
    assert total == pytest.approx(torque, rel=1e-8)


@pytest.mark.parametrize("share", [0.02, 0.5, 0.95, 0.9999])
def test_lubkins_stuck_disc_turns_as_one(sphere: contact.Hertz, share: float) -> None:
    a, shear_modulus = float(sphere.contact_radius), 3e5
    torque = share * float(contact.sliding_torque(LOAD, a, FRICTION))
    slip = contact.torsion_slip(LOAD, a, torque, FRICTION)
    c, beta = slip.stick_radius, slip.twist(shear_modulus)

    def moved(r: float) -> float:
        return integral(ring_swirl, slip.traction, r, a, c) / (2 * math.pi * shear_modulus)

    for r in (0.2 * c, 0.9 * c):
        assert moved(r) == pytest.approx(beta * r, rel=2e-6, abs=0)
    assert moved(0.5 * (a + c)) < beta * 0.5 * (a + c)
    total = integral(lambda r, rho: 2 * math.pi * rho**2, slip.traction, c, a, c)
    assert total == pytest.approx(torque, rel=1e-7, abs=0)
    inside = np.linspace(0, c, 50)
    assert (slip.traction(inside) <= FRICTION * sphere.pressure(inside) * (1 + 1e-12)).all()


def test_torsion_between_stuck_and_sliding(sphere: contact.Hertz) -> None:
    a = float(sphere.contact_radius)
    limit = 3 * math.pi / 16 * FRICTION * LOAD * a
    turned = integrate.quad(
        lambda r: 2 * math.pi * r * r * FRICTION * float(sphere.pressure(r)), 0, a
    )[0]
    assert limit == pytest.approx(turned, rel=1e-8)
    small = contact.torsion_slip(LOAD, a, 1e-4 * limit, FRICTION)
    # next to no slip: the twist is Reissner & Sagoci's, up to a share of 1e-4
    assert small.twist(3e5) == pytest.approx(
        float(contact.stuck_twist(1e-4 * limit, a, 3e5)), rel=1e-4
    )
    assert not contact.torsion_slip(LOAD, a, 0.0, FRICTION).traction([0.0, 0.5 * a, a]).any()
    full = contact.torsion_slip(LOAD, a, 2 * limit, FRICTION)
    assert full.stick_radius == 0
    assert full.twist(3e5) == math.inf
    rho = np.linspace(0, a, 20)
    np.testing.assert_allclose(full.traction(rho), FRICTION * sphere.pressure(rho), rtol=1e-12)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda s: contact.hertz(-1.0, RADIUS, MODULUS),
        lambda s: contact.hertz(1.0, 0.0, MODULUS),
        lambda s: contact.hertz(1.0, RADIUS, math.nan),
        lambda s: contact.contact_modulus(1.0, 0.7),
        lambda s: contact.partial_slip(s, 0.0, 1.0, FRICTION),
        lambda s: contact.partial_slip(s, LOAD, -1.0, FRICTION),
        lambda s: contact.torsion_slip(LOAD, 1e-3, -1.0, FRICTION),
        lambda s: contact.stuck_twist(1.0, 1e-3, 0.0),
        lambda s: contact.punch_pressure(-1.0, LOAD, 1e-3),
    ],
)
def test_bad_parameters_are_refused(sphere: contact.Hertz, wrong: Any) -> None:
    with pytest.raises(PhysicsError):
        wrong(sphere)


def test_hertz_broadcasts_and_starts_at_nothing() -> None:
    found = contact.hertz([[0.0], [LOAD]], [RADIUS, 2 * RADIUS], MODULUS)
    assert found.contact_radius.shape == (2, 2)
    assert (found.pressure(0.0)[0] == 0).all()
    assert found.pressure(0.0)[1, 0] == pytest.approx(float(found.peak_pressure[1, 0]))
