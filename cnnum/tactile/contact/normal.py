"""A sphere, or a rigid flat punch, pressed on an elastic half-space without friction."""

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
        Contact modulus; for two elastic bodies 1/E* is the sum of theirs.

    Raises
    ------
    PhysicsError
        If E <= 0 or ν is out of range.
    """
    ratio = checks.poisson_ratio(poisson)
    return checks.positive("youngs_modulus", youngs_modulus) / (1 - ratio * ratio)


def shear_compliance(youngs_modulus: ArrayLike, poisson: ArrayLike = 0.5) -> Array:
    """Return (2 - ν)/G = 2 (1 + ν)(2 - ν)/E, 1/Pa, of an elastic half-space under a rigid body.

    Parameters and errors are those of `contact_modulus`; two elastic bodies' compliances add.
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
    """Return how deep a rigid flat circular punch goes, P / (2 a E*), m.

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
