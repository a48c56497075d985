"""A load spread evenly along an endless line of the surface (Flamant)."""

import math

import numpy as np
from numpy.typing import ArrayLike

from cnnum.errors import PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting
from cnnum.tactile.halfspace.influence import tensor


@broadcasting
def line_load_stress(
    x: ArrayLike, z: ArrayLike, force_per_length: ArrayLike, *, poisson: ArrayLike = 0.5
) -> Array:
    """Return the stress under a line load along the y axis (plane strain).

    Parameters
    ----------
    x : (...) float, m
        Distance from the line on the plane of the surface.
    z : (...) float, m
        Depth, 0 or more.
    force_per_length : (..., 3) float, N/m
        (Q, R, F) for each metre of the line: across it, along it, into the material.
    poisson : (...) float
        Poisson's ratio, above -1 and at most 0.5; only σ_yy depends on it.

    Returns
    -------
    (..., 3, 3) float, Pa
        Stress tensor, tension positive: -2 x_i x_j (Qx + Fz)/(π r⁴) in the plane,
        -R x_i/(π r²) along the line, σ_yy = ν (σ_xx + σ_zz).

    Raises
    ------
    PhysicsError
        If z < 0, ν is out of range, a number is not finite, or a point lies on the line.

    References
    ----------
    Flamant (1892); Johnson, Contact Mechanics, 2.2-2.3.
    """
    place, depth = checks.finite("x", x), checks.not_negative("z", z)
    if np.any((place == 0) & (depth == 0)):
        raise PhysicsError(
            "A point lies on the loaded line, where the stress is infinite: move it away."
        )
    load = checks.vector("force_per_length", force_per_length)
    ratio = checks.poisson_ratio(poisson)
    r = np.hypot(place, depth)
    e_x, e_z = place / r, depth / r
    radial = -2 / math.pi * (load[..., 0] * e_x + load[..., 2] * e_z) / r
    along = -load[..., 1] / (math.pi * r)
    return tensor(
        {
            "xx": radial * e_x * e_x,
            "yy": ratio * radial,
            "zz": radial * e_z * e_z,
            "xz": radial * e_x * e_z,
            "yz": along * e_z,
            "xy": along * e_x,
        }
    )
