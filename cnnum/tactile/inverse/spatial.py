"""A point load with all three components, from the whole array.

The point load seen by many taxels: strain, its derivatives, and the best force for a place.

Lengths here are in units of the depth, so that z = 1.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.inverse.moments import (
    NORMAL_95,
    Noise,
    open_direction,
    radius_95,
    shear_and_normal,
)
from cnnum.tactile.inverse.point import locate


def directions(offset: Array) -> Array:
    """Return (..., n, 3) the strain rows for Qx + Ry + F = 1, without 3/(4πEz²), (4.16)."""
    x, y = offset[..., 0], offset[..., 1]
    squared = x**2 + y**2
    rows = np.stack([-3.0 * x, -3.0 * y, squared - 2.0], axis=-1)
    return np.asarray(rows / ((squared + 1.0) ** 2.5)[..., np.newaxis], dtype=np.float64)


def lever(offset: Array) -> Array:
    """Return (..., n, 3) the rows (x, y, 1) of Qx + Ry + F."""
    return np.concatenate([offset, np.ones((*offset.shape[:-1], 1))], axis=-1)


def linear_part(offset: Array, weights: Array) -> Array:
    """Return (..., 3n, 3): weighted strain for each component of the force."""
    rows = (weights * directions(offset))[..., :, np.newaxis] * lever(offset)[..., np.newaxis, :]
    return rows.reshape(*rows.shape[:-3], -1, 3)


def place_part(offset: Array, force: Array, weights: Array) -> Array:
    """Return (..., 3n, 2): weighted change of strain as the load moves along x and y."""
    squared = np.sum(offset**2, axis=-1)[..., np.newaxis]
    rows = directions(offset)
    seen = np.sum(lever(offset) * force[..., np.newaxis, :], axis=-1)[..., np.newaxis]
    columns: list[Array] = []
    for axis in (0, 1):
        along = offset[..., axis, np.newaxis]
        slope = np.zeros_like(rows)
        slope[..., axis] = -3.0
        slope[..., 2] = 2.0 * offset[..., axis]
        slope = slope / (squared + 1.0) ** 2.5 - 5.0 * along / (squared + 1.0) * rows
        change = slope * seen + rows * force[..., np.newaxis, axis, np.newaxis]
        columns.append(-weights * change)  # the offset is taxel − load
    whole = np.stack(columns, axis=-1)
    return whole.reshape(*whole.shape[:-3], -1, 2)


def best_force(design: Array, target: Array) -> tuple[Array, Array]:
    """Return the least-squares force and the sum of squares it leaves.

    Parameters
    ----------
    design : (..., m, 3) float
    target : (..., m) float
    """
    inverse = np.linalg.pinv(design, rcond=1e-11)
    force = np.asarray((inverse @ target[..., np.newaxis])[..., 0], dtype=np.float64)
    return force, squares_left(design, force, target)


def squares_left(design: Array, force: Array, target: Array) -> Array:
    """Return the sum of squares of target − design · force."""
    left = target - (design @ force[..., np.newaxis])[..., 0]
    return np.asarray(np.sum(left**2, axis=-1), dtype=np.float64)


def inside_cone(
    force: Array, error: Array, line: Array | None, spot: Array, friction: float
) -> tuple[Array, Array]:
    """Return the load in the middle of the possible ones, and an error that spans it.

    Parameters
    ----------
    force : (frames, 3) float
        Smallest load that fits, (Q, R, F).
    error : (frames, 3) float
        Error of the estimate due to noise alone.
    line : (3,) float or None
        From `open_direction`, in units of the depth; None leaves everything as it is.
    spot : (frames, 2) float
        Places of the loads, in units of the depth.
    friction : float
        Loads with |(Q, R)| ≤ μF are possible.
    """
    if line is None:
        return force, error
    aside = spot @ line[:2] + line[2]
    free = np.stack([np.full_like(aside, line[0]), np.full_like(aside, line[1]), aside], axis=-1)
    free = free / np.linalg.norm(free, axis=-1, keepdims=True)
    low, high = _interval(force, free, friction)
    bounded = np.isfinite(low) & np.isfinite(high)
    middle = np.where(
        bounded, 0.5 * (np.where(bounded, low, 0.0) + np.where(bounded, high, 0.0)), 0.0
    )
    half = np.where(bounded, 0.5 * np.where(bounded, high - low, 0.0), np.inf)
    touched = np.abs(free) > 1e-12
    reach = np.where(touched, half[:, np.newaxis], 0.0) * np.where(touched, np.abs(free), 1.0)
    return force + middle[:, np.newaxis] * free, error + reach


def _interval(force: Array, free: Array, friction: float) -> tuple[Array, Array]:
    """Return the ends of t where force + t · free is in the cone; infinite where it has no ends.

    The cone is Q² + R² ≤ μ²F², F ≥ 0. A load outside it for every t (pulled, or by noise)
    is left open too.
    """
    signs = np.array([1.0, 1.0, -(friction**2)])
    a = np.sum(signs * free**2, axis=-1)
    b = np.sum(signs * free * force, axis=-1)
    c = np.sum(signs * force**2, axis=-1)
    inner = b**2 - a * c
    closed = (a > 1e-12) & (inner >= 0.0)
    root = np.sqrt(np.where(closed, inner, 0.0))
    safe = np.where(closed, a, 1.0)
    low, high = (-b - root) / safe, (-b + root) / safe
    middle = 0.5 * (low + high)
    closed &= force[:, 2] + middle * free[:, 2] >= 0.0
    return np.where(closed, low, -np.inf), np.where(closed, high, np.inf)


_STARTS = 4  # taxels, the strongest, whose own answers are tried as a start
_ROUNDS = 40
_DONE = 1e-14  # relative fall of the squares that is rounding


@dataclass(frozen=True, slots=True, eq=False)
class SpatialLoad:
    """A point load in three directions.

    Attributes
    ----------
    x, y : (...) float, m
        Place on the cover, in the coordinates of the taxels.
    force : (..., 3) float, N
        (Q, R, F).
    position_error : (...) float, m
        Radius that contains the true place in 95 % of cases, for the given noise.
    force_error : (..., 3) float, N
        Half-width that contains each component in 95 % of cases. If the taxels leave a direction
        undetermined (all on one line), it also spans the friction cone, and is infinite if the cone
        sets no limit.
    residual : (...) float
        RMS strain that the load does not explain; if it is far above the noise, the load is not a
        single point load.
    determined : bool
        Whether the taxels determine all three components.
    seen : (...) bool
        Whether there was any signal.
    """

    x: Array
    y: Array
    force: Array
    position_error: Array
    force_error: Array
    residual: Array
    determined: bool
    seen: NDArray[np.bool_]


def locate_load(
    strain: ArrayLike,
    taxels: ArrayLike,
    *,
    depth: float,
    youngs_modulus: float,
    noise: Noise = 0.0,
    friction: float = 1.0,
) -> SpatialLoad:
    """Return the place and the three components of the point load on an array of taxels.

    The dissertation takes the place from one taxel and the force from three by (5.13). It divides
    by ε_zz at each taxel, which fails on the ring ρ = √2 z. Here its answers are only initial
    values; place and force are then fitted to the three components at all taxels at once.

    Parameters
    ----------
    strain : (..., n, 3) float
        ε_xz, ε_yz, ε_zz at n ≥ 2 taxels, tension positive.
    taxels : (n, 2) float, m
    depth : float, m
    youngs_modulus : float, Pa
    noise : float or (float, float)
        RMS noise of the shear and the normal strain; 0 for exact data.
    friction : float
        Largest possible |(Q, R)|/F; used only for taxels on one line.

    Returns
    -------
    SpatialLoad

    Raises
    ------
    ArrayError
        If there are fewer than two taxels, or the shapes do not match.
    PhysicsError
        If a parameter is out of range or a value is not finite.

    References
    ----------
    Vásárhelyi 2007, (5.11)–(5.13); three taxels are near enough anywhere if their spacing is
    below √(8/5) z (5.11 asks more than is needed).
    """
    rows, place = _checked(strain, taxels)
    z = checks.scalar("depth", checks.positive("depth", depth))
    modulus = checks.scalar("youngs_modulus", checks.positive("youngs_modulus", youngs_modulus))
    mu = checks.scalar("friction", checks.not_negative("friction", friction))
    spread = shear_and_normal(noise)
    lead = rows.shape[:-2]
    flat = rows.reshape(-1, *rows.shape[-2:])
    peak = np.abs(flat).max(axis=(-2, -1))
    seen = peak > 0.0
    unit = np.where(seen, peak, 1.0)[:, np.newaxis]
    weights = _weights(spread)
    target = (flat / unit[..., np.newaxis] * weights).reshape(len(flat), -1)
    spot, force = _fit(target, place / z, weights, _starts(flat, place / z))
    newton = 4.0 * np.pi * modulus * z**2 / 3.0 * unit
    deviation = max(spread) / unit[:, 0]
    errors, left = _errors(target, place / z, weights, spot, force, deviation)
    force, force_error = inside_cone(
        force, NORMAL_95 * errors[1], open_direction(place / z), spot, mu
    )
    residual = np.sqrt(left / target.shape[1]) * unit[:, 0]
    return SpatialLoad(
        x=np.where(seen, spot[:, 0] * z, 0.0).reshape(lead),
        y=np.where(seen, spot[:, 1] * z, 0.0).reshape(lead),
        force=np.where(seen[:, np.newaxis], force * newton, 0.0).reshape(*lead, 3),
        position_error=np.where(seen, errors[0] * z, np.inf).reshape(lead),
        force_error=np.where(seen[:, np.newaxis], force_error * newton, np.inf).reshape(*lead, 3),
        residual=residual.reshape(lead),
        determined=open_direction(place / z) is None,
        seen=seen.reshape(lead),
    )


def _checked(strain: ArrayLike, taxels: ArrayLike) -> tuple[Array, Array]:
    rows, place = checks.vector("strain", strain), checks.vector("taxels", taxels, 2)
    if place.ndim != 2 or len(place) < 2 or rows.ndim < 2 or rows.shape[-2] != len(place):
        raise ArrayError(
            "'strain' (..., n, 3) and 'taxels' (n, 2) must belong to the same taxels, at least "
            f"two of them, got {rows.shape} and {place.shape}; for one taxel use `locate`."
        )
    return rows, place


def _weights(spread: tuple[float, float]) -> Array:
    """Return weights of shear and normal rows, 1 for the noisier one."""
    largest = max(spread)
    if min(spread) <= 0.0:
        return np.ones(3)
    shear, normal = largest / spread[0], largest / spread[1]
    return np.array([shear, shear, normal])


def _starts(rows: Array, place: Array) -> Array:
    """Return (frames, k, 2) places: each strong taxel's own, for a push and for a pull."""
    strength = np.sum(rows**2, axis=-1)
    count = min(_STARTS, rows.shape[1])
    strongest = np.argsort(-strength, axis=-1)[:, :count]
    own = np.take_along_axis(rows, strongest[..., np.newaxis], axis=1)
    at = place[strongest]
    places: list[Array] = []
    for sign in (1.0, -1.0):
        load = locate(sign * own, depth=1.0, youngs_modulus=1.0, taxel=at)
        places.append(np.stack([load.x, load.y], axis=-1))
    starts = np.concatenate([*places, at], axis=1)
    middle, reach = place.mean(axis=0), 10.0 + np.ptp(place, axis=0).max()
    return np.asarray(middle + np.clip(starts - middle, -reach, reach), dtype=np.float64)


