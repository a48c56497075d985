"""Runge–Kutta–Chebyshev methods of second order: steps as long as a diffusion's stages allow.

Sommeijer, Shampine & Verwer, J. Comput. Appl. Math. 88 (1998) 315-326, "RKC: An explicit solver for
parabolic PDEs". The interval of stability grows with the square of the stages. So s stages reach
s/3 times as far as s steps of Euler's method.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from cnnum.arrays import Floats

DAMPING = 2.0 / 13.0
"""ε of the paper: how far |P| stays below 1 (by about ε/3) within the interval of stability."""

STABILITY = 2.0 / 3.0 * (1.0 - 2.0 / 15.0 * DAMPING)
"""Length of a method's interval of stability over s² − 1."""

MAX_STAGES = 40
"""Beyond it rounding in single precision grows with s², more than longer steps gain."""


@dataclass(frozen=True, slots=True)
class Chebyshev:
    """A method of s stages.

        Y₀ = x,  Y₁ = Y₀ + first·h F₀,
        Y_j = (1 − back₁_j − back₂_j) Y₀ + back₁_j Y_{j−1} + back₂_j Y_{j−2}
              + rate_j h F_{j−1} + start_j h F₀,   x⁺ = Y_s

    Attributes
    ----------
    stages : int
    first : float
    rows : tuple of (back1, back2, rate, start)
        For j = 2 … s.

    Raises
    ------
    ValueError
        If its polynomial is not 1 + z + z²/2 + O(z³), or leaves [−1, 1] where it must not.
    """

    stages: int
    first: float
    rows: tuple[tuple[float, float, float, float], ...]

    def __post_init__(self) -> None:
        if self.stages < 2 or len(self.rows) != self.stages - 1:
            raise ValueError(f"A Chebyshev method has at least 2 stages, got {self.stages}.")
        z = np.linspace(-self.real_stability, 0.0, 40 * self.stages)
        if np.abs(self.growth(z)).max() > 1.0 + 1e-9:
            raise ValueError(f"The Chebyshev method of {self.stages} stages is not stable.")
        # a difference of third order on 1 + z + z²/2: the rest is O(z³)
        left = self.growth(np.array([-1e-3])) - (1.0 - 1e-3 + 0.5e-6)
        if abs(float(left[0])) > 1e-9:
            raise ValueError(f"The Chebyshev method of {self.stages} stages is not of order 2.")

    @property
    def real_stability(self) -> float:
        """Length of the interval of the negative real axis where |P| ≤ 1."""
        return (self.stages**2 - 1) * STABILITY

    def growth(self, z: Floats) -> Floats:
        """Return the stability polynomial P(z), by the method's own recursion."""
        before, now = np.ones_like(z), 1.0 + self.first * z
        for back1, back2, rate, start in self.rows:
            new = (1.0 - back1 - back2) + back1 * now + back2 * before + rate * z * now + start * z
            before, now = now, new
        return now


@cache
def chebyshev_method(stages: int) -> Chebyshev:
    """Return the method of that many stages (at least 2)."""
    w0 = 1.0 + DAMPING / stages**2
    value, slope, bend = _polynomials(w0, stages)
    w1 = slope[stages] / bend[stages]
    b = np.empty(stages + 1)
    b[2:] = bend[2:] / slope[2:] ** 2
    b[:2] = b[2]
    a = 1.0 - b * value
    rows = [
        (
            float(2.0 * b[j] * w0 / b[j - 1]),
            float(-b[j] / b[j - 2]),
            float(2.0 * b[j] * w1 / b[j - 1]),
            float(-a[j - 1] * 2.0 * b[j] * w1 / b[j - 1]),
        )
        for j in range(2, stages + 1)
    ]
    return Chebyshev(stages, float(b[1] * w1), tuple(rows))


def _polynomials(at: float, highest: int) -> tuple[Floats, Floats, Floats]:
    """Return T₀ … T_highest at a place, and their first and second derivatives.

    By T_{j+1} = 2x T_j − T_{j−1} and its derivatives, which grow from x ≥ 1 on and lose nothing.
    """
    value, slope, bend = np.ones(highest + 1), np.zeros(highest + 1), np.zeros(highest + 1)
    value[1], slope[1] = at, 1.0
    for j in range(1, highest):
        value[j + 1] = 2.0 * at * value[j] - value[j - 1]
        slope[j + 1] = 2.0 * value[j] + 2.0 * at * slope[j] - slope[j - 1]
        bend[j + 1] = 4.0 * slope[j] + 2.0 * at * bend[j] - bend[j - 1]
    return value, slope, bend


def stages_about(reach: Floats) -> Floats:
    """Return how many stages steps of h·|λ| = reach take on average, where each may round up."""
    return np.maximum(2.0, np.sqrt(1.0 + reach / STABILITY) + 0.5)


def stages_for(reach: float) -> int:
    """Return the fewest stages that are stable at h·|λ| = reach.

    The answer may be above `MAX_STAGES`: then the step has to be shorter.
    """
    return max(2, math.ceil(math.sqrt(1.0 + max(reach, 0.0) / STABILITY)))


def coefficients() -> Floats:
    """Return (most + 1, most, 4) numbers: method s, stage j; the first stage's weight at j = 0."""
    table = np.zeros((MAX_STAGES + 1, MAX_STAGES, 4))
    for stages in range(2, MAX_STAGES + 1):
        method = chebyshev_method(stages)
        table[stages, 0, 2] = method.first
        table[stages, 1:stages] = method.rows
    return table
