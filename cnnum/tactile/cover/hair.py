"""Covers with a hair or a ridge: by statics, on a flat layer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.tactile import checks, halfspace
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.protocol import FlatCover, arguments

RINGS, SPOKES = 16, 24
"""Gauss points along the radius of the rod's top, and equal angles around it."""


@dataclass(frozen=True, slots=True)
class HairCover:
    """A rigid rod from the taxel up to just below the surface; see `protocol.Cover`.

    The model is statics: the rod takes the traction that the flat cover has on the plane of its top
    face. It hands force and moment on to its foot on the taxel, where pressure is linear and shear
    uniform. The load on its side is left out, and so is the stress that its stiffness draws. A
    shear force on top thus presses one side of the foot and lifts the other: the difference that a
    three-axial taxel reads as shear. Taxels outside the foot see the flat cover.

    Attributes
    ----------
    radius : float, m
        Radius of the rod.
    length : float, m
        Length of the rod: the lever of a shear force.
    above : float, m
        Thickness of the cover above the rod: 150–500 µm in the dissertation.
    youngs_modulus : float, Pa
        Young's modulus of the cover, and of the seat under the rod.
    poisson : float
        Above -1 and at most 0.5, of the cover.

    References
    ----------
    Vásárhelyi, dissertation (2007), 6.2.2, Fig. 6.4.
    """

    radius: float
    length: float
    above: float
    youngs_modulus: float
    poisson: float = 0.5

    def __post_init__(self) -> None:
        for name in ("radius", "length", "above", "youngs_modulus"):
            checks.positive(name, getattr(self, name))
        checks.poisson_ratio(self.poisson)

    @property
    def depth(self) -> float:
        """Depth of the taxels and of the rod's foot, m."""
        return self.above + self.length

    @property
    def lever(self) -> float:
        """Pressure at the rim of the foot over the shear stress, under a shear force on top."""
        return 4 * self.length / self.radius

    def caught(self, load_at: ArrayLike, force: ArrayLike) -> tuple[Array, Array]:
        """Return the force and moment of the rod on its foot.

        Parameters
        ----------
        load_at : (..., 2) float, m
            From the rod's axis.
        force : (..., 3) float, N

        Returns
        -------
        force : (..., 3) float, N
        moment : (..., 2) float, N m
            ∫ p x dA and ∫ p y dA over the foot.
        """
        load, _, push = arguments(load_at, [0.0, 0.0], force)
        places, areas = self._face()
        flat = FlatCover(self.above, self.youngs_modulus, self.poisson)
        traction = -flat.stress(load[..., None, :], places, push[..., None, :])
        total = np.einsum("...ki,k->...i", traction, areas)
        tilt = np.einsum("...k,kj,k->...j", traction[..., 2], places, areas)
        return total, tilt + self.length * total[..., :2]

    def stress(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return σ_xz, σ_yz, σ_zz at taxels, (..., 3) Pa."""
        _, taxel, _ = arguments(load_at, taxel_at, force)
        outside = FlatCover(self.depth, self.youngs_modulus, self.poisson)
        return np.where(
            self._under(taxel),
            self._foot(load_at, taxel, force),
            outside.stress(load_at, taxel_at, force),
        )

    def strain(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return ε_xz, ε_yz, ε_zz at taxels, (..., 3): uniaxial under the foot."""
        _, taxel, _ = arguments(load_at, taxel_at, force)
        outside = FlatCover(self.depth, self.youngs_modulus, self.poisson)
        softness = np.array([1 + self.poisson, 1 + self.poisson, 1.0]) / self.youngs_modulus
        return np.where(
            self._under(taxel),
            softness * self._foot(load_at, taxel, force),
            outside.strain(load_at, taxel_at, force),
        )

    def _foot(self, load_at: ArrayLike, taxel: Array, force: ArrayLike) -> Array:
        total, moment = self.caught(load_at, force)
        area = np.pi * self.radius**2
        tilt = 4 / (area * self.radius**2) * (moment * taxel).sum(axis=-1)
        stress = -np.broadcast_to(total, (*taxel.shape[:-1], 3)) / area
        return np.concatenate([stress[..., :2], stress[..., 2:] - tilt[..., None]], axis=-1)

    def _under(self, taxel: Array) -> NDArray[np.bool_]:
        """Return which taxels lie under the foot, (..., 1)."""
        return np.asarray(np.hypot(taxel[..., :1], taxel[..., 1:]) <= self.radius)

    def _face(self) -> tuple[Array, Array]:
        """Return points and areas that integrate over the rod's top."""
        x, w = np.polynomial.legendre.leggauss(RINGS)
        rho = self.radius * (x + 1) / 2
        angle = 2 * np.pi * (np.arange(SPOKES) + 0.5) / SPOKES
        turn = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        places = (rho[:, None, None] * turn).reshape(-1, 2)
        areas = np.repeat(w * rho * self.radius / 2 * 2 * np.pi / SPOKES, SPOKES)
        return places, areas


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
