"""The interface of every cover, and the flat one: a half-space."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from cnnum.errors import ArrayError
from cnnum.tactile import checks, halfspace
from cnnum.tactile.checks import Array

COMPONENTS = ("xz", "yz", "zz")
"""Components of stress or strain at a taxel, in this order."""


class Cover(Protocol):
    """A cover: the response at taxel depth to a concentrated load on its top.

    Loads superpose. Places are (x, y) in the plane of the surface; the axes are those of
    `cnnum.tactile.halfspace`. A number out of range is refused with a `PhysicsError`.
    """

    @property
    def depth(self) -> float:
        """Depth of the taxels below the flat surface, m."""
        ...

    def stress(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return the stress at a taxel.

        Parameters
        ----------
        load_at : (..., 2) float, m
            Where the load touches the cover's top.
        taxel_at : (..., 2) float, m
        force : (..., 3) float, N
            (Q, R, F) along x, y, and into the material.

        Returns
        -------
        (..., 3) float, Pa
            σ_xz, σ_yz, σ_zz, tension positive; all arguments broadcast.

        Raises
        ------
        PhysicsError
            If a number is not finite.
        ArrayError
            If a last axis has another length.
        """
        ...

    def strain(self, load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike) -> Array:
        """Return the tensor strain ε_xz, ε_yz, ε_zz at a taxel, as `stress` does the stress."""
        ...


def arguments(
    load_at: ArrayLike, taxel_at: ArrayLike, force: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return the three arguments of a cover, checked and broadcast: (..., 2), (..., 2), (..., 3).

    Raises
    ------
    PhysicsError
        If a number is not finite.
    ArrayError
        If a last axis has another length, or the rest does not broadcast.
    """
    load = checks.vector("load_at", load_at, 2)
    taxel = checks.vector("taxel_at", taxel_at, 2)
    push = checks.vector("force", force)
    try:
        shape = np.broadcast_shapes(load.shape[:-1], taxel.shape[:-1], push.shape[:-1])
    except ValueError:
        raise ArrayError(
            f"'load_at', 'taxel_at' and 'force' do not broadcast: got {load.shape}, {taxel.shape} "
            f"and {push.shape}; expected shapes that broadcast except in the last axis."
        ) from None
    return (
        np.broadcast_to(load, (*shape, 2)),
        np.broadcast_to(taxel, (*shape, 2)),
        np.broadcast_to(push, (*shape, 3)),
    )


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


class Profiles(NamedTuple):
    """Response to a unit load on the axis at given distances, each (...).

    `pushed_*` under a load into the material; `dragged_*` under one sideways, towards θ = 0:
    the zz and rz parts go with cos θ, the tz part with sin θ.
    """

    pushed_zz: Array
    pushed_rz: Array
    dragged_zz: Array
    dragged_rz: Array
    dragged_tz: Array


def to_components(profiles: Profiles, away: Array, force: Array) -> Array:
    """Return the xz, yz and zz components at taxels.

    Parameters
    ----------
    profiles : Profiles
        At the distances of `away`.
    away : (..., 2) float, m
        Taxel minus axis.
    force : (..., 3) float, N

    Returns
    -------
    (..., 3) float
    """
    distance = np.hypot(away[..., 0], away[..., 1])
    direction = away / np.where(distance > 0, distance, 1.0)[..., None]
    direction = np.where(distance[..., None] > 0, direction, [1.0, 0.0])
    x, y = direction[..., 0], direction[..., 1]
    along = force[..., 0] * x + force[..., 1] * y
    across = force[..., 1] * x - force[..., 0] * y
    radial = profiles.pushed_rz * force[..., 2] + profiles.dragged_rz * along
    turning = -profiles.dragged_tz * across
    down = profiles.pushed_zz * force[..., 2] + profiles.dragged_zz * along
    return np.stack([radial * x - turning * y, radial * y + turning * x, down], axis=-1)
