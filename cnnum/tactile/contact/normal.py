"""A sphere or a rigid flat punch pressed on an elastic half-space, and a sphere pulled sideways."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting


def contact_modulus(youngs_modulus: ArrayLike, poisson: ArrayLike = 0.5) -> Array:
    """Return the modulus E* = E / (1 - ν²) of an elastic half-space under a rigid body.

    Parameters
    ----------
    youngs_modulus, poisson : (...) float
        Young's modulus, Pa, and Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (...) float, Pa
        Contact modulus; for two elastic bodies, their values of 1/E* add.

    Raises
    ------
    PhysicsError
        If E <= 0 or ν is out of range.
    """
    ratio = checks.poisson_ratio(poisson)
    return checks.positive("youngs_modulus", youngs_modulus) / (1 - ratio * ratio)


def shear_compliance(youngs_modulus: ArrayLike, poisson: ArrayLike = 0.5) -> Array:
    """Return (2 - ν)/G = 2 (1 + ν)(2 - ν)/E, 1/Pa, of an elastic half-space under a rigid body.

    Parameters and errors are those of `contact_modulus`; the compliances of two elastic bodies add.
    """
    ratio = checks.poisson_ratio(poisson)
    return 2 * (1 + ratio) * (2 - ratio) / checks.positive("youngs_modulus", youngs_modulus)


@dataclass(frozen=True, slots=True)
class Hertz:
    """The contact of a sphere: its radius, peak pressure and approach (arrays broadcast).

    Parameters
    ----------
    contact_radius : (...) float, m
        Radius a of the contact.
    peak_pressure : (...) float, Pa
        Pressure p₀ at its centre.
    approach : (...) float, m
        How far the sphere's centre moves towards the half-space.
    """

    contact_radius: Array
    peak_pressure: Array
    approach: Array

    def pressure(self, rho: ArrayLike) -> Array:
        """Return the pressure, Pa, at the distance `rho` (...) float, m, from the centre."""
        distance = checks.not_negative("rho", rho)
        inside = np.maximum(self.contact_radius**2 - distance**2, 0.0)
        flat = np.where(self.contact_radius > 0, self.contact_radius, 1.0)
        return np.asarray(self.peak_pressure * np.sqrt(inside) / flat)


@broadcasting
def hertz(load: ArrayLike, sphere_radius: ArrayLike, modulus: ArrayLike) -> Hertz:
    """Return the contact of a sphere under a normal load.

    Parameters
    ----------
    load : (...) float, N
        Normal load P, 0 or more.
    sphere_radius : (...) float, m
        Radius R of the sphere (relative curvature of two bodies).
    modulus : (...) float, Pa
        Contact modulus E*, see `contact_modulus`.

    Returns
    -------
    Hertz
        a³ = 3PR/(4E*), p₀ = 3P/(2πa²), approach a²/R.

    Raises
    ------
    PhysicsError
        If the load is negative, or the radius or modulus not positive.

    References
    ----------
    Johnson, Contact Mechanics, 4.22-4.24.
    """
    force = checks.not_negative("load", load)
    radius = checks.positive("sphere_radius", sphere_radius)
    stiffness = checks.positive("modulus", modulus)
    a = np.cbrt(3 * force * radius / (4 * stiffness))
    return Hertz(
        contact_radius=a,
        peak_pressure=2 * stiffness * a / (math.pi * radius),
        approach=a * a / radius,
    )


@broadcasting
def punch_pressure(rho: ArrayLike, load: ArrayLike, radius: ArrayLike) -> Array:
    """Return the pressure below a rigid flat circular punch.

    Parameters
    ----------
    rho : (...) float, m
        Distance from the axis.
    load : (...) float, N
        Normal load P, 0 or more.
    radius : (...) float, m
        Radius a of the punch.

    Returns
    -------
    (...) float, Pa
        P / (2πa √(a² - ρ²)) inside, 0 outside; infinite on the rim itself.

    Raises
    ------
    PhysicsError
        If a distance or the load is negative, or the radius not positive.

    References
    ----------
    Johnson, Contact Mechanics, 3.34.
    """
    distance = checks.not_negative("rho", rho)
    force = checks.not_negative("load", load)
    a = checks.positive("radius", radius)
    return force / (2 * math.pi * a) * inverse_root(a, distance)


@broadcasting
def punch_indentation(load: ArrayLike, radius: ArrayLike, modulus: ArrayLike) -> Array:
    """Return the indentation by a rigid flat circular punch, P / (2 a E*), m.

    Parameters
    ----------
    load : (...) float, N
        Normal load, 0 or more.
    radius : (...) float, m
        Radius of the punch.
    modulus : (...) float, Pa
        Contact modulus E*.

    Raises
    ------
    PhysicsError
        As `hertz`.

    References
    ----------
    Johnson, Contact Mechanics, 3.36.
    """
    force = checks.not_negative("load", load)
    a = checks.positive("radius", radius)
    return force / (2 * a * checks.positive("modulus", modulus))


def inverse_root(a: Array, rho: Array) -> Array:
    """Return 1/√(a² - ρ²) inside, 0 outside, infinity at ρ = a."""
    a, rho = np.broadcast_arrays(a, rho)
    square = np.where(rho <= a, (a - rho) * (a + rho), np.inf)
    result = np.full(square.shape, np.inf)
    np.divide(1.0, np.sqrt(square), out=result, where=square > 0)
    return result


@dataclass(frozen=True, slots=True)
class PartialSlip:
    """Stick zone and traction of a sphere under a tangential force that has only grown.

    The traction points along the force everywhere (Cattaneo, Mindlin). This is exact for ν = 0 and
    the usual approximation otherwise. Normal and tangential loads do not couple, which is exact at
    ν = 0.5 against a rigid body.

    Parameters
    ----------
    contact_radius : (...) float, m
        Radius a of the contact.
    stick_radius : (...) float, m
        Radius c of the part that sticks; 0 if everything slides.
    peak_traction : (...) float, Pa
        Friction times peak pressure, μp₀.
    slip_width : (...) float, m, optional
        Width a − c of the ring that slips. It is given for small forces, where it is below the
        rounding of a; otherwise, it is computed.
    """

    contact_radius: Array
    stick_radius: Array
    peak_traction: Array
    slip_width: Array | None = None

    def traction(self, rho: ArrayLike) -> Array:
        """Return the magnitude of the shear traction, Pa, at the distance `rho` (...) float, m."""
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
        Magnitude Q of the tangential force; from μP on, everything slides and carries μP.
    friction : (...) float
        Coefficient of friction μ, above 0.

    Returns
    -------
    PartialSlip
        Stick radius c = a (1 - Q/(μP))^(1/3), and the traction q = μ (p under P - p under P - Q/μ).

    Raises
    ------
    PhysicsError
        If the load or friction is not positive, or the tangential force is negative.

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
        δ = 3μP/(16a) (2 - ν)/G [1 - (1 - Q/(μP))^(2/3)]; for Q >= μP, the value at which sliding
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
        Magnitude Q of the tangential force.
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
