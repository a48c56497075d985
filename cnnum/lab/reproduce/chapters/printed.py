"""The dissertation's equations as they are printed, for a comparison with the package.

Written down once more on purpose, and in the notation of the print: u is strain, (F, Q, R) the
load along (z, x, y), A the ratio of shear to normal strain.
"""

from math import pi

import numpy as np

from cnnum.arrays import Floats


def displacement(place: Floats, load: Floats, modulus: float, nu: float) -> Floats:
    """Return (4.9): displacement for any Poisson ratio."""
    x, y, z = place
    q, r_, f = load
    r = np.sqrt(x**2 + y**2 + z**2)
    scale = (1 + nu) / (2 * pi * modulus)
    fade = (1 - 2 * nu) / (r * (r + z))
    shear = (2 * (1 - nu) * r + z) / (r * (r + z))
    mix = (2 * r * (nu * r + z) + z**2) / (r**3 * (r + z) ** 2) * (x * q + y * r_)
    u_x = (x * z / r**3 - fade * x) * f + shear * q + mix * x
    u_y = (y * z / r**3 - fade * y) * f + shear * r_ + mix * y
    u_z = (2 * (1 - nu) / r + z**2 / r**3) * f + (fade + z / r**3) * (x * q + y * r_)
    return np.asarray(scale * np.stack([u_x, u_y, u_z]))


def displacement_of_rubber(place: Floats, load: Floats, modulus: float) -> Floats:
    """Return (4.10): displacement at ν = 0.5."""
    x, y, z = place
    q, r_, f = load
    r = np.sqrt(x**2 + y**2 + z**2)
    rows = [
        x * z * f + (r**2 + x**2) * q + x * y * r_,
        y * z * f + x * y * q + (r**2 + y**2) * r_,
        (r**2 + z**2) * f + x * z * q + y * z * r_,
    ]
    return np.asarray(3 / (4 * pi * r**3 * modulus) * np.stack(rows))


def stress(place: Floats, load: Floats) -> Floats:
    """Return (4.11): (3, 3, …) stress at ν = 0.5."""
    r = np.sqrt(np.sum(place**2, axis=0))
    return np.asarray(-3 / (2 * pi * r**5) * place[:, None] * place[None] * _lever(place, load))


def strain(place: Floats, load: Floats, modulus: float) -> Floats:
    """Return (4.12): (3, 3, …) strain at ν = 0.5."""
    r = np.sqrt(np.sum(place**2, axis=0))
    own = np.eye(3).reshape(3, 3, *[1] * r.ndim) * r**2
    rows = own - 3 * place[:, None] * place[None]
    return np.asarray(3 / (4 * pi * modulus * r**5) * rows * _lever(place, load))


def energy(place: Floats, load: Floats, modulus: float) -> Floats:
    """Return (4.13): strain energy density."""
    r = np.sqrt(np.sum(place**2, axis=0))
    return np.asarray(9 * _lever(place, load) ** 2 / (8 * modulus * pi**2 * r**6))


def ratio_squared(u_xz: Floats, u_yz: Floats, u_zz: Floats) -> Floats:
    """Return A² of (5.2) from the strains."""
    return np.asarray((u_xz**2 + u_yz**2) / u_zz**2)


def ratio_squared_at(rho: Floats, z: float) -> Floats:
    """Return A² of (5.2) from the place."""
    return np.asarray(9 * z**2 * rho**2 / (rho**2 - 2 * z**2) ** 2)


def both_roots(a_squared: Floats, z: float) -> tuple[Floats, Floats]:
    """Return ρ₁², ρ₂² of (5.3), the larger first."""
    root = np.sqrt(81 + 72 * a_squared)
    return tuple(z**2 * (2 + (9 + sign * root) / (2 * a_squared)) for sign in (1, -1))  # type: ignore[return-value]


def inside(a_squared: Floats, z: float) -> Floats:
    """Return ρ² of (5.4)."""
    return np.asarray(z**2 * (2 - 12 / (np.sqrt(9 + 8 * a_squared) + 3)))


def outside(a_squared: Floats, z: float) -> Floats:
    """Return ρ² of (5.5)."""
    return np.asarray(z**2 * (2 + 12 / (np.sqrt(9 + 8 * a_squared) - 3)))


def moment(u_zz: Floats, rho: Floats, z: float, modulus: float) -> Floats:
    """Return Qx + Ry + Fz of (5.8)."""
    scale = 4 * pi * modulus * (rho**2 + z**2) ** 2.5
    return np.asarray(u_zz * scale / (3 * (rho**2 - 2 * z**2)))


def normal_force(u_zz: Floats, rho: Floats, z: float, modulus: float) -> Floats:
    """Return F of (5.7)."""
    scale = 4 * pi * modulus * (rho**2 + z**2) ** 2.5
    return np.asarray(u_zz * scale / (3 * (rho**2 - 2 * z**2) * z))


def three_taxels(x: Floats, y: Floats, m: Floats, z: float) -> Floats:
    """Return (Q, R, F) of (5.13) from places and moments of three taxels."""
    x1, x2, x3 = x
    y1, y2, y3 = y
    m1, m2, m3 = m
    q = ((m2 - m3) * y1 + (m3 - m1) * y2 + (m1 - m2) * y3) / (
        (x2 - x3) * y1 + (x3 - x1) * y2 + (x1 - x2) * y3
    )
    r = ((m2 - m3) * x1 + (m3 - m1) * x2 + (m1 - m2) * x3) / (
        (x3 - x2) * y1 + (x1 - x3) * y2 + (x2 - x1) * y3
    )
    f = ((m3 * x2 - m2 * x3) * y1 + (m1 * x3 - m3 * x1) * y2 + (m2 * x1 - m1 * x2) * y3) / (
        ((y2 - y1) * x3 + (y1 - y3) * x2 + (y3 - y2) * x1) * z
    )
    return np.stack([q, r, f])


def with_sensitivity(a_m_squared: Floats, beta_ns: float, z: float) -> Floats:
    """Return ρ² of (5.15), from the ratio of signals."""
    return np.asarray(z**2 * (2 - 12 / (np.sqrt(9 + 8 * beta_ns**2 * a_m_squared) + 3)))


def _lever(place: Floats, load: Floats) -> Floats:
    q, r, f = load
    return np.asarray(q * place[0] + r * place[1] + f * place[2])
