"""A sphere twisted about its normal: stuck (Reissner-Sagoci) and with partial slip (Lubkin).

While a torque grows, the outer ring slides and the inner disc of radius t turns as a whole. So each
step adds the stuck disc's traction ρ/√(t² - ρ²) with some weight g(t), t shrinking from a to c.
That the ring carries μp is Abel's equation for g, and its solution is

    g(t) = (2μp₀/π) E(√(1 - t²/a²)) / t,    E the complete elliptic integral.

Torque and twist are integrals of g, and the traction's integral is Lubkin's (1951) closed form.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebfit, chebpts1, chebval
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike

from cnnum.errors import PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting
from cnnum.tactile.contact.normal import inverse_root

# The integrand is smooth but for t² log t at 0: 40 points reach 1e-12 of the full torque.
_NODES, _WEIGHTS = leggauss(40)
_SERIES = 24
_MOSTLY = 0.5  # a share from which c, else a − c, is what is solved for


@broadcasting
def stuck_torsion_traction(rho: ArrayLike, torque: ArrayLike, radius: ArrayLike) -> Array:
    """Return the circumferential traction of a twisted disc that cannot slip.

    Parameters
    ----------
    rho : (...) float, m
        Distance from the axis.
    torque : (...) float, N m
        Torque T about the normal; the traction has its sign.
    radius : (...) float, m
        Radius a of the contact.

    Returns
    -------
    (...) float, Pa
        3Tρ / (4πa³ √(a² - ρ²)) inside, 0 outside; infinite on the rim.

    Raises
    ------
    PhysicsError
        If a distance is negative, the radius not positive, or a number not finite.

    References
    ----------
    Reissner & Sagoci (1944); Johnson, Contact Mechanics, 3.112.
    """
    distance = checks.not_negative("rho", rho)
    a = checks.positive("radius", radius)
    moment = checks.finite("torque", torque)
    return 3 * moment * distance / (4 * math.pi * a**3) * inverse_root(a, distance)


@broadcasting
def stuck_twist(torque: ArrayLike, radius: ArrayLike, shear_modulus: ArrayLike) -> Array:
    """Return the angle by which a stuck disc turns, β = 3T / (16 G a³), rad.

    Parameters
    ----------
    torque : (...) float, N m
        Torque about the normal.
    radius : (...) float, m
        Radius of the contact.
    shear_modulus : (...) float, Pa
        Shear modulus G = E / (2 (1 + ν)).

    Raises
    ------
    PhysicsError
        If the radius or modulus is not positive, or the torque is not finite.

    References
    ----------
    Reissner & Sagoci (1944).
    """
    a = checks.positive("radius", radius)
    stiffness = checks.positive("shear_modulus", shear_modulus)
    return 3 * checks.finite("torque", torque) / (16 * stiffness * a**3)


@broadcasting
def sliding_torque(load: ArrayLike, radius: ArrayLike, friction: ArrayLike) -> Array:
    """Return the torque at which a Hertz contact turns as a whole, 3πμPa/16, N m.

    Parameters
    ----------
    load : (...) float, N
        Normal load P, 0 or more.
    radius : (...) float, m
        Radius a of the contact.
    friction : (...) float
        Coefficient of friction μ.

    Raises
    ------
    PhysicsError
        If the load is negative, or the radius or friction not positive.
    """
    force = checks.not_negative("load", load)
    a = checks.positive("radius", radius)
    return 3 * math.pi / 16 * checks.positive("friction", friction) * force * a


@dataclass(frozen=True, slots=True)
class TorsionSlip:
    """A twisted Hertz contact whose inner disc sticks, under a torque that has only grown.

    Parameters
    ----------
    contact_radius : float, m
        Radius a of the contact.
    stick_radius : float, m
        Radius c of the part that sticks; 0 if everything slides.
    peak_traction : float, Pa
        Friction times peak pressure, μp₀.
    slip_width : float, m, optional
        Width a − c of the ring that slips. It is given for small torques, where it is below the
        rounding of a; otherwise, it is computed.
    """

    contact_radius: float
    stick_radius: float
    peak_traction: float
    slip_width: float | None = None

    @property
    def _ring(self) -> float:
        if self.slip_width is None:
            return self.contact_radius - self.stick_radius
        return self.slip_width

    def traction(self, rho: ArrayLike) -> Array:
        """Return the circumferential traction, Pa, at the distance `rho` (...) float, m."""
        distance = checks.not_negative("rho", rho)
        a, c = self.contact_radius, self.stick_radius
        inward = np.maximum(a - distance, 0.0)
        sliding = np.asarray(self.peak_traction / a * np.sqrt(inward * (a + distance)))
        sticks = inward > self._ring
        if c == 0 or not sticks.any():
            return sliding
        # the closed form is a small difference where little has slipped, and near the axis
        near = np.asarray(sticks & ((2 * c > a) | (2 * distance < c)))
        inside = np.where(sticks, distance, 0.0)
        result = np.where(near, self._summed(inside), sliding)
        if (other := np.asarray(sticks & ~near)).any():
            result = np.where(other, sliding * self._share(np.where(other, distance, c)), result)
        return np.asarray(result)

    def _summed(self, rho: Array) -> Array:
        """Return the traction at `rho` < c as the sum over the stuck discs, all of one sign."""
        place = np.asarray(rho)[..., np.newaxis]
        t, width = self._discs(place)
        return np.asarray((place * self._weight(t) * width * _WEIGHTS / 2).sum(axis=-1))

    def _discs(self, rho: Array) -> tuple[Array, Array]:
        """Return radii t of stuck discs from c to a, of (..., 1) ρ < c, and the width of their u.

        At t = ρ cosh u, so that dt / √(t² − ρ²) = du. With A = √(a² − ρ²) and C = √(c² − ρ²), u
        grows from c to a by log((a + A) / (c + C)), in which nothing cancels but a − c itself.
        """
        a, c, ring = self.contact_radius, self.stick_radius, self._ring
        outer = np.sqrt((a - rho) * (a + rho))
        inner = np.sqrt(np.maximum(a - rho - ring, 0.0) * (c + rho))
        width = np.log1p(ring * (1 + (a + c) / (outer + inner)) / (c + inner))
        # t from ρ e^u = c + C on: of a ρ of 0 it is C e^{…} itself
        growth = (c + inner) * np.exp(width * (_NODES + 1) / 2)
        return (growth + rho * rho / growth) / 2, width

    def _share(self, rho: Array) -> Array:
        """Return the traction over the sliding one at `rho` <= c, in Lubkin's closed form."""
        from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

        a, c = self.contact_radius, self.stick_radius
        sine = a / c * np.sqrt((c - rho) * (c + rho) / ((a - rho) * (a + rho)))
        angle = np.arcsin(np.minimum(sine, 1.0))
        m, n = (a - c) * (a + c) / a**2, (c / a) ** 2
        missing = ellipk(m) * ellipeinc(angle, n) - (ellipk(m) - ellipe(m)) * ellipkinc(angle, n)
        return np.asarray(1 - 2 / math.pi * missing)

    def potential(self, rho: Array) -> Array:
        """Return the integral of the traction from `rho`, m, to the rim, N/m."""
        a, c = self.contact_radius, self.stick_radius
        inside = np.minimum(rho, a)
        root = np.sqrt((a - inside) * (a + inside))
        sliding = self.peak_traction / (2 * a) * (a * a * np.arctan2(root, inside) - inside * root)
        if c == 0:
            return np.asarray(sliding)
        w = np.sqrt(np.maximum(c * c - rho * rho, 0.0))
        inner = chebval(2 * w / c - 1, self._stuck_series())
        return np.asarray(np.where(rho < c, inner, sliding), dtype=np.float64)

    def _stuck_series(self) -> Array:
        """Return the potential inside the stick radius as a Chebyshev series in √(c² - ρ²).

        It is analytic in that variable, nearest singularity at ±ic: 24 terms give 1e-15.
        """
        c = self.stick_radius
        unit = chebpts1(_SERIES + 1)
        rho = c * np.sqrt(1 - ((unit + 1) / 2) ** 2)[:, None]
        t, width = self._discs(rho)
        added = self._weight(t) * (t - rho) * (t + rho) * width / 2 * _WEIGHTS
        return np.asarray(chebfit(unit, added.sum(axis=-1), _SERIES), dtype=np.float64)

    def _weight(self, t: Array) -> Array:
        """Return g(t), Pa, of the stuck disc of radius t that the torque's growth added."""
        return 2 * self.peak_traction / math.pi * _elliptic(t / self.contact_radius) / t

    def twist(self, shear_modulus: float) -> float:
        """Return the angle of the stuck disc, rad, for the shear modulus G, Pa.

        At full sliding (c = 0) the closed form diverges as log(1/c): infinity is returned.
        """
        stiffness = checks.scalar("shear_modulus", checks.positive("shear_modulus", shear_modulus))
        if self.stick_radius == 0:
            return math.inf
        width = math.log1p(self._ring / self.stick_radius)
        t = self.stick_radius * np.exp(width * (_NODES + 1) / 2)
        total = float((self._weight(t) * t * _WEIGHTS).sum()) * width / 2
        return math.pi / (4 * stiffness) * total


