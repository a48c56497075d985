"""A taxel under its cover: the coupling of strain to force, and its receptive field."""

from dataclasses import dataclass, field
from math import pi, sqrt

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import CalibrationError, PhysicsError
from cnnum.safety.values import is_real
from cnnum.tactile.taxel.bridge import Bridge, apply_matrix, trailing


@dataclass(frozen=True, slots=True, eq=False)
class Coupling:
    """Linear link from the bottom strain (or stress) of the cover to the force on a taxel.

    The taxel is the body below, so a traction of the cover acts on it with the opposite sign:
    force = −cross · (shear ε_xz, shear ε_yz, normal ε_zz).

    Attributes
    ----------
    shear, normal : float, N (per unit strain; m² for a stress sensor)
        Stiffness of the link.
    cross : (3, 3) or (rows, cols, 3, 3) float
        Cross sensitivity: how much of each component appears in the others.

    References
    ----------
    Vásárhelyi 2007, (4.14), (4.15).
    """

    shear: float
    normal: float
    cross: Floats = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if not all(is_real(value) and value > 0.0 for value in (self.shear, self.normal)):
            raise PhysicsError(
                "A coupling needs positive finite stiffnesses, got "
                f"shear {self.shear} and normal {self.normal}."
            )
        cross = frozen(finite("cross", self.cross))
        if cross.ndim not in (2, 4) or cross.shape[-2:] != (3, 3):
            raise PhysicsError(
                "'cross' must have the shape (3, 3) or (rows, cols, 3, 3), got "
                f"{cross.shape}; leave it out for none."
            )
        object.__setattr__(self, "cross", cross)

    @classmethod
    def nominal(
        cls,
        *,
        depth: float = 200e-6,
        youngs_modulus: float = 0.87e6,
        reduction: float = 10.0,
        beta_ns: float = 1.5,
        bridge: Bridge | None = None,
        cross: ArrayLike | None = None,
    ) -> "Coupling":
        """Return the coupling with a given loss of sensitivity under a cover.

        Parameters
        ----------
        depth : float, m
            Thickness of the cover.
        youngs_modulus : float, Pa
            Young's modulus of the cover.
        reduction : float
            A point load above the centre reads this many times less than on bare silicon;
            Table 3.II: 5–30, growing with the thickness.
        beta_ns : float
            Normal-to-shear sensitivity α_s/α_n (4.19).
        bridge : Bridge, optional
        cross : (3, 3) or (rows, cols, 3, 3) float, optional

        Raises
        ------
        PhysicsError
            If a parameter is not positive.
        """
        if not min(depth, youngs_modulus, reduction, beta_ns) > 0.0:
            raise PhysicsError(
                "Depth, Young's modulus, reduction and β_ns must be positive, got "
                f"{depth} m, {youngs_modulus} Pa, {reduction} and {beta_ns}."
            )
        silicon = Bridge() if bridge is None else bridge
        normal = 2.0 * pi * youngs_modulus * depth**2 / (3.0 * reduction)  # 1/A of (4.18)
        shear = normal * abs(silicon.normal / silicon.shear) / beta_ns
        mixing = np.eye(3) if cross is None else np.asarray(cross, dtype=np.float64)
        return cls(shear, normal, mixing)

    def force(self, strain: ArrayLike) -> Floats:
        """Return the force (..., 3), N, on the silicon under a strain (or stress) at its surface.

        Parameters
        ----------
        strain : (..., 3) float
            ε_xz, ε_yz, ε_zz (or σ, Pa), tension positive; another last axis raises an ArrayError.
        """
        rows = trailing("strain", finite("strain", strain), 3, "(ε_xz, ε_yz, ε_zz)")
        stiffness = np.array([self.shear, self.shear, self.normal])
        return apply_matrix(-self.cross * stiffness, rows)


EXTREMA_RATIO = 25.0 * sqrt(5.0) / 24.0
"""|u_zz| below the load over the largest |u_xz|, at x = z/2 (4.20)."""

_TOP = 0.6  # share of an extremum above which its shape is fitted
_DEGREE = 4  # enough for 1e-3 of the height over that range, and still averages noise out


