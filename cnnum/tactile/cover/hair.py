"""The cover with a hair: a rigid rod that stands on the taxel, embedded in a flat cover."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.flat import FlatCover
from cnnum.tactile.cover.protocol import arguments

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
        Of cover over the rod's top: 150–500 µm in the dissertation.
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
