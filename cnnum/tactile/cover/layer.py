"""The flat cover as it is: a layer bonded to a rigid base, in closed form wave by wave.

A layer bonded to a rigid base as a spatial filter, in closed form for any Poisson ratio.

The convention is that of `cnnum.tactile.halfspace.surface`: a traction (q_x, q_y, p) of wave
vector k on top. Stress and displacement at a depth have the same wave vector. With ζ = k times the
height over the base, two fields vanish on the base (Papkovich and Neuber, κ = 3 - 4ν)::

    2G u_up = κ sinh ζ - ζ cosh ζ     2G u_along = -i ζ sinh ζ
    2G u_up = -ζ sinh ζ               2G u_along = -i (ζ cosh ζ + κ sinh ζ)

and the traction on top picks the sum of both. Everything is scaled by e^{-ζ}, so that no layer is
too thick. Nothing is divided by 1 - 2ν, so that ν = 0.5 is a place like any other.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting
from cnnum.tactile.cover.protocol import Profiles, arguments, to_components

Complex = NDArray[np.complex128]

SLOWEST = 1e-6
"""Least kh worked with; below it the layer behaves as at k = 0, to 1e-12."""


@dataclass(frozen=True, slots=True)
class LayerWaves:
    """Factors of one wave number, along the wave vector and across it.

    All are real and for unit traction. Those between a traction along the wave and one into the
    layer, either way, are to be multiplied by i. Displacements are of a shear modulus of 1, in
    metres.

    Attributes
    ----------
    zz_p, zz_q : (...) float
        σ_zz over the pressure, and over the shear along the wave (times i).
    along_p, along_q : (...) float
        σ_kz over the pressure (times i), and over the shear along the wave.
    across : (...) float
        σ_tz over the shear across the wave.
    strain_p, strain_q : (...) float
        G ε_zz over the pressure, and over the shear along the wave (times i).
    down_p, down_q : (...) float, m
        G u_z over the pressure, and over the shear along the wave (times i).
    slide_p, slide_q, slide_across : (...) float, m
        G u_k over the pressure (times i) and over the shear along the wave; G u_t across it.
    """

    zz_p: Array
    zz_q: Array
    along_p: Array
    along_q: Array
    across: Array
    strain_p: Array
    strain_q: Array
    down_p: Array
    down_q: Array
    slide_p: Array
    slide_q: Array
    slide_across: Array


@dataclass(frozen=True, slots=True)
class _Pair:
    """Stress, strain and displacement of both fields at one height, times e^{-ζ}."""

    zz: tuple[Array, Array]
    along: tuple[Array, Array]
    strain: tuple[Array, Array]
    up: tuple[Array, Array]
    side: tuple[Array, Array]


@broadcasting
def layer_waves(
    k: ArrayLike, depth: ArrayLike, *, thickness: ArrayLike, poisson: ArrayLike = 0.5
) -> LayerWaves:
    """Return the response of a bonded layer to a wave of traction.

    Parameters
    ----------
    k : (...) float, rad/m
        Wave number, 0 or more.
    depth : (...) float, m
        0 on top, up to the thickness on the base.
    thickness : (...) float, m
    poisson : (...) float
        Above -1 and at most 0.5.

    Raises
    ------
    PhysicsError
        If a number is out of range or not finite, or the depth beyond the thickness.
    """
    height = checks.positive("thickness", thickness)
    z = checks.not_negative("depth", depth)
    if np.any(z > height * (1 + 1e-12)):
        raise PhysicsError(
            f"'depth': expected at most the layer's thickness, {height.min():g} m, got {z.max():g}."
        )
    number = np.maximum(checks.not_negative("k", k), SLOWEST / height)
    ratio = checks.poisson_ratio(poisson)
    top = number * height
    here = number * np.maximum(height - z, 0.0)
    first = _weights(_pair(top, ratio), _determinant(top, ratio))
    return _combined(first, _pair(here, ratio), number, here, top)


def _pair(zeta: Array, poisson: Array) -> _Pair:
    c, s = (1 + np.exp(-2 * zeta)) / 2, -np.expm1(-2 * zeta) / 2
    kappa, n, m = 3 - 4 * poisson, 1 - 2 * poisson, 2 - 2 * poisson
    return _Pair(
        zz=(m * c - zeta * s, -(n * s + zeta * c)),
        along=(n * s - zeta * c, -(m * c + zeta * s)),
        strain=(n * c - zeta * s / 2, -(s + zeta * c) / 2),
        up=((kappa * s - zeta * c) / 2, -zeta * s / 2),
        side=(-zeta * s / 2, -(zeta * c + kappa * s) / 2),
    )


def _determinant(top: Array, poisson: Array) -> Array:
    fade = np.exp(-2 * top)
    sinh = -np.expm1(-2 * top) / 2
    return (2 - 2 * poisson) ** 2 * fade + top**2 * fade + (3 - 4 * poisson) * sinh**2


def _weights(top: _Pair, determinant: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return how much of each field a pressure calls for, and a shear along the wave (times i)."""
    (s1, s2), (t1, t2) = top.zz, top.along
    pressed = (t2 / determinant, -t1 / determinant)
    sheared = (-s2 / determinant, s1 / determinant)
    return pressed, sheared


