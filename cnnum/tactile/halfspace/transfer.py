"""The half-space as a spatial filter: its response to a traction of one wave vector.

A traction q exp(i(k_x x + k_y y)) gives stress of the same wave vector; the factors between them
are here. k = |k| and depth z meet as kz alone, in three shapes. They are the harmonic extension
e^{-kz}, the low-pass (1 + kz) e^{-kz} and the band-pass kz e^{-kz}. Normal stress is the low-pass,
and normal strain is the band-pass at ν = 0.5.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting

Complex = NDArray[np.complex128]


@broadcasting
def harmonic_extension(k: ArrayLike, depth: ArrayLike) -> Array:
    """Return e^{-kz}: how a harmonic field of wave number k fades with depth.

    Parameters
    ----------
    k : (...) float, rad/m
        Wave number, 0 or more.
    depth : (...) float, m
        Depth z, 0 or more.

    Raises
    ------
    PhysicsError
        If a number is negative or not finite.
    """
    return np.asarray(np.exp(-_reach(k, depth)))


@broadcasting
def low_pass(k: ArrayLike, depth: ArrayLike) -> Array:
    """Return (1 + kz) e^{-kz}: normal stress at depth over the pressure on the surface, times -1.

    Parameters and errors are those of `harmonic_extension`; any ν.
    """
    reach = _reach(k, depth)
    return np.asarray((1 + reach) * np.exp(-reach))


@broadcasting
def band_pass(k: ArrayLike, depth: ArrayLike) -> Array:
    """Return kz e^{-kz}: normal strain at depth over the pressure, times -2E/3, at ν = 0.5.

    Parameters and errors are those of `harmonic_extension`. It peaks at k = 1/z and passes no
    mean: the "Mexican hat" of Vásárhelyi's dissertation (2007), 4.2.4.
    """
    reach = _reach(k, depth)
    return np.asarray(reach * np.exp(-reach))


@broadcasting
def stress_transfer(kx: ArrayLike, ky: ArrayLike, depth: ArrayLike) -> Complex:
    """Return the factors from surface traction to the stress that taxels see.

    Parameters
    ----------
    kx, ky : (...) float, rad/m
        Wave vector.
    depth : (...) float, m
        Depth z, 0 or more.

    Returns
    -------
    (..., 3, 3) complex
        Rows σ_xz, σ_yz, σ_zz; columns q_x, q_y, p. The same for every Poisson ratio.

    Raises
    ------
    PhysicsError
        If the depth is negative or a number not finite.

    References
    ----------
    Fourier transform of Boussinesq's and Cerruti's solutions (Johnson, Contact Mechanics, 3.2).
    """
    kx, ky = checks.finite("kx", kx), checks.finite("ky", ky)
    z = checks.not_negative("depth", depth)
    k = np.hypot(kx, ky)
    ex, ey = _direction(kx, ky, k)
    reach = k * z
    rows = [
        [-1 + reach * ex * ex, reach * ex * ey, 1j * reach * ex],
        [reach * ex * ey, -1 + reach * ey * ey, 1j * reach * ey],
        [1j * reach * ex, 1j * reach * ey, -1 - reach],
    ]
    return _matrix(rows, np.exp(-reach))


@broadcasting
def strain_transfer(
    kx: ArrayLike,
    ky: ArrayLike,
    depth: ArrayLike,
    *,
    youngs_modulus: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Complex:
    """Return the factors from surface traction to the strain that taxels see.

    Parameters
    ----------
    kx, ky, depth
        As in `stress_transfer`.
    youngs_modulus, poisson : (...) float
        Young's modulus, Pa, and Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., 3, 3) complex, 1/Pa
        Rows ε_xz, ε_yz, ε_zz (tensor strains); columns q_x, q_y, p. At k = 0 and ν < 0.5 it is the
        mean over all directions of a vanishing wave vector. So it is for a very large loaded disc.

    Raises
    ------
    PhysicsError
        If E <= 0, the depth is negative, ν is out of range, or a number not finite.
    """
    modulus = checks.positive("youngs_modulus", youngs_modulus)
    ratio = checks.poisson_ratio(poisson)
    kx, ky, depth = (
        checks.finite(name, part) for name, part in (("kx", kx), ("ky", ky), ("depth", depth))
    )
    shape = np.broadcast_shapes(*(np.shape(part) for part in (kx, ky, depth, modulus, ratio)))
    factors = np.broadcast_to(stress_transfer(kx, ky, depth), (*shape, 3, 3)).copy()
    k = np.hypot(kx, ky)
    ex, ey = _direction(kx, ky, k)
    fade = 2 * ratio * np.exp(-k * checks.not_negative("depth", depth))
    for column, trace in enumerate((1j * ex, 1j * ey, -np.ones_like(k))):
        factors[..., 2, column] -= fade * trace
    return np.asarray(((1 + ratio) / modulus)[..., None, None] * factors)


def _reach(k: ArrayLike, depth: ArrayLike) -> Array:
    return checks.not_negative("k", k) * checks.not_negative("depth", depth)


def _direction(kx: Array, ky: Array, k: Array) -> tuple[Array, Array]:
    """Return k's direction, 0 at k = 0."""
    safe = np.where(k > 0, k, 1.0)
    return kx / safe, ky / safe


def _matrix(rows: Sequence[Sequence[NDArray[np.generic]]], factor: Array) -> Complex:
    parts = np.broadcast_arrays(*(part for row in rows for part in row))
    flat = np.stack(parts, axis=-1).astype(np.complex128)
    return flat.reshape(*flat.shape[:-1], 3, 3) * factor[..., None, None]
