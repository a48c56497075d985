"""From the noise of a taxel to the error that is stated with an answer."""

import numpy as np

from cnnum.errors import PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array

Noise = float | tuple[float, float]
"""RMS of the noise in the shear and in the normal component, or one number for both."""

NORMAL_95 = 1.959964
"""Half-width, in standard deviations, that covers a normal variable in 95 % of cases."""


def shear_and_normal(noise: Noise) -> tuple[float, float]:
    """Return the noise of the shear and of the normal component.

    Raises
    ------
    PhysicsError
        If a noise is negative or not finite, or there are neither one nor two.
    """
    values = checks.finite("noise", noise)
    if values.shape not in ((), (2,)) or (values < 0.0).any():
        raise PhysicsError(
            f"'noise' must be an RMS of 0 or more, or a pair (shear, normal), got {noise}."
        )
    shear, normal = np.broadcast_to(values, 2).tolist()
    return shear, normal


def radius_95(first: Array, second: Array) -> Array:
    """Return the radius that holds a two-dimensional normal error in 95 % of cases.

    Parameters
    ----------
    first, second : (...) float
        Standard deviations along the principal axes, in either order.

    References
    ----------
    Leenhouts, Navigation 32 (1985) 16: a cubic in their ratio, within 0.1 % of the integral.
    """
    large = np.maximum(first, second)
    small = np.minimum(first, second)
    usable = np.isfinite(large) & (large > 0.0)
    q = np.divide(small, large, out=np.zeros_like(large), where=usable)
    return large * (1.960790 + q * (0.004071 + q * (0.114276 + q * 0.371625)))
