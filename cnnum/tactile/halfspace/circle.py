"""A uniform traction on a disc of the surface: the stress on its axis, in closed form."""

import numpy as np
from numpy.typing import ArrayLike

from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting
from cnnum.tactile.halfspace.influence import tensor


@broadcasting
def circle_axis_stress(
    z: ArrayLike, traction: ArrayLike, *, radius: ArrayLike, poisson: ArrayLike = 0.5
) -> Array:
    """Return the stress on the axis below a uniformly loaded disc.

    Parameters
    ----------
    z : (...) float, m
        Depth below the centre, 0 or more.
    traction : (..., 3) float, Pa
        (q_x, q_y, p), the pressure p pushing into the material.
    radius : (...) float, m
        Radius a of the disc.
    poisson : (...) float
        Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., 3, 3) float, Pa
        Stress tensor, tension positive. With c = z/√(a² + z²): σ_zz = -p (1 - c³),
        σ_xx = σ_yy = -p/2 [(1 + 2ν) - 2(1 + ν) c + c³], σ_xz = -q_x (1 - 3c/2 + c³/2).

    Raises
    ------
    PhysicsError
        If the depth is negative, the radius not positive, ν out of range, or a number not
        finite.

    References
    ----------
    Timoshenko & Goodier, Theory of Elasticity, art. 139, for pressure; Cerruti integrated for
    shear.
    """
    depth = checks.not_negative("z", z)
    a = checks.positive("radius", radius)
    ratio = checks.poisson_ratio(poisson)
    load = checks.vector("traction", traction)
    root = np.hypot(a, depth)
    c = depth / root
    rest = (a / root) * (a / (root + depth))  # 1 - c, exact far below
    across = -load[..., 2] / 2 * rest * (rest * (2 + c) - (1 - 2 * ratio))
    down = -load[..., 2] * rest * (1 + c + c * c)
    shear = rest * rest * (2 + c) / 2
    return tensor(
        {
            "xx": across,
            "yy": across,
            "zz": down,
            "xz": -load[..., 0] * shear,
            "yz": -load[..., 1] * shear,
            "xy": np.zeros_like(across),
        }
    )
