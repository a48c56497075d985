"""Where a point load stands and how large it is, from one three-axial taxel under the cover."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.inverse.moments import NORMAL_95, Noise, radius_95, shear_and_normal

_SPREAD = 2.447747  # radius, in standard deviations, of the 95 % region of a direction (χ², 2)
_FAR = 1e-60  # a ratio of components below this puts the load farther off than numbers reach
_DROWNED = 1e-9  # signal over noise below which it does not matter how far below
_AROUND = 32  # directions of noise that are looked at, besides the gradient's
_ONE_SIDED = 1.644854  # half-width, in standard deviations, that leaves 5 % to one side
# the same that leaves 5 % to both sides where one reaches 0, 0.1, … 1 times as far as the other
_UNEVEN = (1.6449, 1.6449, 1.6449, 1.6449, 1.6450, 1.6496, 1.6713, 1.7176, 1.7847, 1.8668, 1.96)
_DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (0.5**0.5, 0.5**0.5), (0.5**0.5, -(0.5**0.5)))


@dataclass(frozen=True, slots=True, eq=False)
class PointLoad:
    """A point load on the cover, as measured by one taxel.

    Attributes
    ----------
    x, y : (...) float, m
        Place of the load; that of the taxel where it measures nothing.
    force : (...) float, N
        F, if the load is normal.
    moment : (...) float, N m
        Qx + Ry + Fz (5.8), all that one taxel can measure of a load in three directions.
    inside : (...) bool
        Whether the load is nearer than √2 z, where the normal strain is negative (always true for
        stress).
    seen : (...) bool
        Whether there is a load that explains the signal.
    position_error : (...) float, m
        Radius that contains the true place in 95 % of cases, for the given noise.
    force_error : (...) float, N
        Half-width that contains the true force in 95 % of cases; both errors are infinite where no
        load is seen.
    """

    x: Array
    y: Array
    force: Array
    moment: Array
    inside: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    position_error: Array
    force_error: Array


def locate(
    strain: ArrayLike,
    *,
    depth: float,
    youngs_modulus: float,
    taxel: ArrayLike = (0.0, 0.0),
    noise: Noise = 0.0,
) -> PointLoad:
    """Return the point load that causes the strain at one taxel, assuming that it is a push.

    The dissertation squares ε_zz/|ε_shear|. It therefore needs one formula inside √2 z (5.4) and
    another outside (5.5), and has none on the ring. With its sign kept, (5.2) becomes
    s ρ² + 3 z n ρ − 2 z² s = 0, with s = |ε_shear| and n = −ε_zz, which always has one root ρ ≥ 0.
    The force is computed from both components, so it has no singular ring either.

    Parameters
    ----------
    strain : (..., 3) float
        ε_xz, ε_yz, ε_zz, tension positive.
    depth : float, m
        z, from the surface to the taxel.
    youngs_modulus : float, Pa
    taxel : (..., 2) float, m
        Place of the taxel.
    noise : float or (float, float)
        RMS noise of the shear and the normal strain; 0 for exact data.

    Returns
    -------
    PointLoad

    Raises
    ------
    ArrayError
        If an axis has the wrong length.
    PhysicsError
        If a parameter is out of range or a value is not finite.

    References
    ----------
    Vásárhelyi 2007, (5.1)–(5.8).
    """
    rows, place, z = _checked("strain", strain, taxel, depth)
    modulus = checks.scalar("youngs_modulus", checks.positive("youngs_modulus", youngs_modulus))
    shear, normal = np.hypot(rows[..., 0], rows[..., 1]), -rows[..., 2]
    size = np.hypot(shear, normal)
    seen = np.asarray((shear > _FAR * size) | (normal > 0.0))
    safe = np.where(seen, size, 1.0)
    s, n = np.where(seen, shear / safe, 0.0), np.where(seen, normal / safe, 1.0)
    s = np.where(s > _FAR, s, 0.0)
    radius = z * _signed_root(s, n)
    scale = 4.0 * np.pi * modulus / (3.0 * z)
    force = scale * _lever(radius, z) * np.where(seen, size, 0.0)
    x, y = _around(place, rows, shear, radius)
    spread = [v / np.maximum(safe, _DROWNED * v) for v in shear_and_normal(noise)]
    linear = _linear_errors(s, n, radius, z, force, spread)
    bent = _curvature(s, n, radius, z, force, spread)
    errors = linear[0] + bent[0], linear[1] + bent[1]
    inside = np.asarray(seen & (normal > 0.0))
    return _load(x, y, force, z, inside, seen, errors)


def locate_signals(
    signals: ArrayLike,
    *,
    depth: float,
    youngs_modulus: float,
    alpha_normal: float,
    beta_ns: float = 1.5,
    taxel: ArrayLike = (0.0, 0.0),
    noise: float = 0.0,
) -> PointLoad:
    """Return the point load from the signals of a taxel, with its normal-to-shear sensitivity.

    Parameters
    ----------
    signals : (..., 3) float, V
        T_x, T_y, S_n.
    depth, youngs_modulus, taxel
        As in `locate`.
    alpha_normal : float, 1/V
        Strain per volt of S_n; the place does not depend on it.
    beta_ns : float
        α_s/α_n.
    noise : float, V
        RMS noise of one bridge; that of T_x and T_y is √2 times as large, that of S_n the same
        (4.14).

    Errors are those of `locate`.

    References
    ----------
    Vásárhelyi 2007, (5.14), (5.15).
    """
    volts = checks.vector("signals", signals)
    alpha = checks.scalar("alpha_normal", checks.positive("alpha_normal", alpha_normal))
    beta = checks.scalar("beta_ns", checks.positive("beta_ns", beta_ns))
    bridge = shear_and_normal(noise)[1]
    return locate(
        -alpha * volts * np.array([beta, beta, 1.0]),
        depth=depth,
        youngs_modulus=youngs_modulus,
        taxel=taxel,
        noise=(alpha * beta * bridge * float(np.sqrt(2.0)), alpha * bridge),
    )


def locate_stress(
    stress: ArrayLike, *, depth: float, taxel: ArrayLike = (0.0, 0.0), noise: Noise = 0.0
) -> PointLoad:
    """Return the point load, a push or a pull, that causes the stress at one taxel.

    Parameters
    ----------
    stress : (..., 3) float, Pa
        σ_xz, σ_yz, σ_zz, tension positive.
    depth, taxel
        As in `locate`.
    noise : float or (float, float), Pa
        RMS noise of the shear and the normal stress.

    Returns
    -------
    PointLoad
        It has no singular ring; a load is unseen only where σ_zz is negligible compared with the
        shear. The errors hold in at least 95 % of cases, for noise of any size: they span the
        places and forces of all stresses within 95 % of the noise, and are infinite if these
        include σ_zz = 0.

    Raises
    ------
    ArrayError, PhysicsError
        As `locate`.

    References
    ----------
    Vásárhelyi 2007, (5.9), (5.10).
    """
    rows, place, z = _checked("stress", stress, taxel, depth)
    push = -rows[..., 2]
    seen = np.asarray(np.abs(push) > _FAR * np.hypot(rows[..., 0], rows[..., 1]))
    safe = np.where(seen, push, 1.0)
    offset = np.where(seen[..., np.newaxis], z * rows[..., :2] / safe[..., np.newaxis], 0.0)
    radius = np.hypot(offset[..., 0], offset[..., 1])
    squared = radius**2 + z**2
    force = 2.0 * np.pi * push * squared**2.5 / (3.0 * z**3)
    spread = [v / np.maximum(np.abs(safe), _DROWNED * v) for v in shear_and_normal(noise)]
    reach, factor = _stress_errors(radius / z, spread)
    with np.errstate(over="ignore", invalid="ignore"):  # of an infinite part of no force
        errors = z * reach, np.where(force == 0.0, np.inf, np.abs(force) * factor)
    x, y = place[..., 0] + offset[..., 0], place[..., 1] + offset[..., 1]
    return _load(x, y, force, z, seen, seen, errors)


def _stress_errors(ratio: Array, noise: list[Array]) -> tuple[Array, Array]:
    """Return the errors of place over depth and of force over force, of stress.

    Parameters
    ----------
    ratio : (...) float
        |σ_shear| / |σ_zz|, the place over the depth.
    noise : list of (...) float
        Noise of the shear and of the normal stress, over |σ_zz|.

    Notes
    -----
    With p = σ_zz and s = |σ_shear| the place is s/p and the force is as (s² + p²)^{5/2} / p⁴. The
    range of a number over the ellipse of 1.96 standard deviations around a measurement is its
    profile-likelihood interval of 95 %; of the place, a plane vector, over that of 2.45. Where it
    reaches less far to one side, a half-width for both may leave more to the other: up to 5 % to
    one side alone, 1.64 deviations. Both errors are those of the linear formulas where the noise is
    small. Directions along the gradient, in which small noise reaches farthest, are among those
    that are looked at.
    """
    shear, normal = (np.broadcast_to(v, ratio.shape) for v in noise)
    squared = 1.0 + ratio**2
    across = np.hypot(shear, ratio * normal)
    linear = radius_95(across, shear)
    slopes = 5.0 * ratio / squared * shear, (5.0 / squared - 4.0) * normal
    up, down_by, sided, place = (np.zeros_like(ratio) for _ in range(4))
    steps = [(np.cos(angle), np.sin(angle)) for angle in np.arange(_AROUND) * 2.0 * np.pi / _AROUND]
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        for along, down in (*steps, *_both_ways(*slopes)):
            change = _force_change(ratio, NORMAL_95 * shear * along, NORMAL_95 * normal * down)
            up, down_by = np.fmax(up, change), np.fmax(down_by, -change)
            change = _force_change(ratio, _ONE_SIDED * shear * along, _ONE_SIDED * normal * down)
            sided = np.fmax(sided, np.abs(change))
        for along, down in (*steps, *_both_ways(shear, -ratio * normal)):
            p, aside = 1.0 + _SPREAD * normal * down, _SPREAD * shear * along
            place = np.fmax(place, np.abs((ratio + aside) / p - ratio))
            place = np.fmax(place, np.hypot(ratio / p - ratio, aside / p))
        longer = np.where(across > 0.0, place / (_SPREAD * across), 1.0)
        force = np.maximum(up, down_by)
        even = np.where(force > 0.0, np.minimum(up, down_by) / force, 1.0)
        deviations = np.interp(even, np.linspace(0.0, 1.0, len(_UNEVEN)), _UNEVEN)
        part = (deviations - _ONE_SIDED) / (NORMAL_95 - _ONE_SIDED)
        force = np.where(np.isfinite(force), sided + part * (force - sided), force)
    place = linear * np.maximum(longer, 1.0)
    return (
        np.where(_SPREAD * normal >= 1.0, np.inf, place),
        np.where(NORMAL_95 * normal >= 1.0, np.inf, force),
    )


def _force_change(ratio: Array, shear: Array, normal: Array) -> Array:
    """Return the relative change of the force under changes of s/p and of p."""
    s, p = ratio + shear, 1.0 + normal
    return ((s**2 + p**2) / (1.0 + ratio**2)) ** 2.5 / p**4 - 1.0


def _both_ways(along: Array, down: Array) -> list[tuple[Array, Array]]:
    """Return the unit vector of a direction, and its opposite."""
    size = np.hypot(along, down)
    size = np.where(size > 0.0, size, 1.0)
    return [(sign * along / size, sign * down / size) for sign in (1.0, -1.0)]


def _checked(
    name: str, rows: ArrayLike, taxel: ArrayLike, depth: float
) -> tuple[Array, Array, float]:
    """Return the checked rows and taxel places, broadcast, and the depth."""
    values = checks.vector(name, rows)
    place = checks.vector("taxel", taxel, 2)
    z = checks.scalar("depth", checks.positive("depth", depth))
    lead = np.broadcast_shapes(values.shape[:-1], place.shape[:-1])
    return np.broadcast_to(values, (*lead, 3)), np.broadcast_to(place, (*lead, 2)), z


def _signed_root(s: Array, n: Array) -> Array:
    """Return ρ/z ≥ 0 of s ρ² + 3 n ρ − 2 s = 0, in the form that does not cancel."""
    root = np.sqrt(9.0 * n**2 + 8.0 * s**2)
    outside = np.divide(root - 3.0 * n, 2.0 * s, out=np.zeros_like(s), where=s > 0.0)
    inside = np.divide(4.0 * s, root + 3.0 * n, out=np.zeros_like(s), where=n > 0.0)
    return np.where(n > 0.0, inside, outside)


def _lever(radius: Array, z: float) -> Array:
    """Return (ρ² + z²)² / √(ρ² + 4z²): r⁵ over the length of (3zρ, 2z² − ρ²)."""
    return (radius**2 + z**2) ** 2 / np.sqrt(radius**2 + 4.0 * z**2)


def _around(place: Array, rows: Array, shear: Array, radius: Array) -> tuple[Array, Array]:
    """Return the place at that radius: a pushing load lies towards (ε_xz, ε_yz)."""
    unit = np.where(shear > 0.0, shear, 1.0)
    return (
        place[..., 0] + radius * rows[..., 0] / unit,
        place[..., 1] + radius * rows[..., 1] / unit,
    )


def _linear_errors(
    s: Array, n: Array, radius: Array, z: float, force: Array, noise: list[Array]
) -> tuple[Array, Array]:
    """Return the errors of place and force: noise carried through to first order."""
    root = np.sqrt(9.0 * n**2 + 8.0 * s**2)
    by_s, by_n = (2.0 * z**2 - radius**2) / (z * root), -3.0 * radius / root
    inside = 4.0 * z / np.where(n > 0.0, root + 3.0 * n, 1.0)
    across = np.where(n > 0.0, inside, radius / np.where(s > 0.0, s, 1.0))
    radial = np.hypot(by_s * noise[0], by_n * noise[1])
    slope = 4.0 * radius / (radius**2 + z**2) - radius / (radius**2 + 4.0 * z**2)
    relative = np.hypot((s + slope * by_s) * noise[0], (n + slope * by_n) * noise[1])
    return radius_95(radial, across * noise[0]), NORMAL_95 * relative * force


def _curvature(
    s: Array, n: Array, radius: Array, z: float, force: Array, noise: list[Array]
) -> tuple[Array, Array]:
    """Return the errors from the curvature of the inverse: second differences over the noise.

    Infinite where the noise reaches signals that no load at a finite distance makes (s = 0
    under n < 0): far out, a taxel cannot bound how far.
    """
    place, amplitude = np.zeros_like(s), np.zeros_like(s)
    for along_s, along_n in _DIRECTIONS:
        pair: list[tuple[Array, Array]] = []
        for sign in (_SPREAD, -_SPREAD):
            moved_s, moved_n = s + sign * along_s * noise[0], n + sign * along_n * noise[1]
            out = z * _signed_root(np.abs(moved_s), moved_n)
            ratio = _lever(out, z) / _lever(radius, z) * np.hypot(moved_s, moved_n)
            pair.append((np.copysign(out, moved_s), force * ratio))
        place = np.maximum(place, np.abs(0.5 * (pair[0][0] + pair[1][0]) - radius))
        amplitude = np.maximum(amplitude, np.abs(0.5 * (pair[0][1] + pair[1][1]) - force))
    unbounded = (s <= _SPREAD * noise[0]) & (n <= _SPREAD * noise[1]) & (noise[0] > 0.0)
    return np.where(unbounded, np.inf, place), np.where(unbounded, np.inf, amplitude)


def _load(
    x: Array,
    y: Array,
    force: Array,
    z: float,
    inside: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    errors: tuple[Array, Array],
) -> PointLoad:
    """Return the record, with infinite errors where nothing was seen."""
    place, amplitude = (np.where(seen, error, np.inf) for error in errors)
    return PointLoad(x, y, force, force * z, inside, seen, place, amplitude)
