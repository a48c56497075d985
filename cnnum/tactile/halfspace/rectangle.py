"""A uniform traction on a rectangle of the surface: displacement, stress and strain anywhere."""

from collections.abc import Callable, Collection

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike

from cnnum.errors import ArrayError, PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.halfspace import influence
from cnnum.tactile.halfspace.corner import FUNCTIONS, Corner
from cnnum.tactile.halfspace.influence import Integrals
from cnnum.tactile.halfspace.point import point_functions

# Corners cancel as (distance/size)², n Gauss points converge as (size/distance)^2n: beyond the
# first distance, in half widths, Gauss points are the better, and further out fewer will do.
_GAUSS = ((20.0, 6), (60.0, 4))


def rectangle_displacement(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    traction: ArrayLike,
    *,
    size: tuple[float, float],
    youngs_modulus: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Array:
    """Return the displacement under a uniform traction on a rectangle around the origin.

    Parameters
    ----------
    x, y, z : (...) float, m
        Place relative to the centre of the rectangle, z >= 0 into the material.
    traction : (..., 3) float, Pa
        (q_x, q_y, p), the pressure p pushing into the material.
    size : (float, float), m
        Full width along x and along y.
    youngs_modulus, poisson : (...) float
        Young's modulus, Pa, and Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., 3) float, m
        Displacement; finite everywhere.

    Raises
    ------
    PhysicsError
        If E <= 0, z < 0, ν is out of range, a width is not positive, or a number is not finite.

    References
    ----------
    Johnson, Contact Mechanics, 3.25 (surface); Love (1929).
    """
    place, sides, load, ratio = _checked(x, y, z, size, traction, poisson)
    modulus = checks.positive("youngs_modulus", youngs_modulus)
    return influence.displacement_of(
        lambda names: rectangle_functions(names, *place, *sides), load, modulus, ratio
    )


def rectangle_stress(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    traction: ArrayLike,
    *,
    size: tuple[float, float],
    poisson: ArrayLike = 0.5,
) -> Array:
    """Return the stress under a uniform traction on a rectangle around the origin.

    Parameters
    ----------
    x, y, z, traction, size, poisson
        As in `rectangle_displacement`.

    Returns
    -------
    (..., 3, 3) float, Pa
        Stress tensor, tension positive.

    Raises
    ------
    PhysicsError
        As `rectangle_displacement`; also for a point of the surface on the rectangle's outline,
        where the traction jumps.

    References
    ----------
    Love (1929) for pressure; Cerruti's solution integrated for shear.
    """
    place, sides, load, ratio = _checked(x, y, z, size, traction, poisson)
    _refuse_outline(place, sides)
    return influence.stress_of(
        lambda names: rectangle_functions(names, *place, *sides), load, ratio
    )


def rectangle_strain(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    traction: ArrayLike,
    *,
    size: tuple[float, float],
    youngs_modulus: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Array:
    """Return the strain under a uniform traction on a rectangle around the origin.

    Parameters
    ----------
    x, y, z, traction, size, youngs_modulus, poisson
        As in `rectangle_displacement`.

    Returns
    -------
    (..., 3, 3) float
        Strain tensor; its shear components are half the engineering ones.

    Raises
    ------
    PhysicsError
        As `rectangle_stress`.
    """
    place, sides, load, ratio = _checked(x, y, z, size, traction, poisson)
    _refuse_outline(place, sides)
    modulus = checks.positive("youngs_modulus", youngs_modulus)
    return influence.strain_of(
        lambda names: rectangle_functions(names, *place, *sides), load, modulus, ratio
    )


def rectangle_functions(
    names: Collection[str], x: Array, y: Array, z: Array, width_x: float, width_y: float
) -> Integrals:
    """Return the harmonic functions `names` integrated over a rectangle around the origin."""
    x, y, z = np.broadcast_arrays(x, y, z)
    scale = max(width_x, width_y) / 2
    place = np.abs(x) / scale, np.abs(y) / scale, z / scale
    half = width_x / 2 / scale, width_y / 2 / scale
    distance = np.hypot(np.hypot(place[0], place[1]), place[2])
    tier = np.searchsorted([limit for limit, _ in _GAUSS], distance)
    values = {name: np.empty(x.shape) for name in names}
    for n in range(len(_GAUSS) + 1):
        where = tier == n
        if where.any():
            found = _in_tier(n, names, (place[0][where], place[1][where], place[2][where]), half)
            for name in names:
                values[name][where] = found[name]
    return {name: _unfold(name, values[name], x, y) * scale ** _power(name) for name in names}


def _in_tier(
    tier: int, names: Collection[str], place: tuple[Array, Array, Array], half: tuple[float, float]
) -> Integrals:
    if tier == 0:
        return _by_corners(names, *place, *half)
    return _by_gauss(_GAUSS[tier - 1][1], names, *place, *half)


def _by_corners(
    names: Collection[str], x: Array, y: Array, z: Array, half_x: float, half_y: float
) -> Integrals:
    corners = [
        (sign_x * sign_y, Corner(x + sign_x * half_x, y + sign_y * half_y, z))
        for sign_x in (1, -1)
        for sign_y in (1, -1)
    ]
    return {name: _corner_sum(FUNCTIONS[name], corners) for name in names}


def _corner_sum(function: Callable[[Corner], Array], corners: list[tuple[int, Corner]]) -> Array:
    (_, pp), (_, pm), (_, mp), (_, mm) = corners
    return (function(pp) - function(pm)) - (function(mp) - function(mm))


def _by_gauss(
    count: int,
    names: Collection[str],
    x: Array,
    y: Array,
    z: Array,
    half_x: float,
    half_y: float,
) -> Integrals:
    nodes, weights = leggauss(count)
    values = point_functions(
        names,
        x[..., None, None] - half_x * nodes[:, None],
        y[..., None, None] - half_y * nodes,
        z[..., None, None],
    )
    area = half_x * half_y * weights[:, None] * weights
    return {name: (values[name] * area).sum(axis=(-2, -1)) for name in names}


def _unfold(name: str, value: Array, x: Array, y: Array) -> Array:
    """Give the value at (|x|, |y|) the sign that it has at (x, y)."""
    odd_x, odd_y = parity(name)
    if odd_x:
        value = value * np.sign(x)
    return value * np.sign(y) if odd_y else value


def parity(name: str) -> tuple[bool, bool]:
    """Return whether a function is odd in x, and whether it is odd in y."""
    axes = name.partition("_")[2]
    return axes.count("x") % 2 == 1, axes.count("y") % 2 == 1


def _power(name: str) -> int:
    """Return the power of length that the integral of this function has."""
    kind, _, axes = name.partition("_")
    return {"M": 0, "S": 1, "V": 1 - len(axes), "L": 2 - len(axes), "W": 3 - len(axes)}[kind]


def _checked(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    size: tuple[float, float],
    traction: ArrayLike,
    poisson: ArrayLike,
) -> tuple[tuple[Array, Array, Array], tuple[float, float], Array, Array]:
    place = checks.finite("x", x), checks.finite("y", y), checks.not_negative("z", z)
    sides = checks.positive("size", checks.vector("size", size, 2))
    if sides.ndim > 1:
        raise ArrayError(f"'size': expected the two sides of one rectangle, got {sides.shape}.")
    width_x, width_y = sides
    load = checks.vector("traction", traction)
    return place, (float(width_x), float(width_y)), load, checks.poisson_ratio(poisson)


def _refuse_outline(place: tuple[Array, Array, Array], sides: tuple[float, float]) -> None:
    x, y, z = np.abs(place[0]), np.abs(place[1]), place[2]
    half_x, half_y = sides[0] / 2, sides[1] / 2
    on_x = (x == half_x) & (y <= half_y)
    on_y = (y == half_y) & (x <= half_x)
    if np.any((z == 0) & (on_x | on_y)):
        raise PhysicsError(
            "A point lies on the surface at the outline of the loaded rectangle, where the "
            "stress jumps: expected points outside it or below the surface."
        )
