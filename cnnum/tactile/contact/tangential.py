"""A sphere pulled sideways: Cattaneo-Mindlin partial slip, no slip, and full sliding."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting
from cnnum.tactile.contact.normal import Hertz, inverse_root


@dataclass(frozen=True, slots=True)
class PartialSlip:
    """Stick zone and traction of a sphere, under a tangential force that only grew.

    The traction points along the force everywhere (Cattaneo, Mindlin). That is exact for ν = 0 and
    the field's usual approximation else. Normal and tangential loads do not couple, which is exact
    at ν = 0.5 against a rigid body.

    Parameters
    ----------
    contact_radius : (...) float, m
        Radius a of the contact.
    stick_radius : (...) float, m
        Radius c of the part that sticks; 0 when all slides.
    peak_traction : (...) float, Pa
        Friction times peak pressure, μp₀.
    slip_width : (...) float, m, optional
        Width a − c of the ring that slips, for a small force far below the roundings of a; their
        difference unless given.
    """

    contact_radius: Array
    stick_radius: Array
    peak_traction: Array
    slip_width: Array | None = None

    def traction(self, rho: ArrayLike) -> Array:
        """Return the shear traction's size, Pa, at the distance `rho` (...) float, m."""
        distance = checks.not_negative("rho", rho)
        a, c, ring = self.contact_radius, self.stick_radius, self.slip_width
        ring = a - c if ring is None else ring
        inward = np.maximum(a - distance, 0.0)
        whole = np.sqrt(inward * (a + distance))
        stuck = np.sqrt(np.maximum(inward - ring, 0.0) * (c + distance))
        # √(a² − ρ²) − √(c² − ρ²) where it sticks, without a difference
        sticks = inward > ring
        less = np.where(sticks, ring * (a + c) / np.where(sticks, whole + stuck, 1.0), whole)
        return np.asarray(self.peak_traction / a * less)


def partial_slip(
    contact: Hertz, load: ArrayLike, tangential: ArrayLike, friction: ArrayLike
) -> PartialSlip:
    """Return the partial slip of a Hertz contact under a tangential force.

    Parameters
    ----------
    contact : Hertz
        The contact under the normal load.
    load : (...) float, N
        Normal load P, above 0.
    tangential : (...) float, N
        Size Q of the tangential force; from μP on everything slides and carries μP.
    friction : (...) float
        Coefficient of friction μ, above 0.

    Returns
    -------
    PartialSlip
        Stick radius c = a (1 - Q/(μP))^(1/3), and the traction
        q = μ (p of the load - p of the load less Q/μ).

    Raises
    ------
    PhysicsError
        If the load or friction is not positive or the tangential force negative.

    References
    ----------
    Johnson, Contact Mechanics, 7.28-7.30; Ciavarella (1998), Jäger (1998).
    """
    checks.record("contact", contact, Hertz)
    share, a = slip_share(load, tangential, friction), contact.contact_radius
    with np.errstate(divide="ignore"):  # where all slides
        ring = -np.expm1(np.log1p(-share) / 3)
    return PartialSlip(
        contact_radius=a,
        stick_radius=np.asarray(a * np.cbrt(1 - share)),
        slip_width=np.asarray(a * ring),
        peak_traction=checks.positive("friction", friction) * contact.peak_pressure,
    )


def tangential_displacement(
    contact: Hertz,
    load: ArrayLike,
    tangential: ArrayLike,
    friction: ArrayLike,
    compliance: ArrayLike,
) -> Array:
    """Return how far a sphere moves sideways before it slides.

    Parameters
    ----------
    contact, load, tangential, friction
        As in `partial_slip`.
    compliance : (...) float, 1/Pa
        (2 - ν)/G, see `shear_compliance`.

    Returns
    -------
    (...) float, m
        δ = 3μP/(16a) (2 - ν)/G [1 - (1 - Q/(μP))^(2/3)]; at Q >= μP the value where sliding
        begins.

    Raises
    ------
    PhysicsError
        As `partial_slip`; also if the compliance is not positive.

    References
    ----------
    Johnson, Contact Mechanics, 7.40.
    """
    checks.record("contact", contact, Hertz)
    share = slip_share(load, tangential, friction)
    softness = checks.positive("compliance", compliance)
    whole = 3 * checks.positive("friction", friction) * checks.positive("load", load)
    # 1 - (1 - s)^(2/3) without cancellation for a small share s
    with np.errstate(divide="ignore"):
        grown = -np.expm1(2 / 3 * np.log1p(-share))
    return np.asarray(whole / (16 * contact.contact_radius) * softness * grown)


@broadcasting
def stuck_traction(rho: ArrayLike, tangential: ArrayLike, radius: ArrayLike) -> Array:
    """Return the shear traction, Pa, of a contact that cannot slip: Q / (2πa √(a² - ρ²)).

    Parameters
    ----------
    rho : (...) float, m
        Distance from the axis.
    tangential : (...) float, N
        Size Q of the tangential force.
    radius : (...) float, m
        Radius a of the contact.

    Raises
    ------
    PhysicsError
        If a distance or the force is negative, or the radius not positive.

    References
    ----------
    Mindlin (1949); Johnson, Contact Mechanics, 7.36.
    """
    distance = checks.not_negative("rho", rho)
    force = checks.not_negative("tangential", tangential)
    a = checks.positive("radius", radius)
    return force / (2 * math.pi * a) * inverse_root(a, distance)


def slip_share(load: ArrayLike, tangential: ArrayLike, friction: ArrayLike) -> Array:
    """Return Q/(μP), at most 1."""
    force = checks.not_negative("tangential", tangential)
    limit = checks.positive("friction", friction) * checks.positive("load", load)
    return np.minimum(force / limit, 1.0)
