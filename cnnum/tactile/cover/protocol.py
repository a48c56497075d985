"""The interface of every cover: a load on its top, and the response at a taxel."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from cnnum.errors import ArrayError
from cnnum.tactile import checks
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
            f"and {push.shape}; expected shapes that fit but for the last axis."
        ) from None
    return (
        np.broadcast_to(load, (*shape, 2)),
        np.broadcast_to(taxel, (*shape, 2)),
        np.broadcast_to(push, (*shape, 3)),
    )
