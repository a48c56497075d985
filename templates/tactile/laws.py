"""Laws by which a load grows that an object at a constant speed puts on the skin.

Each takes x, the time since the load began over the time that the law is named after, and returns
the load as a share of its last value. Neither gain, friction, speed nor size enters.
"""

from collections.abc import Callable
from dataclasses import dataclass

from cnnum.programs.fields import Field, exp, maximum, minimum, sqrt

CURVE = (2.04205, 0.254459, -0.0207595)
"""Of the torque: −ln(1 − T/T₀) = 2.04 x + 0.254 x² − 0.0208 x³, fitted to Lubkin's solution between
0 and 2.5 times the angle at which half the contact radius sticks: within 2.1e-4 of it."""

SHRINK = (0.598938, 0.103159, -0.00899427)
"""Of the stick radius: −ln(c/a), fitted over the same range: within 7.4e-4."""

FARTHEST = 2.5
"""x up to which the torque's fit holds; beyond it the torque is within 0.2 % of its last value."""


@dataclass(frozen=True, slots=True)
class Law:
    """A law of growth.

    Attributes
    ----------
    load : callable
        x (≥ 0, any map) to the share of the last load.
    sticks : callable
        x to the stick radius over the contact radius.
    """

    load: Callable[[Field], Field]
    sticks: Callable[[Field], Field]


def _pulled(x: Field) -> Field:
    """Return 1 − (1 − x)^(3/2): Mindlin's force, x = 1 when all slips."""
    left = maximum(1.0 - x, 0.0)
    return 1.0 - left * sqrt(left)


def _disc(x: Field) -> Field:
    """Return c/a = √(1 − x) (Cattaneo, Mindlin)."""
    return sqrt(maximum(1.0 - x, 0.0))


def _turned(x: Field) -> Field:
    """Return Lubkin's torque, x = 1 when half the contact radius sticks."""
    return 1.0 - exp(-_cubic(CURVE, minimum(x, FARTHEST)))


def _core(x: Field) -> Field:
    return exp(-_cubic(SHRINK, minimum(x, FARTHEST)))


def _cubic(factors: tuple[float, float, float], x: Field) -> Field:
    first, second, third = factors
    return x * (first + x * (second + x * third))


PULL = Law(_pulled, _disc)
"""Force under a pull at constant speed; its time is that of gross slip."""

TWIST = Law(_turned, _core)
"""Torque under a twist at constant rate; its time is that at which half the contact radius
sticks."""
