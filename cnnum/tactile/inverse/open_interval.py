"""The bounds of friction on a load that taxels on one line leave open in one direction."""

import numpy as np

from cnnum.tactile.checks import Array


def inside_cone(
    force: Array, error: Array, line: Array | None, spot: Array, friction: float
) -> tuple[Array, Array]:
    """Return the load in the middle of the possible ones, and an error that spans it.

    Parameters
    ----------
    force : (frames, 3) float
        Smallest load that fits, (Q, R, F).
    error : (frames, 3) float
        Of it, by the noise alone.
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