def torsion_slip(load: float, radius: float, torque: float, friction: float) -> TorsionSlip:
    """Return the partial slip of a Hertz contact under a torque about its normal.

    Parameters
    ----------
    load : float, N
        Normal load P, above 0.
    radius : float, m
        Contact radius a under this load.
    torque : float, N m
        Magnitude T of the torque, 0 or more; from 3πμPa/16 on, everything slides.
    friction : float
        Coefficient of friction μ, above 0.

    Returns
    -------
    TorsionSlip
        The stick radius follows from T = (8μp₀/3) ∫ t² E(√(1 - t²/a²)) dt from c to a.

    Raises
    ------
    PhysicsError
        If the load, radius or friction is not positive, or the torque is negative.

    References
    ----------
    Lubkin, J. Appl. Mech. 18 (1951) 183; Johnson, Contact Mechanics, 7.5.
    """
    force = checks.scalar("load", checks.positive("load", load))
    a = checks.scalar("radius", checks.positive("radius", radius))
    rub = checks.scalar("friction", checks.positive("friction", friction))
    limit = float(sliding_torque(force, a, rub))
    if not (limit > 0.0 and a * a > 0.0):
        raise PhysicsError(f"A load of {force:g} N on a radius of {a:g} m gives no finite torque.")
    share = checks.scalar("torque", checks.not_negative("torque", torque)) / limit
    peak = rub * 3 * force / (2 * math.pi * a * a)
    return TorsionSlip(a, a * stick_ratio(share), peak, a * slip_ratio(share))


