"""A uniform traction on a rectangle or a disc of the surface: displacement, stress and strain.

The harmonic functions integrated over a quarter plane: four corners make a rectangle.

X and Y go from a corner of the rectangle to the point; s² = X² + z², t² = Y² + z². Every function
below satisfies ∂²/∂X∂Y = the point's function of the same name. Terms that depend on X or on Y
alone are dropped: they cancel between corners. Love (1929) gave the normal load; the shear loads
follow from the same antiderivatives. Arguments of logarithms and arctangents are written so that z
>= 0 leaves no cancellation.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike

from cnnum.errors import ArrayError, PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting
from cnnum.tactile.halfspace import influence
from cnnum.tactile.halfspace.influence import Integrals, tensor
from cnnum.tactile.halfspace.point import point_functions


@broadcasting
def circle_axis_stress(
    z: ArrayLike, traction: ArrayLike, *, radius: ArrayLike, poisson: ArrayLike = 0.5
) -> Array:
    """Return the stress on the axis below a uniformly loaded disc.

    Parameters
    ----------
    z : (...) float, m
        Depth below the centre, 0 or more.
    traction : (..., 3) float, Pa
        (q_x, q_y, p), the pressure p pushing into the material.
    radius : (...) float, m
        Radius a of the disc.
    poisson : (...) float
        Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., 3, 3) float, Pa
        Stress tensor, tension positive. With c = z/√(a² + z²): σ_zz = -p (1 - c³),
        σ_xx = σ_yy = -p/2 [(1 + 2ν) - 2(1 + ν) c + c³], σ_xz = -q_x (1 - 3c/2 + c³/2).

    Raises
    ------
    PhysicsError
        If the depth is negative, the radius not positive, ν out of range, or a number not
        finite.

    References
    ----------
    Timoshenko & Goodier, Theory of Elasticity, art. 139, for pressure; Cerruti integrated for
    shear.
    """
    depth = checks.not_negative("z", z)
    a = checks.positive("radius", radius)
    ratio = checks.poisson_ratio(poisson)
    load = checks.vector("traction", traction)
    root = np.hypot(a, depth)
    c = depth / root
    rest = (a / root) * (a / (root + depth))  # 1 - c, exact far below
    across = -load[..., 2] / 2 * rest * (rest * (2 + c) - (1 - 2 * ratio))
    down = -load[..., 2] * rest * (1 + c + c * c)
    shear = rest * rest * (2 + c) / 2
    return tensor(
        {
            "xx": across,
            "yy": across,
            "zz": down,
            "xz": -load[..., 0] * shear,
            "yz": -load[..., 1] * shear,
            "xy": np.zeros_like(across),
        }
    )


@dataclass(frozen=True, slots=True)
class Corner:
    """Distances from one corner of the rectangle to the point, and functions of them.

    Parameters
    ----------
    X, Y, z : (...) float
        From the corner to the point.

    Attributes
    ----------
    s, t, r : (...) float
        Distance from the point to the edge along y, to the edge along x, and to the corner.
    """

    X: Array
    Y: Array
    z: Array
    s: Array = field(init=False)
    t: Array = field(init=False)
    r: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "s", np.hypot(self.X, self.z))
        object.__setattr__(self, "t", np.hypot(self.Y, self.z))
        object.__setattr__(self, "r", np.hypot(self.s, self.Y))

    @property
    def r_plus_x(self) -> Array:
        """The sum r + X, without cancellation where X < 0."""
        return _sum(self.r, self.X, self.t)

    @property
    def r_plus_y(self) -> Array:
        """The sum r + Y, without cancellation where Y < 0."""
        return _sum(self.r, self.Y, self.s)

    @property
    def angle(self) -> Array:
        """The solid angle's part of this corner, atan(XY / zr)."""
        return np.arctan2(self.X * self.Y, self.z * self.r)

    @property
    def angle_x(self) -> Array:
        """The integral of L_x over Y, differentiated, 2 atan(XY / ((s + z)(r + s)))."""
        return 2 * np.arctan2(self.X * self.Y, (self.s + self.z) * (self.r + self.s))

    @property
    def angle_y(self) -> Array:
        """The same with x and y exchanged."""
        return 2 * np.arctan2(self.X * self.Y, (self.t + self.z) * (self.r + self.t))


