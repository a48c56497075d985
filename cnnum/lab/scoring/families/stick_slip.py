"""Stick–slip: an object on a springy hand, under friction that falls with the sliding speed.

The contact holds the object by Mindlin's force up to its limit. The limit falls from the static to
the kinetic one as sliding gets faster: μ(v)/μ(0) = k + (1 − k)/(1 + v/v₀).
"""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats

FADES = 1e-3
"""v₀, m/s."""

STEP = 1e-4
"""s, at most: a fiftieth of the quickest swing of 0.05 kg on a contact of 10 kN/m is 3e-4 s."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """An object that a hand draws over a skin.

    Attributes
    ----------
    mass : float, kg
    stiffness : float, N/m
        Of the hand.
    speed : float, m/s
        Of the hand.
    limit : float, N
        Static friction force.
    travel : float, m
        How far the contact gives at that force.
    kinetic : float
        Share of friction that is left at high speeds.
    damping : float
        Share of the critical one, of the mass on the hand.
    """

    mass: float
    stiffness: float
    speed: float
    limit: float
    travel: float
    kinetic: float
    damping: float = 0.1

    def friction(self, speed: float) -> float:
        """Return the share of the static friction that holds at a sliding speed."""
        return self.kinetic + (1.0 - self.kinetic) / (1.0 + abs(speed) / FADES)


def stick_slip(hand: Drawn, times: Floats) -> tuple[Floats, Floats]:
    """Return the way of the object (m) and its share of static friction at some times (s)."""
    steps = max(1, int(np.ceil(times[0] / STEP)))
    dt = float(times[0]) / steps
    drag = 2.0 * hand.damping * (hand.stiffness * hand.mass) ** 0.5
    ways, shares = np.empty(len(times)), np.empty(len(times))
    way = speed = slid = 0.0
    share = 1.0
    for n in range(len(times) * steps):
        pulls = hand.stiffness * (hand.speed * n * dt - way) + drag * (hand.speed - speed)
        speed += dt / hand.mass * (pulls - _held(hand, way - slid, share))
        way += dt * speed
        slides = max(0.0, way - slid - share * hand.travel)
        slid, share = slid + slides, hand.friction(slides / dt)
        ways[n // steps], shares[n // steps] = way, share
    return ways, shares


def _held(hand: Drawn, stretch: float, share: float) -> float:
    """Return the force of the contact (Mindlin), N."""
    use = min(max(abs(stretch) / (share * hand.travel), 0.0), 1.0)
    force = share * hand.limit * (1.0 - (1.0 - use) ** 1.5)
    return float(force) if stretch >= 0 else -float(force)
