"""Hooke's law of an isotropic solid, in forms that stay exact up to ν = 0.5."""

import numpy as np

from cnnum.tactile.checks import Array


def strain_from_stress(stress: Array, youngs_modulus: Array, poisson: Array) -> Array:
    """Return the strain tensor (..., 3, 3) that belongs to a stress tensor (..., 3, 3), Pa."""
    deviator, trace = _split(stress)
    shear = ((1 + poisson) / youngs_modulus)[..., None, None]
    volume = ((1 - 2 * poisson) / (3 * youngs_modulus) * trace)[..., None, None]
    return shear * deviator + volume * np.eye(3)


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