@dataclass(frozen=True, slots=True)
class ReceptiveField:
    """The quantities of (4.17)–(4.20).

    Attributes
    ----------
    centre : float, m
        Where the normal signal is largest.
    amplitude : float, V
        A: the largest normal signal S_n.
    width : float, m
        W: the distance between the zeros of S_n; 2√2 z on a half-space.
    inhibition : float
        Ratio of the largest to the most negative S_n; 5^{5/2} = 55.9 on a half-space, about 19
        measured.
    shear : float, V
        The largest |T_x|.
    beta_ns : float
        α_s/α_n by (4.20).
    """

    centre: float
    amplitude: float
    width: float
    inhibition: float
    shear: float
    beta_ns: float


def receptive_field(x: ArrayLike, shear: ArrayLike, normal: ArrayLike) -> ReceptiveField:
    """Return the figures of merit of one line scan of a constant normal load.

    No model of the cover is used, except for the ratio of (4.20) in `beta_ns`.

    Parameters
    ----------
    x : (n,) float, m
        Place of the load along a line through the centre of the taxel, in any order.
    shear, normal : (n,) float, V
        T_x and S_n, without offsets.

    Returns
    -------
    ReceptiveField

    Raises
    ------
    CalibrationError
        If the scan has too few points or does not reach past the zeros of S_n.

    References
    ----------
    Vásárhelyi 2007, (4.17)–(4.20).
    """
    place, tangential, vertical = _sorted(x, shear, normal)
    centre, amplitude = _extremum(place, vertical)
    left, right = _zeros(place, vertical)
    sides = [_extremum(place, sign * tangential)[1] for sign in (1.0, -1.0)]
    lowest = -float(vertical.min())
    sideways = float(np.mean(sides))
    return ReceptiveField(
        centre=centre,
        amplitude=amplitude,
        width=right - left,
        inhibition=amplitude / lowest if lowest > 0.0 else float("inf"),
        shear=sideways,
        beta_ns=amplitude / (sideways * EXTREMA_RATIO),
    )


def _sorted(x: ArrayLike, shear: ArrayLike, normal: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return the scan in the order of x."""
    place, tangential, vertical = finite("x", x), finite("shear", shear), finite("normal", normal)
    if place.ndim != 1 or not place.shape == tangential.shape == vertical.shape:
        raise CalibrationError(
            "'x', 'shear' and 'normal' must be one line scan, three (n,) arrays, got "
            f"{place.shape}, {tangential.shape} and {vertical.shape}."
        )
    if place.size < 10:
        raise CalibrationError(
            f"A line scan needs 10 points or more, got {place.size}; scan in smaller steps."
        )
    order = np.argsort(place, kind="stable")
    return place[order], tangential[order], vertical[order]


def _extremum(x: Floats, y: Floats) -> tuple[float, float]:
    """Return place and height of the maximum, from a polynomial over its top."""
    peak = int(np.argmax(y))
    low, high = peak, peak
    while low > 0 and y[low - 1] > _TOP * y[peak]:
        low -= 1
    while high < len(y) - 1 and y[high + 1] > _TOP * y[peak]:
        high += 1
    if high - low < _DEGREE or x[high] == x[low]:
        return float(x[peak]), float(y[peak])
    half = 0.5 * (x[high] - x[low])
    middle = 0.5 * (x[high] + x[low])
    span = slice(low, high + 1)
    powers = np.arange(_DEGREE + 1)
    fine = np.linspace(-1.0, 1.0, 2001)
    columns = ((x[span, np.newaxis] - middle) / half) ** powers
    fit = np.asarray(np.linalg.pinv(columns) @ y[span], dtype=np.float64)
    values = np.asarray(fine[:, np.newaxis] ** powers @ fit, dtype=np.float64)
    best = int(np.argmax(values))
    return float(middle + half * fine[best]), float(values[best])


def _zeros(x: Floats, y: Floats) -> tuple[float, float]:
    """Return where y falls to zero on either side of its peak."""
    peak = int(np.argmax(y))
    before = np.flatnonzero(y[:peak] <= 0.0)
    after = np.flatnonzero(y[peak:] <= 0.0)
    if not (before.size and after.size):
        raise CalibrationError(
            "The normal signal has no zero on both sides of its peak: expected a scan past √2 "
            "times the cover's thickness on both sides; scan farther, or remove the offset."
        )
    return _crossing(x, y, int(before[-1])), _crossing(x, y, peak + int(after[0]) - 1)


def _crossing(x: Floats, y: Floats, i: int) -> float:
    """Return the zero of the line through points i and i + 1."""
    return float(x[i] - y[i] * (x[i + 1] - x[i]) / (y[i + 1] - y[i]))
