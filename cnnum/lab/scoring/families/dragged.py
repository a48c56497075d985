"""Scenes with a face that is pressed on and dragged at a constant speed."""

from math import cos, pi, sin

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.grips import (
    CHUNK,
    HOLD,
    PRESS,
    REST,
    SETTLED,
    Array,
    Arrays,
    Draw,
    Make,
    Skin,
    Trial,
    power,
)
from cnnum.lab.scoring.families.faces import PRESSURE, Face, Shaping
from cnnum.tactile.grid import Grid


def dragged(shaping: Shaping) -> Make:
    """Return scenes in which a face is pressed on, then pulled at a constant speed."""

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        draw = Draw.of(family, seed, Array())
        face = shaping(draw)
        load = draw.uniform(*PRESSURE) * pi * face.radius**2
        travel = face.travel(load, draw.bounds.friction)
        way = power(1.0)(draw, travel).way
        array = arrays.made(draw, Array())
        return _trial(array, draw, family, Dragged(face, draw, load, travel), way)

    return make


class Dragged:
    """A face on a skin.

    Parameters
    ----------
    face : Face
    draw : Draw
        Its place, turn, friction and direction.
    load, travel : float, N, m
        Whole load, and the way to gross slip.
    """

    def __init__(self, face: Face, draw: Draw, load: float, travel: float) -> None:
        turn = draw.uniform(0.0, pi)
        self._face, self._load, self.travel = face, load, travel
        self._friction, self._start = draw.bounds.friction, draw.start
        self._x = cos(turn) * face.x - sin(turn) * face.y
        self._y = sin(turn) * face.x + cos(turn) * face.y
        self._along = (cos(draw.direction), sin(draw.direction))

    def tractions(self, grid: Grid, load: float, way: float) -> Floats:
        """Return (rows, cols, 3) tractions, Pa, under a share of the load, at a way (m)."""
        slid = max(0.0, way - self.travel)
        x = self._x + self._start[0] + slid * self._along[0]
        y = self._y + self._start[1] + slid * self._along[1]
        normal = self._load * self._face.pressure(load)
        shear = self._face.shear(min(way / self.travel, 1.0)) if way > 0 else 0.0 * normal
        shear = self._friction * self._load * shear
        forces = np.stack([shear * self._along[0], shear * self._along[1], normal], axis=-1)
        return spread(grid, x, y, forces)


def spread(grid: Grid, x: Floats, y: Floats, forces: Floats) -> Floats:
    """Return the tractions of point forces (N), each shared by its four nearest cells."""
    column, row = (x - grid.x[0]) / grid.dx, (y - grid.y[0]) / grid.dy
    left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
    right, below = column - left, row - top
    made = np.zeros((grid.rows * grid.cols, 3))
    for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (below if down else 1 - below) * (right if across else 1 - right)
        place = (top + down) * grid.cols + left + across
        for axis in range(3):
            made[:, axis] += np.bincount(place, weight * forces[:, axis], len(made))
    return np.asarray(made.reshape(grid.rows, grid.cols, 3) / grid.cell_area)


def _trial(array: SimulatedArray, draw: Draw, family: str, body: Dragged, way: Floats) -> Trial:
    rests, presses, holds = (draw.scans(time) for time in (REST, PRESS, HOLD))
    rise = np.arange(1, presses + 1) / presses
    load = np.concatenate([np.zeros(rests), rise, np.ones(holds + len(way))])
    way = np.concatenate([np.zeros(len(load) - len(way)), way])
    strain = [
        np.tensordot(
            np.stack([body.tractions(array.surface, load[n], way[n]) for n in range(first, last)]),
            array.influence,
            axes=([1, 2, 3], [2, 3, 4]),
        )
        for first in range(0, len(load), CHUNK)
        for last in [min(first + CHUNK, len(load))]
    ]
    slid = np.maximum(way - body.travel, 0.0)
    count = len(load)
    return Trial(
        family=family,
        name=f"{family} {draw.seed}",
        rate=draw.rate,
        frames=Skin().read(array, np.concatenate(strain), draw.rng).astype(np.float32),
        slips=(slid > 0).astype(np.float64),
        scored=np.arange(count) >= SETTLED * draw.rate,
        early=np.zeros(count, dtype=bool),
        slid=slid,
        sense=np.zeros(count, dtype=np.int64),
        direction=draw.direction,
        rows=np.arange(count),
        setting={"rate": draw.rate},
    )