def _sum(r: Array, a: Array, b: Array) -> Array:
    """Return r + a where r² = a² + b²."""
    return np.where(a >= 0, r + a, ratio(b * b, r - a)).astype(np.float64)


def ratio(a: Array, b: Array) -> Array:
    """Return a / b, and 0 where b = 0 (a point on an edge: the mean of its two sides)."""
    return np.divide(a, b, out=np.zeros(np.broadcast_shapes(a.shape, b.shape)), where=b != 0)


def _xlogy(a: Array, b: Array) -> Array:
    from scipy.special import xlogy

    return np.asarray(xlogy(a, b), dtype=np.float64)


def _love(c: Corner) -> Array:
    return _xlogy(c.X, c.r_plus_y) + _xlogy(c.Y, c.r_plus_x)


FUNCTIONS: dict[str, Callable[[Corner], Array]] = {
    "M_xxx": lambda c: -2 * np.log(c.r_plus_y) - ratio(c.X**2 * c.Y, c.r * c.s**2),
    "M_xxy": lambda c: ratio(c.X, c.r) - np.log(c.r_plus_x),
    "M_xyy": lambda c: ratio(c.Y, c.r) - np.log(c.r_plus_y),
    "M_yyy": lambda c: -2 * np.log(c.r_plus_x) - ratio(c.X * c.Y**2, c.r * c.t**2),
    "M_xxz": lambda c: c.angle - ratio(c.z * c.X * c.Y, c.r * c.s**2),
    "M_yyz": lambda c: c.angle - ratio(c.z * c.X * c.Y, c.r * c.t**2),
    "M_zzz": lambda c: (
        c.angle + ratio(c.z * c.X * c.Y, c.r * c.s**2) + ratio(c.z * c.X * c.Y, c.r * c.t**2)
    ),
    "M_xyz": lambda c: ratio(c.z, c.r),
    "M_xzz": lambda c: -ratio(c.z**2 * c.Y, c.r * c.s**2),
    "M_yzz": lambda c: -ratio(c.z**2 * c.X, c.r * c.t**2),
    "S_xx": lambda c: _xlogy(c.X, c.r_plus_y) + 2 * _xlogy(c.Y, c.r_plus_x) - 2 * c.z * c.angle,
    "S_yy": lambda c: 2 * _xlogy(c.X, c.r_plus_y) + _xlogy(c.Y, c.r_plus_x) - 2 * c.z * c.angle,
    "S_zz": _love,
    "S_xy": lambda c: -c.r,
    "S_xz": lambda c: -_xlogy(c.z, c.r_plus_y),
    "S_yz": lambda c: -_xlogy(c.z, c.r_plus_x),
    "V": lambda c: _love(c) - c.z * c.angle,
    "V_x": lambda c: np.log(c.r_plus_y),
    "V_y": lambda c: np.log(c.r_plus_x),
    "V_z": lambda c: -c.angle,
    "L_x": lambda c: _xlogy(c.Y, c.r + c.z) + _xlogy(c.z, c.r_plus_y) + c.X * c.angle_x,
    "L_y": lambda c: _xlogy(c.X, c.r + c.z) + _xlogy(c.z, c.r_plus_x) + c.Y * c.angle_y,
    "L_xx": lambda c: c.angle_x,
    "L_xy": lambda c: np.log(c.r + c.z),
    "L_yy": lambda c: c.angle_y,
    "W_xx": lambda c: c.z * c.angle_x - _xlogy(c.X, c.r_plus_y),
    "W_xy": lambda c: _xlogy(c.z, c.r + c.z) - c.r,
    "W_yy": lambda c: c.z * c.angle_y - _xlogy(c.Y, c.r_plus_x),
    "W_xxx": lambda c: ratio(c.Y, c.r + c.z) - np.log(c.r_plus_y),
    "W_xxy": lambda c: -ratio(c.X, c.r + c.z),
    "W_xyy": lambda c: -ratio(c.Y, c.r + c.z),
    "W_yyy": lambda c: ratio(c.X, c.r + c.z) - np.log(c.r_plus_x),
}


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
            near = _in_tier(n, names, (place[0][where], place[1][where], place[2][where]), half)
            for name in names:
                values[name][where] = near[name]
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
