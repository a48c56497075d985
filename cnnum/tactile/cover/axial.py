"""From profiles around an axis to components at taxels."""

from typing import NamedTuple

import numpy as np

from cnnum.tactile.checks import Array


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
