"""From readings of several taxels to the load by moments, its error, and what can be resolved."""

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from cnnum.errors import ArrayError, PhysicsError, name_error
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting

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


_COLLINEAR = 1e-9  # spread across a line, as a share of that along it, that is rounding


def force_from_moments(offsets: ArrayLike, moments: ArrayLike, *, depth: float) -> Array:
    """Return the load (Q, R, F) from the signals of three or more taxels at one depth.

    Parameters
    ----------
    offsets : (..., n, 2) float, m
        Places of the taxels relative to the load.
    moments : (..., n) float, N m
        M = Qx + Ry + Fz at each (5.12).
    depth : float, m

    Returns
    -------
    (..., 3) float, N
        The solution (5.13) for three taxels, least squares for more. If all taxels are on one line,
        a direction is undetermined, and the smallest load that fits is returned.

    Raises
    ------
    ArrayError
        If the shapes do not match.
    PhysicsError
        If the depth is not positive or a value is not finite.

    References
    ----------
    Vásárhelyi 2007, (5.12), (5.13).
    """
    place = checks.vector("offsets", offsets, 2)
    seen = checks.finite("moments", moments)
    z = checks.scalar("depth", checks.positive("depth", depth))
    if place.ndim < 2 or seen.ndim < 1 or place.shape[-2] != seen.shape[-1] or seen.shape[-1] < 1:
        raise ArrayError(
            "'offsets' (..., n, 2) and 'moments' (..., n) must belong to the same taxels, got "
            f"{place.shape} and {seen.shape}."
        )
    rows = np.concatenate([place, np.full((*place.shape[:-1], 1), z)], axis=-1)
    inverse = np.linalg.pinv(rows, rcond=_COLLINEAR)
    return np.asarray((inverse @ seen[..., np.newaxis])[..., 0], dtype=np.float64)


def largest_spacing(depth: ArrayLike) -> Array:
    """Return the pitch of a square array below which any load is within √2 z of three taxels.

    Parameters
    ----------
    depth : (...) float, m

    Returns
    -------
    (...) float, m
        √(8/5) z: the third-nearest taxel is never farther than (√5/2) times the pitch.

    Raises
    ------
    PhysicsError
        If the depth is not positive.

    References
    ----------
    Vásárhelyi 2007, (5.11), whose (1 + √2)/2 z is sufficient but not necessary.
    """
    return np.asarray(np.sqrt(1.6) * checks.positive("depth", depth), dtype=np.float64)


@broadcasting
def sliding_force(
    moment: ArrayLike, offset: ArrayLike, *, depth: float, friction: ArrayLike, direction: ArrayLike
) -> Array:
    """Return the load (Q, R, F) on the cover from one taxel, if the load is known to slide.

    Parameters
    ----------
    moment : (...) float, N m
        Qx + Ry + Fz.
    offset : (..., 2) float, m
        Place of the taxel relative to the load.
    depth : float, m
    friction : (...) float
        μ: |(Q, R)| = μF.
    direction : (...) float, rad
        Direction of the friction force on the cover, from x towards y.

    Returns
    -------
    (..., 3) float, N
        Zero where no such load pushes (F would not be positive).

    Raises
    ------
    PhysicsError
        If the depth is not positive, the friction negative, or a value not finite.

    References
    ----------
    Vásárhelyi 2007, the remark after (5.8).
    """
    place = checks.vector("offset", offset, 2)
    mu = checks.not_negative("friction", friction)
    angle = checks.finite("direction", direction)
    z = checks.scalar("depth", checks.positive("depth", depth))
    along_x, along_y = mu * np.cos(angle), mu * np.sin(angle)
    lever = along_x * place[..., 0] + along_y * place[..., 1] + z
    seen = checks.finite("moment", moment)
    normal = np.divide(seen, lever, out=np.zeros(np.broadcast(seen, lever).shape), where=lever != 0)
    normal = np.maximum(normal, 0.0)
    return np.stack(np.broadcast_arrays(along_x * normal, along_y * normal, normal), axis=-1)


def open_direction(taxels: Array) -> Array | None:
    """Return (normal_x, normal_y, −distance) of the line that all taxels are on, if they are.

    Parameters
    ----------
    taxels : (n, 2) float, m

    Returns
    -------
    (3,) float or None
        With a unit normal: normal · taxel = distance. A load at ℓ then can change along
        (z normal, normal · ℓ − distance) without any taxel seeing it.
    """
    middle = taxels.mean(axis=0)
    _, sizes, axes = np.linalg.svd(taxels - middle, full_matrices=True)
    spread = np.zeros(2)
    spread[: sizes.size] = sizes
    if spread[1] > _COLLINEAR * spread[0]:
        return None
    across = axes[1]
    return np.array([across[0], across[1], -across @ middle], dtype=np.float64)


QUANTITIES = ("strain", "stress")


@broadcasting
def resolution_limit(
    depth: ArrayLike,
    signal_to_noise: ArrayLike,
    *,
    quantity: str = "strain",
    pitch: ArrayLike = 0.0,
) -> Array:
    """Return the smallest half period of a pressure pattern that taxels under a cover can resolve.

    Under a pressure wave of wave number k, the normal strain falls as kz e^{−kz}, and the stress as
    (1 + kz) e^{−kz}. Where this is below the noise, nothing is left of the wave. A wave shorter
    than twice the pitch of the taxels is mistaken for a longer one.

    Parameters
    ----------
    depth : (...) float, m
        Thickness z of the cover.
    signal_to_noise : (...) float
        For the amplitude of the wave that the cover transmits best: kz = 1 for strain, uniform for
        stress. It is √(n/2) times as high for n taxels as for one; above 1.
    quantity : {"strain", "stress"}
        The measured quantity.
    pitch : (...) float, m
        Pitch of the taxels.

    Returns
    -------
    (...) float, m
        π/k, not below the pitch.

    Raises
    ------
    PhysicsError
        If the depth is not positive or the signal-to-noise ratio not above 1.
    UnknownNameError
        If the quantity is not one of the two.
    """
    if quantity not in QUANTITIES:
        raise name_error("quantity", quantity, QUANTITIES)
    z, spacing = checks.positive("depth", depth), checks.not_negative("pitch", pitch)
    ratio = checks.finite("signal_to_noise", signal_to_noise)
    checks.positive("signal_to_noise - 1", ratio - 1.0)
    lambert = cast(Any, special.lambertw(-1.0 / (np.e * ratio), k=-1))
    product = -np.real(np.asarray(lambert)).astype(np.float64)  # kz, or 1 + kz
    wave = product if quantity == "strain" else product - 1.0
    return np.asarray(np.maximum(np.pi * z / wave, spacing), dtype=np.float64)
