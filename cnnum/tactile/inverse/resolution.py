"""How fine a load map can be: the cover is a low-pass, and waves under the noise are lost."""

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from cnnum.errors import name_error
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting

QUANTITIES = ("strain", "stress")


@broadcasting
def resolution_limit(
    depth: ArrayLike,
    signal_to_noise: ArrayLike,
    *,
    quantity: str = "strain",
    pitch: ArrayLike = 0.0,
) -> Array:
    """Return the smallest half period of a pressure pattern that taxels under a cover can see.

    Under a pressure wave of wave number k the normal strain falls as kz e^{−kz}. The stress falls
    as (1 + kz) e^{−kz}. Where that is below the noise, nothing is left of the wave. A wave shorter
    than twice the pitch of the taxels is mistaken for a longer one.

    Parameters
    ----------
    depth : (...) float, m
        Thickness z of the cover.
    signal_to_noise : (...) float
        Of the amplitude of the wave that the cover hands on best: kz = 1 for strain, uniform for
        stress. All n taxels know it √(n/2) better than one does; above 1.
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
