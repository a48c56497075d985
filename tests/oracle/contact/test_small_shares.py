"""Partial slip at every share of the sliding force, down to numbers that a float hardly holds.

The references are the definitions in 50 digits; nothing of the package is in them.
"""

import math
from collections.abc import Callable

import numpy as np
import pytest
from mpmath import mp, mpf

from cnnum.tactile.contact.normal import PartialSlip, hertz, partial_slip
from cnnum.tactile.contact.torsion import TorsionSlip, stuck_twist, torsion_slip

A, MU, P = 2e-3, 0.5, 2.0  # of which the sliding force, 1 N, is no rounded number
PEAK = MU * 3 * P / (2 * math.pi * A**2)
SHARES = [1e-300, 1e-30, 1e-17, 1e-12, 1e-9, 1e-6, 1e-3, 0.1, 0.4, 0.6, 0.9, 0.999, 1 - 1e-9]
PLACES = [0.0, 1e-9, 1e-3, 0.1, 0.5, 0.9, 0.999]
"""As parts of the contact radius."""


@pytest.mark.parametrize("share", SHARES)
def test_traction_of_a_pull_is_its_definition(share: float) -> None:
    contact = hertz(P, A**3 * 4 / 3 / P, 1.0)  # of the contact radius A
    a = float(contact.contact_radius)
    slip = partial_slip(contact, P, share * MU * P, MU)
    rho = a * np.array([*PLACES, 1.0, 1.5])
    found = slip.traction(rho) / float(slip.peak_traction)
    with mp.workdps(400):
        c = mpf(1) - mpf(share)
        c = c ** (mpf(1) / 3)
        for place, got in zip(rho / a, found, strict=True):
            outer = mp.sqrt(max(1 - mpf(place) ** 2, 0))
            inner = mp.sqrt(max(c**2 - mpf(place) ** 2, 0))
            wanted = float(outer - inner)
            # a place next to c is one of roundings: the traction is steep there
            if abs(float(c) - place) > 1e-6:
                assert got == pytest.approx(wanted, rel=1e-13, abs=0.0), place


def stick(share: float) -> tuple[mpf, mpf]:
    """The ratio 1 − c/a of a torque, and c/a, of T = ∫ t² E(1 − t²) dt from c to 1."""

    def torque(slip: mpf) -> mpf:
        whole = 3 * mp.pi**2 / 64
        return mp.quad(lambda t: t * t * mp.ellipe(1 - t * t), [1 - slip, 1]) / whole

    start = mpf(share) * 3 * mp.pi / 32 if share < 0.5 else 1 - mp.cbrt(1 - mpf(share)) * mpf("1.1")
    slip = mp.findroot(lambda d: torque(d) / mpf(share) - 1, (start, start * mpf("1.02")))
    return slip, 1 - slip


@pytest.mark.parametrize("share", [1e-30, 1e-12, 1e-9, 1e-3, 0.4, 0.6, 0.9, 0.999])
def test_traction_and_twist_of_a_torque_are_their_integrals(share: float) -> None:
    """Of stuck discs of radii from c to a, each with the weight g(t) = (2/π) E(√(1 − t²)) / t."""
    slip = torsion_slip(P, A, share * 3 * math.pi / 16 * MU * P * A, MU)
    with mp.workdps(20 if share > 1e-4 else 60):
        d, c = stick(share)
        weight = lambda t: 2 / mp.pi * mp.ellipe(1 - t * t) / t  # noqa: E731
        assert slip.slip_width / A == pytest.approx(float(d), rel=1e-12, abs=0.0)
        twist = mp.pi / 4 * mp.quad(weight, [c, 1])
        assert slip.twist(1.0) / PEAK == pytest.approx(float(twist), rel=1e-11, abs=0.0)
        for place in PLACES[:2] + PLACES[4:]:
            if place >= c - mpf("1e-6"):
                continue
            rho = mpf(place)
            got = float(slip.traction(place * A)) / PEAK
            assert got == pytest.approx(summed(weight, rho, c), rel=1e-10, abs=0.0), place


def summed(weight: Callable[[mpf], mpf], rho: mpf, c: mpf) -> float:
    """∫ g(t) ρ / √(t² − ρ²) dt, in w = √(t² − ρ²), where there is no root in the denominator."""
    low, high = (mp.sqrt(t**2 - rho**2) for t in (c, mpf(1)))
    return float(mp.quad(lambda w: weight(mp.hypot(w, rho)) * rho / mp.hypot(w, rho), [low, high]))


def test_the_smallest_torque_is_that_of_a_stuck_disc() -> None:
    torque = 1e-200
    slip = torsion_slip(P, A, torque, MU)
    assert slip.twist(3.0) == pytest.approx(float(stuck_twist(torque, A, 3.0)), rel=1e-12)
    inside = slip.potential(np.array([0.5 * A]))
    # ∫ 3Tρ / (4πa³ √(a² − ρ²)) dρ from ρ to the rim
    wanted = 3 * torque / (4 * math.pi * A**3) * math.sqrt(0.75) * A
    assert inside == pytest.approx(wanted, rel=1e-12)


def test_records_without_a_width_take_the_difference() -> None:
    pull = PartialSlip(np.asarray(1.0), np.asarray(0.6), np.asarray(2.0))
    assert pull.traction(0.3) == pytest.approx(2.0 * (math.sqrt(0.91) - math.sqrt(0.27)))
    turn, known = TorsionSlip(1.0, 0.6, 2.0), TorsionSlip(1.0, 0.6, 2.0, 0.4)
    assert turn.traction(0.3) == pytest.approx(known.traction(0.3))