def stick_ratio(share: float) -> float:
    """Return c/a for a torque of `share` times the sliding one; 0 from a share of 1 on."""
    if share >= _MOSTLY:
        if share >= 1:
            return 0.0
        return _root(lambda c: _torque_share(1 - c, c) - share)
    return 1.0 - slip_ratio(share)


def slip_ratio(share: float) -> float:
    """Return 1 − c/a, to its own last digits however small the share is."""
    if share <= 0:
        return 0.0
    if share >= _MOSTLY:
        return 1.0 - stick_ratio(share)
    # a share s of 1 slips by about 3π s/32 where it is small, and by less than s everywhere below
    return share * _root(lambda d: _torque_share(d * share, 1 - d * share) / share - 1)


def _root(f: Callable[[float], float]) -> float:
    """Return the zero of a function between 0 and 1."""
    from scipy.optimize import brentq

    return float(brentq(f, 0.0, 1.0, xtol=1e-15, rtol=1e-14))


def _torque_share(slip: float, stick: float) -> float:
    """Return the torque over the sliding one of the ratios 1 − c/a and c/a."""
    t = stick + slip * (_NODES + 1) / 2
    total = float((t * t * _elliptic(t) * _WEIGHTS).sum()) * slip / 2
    return total / (3 * math.pi**2 / 64)


def _elliptic(ratio: Array) -> Array:
    from scipy.special import ellipe

    return np.asarray(ellipe(1 - ratio * ratio), dtype=np.float64)
