"""Answers that no formula gives, from SciPy's Dormand–Prince 8(5,3) with small tolerances."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from cnnum.arrays import Floats

PRECISION = 1e-10


def refined(
    slope: Callable[[Floats], Floats], start: Floats, time: float, precision: float = PRECISION
) -> Floats:
    """Return the solution of x' = slope(x) at a time; x has any shape."""
    solution = solve_ivp(
        lambda _, flat: slope(flat.reshape(start.shape)).ravel(),
        (0.0, time),
        start.ravel(),
        method="DOP853",
        rtol=precision,
        atol=precision,
    )
    return np.asarray(solution.y[:, -1]).reshape(start.shape)
