"""How an object is pulled: its way, its load and its friction, frame by frame."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.scoring.families.draw import Draw
from cnnum.lab.scoring.families.stick_slip import Drawn, stick_slip

SLIDE = (0.5e-3, 1.2e-3)
"""m of sliding at least and at most."""

TREMOR, TREMBLES, SWINGS = (6.0, 12.0), 0.03e-3, 0.04
"""Hz; m; share of the load."""


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """A pull, frame by frame.

    Attributes
    ----------
    way : (frames,) float, m
        How far the object has been moved.
    load, friction : (frames,) float
        As shares of those of the grip.
    """

    way: Floats
    load: Floats
    friction: Floats


Pulling = Callable[[Draw, float], Pull]
"""From the numbers of a scene, and the way (m) at which gross slip begins."""


def power(exponent: float) -> Pulling:
    """Return pulls whose way grows as a power of time; 1 is a constant speed."""

    def pull(draw: Draw, travel: float) -> Pull:
        return plain(_whole(draw, travel) * _time(draw, travel) ** exponent)

    return pull


def force_ramp(draw: Draw, travel: float) -> Pull:
    """Return a pull whose force grows evenly up to friction, then a slide at 2 mm/s (Mindlin)."""
    lasts = draw.scans(draw.uniform(0.5, 2.0))
    force = np.arange(1, lasts + 1) / lasts
    grows = travel * (1.0 - (1.0 - np.minimum(force, 0.999)) ** (2 / 3))
    slide = 2e-3 * np.arange(1, draw.scans(SLIDE[1] / 2e-3) + 1) / draw.rate
    return plain(np.concatenate([grows, travel + slide]).astype(np.float64))


def tremor(draw: Draw, travel: float) -> Pull:
    """Return a pull at a constant speed by a hand that trembles along it and in its grip."""
    way = _whole(draw, travel) * _time(draw, travel)
    move, grip = shaken(draw, len(way))
    return Pull(way + TREMBLES * move, 1.0 + SWINGS * grip, np.ones(len(way)))


def weakening(draw: Draw, travel: float) -> Pull:
    """Return a pull through a springy hand, with friction that falls with the sliding speed."""
    bounds = draw.bounds
    hand = Drawn(
        mass=draw.uniform(0.05, 0.2),
        stiffness=draw.uniform(1000.0, 3000.0),
        speed=draw.speed,
        limit=bounds.friction * bounds.load,
        travel=travel,
        kinetic=draw.uniform(0.6, 0.8),
    )
    # the hand's spring stretches before the object moves
    seconds = (_whole(draw, travel) + hand.limit / hand.stiffness) / draw.speed
    way, friction = stick_slip(hand, np.arange(1, draw.scans(seconds) + 1) / draw.rate)
    return Pull(way, np.ones(len(way)), friction)


def part(low: float, high: float) -> Pulling:
    """Return pulls that stop at a share of friction's limit, then hold on."""

    def pull(draw: Draw, travel: float) -> Pull:
        way = travel * (1.0 - (1.0 - draw.uniform(low, high)) ** (2 / 3))
        rises = draw.scans(way / draw.speed)
        held = np.full(draw.scans(1.0), way)
        return plain(np.concatenate([way * np.arange(1, rises + 1) / rises, held]))

    return pull


def plain(way: Floats) -> Pull:
    """Return a pull under an even load and friction."""
    return Pull(way, np.ones(len(way)), np.ones(len(way)))


def shaken(draw: Draw, frames: int) -> tuple[Floats, Floats]:
    """Return two unit swings of a hand's tremor."""
    time = np.arange(frames) / draw.rate
    move, grip = (2 * np.pi * draw.uniform(*TREMOR) * time for _ in range(2))
    return np.sin(move), np.sin(grip)


def _whole(draw: Draw, travel: float) -> float:
    return travel + min(max(0.5 * draw.speed, SLIDE[0]), SLIDE[1])


def _time(draw: Draw, travel: float) -> Floats:
    """Return time as a share of the pull."""
    lasts = max(3, draw.scans(_whole(draw, travel) / draw.speed))
    return np.asarray(np.arange(1, lasts + 1) / lasts)