def _combined(
    weights: tuple[tuple[Array, Array], tuple[Array, Array]],
    here: _Pair,
    k: Array,
    zeta: Array,
    top: Array,
) -> LayerWaves:
    fade = np.exp(zeta - top)
    pressed, sheared = weights

    def mixed(weight: tuple[Array, Array], field: tuple[Array, Array]) -> Array:
        return np.asarray((weight[0] * field[0] + weight[1] * field[1]) * fade)

    cosh = (1 + np.exp(-2 * top)) / 2
    return LayerWaves(
        zz_p=mixed(pressed, here.zz),
        zz_q=mixed(sheared, here.zz),
        along_p=-mixed(pressed, here.along),
        along_q=mixed(sheared, here.along),
        across=np.asarray(-(1 + np.exp(-2 * zeta)) / 2 / cosh * fade),
        strain_p=mixed(pressed, here.strain),
        strain_q=mixed(sheared, here.strain),
        down_p=-mixed(pressed, here.up) / k,
        down_q=-mixed(sheared, here.up) / k,
        slide_p=mixed(pressed, here.side) / k,
        slide_q=-mixed(sheared, here.side) / k,
        slide_across=np.asarray(-np.expm1(-2 * zeta) / 2 / cosh * fade / k),
    )


@broadcasting
def layer_stress_transfer(
    kx: ArrayLike,
    ky: ArrayLike,
    depth: ArrayLike,
    *,
    thickness: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Complex:
    """Return the factors from surface traction to the stress that taxels in a layer see.

    Parameters
    ----------
    kx, ky : (...) float, rad/m
        Wave vector.
    depth, thickness, poisson
        As in `layer_waves`.

    Returns
    -------
    (..., 3, 3) complex
        Rows σ_xz, σ_yz, σ_zz; columns q_x, q_y, p; `halfspace.stress_transfer` for a thick layer.

    Raises
    ------
    PhysicsError
        As `layer_waves`.
    """
    x, y, waves = _waves(kx, ky, depth, thickness, poisson)
    rows = _turned(waves.along_q, waves.across, x, y)
    return _assembled(rows, x, y, waves.along_p, waves.zz_q, waves.zz_p)


@broadcasting
def layer_displacement_transfer(
    kx: ArrayLike,
    ky: ArrayLike,
    depth: ArrayLike,
    *,
    thickness: ArrayLike,
    youngs_modulus: ArrayLike,
    poisson: ArrayLike = 0.5,
) -> Complex:
    """Return the factors from surface traction to displacement in a layer.

    Parameters
    ----------
    kx, ky, depth, thickness, poisson
        As in `layer_stress_transfer`.
    youngs_modulus : (...) float, Pa

    Returns
    -------
    (..., 3, 3) complex, m/Pa
        Rows u_x, u_y, u_z; columns q_x, q_y, p.

    Raises
    ------
    PhysicsError
        As `layer_waves`, or if E <= 0.
    """
    modulus = checks.positive("youngs_modulus", youngs_modulus)
    x, y, waves = _waves(kx, ky, depth, thickness, poisson)
    rows = _turned(waves.slide_q, waves.slide_across, x, y)
    shear = modulus / (2 * (1 + checks.poisson_ratio(poisson)))
    factors = _assembled(rows, x, y, waves.slide_p, waves.down_q, waves.down_p)
    return np.asarray(factors / shear[..., None, None])


def _waves(
    kx: ArrayLike, ky: ArrayLike, depth: ArrayLike, thickness: ArrayLike, poisson: ArrayLike
) -> tuple[Array, Array, LayerWaves]:
    kx, ky = checks.finite("kx", kx), checks.finite("ky", ky)
    k = np.hypot(kx, ky)
    safe = np.where(k > 0, k, 1.0)
    waves = layer_waves(k, depth, thickness=thickness, poisson=poisson)
    return kx / safe, ky / safe, waves


def _turned(along: Array, across: Array, x: Array, y: Array) -> list[list[Array]]:
    """Return the rows of the components `along` the unit vector (x, y) and `across` it."""
    split = along - across
    mixed = split * x * y
    return [[across + split * x * x, mixed], [mixed, across + split * y * y]]


def _assembled(
    rows: list[list[Array]], x: Array, y: Array, side: Array, down_q: Array, down_p: Array
) -> Complex:
    table = [
        [*rows[0], 1j * x * side],
        [*rows[1], 1j * y * side],
        [1j * x * down_q, 1j * y * down_q, down_p],
    ]
    parts = np.broadcast_arrays(*(part for row in table for part in row))
    flat = np.stack(parts, axis=-1).astype(np.complex128)
    return flat.reshape(*flat.shape[:-1], 3, 3)


REACH = 45.0
"""kz up to which waves count: e^{-45} is 3e-20."""

FARTHEST = 60.0
"""Distance over depth up to which a layer is worked out: far beyond, nothing arrives."""

_CHUNK = 256  # distances at once: their tables stay in the cache


@dataclass(frozen=True, slots=True)
class LayerCover:
    """A layer of finite thickness on a rigid base, see `protocol.Cover`.

    At ν = 0.5 the base lets no normal strain arise where the taxels lie, only stress: ε_zz is
    zero on the base. Loads farther away than 60 depths count as none.

    Attributes
    ----------
    thickness : float, m
    youngs_modulus : float, Pa
    poisson : float
        Above -1 and at most 0.5.
    taxel_depth : float, m, optional
        On the base unless given.

    Raises
    ------
    PhysicsError
        If a number is out of range.
    """

    thickness: float
    youngs_modulus: float
    poisson: float = 0.5
    taxel_depth: float | None = None

    def __post_init__(self) -> None:
        checks.scalar("thickness", checks.positive("thickness", self.thickness))
        checks.positive("youngs_modulus", self.youngs_modulus)
        checks.poisson_ratio(self.poisson)
        checks.scalar("taxel_depth", checks.positive("taxel_depth", self.depth))
        if self.depth > self.thickness:
            raise PhysicsError(
                f"'taxel_depth': expected at most the thickness, {self.thickness:g} m, "
                f"got {self.depth:g}."
            )

    @property
    def depth(self) -> float:
        """Depth of the taxels, m."""
        return self.thickness if self.taxel_depth is None else self.taxel_depth

    def stress(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return σ_xz, σ_yz, σ_zz at taxels, (..., 3) Pa."""
        load, taxel, push = arguments(load_at, taxel_at, force)
        away = taxel - load
        return to_components(self._profiles(np.hypot(away[..., 0], away[..., 1]))[0], away, push)

    def strain(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return ε_xz, ε_yz, ε_zz at taxels, (..., 3)."""
        load, taxel, push = arguments(load_at, taxel_at, force)
        away = taxel - load
        stress, (pushed, dragged) = self._profiles(np.hypot(away[..., 0], away[..., 1]))
        shear = self.youngs_modulus / (2 * (1 + self.poisson))
        # of the normal components only the strain, of the tangential ones stress / 2G
        halves = stress._replace(pushed_zz=2 * pushed, dragged_zz=2 * dragged)
        return to_components(halves, away, push) / (2 * shear)

    def _profiles(self, distance: Array) -> tuple[Profiles, tuple[Array, Array]]:
        """Return stress, and G ε_zz pushed and dragged, of unit forces."""
        flat, place = np.unique(distance.reshape(-1), return_inverse=True)
        k, weight = _waves_and_weights(
            min(flat.max(initial=0.0), FARTHEST * self.depth), self.depth
        )
        waves = layer_waves(k, self.depth, thickness=self.thickness, poisson=self.poisson)
        near = np.flatnonzero(flat <= FARTHEST * self.depth)
        rows = np.zeros((7, flat.size))
        for start in range(0, near.size, _CHUNK):
            part = near[start : start + _CHUNK]
            rows[:, part] = _hankel(waves, k, weight, flat[part])
        shaped = rows[:, place.reshape(-1)].reshape(7, *distance.shape)
        return Profiles(*shaped[:5]), (shaped[5], shaped[6])


def _waves_and_weights(farthest: float, depth: float) -> tuple[Array, Array]:
    """Return Gauss points on (0, 45/z), several to each swing of the Bessel functions."""
    end = REACH / depth
    panels = 12 + math.ceil(end * farthest / (2 * math.pi))
    x, w = np.polynomial.legendre.leggauss(16)
    width = end / panels
    starts = width * np.arange(panels)[:, None]
    k = (starts + width * (x + 1) / 2).reshape(-1)
    return k, np.tile(w * width / 2, panels)


def _hankel(waves: LayerWaves, k: Array, weight: Array, distance: Array) -> Array:
    """Return the seven profiles at distances: inverse transforms of the waves, (7, n)."""
    from scipy.special import j0, j1

    measure = k * weight / (2 * math.pi)
    reach = k[:, None] * distance
    zero, one = j0(reach), j1(reach)
    # J2 from both: smooth at 0, where its error is rounding of 1e-16 of J0
    two = np.where(reach > 1e-3, 2 * one / np.maximum(reach, 1e-3) - zero, reach**2 / 8)
    mean, split = (waves.along_q + waves.across) / 2, (waves.along_q - waves.across) / 2
    even, odd = (measure * mean) @ zero, (measure * split) @ two
    return np.stack(
        [
            (measure * waves.zz_p) @ zero,
            -(measure * waves.along_p) @ one,
            -(measure * waves.zz_q) @ one,
            even - odd,
            -even - odd,
            (measure * waves.strain_p) @ zero,
            -(measure * waves.strain_q) @ one,
        ]
    )
