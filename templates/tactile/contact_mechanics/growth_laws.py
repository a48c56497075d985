"""Laws by which a load grows that an object at a constant speed puts on the skin.

Each takes x, the time since the load began over the time that the law is named after, and returns
the load as a share of its last value. Neither gain, friction, speed nor size enters.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np

from cnnum.arrays import Floats
from cnnum.programs.fields import Field, exp, maximum, minimum, sqrt

SHORTEST = 2.0
"""Frames: the least time of a law, from what two frames can tell."""

CURVE = (2.04205, 0.254459, -0.0207595)
"""Of the torque: −ln(1 − T/T₀) = 2.04 x + 0.254 x² − 0.0208 x³, fitted to Lubkin's solution between
0 and 2.5 times the angle at which half the contact radius sticks: within 2.1e-4 of it."""

SHRINK = (0.598938, 0.103159, -0.00899427)
"""Of the stick radius: −ln(c/a), fitted over the same range: within 7.4e-4."""

NEARER = 0.05
"""By so much of s^(3/2) (1 − s), s = 1 − x, what taxels read of a pull lags behind Mindlin's force,
where nobody knows their cover. What is added once the disc that sticks has shrunk stands nearer to
the contact's middle, and the taxels near a contact feel that more. Fitted pulls have −0.048 with a
standard deviation of 0.034 (133 pulls at 1000 frames a second, tuning seeds, all covers), and the
time of slip that they give is 1 to 4 % too late without it."""

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
    times : Times
        Which times it is tried with.
    """

    load: Callable[[Field], Field]
    sticks: Callable[[Field], Field]
    times: "Times"


@dataclass(frozen=True, slots=True)
class Times:
    """Times that a law is tried with, frames: each a share more than the one before.

    Attributes
    ----------
    count : int
        How many there are at least; what is left of the last map goes on in the same way.
    share : float
        Of a time, to the next one.
    step : float
        Most that this may be, frames.
    """

    count: int
    share: float
    step: float = inf

    def frames(self, count: int) -> Floats:
        """Return the first so many times."""
        times = [SHORTEST]
        while len(times) < count:
            times.append(times[-1] + min(self.share * times[-1], self.step))
        return np.array(times)

    def shares(self, times: Floats) -> Floats:
        """Return how far each is from the next, as a share of it."""
        return np.minimum(self.share, self.step / times)


def pull_law(lag: Field | float = NEARER) -> Law:
    """Return the law of the force under a pull at constant speed, x = 1 when all slips.

    What is read of Mindlin's force lags behind it by a share of s^(3/2) (1 − s), s = 1 − x. Its
    time is that of gross slip, up to 1.7 s at 1000 frames a second. They are 3 frames apart at
    most, for slip is to be told within five: with 4.5 delays scatter by 1.4 instead of 1.2 frames.
    """

    def read(x: Field) -> Field:
        left = maximum(1.0 - x, 0.0)
        return 1.0 - left * sqrt(left) * (1.0 + lag * (1.0 - left))

    return Law(read, _disc, Times(count=640, share=0.05, step=3.0))


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


TWIST = Law(_turned, _core, Times(count=256, share=0.0263))
"""Torque under a twist at constant rate; its time is that at which half the contact radius
sticks, up to 1.5 s at 1000 frames a second."""
