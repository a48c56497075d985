"""Scenes without slip: movements of hands that hold an object."""

from collections.abc import Callable
from math import pi

import numpy as np

from cnnum.drivers.simulated.grips import (
    REST,
    SWINGS,
    Array,
    Arrays,
    Draw,
    Make,
    Skin,
    Trial,
    part,
    played,
    shaken,
    touch,
    trial_of,
)
from cnnum.drivers.simulated.settings import Command, Phase, total_scans

SECONDS = 6.0
"""Length of a scene."""

WEIGHT = (0.1, 0.3)
"""Pull of a held object, as a share of friction's limit: a shaken grip still holds it."""

PULLED = (0.3, 0.7)
"""The same of a pull that stops."""

Phases = tuple[Phase, ...]
Doing = Callable[[Draw], Phases]


def held(doing: Doing, *, weighs: bool = False, skin: Skin = Skin()) -> Make:  # noqa: B008
    """Return scenes in which a hand does one thing again and again."""

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        draw = Draw.of(family, seed, Array())
        phases = list(touch(draw))
        phases += _weight(draw, *WEIGHT) if weighs else ()
        while True:
            more = doing(draw)
            if (total_scans(phases, draw.rate) + total_scans(more, draw.rate)) > draw.scans(
                SECONDS - 0.4
            ):
                break
            phases += more
        phases += [Phase("relax", 0.2)] if weighs else []
        phases.append(Phase("release", 0.2))
        array = arrays.made(draw, Array(), tuple(phases))
        return trial_of(array, draw, skin, family, list(array.scans()))

    return make


def part_pulled(arrays: Arrays, family: str, seed: int) -> Trial:
    """Return a scene with a pull that stops at a share of friction's limit."""
    return _pulled(arrays, family, seed, shakes=False)


def trembling(arrays: Arrays, family: str, seed: int) -> Trial:
    """Return such a scene, held by a hand that trembles along the pull and in its grip."""
    return _pulled(arrays, family, seed, shakes=True)


def _pulled(arrays: Arrays, family: str, seed: int, *, shakes: bool) -> Trial:
    draw = Draw.of(family, seed, Array())
    bounds = draw.bounds
    way = part(*PULLED)(draw, bounds.travel()).way
    frames = draw.scans(SECONDS) - total_scans(touch(draw), draw.rate)
    way = np.concatenate([way, np.full(max(0, frames - len(way)), way[-1])])
    move, grip = shaken(draw, len(way)) if shakes else np.zeros((2, len(way)))
    # a twentieth of the way to slip: the pull stays below friction's limit
    moves = np.diff(way + 0.05 * bounds.travel() * move, prepend=0.0)
    along = np.array([np.cos(draw.direction), np.sin(draw.direction)])
    hand = [
        Command(load=float(load), move=(float(step[0]), float(step[1])))
        for step, load in zip(
            moves[:, None] * along, bounds.load * (1.0 + SWINGS * grip), strict=True
        )
    ]
    return played(arrays, draw, Array(), Skin(), family, hand)


def grips(draw: Draw) -> Phases:
    """Change the load to something between 0.6 and 1.35 of the first one."""
    load = draw.bounds.load * draw.log(0.6, 1.35)
    return Phase("grip", draw.log(0.15, 1.0), load=load), Phase("hold", 0.2)


def touches(draw: Draw) -> Phases:
    """Let go, and press again."""
    load = draw.bounds.load * draw.log(0.6, 1.35)
    press = Phase("press", draw.uniform(0.15, 0.4), load=load)
    return Phase("release", 0.2), Phase("hold", 0.2), press, Phase("hold", 0.2)


def vibrates(draw: Draw) -> Phases:
    """Shake the load by 3 to 30 % at 3 to 40 Hz, or a quarter of the rate."""
    frequency = draw.log(3.0, min(40.0, draw.rate / 4.0))
    cycles = max(1, round(draw.uniform(0.4, 1.0) * frequency))
    shakes = Phase(
        "vibrate", cycles / frequency, frequency=frequency, amplitude=draw.log(0.03, 0.3)
    )
    return shakes, Phase("hold", 0.2)


def rolls(draw: Draw) -> Phases:
    """Roll to one side and back."""
    speed, direction = draw.log(0.3e-3, 3e-3), draw.uniform(-pi, pi)
    lasts = min(draw.uniform(0.2, 0.8), 0.8e-3 / speed)
    there = Phase("roll", lasts, speed=speed, direction=direction)
    back = Phase("roll", lasts, speed=speed, direction=direction + pi)
    return there, back, Phase("hold", 0.2)


def _weight(draw: Draw, low: float, high: float) -> Phases:
    lasts = draw.bounds.travel(draw.uniform(low, high)) / draw.speed
    return (Phase("pull", lasts, speed=draw.speed, direction=draw.direction),)


def oblique(frequency: float) -> Make:
    """Return scenes of touches that come and go together with their shear, and stick.

    Under a load and a pull that grow in proportion, both as of a sphere, all of the contact sticks
    as long as the pull is below friction's limit (Mindlin and Deresiewicz).

    Parameters
    ----------
    frequency : float, Hz
        Frequency of the touches.
    """

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        draw = Draw.of(family, seed, Array())
        bounds, lasts = draw.bounds, 1.0 / frequency
        along = np.array([np.cos(draw.direction), np.sin(draw.direction)])
        hand, count = list[Command](), draw.scans(SECONDS)
        idle = [Command(load=0.0)] * draw.scans(REST)
        while len(idle) + len(hand) < count:
            # to the depth of the first load, or more or less; the pull is a share of its limit
            high, share = draw.uniform(0.7, 1.2), draw.uniform(0.2, 0.7)
            rises = np.arange(1, draw.scans(0.3 * lasts) + 1) / draw.scans(0.3 * lasts)
            holds, air = np.ones(draw.scans(0.2 * lasts)), np.zeros(draw.scans(0.2 * lasts))
            deep = high * np.concatenate([rises, holds, rises[::-1], air])
            moves = np.diff(share * bounds.travel() * deep, prepend=0.0)
            hand += [
                Command(load=float(load), move=(float(step[0]), float(step[1])))
                for load, step in zip(bounds.load * deep**1.5, moves[:, None] * along, strict=True)
            ]
        array = arrays.made(draw, Array())
        return trial_of(array, draw, Skin(), family, list(array.follow([*idle, *hand][:count])))

    return make
