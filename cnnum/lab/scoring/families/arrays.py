"""Simulated arrays, which share the responses of their covers."""

from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.script import Phase
from cnnum.drivers.simulated.settings import Settings
from cnnum.drivers.simulated.springs import State
from cnnum.lab.scoring.families.draw import (
    HOLD,
    PITCH,
    PRESS,
    REST,
    YOUNGS_MODULUS,
    Array,
    Draw,
)

CHUNK = 64
"""Frames worked out at once."""


class Arrays:
    """Makes simulated arrays; those with one cover share its influence."""

    def __init__(self) -> None:
        self._influences: dict[tuple[object, ...], Floats] = {}

    def made(
        self, draw: Draw, array: Array, script: tuple[Phase, ...] | None = None
    ) -> SimulatedArray:
        """Return the array of a scene; a script begins with a touch unless given."""
        settings = Settings(
            seed=draw.seed,
            shape=array.shape,
            rate=draw.rate,
            pitch=PITCH,
            cover=array.cover,  # type: ignore[arg-type]
            thickness=draw.thickness,
            youngs_modulus=YOUNGS_MODULUS,
            friction=draw.bounds.friction,
            radius=draw.bounds.radius,
            start=draw.start,
            noise=draw.noise,
            script=touch(draw) if script is None else script,
        )
        key = (array.shape, array.cover, draw.thickness)
        made = SimulatedArray(settings, self._influences.get(key))
        self._influences[key] = made.influence
        return made


def touch(draw: Draw) -> tuple[Phase, ...]:
    """Return how a scene begins: nothing, a press, and a hold."""
    return Phase("hold", REST), Phase("press", PRESS, load=draw.bounds.load), Phase("hold", HOLD)


def strain_of(array: SimulatedArray, states: Sequence[State]) -> Floats:
    """Return the strain under contacts, (states, rows, cols, 3)."""
    starts = range(0, len(states), CHUNK)
    return np.concatenate([array.strain(list(states[n : n + CHUNK])) for n in starts])
