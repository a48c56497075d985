"""The harmonic functions integrated over a quarter plane: four corners make a rectangle.

X and Y go from a corner of the rectangle to the point; s² = X² + z², t² = Y² + z². Every function
below satisfies ∂²/∂X∂Y = the point's function of the same name. Terms that depend on X or on Y
alone are dropped: they cancel between corners. Love (1929) gave the normal load; the shear loads
follow from the same antiderivatives. Arguments of logarithms and arctangents are written so that z
>= 0 leaves no cancellation.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cnnum.tactile.checks import Array


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