def _fit(target: Array, place: Array, weights: Array, starts: Array) -> tuple[Array, Array]:
    """Return places and forces with the least squares left, from the best of the starts."""
    every = place[np.newaxis, np.newaxis] - starts[:, :, np.newaxis, :]
    _, left = best_force(linear_part(every, weights), target[:, np.newaxis])
    best = np.argmin(left, axis=1)
    spot = np.take_along_axis(starts, best[:, np.newaxis, np.newaxis], axis=1)[:, 0]
    return _descend(target, place, weights, spot)


def _descend(target: Array, place: Array, weights: Array, spot: Array) -> tuple[Array, Array]:
    """Levenberg–Marquardt over the place; the force is solved for at each (variable projection)."""
    design = linear_part(place - spot[:, np.newaxis], weights)
    force, left = best_force(design, target)
    damping = np.full(len(spot), 1e-6)
    for _ in range(_ROUNDS):
        step = _step(target, place, weights, spot, force, damping)
        moved = spot + step
        trial = linear_part(place - moved[:, np.newaxis], weights)
        trial_force, trial_left = best_force(trial, target)
        better = trial_left < left
        fallen = np.max(
            np.where(better, (left - trial_left) / np.maximum(left, 1e-300), 0.0), initial=0
        )
        small = np.max(np.abs(step), initial=0.0) < 1e-13
        spot = np.where(better[:, np.newaxis], moved, spot)
        force = np.where(better[:, np.newaxis], trial_force, force)
        left = np.where(better, trial_left, left)
        damping = np.clip(np.where(better, damping / 10.0, damping * 10.0), 1e-15, 1e6)
        if small or (better.all() and fallen < _DONE):
            break
    return spot, force


