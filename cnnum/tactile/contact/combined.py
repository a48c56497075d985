"""Shear under a tangential force and a torque at once: no closed form, two approximations.

Below sliding, the tractions of the force alone and of the torque alone are scaled and added. Cell
by cell they are cut to friction times pressure. The scales are those with which the cut field still
carries both loads. Sliding as a whole turns about a pole, and friction points along the motion
everywhere. That is exact for rigid sliding, up to the cells' midpoints.
"""

import math

import numpy as np

from cnnum.tactile.checks import Array

# The scales converge linearly, slowest next to sliding: there 60 rounds leave less than 1 %.
_ROUNDS = 60
_CLOSE = 1e-9


def partial_shear(pulled: Array, twisted: Array, limit: Array, arm: Array) -> Array:
    """Return the scaled sum of two shear maps, cut to a limit.

    Parameters
    ----------
    pulled, twisted : (rows, cols, 2) float, Pa
        Shear under the force alone and under the torque alone.
    limit : (rows, cols) float, Pa
        Friction times pressure.
    arm : (rows, cols, 2) float, m
        (-y, x) of each cell from the contact's centre.

    Returns
    -------
    (rows, cols, 2) float, Pa
        Shear that carries both loads to about 1e-9, unless they are next to sliding.
    """
    direction = pulled.sum(axis=(0, 1))
    force, torque = float((pulled * direction).sum()), float((twisted * arm).sum())
    more_pull = more_twist = 1.0
    shear = limited(pulled + twisted, limit)
    for _ in range(_ROUNDS):
        pull = force / float((shear * direction).sum())
        twist = torque / float((shear * arm).sum())
        if max(abs(pull - 1), abs(twist - 1)) < _CLOSE:
            break
        more_pull, more_twist = more_pull * pull, more_twist * twist
        shear = limited(more_pull * pulled + more_twist * twisted, limit)
    return shear


def sliding_shear(direction: Array, ratio: float, limit: Array, arm: Array, size: float) -> Array:
    """Return the shear of a contact that slides and turns as a whole.

    Parameters
    ----------
    direction : (2,) float
        Unit vector of the tangential force.
    ratio : float, m
        Torque over force; its sign is the torque's.
    limit, arm
        As in `partial_shear`.
    size : float, m
        Contact radius, the scale of the pole's distance.

    Returns
    -------
    (rows, cols, 2) float, Pa
        Shear of size `limit` along the motion about the pole whose loads have that ratio.
    """

    def shear(log_speed: float) -> Array:
        motion = size * math.exp(log_speed) * direction + math.copysign(1.0, ratio) * arm
        speed = np.hypot(motion[..., 0], motion[..., 1])
        return motion * (limit / np.where(speed > 0, speed, 1.0))[..., None]

    def excess(log_speed: float) -> float:
        now = shear(log_speed)
        return abs(float((now * arm).sum())) - abs(ratio) * abs(float((now @ direction).sum()))

    low, high = -12.0, 12.0
    if excess(low) <= 0:
        return shear(low)
    if excess(high) >= 0:
        return shear(high)
    from scipy.optimize import brentq

    return shear(float(brentq(excess, low, high, xtol=1e-12)))


def limited(shear: Array, limit: Array) -> Array:
    """Return the shear map with each vector cut to the size `limit`, its direction kept."""
    size = np.hypot(shear[..., 0], shear[..., 1])
    over = size > limit
    factor = np.where(over, limit / np.where(over, size, 1.0), 1.0)
    return np.asarray(shear * factor[..., None])
