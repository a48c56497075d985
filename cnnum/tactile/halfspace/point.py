"""A point load on the surface of an elastic half-space, for any Poisson ratio, and a line load."""

import math
from collections.abc import Callable, Collection

import numpy as np
from numpy.typing import ArrayLike

from cnnum.errors import PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting
from cnnum.tactile.halfspace import influence
from cnnum.tactile.halfspace.influence import Integrals, energy_density, tensor

Direction = tuple[Array, Array, Array]

# Functions of the direction (x, y, z)/r alone; w = 1/(1 + z/r). As z >= 0 keeps w in
# [1/2, 1], nothing cancels straight below, on the surface or far away.
_DIRECTIONAL: dict[str, Callable[[Array, Array, Array, Array], Array]] = {
    "V": lambda x, y, z, w: np.ones_like(w),
    "L_x": lambda x, y, z, w: x * w,
    "L_y": lambda x, y, z, w: y * w,
    "W_xx": lambda x, y, z, w: w * (x * x * w - 1),
    "W_xy": lambda x, y, z, w: x * y * w * w,
    "W_yy": lambda x, y, z, w: w * (y * y * w - 1),
    "V_x": lambda x, y, z, w: -x,
    "V_y": lambda x, y, z, w: -y,
    "V_z": lambda x, y, z, w: -z,
    "L_xx": lambda x, y, z, w: w * (1 - x * x * (2 + z) * w),
    "L_xy": lambda x, y, z, w: -x * y * (2 + z) * w * w,
    "L_yy": lambda x, y, z, w: w * (1 - y * y * (2 + z) * w),
    "W_xxx": lambda x, y, z, w: x * w * w * (3 - x * x * (3 + z) * w),
    "W_xxy": lambda x, y, z, w: y * w * w * (1 - x * x * (3 + z) * w),
    "W_xyy": lambda x, y, z, w: x * w * w * (1 - y * y * (3 + z) * w),
    "W_yyy": lambda x, y, z, w: y * w * w * (3 - y * y * (3 + z) * w),
}