def _step(
    target: Array, place: Array, weights: Array, spot: Array, force: Array, damping: Array
) -> Array:
    """Return the damped Gauss–Newton step of the place, the force eliminated."""
    offset = place - spot[:, np.newaxis]
    design = linear_part(offset, weights)
    slope = place_part(offset, force, weights)
    left = target - (design @ force[..., np.newaxis])[..., 0]
    slope = slope - design @ (np.linalg.pinv(design, rcond=1e-11) @ slope)
    square = np.swapaxes(slope, -1, -2) @ slope
    pull = (np.swapaxes(slope, -1, -2) @ left[..., np.newaxis])[..., 0]
    trace = np.maximum(np.trace(square, axis1=-2, axis2=-1), 1e-300)
    square = square + (damping * trace)[:, np.newaxis, np.newaxis] * np.eye(2)
    xx, xy, yy = square[:, 0, 0], square[:, 0, 1], square[:, 1, 1]
    step = np.stack([yy * pull[:, 0] - xy * pull[:, 1], xx * pull[:, 1] - xy * pull[:, 0]], axis=-1)
    step = step / np.maximum(xx * yy - xy**2, 1e-300)[:, np.newaxis]
    return np.asarray(np.clip(step, -1.0, 1.0), dtype=np.float64)


def _errors(
    target: Array, place: Array, weights: Array, spot: Array, force: Array, deviation: Array
) -> tuple[tuple[Array, Array], Array]:
    """Return the place's 95 % radius, the force's standard deviations, and the squares left."""
    offset = place - spot[:, np.newaxis]
    design = linear_part(offset, weights)
    jacobian = np.concatenate([place_part(offset, force, weights), design], axis=-1)
    inverse = np.linalg.pinv(jacobian, rcond=1e-11)
    covariance = (inverse @ np.swapaxes(inverse, -1, -2)) * (deviation**2)[
        :, np.newaxis, np.newaxis
    ]
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[:, :2, :2]), 0.0))
    radius = radius_95(spread[:, 0], spread[:, 1])
    diagonal = np.sqrt(np.maximum(np.einsum("...ii->...i", covariance)[:, 2:], 0.0))
    return (radius, diagonal), squares_left(design, force, target)
