"""The flat cover as it is: a layer bonded to a rigid base."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cnnum.errors import PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.axial import Profiles, to_components
from cnnum.tactile.cover.layer_waves import LayerWaves, layer_waves
from cnnum.tactile.cover.protocol import arguments

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