@broadcasting
def displacement(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    force: ArrayLike,
    *,
    youngs_modulus: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Array:
    """Return the displacement at (x, y, z) under a point load at the origin.

    Parameters
    ----------
    x, y : (...) float, m
        Place in the plane of the surface, relative to the load.
    z : (...) float, m
        Depth into the material, 0 on the surface.
    force : (..., 3) float, N
        The load (Q, R, F) along x, y, and z into the material.
    youngs_modulus : (...) float, Pa
        Young's modulus E.
    poisson : (...) float
        Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., 3) float, m
        Displacement (u_x, u_y, u_z); all arguments broadcast.

    Raises
    ------
    PhysicsError
        If E <= 0, z < 0, ν is out of range, a number is not finite, or a point is that of the load.

    References
    ----------
    Vásárhelyi, dissertation (2007), (4.9); Johnson, Contact Mechanics, 3.2 and 3.6.
    """
    place, load, modulus, ratio = _checked(x, y, z, force, youngs_modulus, poisson)
    return influence.displacement_of(
        lambda names: point_functions(names, *place), load, modulus, ratio
    )


@broadcasting
def stress(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    force: ArrayLike,
    *,
    youngs_modulus: ArrayLike = 1.0,
    poisson: ArrayLike = 0.5,
) -> Array:
    """Return the stress at (x, y, z) under a point load at the origin.

    Parameters
    ----------
    x, y, z, force, youngs_modulus, poisson
        As in `displacement`; the stress does not depend on Young's modulus.

    Returns
    -------
    (..., 3, 3) float, Pa
        Stress tensor, tension positive: σ_zz < 0 under a positive F.

    Raises
    ------
    PhysicsError
        As `displacement`.

    References
    ----------
    Vásárhelyi, dissertation (2007), (4.11) for ν = 0.5; Johnson, 3.19 and 3.76 for any ν.
    """
    place, load, _, ratio = _checked(x, y, z, force, youngs_modulus, poisson)
    return influence.stress_of(lambda names: point_functions(names, *place), load, ratio)


@broadcasting
def strain(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    force: ArrayLike,
    *,
    youngs_modulus: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Array:
    """Return the strain at (x, y, z) under a point load at the origin.

    Parameters
    ----------
    x, y, z, force, youngs_modulus, poisson
        As in `displacement`.

    Returns
    -------
    (..., 3, 3) float
        Strain tensor; its shear components are half the engineering ones.

    Raises
    ------
    PhysicsError
        As `displacement`.

    References
    ----------
    Vásárhelyi, dissertation (2007), (4.12) for ν = 0.5.
    """
    place, load, modulus, ratio = _checked(x, y, z, force, youngs_modulus, poisson)
    return influence.strain_of(lambda names: point_functions(names, *place), load, modulus, ratio)


@broadcasting
def strain_energy_density(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    force: ArrayLike,
    *,
    youngs_modulus: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Array:
    """Return the elastic energy per volume at (x, y, z) under a point load at the origin.

    Parameters
    ----------
    x, y, z, force, youngs_modulus, poisson
        As in `displacement`.

    Returns
    -------
    (...) float, J/m³
        Strain energy density, σ_ij ε_ij / 2.

    Raises
    ------
    PhysicsError
        As `displacement`.

    References
    ----------
    Vásárhelyi, dissertation (2007), (4.7), and (4.13) for ν = 0.5.
    """
    place, load, modulus, ratio = _checked(x, y, z, force, youngs_modulus, poisson)
    field = influence.stress_of(lambda names: point_functions(names, *place), load, ratio)
    return energy_density(field, modulus, ratio)


def point_functions(names: Collection[str], x: Array, y: Array, z: Array) -> Integrals:
    """Return the harmonic functions `names` at (x, y, z), for z >= 0 and away from the origin."""
    r = np.hypot(np.hypot(x, y), z)
    direction = (x / r, y / r, z / r)
    return {name: _directional(name, direction) / r ** _power(name) for name in names}


def _directional(name: str, direction: Direction) -> Array:
    kind, _, axes = name.partition("_")
    parts = [direction["xyz".index(axis)] for axis in axes]
    if kind == "M":
        return 3 * parts[0] * parts[1] * parts[2]
    if kind == "S":
        return parts[0] * parts[1] + (axes[0] == axes[1])
    return _DIRECTIONAL[name](*direction, 1 / (1 + direction[2]))


def _power(name: str) -> int:
    kind, _, axes = name.partition("_")
    return {"M": 2, "S": 1, "V": 1 + len(axes), "L": len(axes), "W": len(axes) - 1}[kind]


def _checked(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    force: ArrayLike,
    youngs_modulus: ArrayLike,
    poisson: ArrayLike,
) -> tuple[Direction, Array, Array, Array]:
    place = checks.finite("x", x), checks.finite("y", y), checks.not_negative("z", z)
    if np.any((place[0] == 0) & (place[1] == 0) & (place[2] == 0)):
        raise PhysicsError(
            "A point lies at the load itself, where the solution is infinite: "
            "move it away, or spread the load over an area."
        )
    load = checks.vector("force", force)
    return (
        place,
        load,
        checks.positive("youngs_modulus", youngs_modulus),
        checks.poisson_ratio(poisson),
    )


@broadcasting
def line_load_stress(
    x: ArrayLike, z: ArrayLike, force_per_length: ArrayLike, *, poisson: ArrayLike = 0.5
) -> Array:
    """Return the stress under a line load along the y axis (plane strain).

    Parameters
    ----------
    x : (...) float, m
        Distance from the line in the plane of the surface.
    z : (...) float, m
        Depth, 0 or more.
    force_per_length : (..., 3) float, N/m
        (Q, R, F) for each metre of the line: across it, along it, into the material.
    poisson : (...) float
        Poisson's ratio, above -1 and at most 0.5; only σ_yy depends on it.

    Returns
    -------
    (..., 3, 3) float, Pa
        Stress tensor, tension positive: -2 x_i x_j (Qx + Fz)/(π r⁴) in the plane,
        -R x_i/(π r²) along the line, σ_yy = ν (σ_xx + σ_zz).

    Raises
    ------
    PhysicsError
        If z < 0, ν is out of range, a number is not finite, or a point lies on the line.

    References
    ----------
    Flamant (1892); Johnson, Contact Mechanics, 2.2-2.3.
    """
    place, depth = checks.finite("x", x), checks.not_negative("z", z)
    if np.any((place == 0) & (depth == 0)):
        raise PhysicsError(
            "A point lies on the loaded line, where the stress is infinite: move it away."
        )
    load = checks.vector("force_per_length", force_per_length)
    ratio = checks.poisson_ratio(poisson)
    r = np.hypot(place, depth)
    e_x, e_z = place / r, depth / r
    radial = -2 / math.pi * (load[..., 0] * e_x + load[..., 2] * e_z) / r
    along = -load[..., 1] / (math.pi * r)
    return tensor(
        {
            "xx": radial * e_x * e_x,
            "yy": ratio * radial,
            "zz": radial * e_z * e_z,
            "xz": radial * e_x * e_z,
            "yz": along * e_z,
            "xy": along * e_x,
        }
    )
