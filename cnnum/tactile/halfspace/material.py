"""Hooke's law of an isotropic solid, in forms that stay exact up to ν = 0.5."""

import numpy as np
from numpy.typing import ArrayLike

from cnnum.errors import ArrayError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting


@broadcasting
def strain_from_stress(
    stress: ArrayLike, *, youngs_modulus: ArrayLike, poisson: ArrayLike = 0.5
) -> Array:
    """Return the strain that belongs to a stress.

    Parameters
    ----------
    stress : (..., 3, 3) float, Pa
        Stress tensor.
    youngs_modulus : (...) float, Pa
        Young's modulus.
    poisson : (...) float
        Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., 3, 3) float
        Strain tensor, tensor shear strains.

    Raises
    ------
    PhysicsError
        If E <= 0, ν is out of range, or a number is not finite.
    ArrayError
        If the last two axes are not 3 by 3.
    """
    field = checks.vector("stress", stress)
    if field.ndim < 2 or field.shape[-2] != 3:
        raise ArrayError(f"'stress': expected shape (..., 3, 3), got {field.shape}.")
    modulus = checks.positive("youngs_modulus", youngs_modulus)
    ratio = checks.poisson_ratio(poisson)
    deviator, trace = _split(field)
    shear = ((1 + ratio) / modulus)[..., None, None]
    volume = ((1 - 2 * ratio) / (3 * modulus) * trace)[..., None, None]
    return np.asarray(shear * deviator + volume * np.eye(3))


def energy_density(stress: Array, youngs_modulus: Array, poisson: Array) -> Array:
    """Return the strain energy density (...), J/m³, of a stress tensor (..., 3, 3), Pa.

    The energies of shape and of volume are summed: both are positive, so nothing cancels.
    """
    deviator, trace = _split(stress)
    shape = (1 + poisson) / (2 * youngs_modulus) * (deviator**2).sum(axis=(-2, -1))
    return np.asarray(shape + (1 - 2 * poisson) / (6 * youngs_modulus) * trace**2)


def _split(stress: Array) -> tuple[Array, Array]:
    trace = np.trace(stress, axis1=-2, axis2=-1)
    return stress - trace[..., None, None] / 3 * np.eye(3), trace
