"""The cover with a ridge, like a fingerprint's: by statics, on a flat layer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cnnum.tactile import checks, halfspace
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.protocol import arguments

STRIPS = 8
"""Cells to each side of the foot; the traction is linear, the cells carry its mean."""


@dataclass(frozen=True, slots=True)
class RidgeCover:
    """A ridge along y over the middle, with flat cover under it; see `protocol.Cover`.

    The model is statics. Only the ridge is touched; a load next to it rests on its edge. Across,
    the ridge hands on force and moment; a shear force acts at its height. The traction is linear
    over the foot's width. Along, the load has spread by `spread` to each side when it reaches the
    foot. It moves on as over a flat cover. So it is direction-selective, as in Fig. 6.7.

    Attributes
    ----------
    depth : float, m
        Depth of the taxels below the ridge's foot.
    youngs_modulus : float, Pa
    width : float, m
        0.36–0.76 mm in the dissertation.
    height : float, m
        0.25–0.28 mm in the dissertation.
    spread : float, m, optional
        The height unless given: loads spread at about 45°.
    poisson : float
        Above -1 and at most 0.5.

    References
    ----------
    Vásárhelyi, dissertation (2007), 6.3.1; linear traction: beam theory.
    """

    depth: float
    youngs_modulus: float
    width: float = 0.5e-3
    height: float = 0.265e-3
    spread: float | None = None
    poisson: float = 0.5

    def __post_init__(self) -> None:
        for name in ("depth", "youngs_modulus", "width", "height"):
            checks.positive(name, getattr(self, name))
        if self.spread is not None:
            checks.positive("spread", self.spread)
        checks.poisson_ratio(self.poisson)

    @property
    def length(self) -> float:
        """Length of the foot that carries one load, m."""
        return 2 * (self.height if self.spread is None else self.spread)

    def stress(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return σ_xz, σ_yz, σ_zz at taxels, (..., 3) Pa."""
        return self._summed(load_at, taxel_at, force, strain=False)

    def strain(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return ε_xz, ε_yz, ε_zz at taxels, (..., 3)."""
        return self._summed(load_at, taxel_at, force, strain=True)

    def traction(self, load_at: ArrayLike, force: ArrayLike) -> tuple[Array, Array]:
        """Return the cells of the foot and their loads.

        Parameters
        ----------
        load_at : (..., 2) float, m
        force : (..., 3) float, N

        Returns
        -------
        places : (cells, 2) float, m
            Centres, from the ridge's axis and along it from the load.
        traction : (..., cells, 3) float, Pa
            (q_x, q_y, p) of each.
        """
        load, _, push = arguments(load_at, [0.0, 0.0], force)
        steps = (np.arange(STRIPS) + 0.5) / STRIPS - 0.5
        x, y = (part.reshape(-1) for part in np.meshgrid(self.width * steps, self.length * steps))
        aside = np.clip(load[..., 0], -self.width / 2, self.width / 2)
        across = push[..., 2] * aside + push[..., 0] * self.height
        along = push[..., 1] * self.height
        # cells of equal width have 1 - 1/n² of the second moment of the whole foot
        second = (1 - 1 / STRIPS**2) / 12
        slope_x = across / (second * self.width**2)
        slope_y = along / (second * self.length**2)
        pressure = push[..., 2, None] + slope_x[..., None] * x + slope_y[..., None] * y
        shear = np.broadcast_to(push[..., None, :2], (*pressure.shape, 2))
        area = self.width * self.length
        return np.stack([x, y], axis=-1), np.concatenate([shear, pressure[..., None]], -1) / area

    def _summed(
        self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike, *, strain: bool
    ) -> Array:
        load, taxel, push = arguments(load_at, taxel_at, force)
        cells, traction = self.traction(load, push)
        x = taxel[..., 0, None] - cells[:, 0]
        y = taxel[..., 1, None] - load[..., 1, None] - cells[:, 1]
        size = (self.width / STRIPS, self.length / STRIPS)
        if strain:
            field = halfspace.rectangle_strain(
                x,
                y,
                self.depth,
                traction,
                size=size,
                youngs_modulus=self.youngs_modulus,
                poisson=self.poisson,
            )
        else:
            field = halfspace.rectangle_stress(
                x, y, self.depth, traction, size=size, poisson=self.poisson
            )
        return np.asarray(field[..., 2].sum(axis=-2))
