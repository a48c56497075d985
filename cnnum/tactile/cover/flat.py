"""The flat cover: a half-space."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from cnnum.tactile import checks, halfspace
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.protocol import arguments


@dataclass(frozen=True, slots=True)
class FlatCover:
    """An endlessly thick flat cover, with the taxels inside; see `protocol.Cover`.

    Attributes
    ----------
    depth : float, m
        Depth of the taxels.
    youngs_modulus : float, Pa
    poisson : float
        Above -1 and at most 0.5.

    References
    ----------
    Vásárhelyi, dissertation (2007), (4.9)–(4.12).
    """

    depth: float
    youngs_modulus: float
    poisson: float = 0.5

    def __post_init__(self) -> None:
        checks.positive("depth", self.depth)
        checks.positive("youngs_modulus", self.youngs_modulus)
        checks.poisson_ratio(self.poisson)

    def stress(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return σ_xz, σ_yz, σ_zz at taxels, (..., 3) Pa."""
        load, taxel, push = arguments(load_at, taxel_at, force)
        away = taxel - load
        field = halfspace.stress(away[..., 0], away[..., 1], self.depth, push, poisson=self.poisson)
        return field[..., 2]

    def strain(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return ε_xz, ε_yz, ε_zz at taxels, (..., 3)."""
        load, taxel, push = arguments(load_at, taxel_at, force)
        away = taxel - load
        field = halfspace.strain(
            away[..., 0],
            away[..., 1],
            self.depth,
            push,
            youngs_modulus=self.youngs_modulus,
            poisson=self.poisson,
        )
        return field[..., 2]
