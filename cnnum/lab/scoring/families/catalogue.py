"""All families of scenes, by name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, pi, sin
from typing import Literal

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated import grips as pulls
from cnnum.drivers.simulated import hands as held
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.grips import (
    CHUNK,
    HOLD,
    PRESS,
    REST,
    SETTLED,
    SHAKEN,
    Array,
    Arrays,
    Draw,
    Make,
    Skin,
    Trial,
    power,
    pulled,
    strain_of,
    twisted,
)
from cnnum.frame import FORCE_AXES
from cnnum.lab.scoring.families import bristles, faces, fingertip
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


Kind = Literal["slip", "twist", "held"]

EVEN = pulls.power(1.0)


@dataclass(frozen=True, slots=True)
class Family:
    """A family of scenes.

    Attributes
    ----------
    name : str
    kind : "slip", "twist" or "held"
        The kind of event; in "held" nothing slips.
    make : callable
        From shared arrays, the name and a seed to a trial.
    about : str
        Its distinction.
    axes : tuple of str
        Channels that the array reads.
    """

    name: str
    kind: Kind
    make: Make
    about: str
    axes: tuple[str, ...] = FORCE_AXES


FAMILIES = (
    Family("constant speed", "slip", pulled(EVEN), "how it is pulled"),
    *(
        Family(f"t^{power:g}", "slip", pulled(pulls.power(power)), "how it is pulled")
        for power in (0.5, 0.7, 1.5, 2.0, 3.0)
    ),
    Family("force ramp", "slip", pulled(pulls.force_ramp), "how it is pulled"),
    Family("tremor", "slip", pulled(pulls.tremor), "how it is pulled"),
    Family("stick-slip", "slip", pulled(pulls.weakening), "how it is pulled"),
    Family("flat punch", "slip", dragged(faces.punch), "what touches"),
    Family("ring", "slip", dragged(faces.ring), "what touches"),
    Family("bar", "slip", dragged(faces.bar), "what touches"),
    Family("two bodies", "slip", dragged(faces.two_bodies), "what touches"),
    Family("ridges", "slip", dragged(faces.ridges), "what touches"),
    Family("rough face (tamaas)", "slip", dragged(faces.rough), "what touches"),
    Family("layer", "slip", pulled(EVEN, Array(cover="layer")), "cover"),
    Family("bumps", "slip", pulled(EVEN, Array(cover="bumpy")), "cover"),
    Family("shear read ×0.67", "slip", pulled(EVEN, skin=Skin(shear=1 / 1.5)), "cover"),
    Family("shear read ×1.5", "slip", pulled(EVEN, skin=Skin(shear=1.5)), "cover"),
    Family("gains ±20 %", "slip", pulled(EVEN, skin=Skin(gains=0.2)), "taxels"),
    Family("cross-talk 5 %", "slip", pulled(EVEN, skin=Skin(crosstalk=0.05)), "taxels"),
    Family("creep 5 %/s", "slip", pulled(EVEN, skin=Skin(creep=0.05)), "taxels"),
    Family("hysteresis 5 %", "slip", pulled(EVEN, skin=Skin(hysteresis=0.05)), "taxels"),
    Family("saturation", "slip", pulled(EVEN, skin=Skin(limit=0.7)), "taxels"),
    Family("2 dead taxels", "slip", pulled(EVEN, skin=Skin(dead=2)), "taxels"),
    Family("heavy-tailed noise", "slip", pulled(EVEN, skin=Skin(heavy=True)), "taxels"),
    *(
        Family(f"{rate:g} Hz", "slip", pulled(EVEN, Array(rate=rate)), "frames a second")
        for rate in (10.0, 25.0, 1000.0)
    ),
    Family("4×4 taxels", "slip", pulled(EVEN, Array((4, 4), radius=15e-3)), "array"),
    Family("twist", "twist", twisted(), "plain"),
    Family("twist, layer", "twist", twisted(Array(cover="layer")), "cover"),
    Family("twist, bumps", "twist", twisted(Array(cover="bumpy")), "cover"),
    Family("twist, real taxels", "twist", twisted(skin=SHAKEN), "taxels"),
    Family("twist, 10 Hz", "twist", twisted(Array(rate=10.0)), "frames a second"),
    Family("grip", "held", held.held(held.grips), "load changes"),
    Family("press and release", "held", held.held(held.touches), "load comes and goes"),
    Family("part pull", "held", held.part_pulled, "pull stops at 0.3 to 0.7 μP"),
    Family("trembling pull", "held", held.trembling, "the same in a hand that trembles"),
    Family("vibration", "held", held.held(held.vibrates, weighs=True), "under a weight"),
    Family("rolling", "held", held.held(held.rolls), "without a weight"),
    Family("rolling, weight", "held", held.held(held.rolls, weighs=True), "under a weight"),
    Family("grip, real taxels", "held", held.held(held.grips, skin=SHAKEN), "load changes"),
    *(
        Family(f"oblique touch, {rate:g} Hz", "held", held.oblique(rate), "comes with its shear")
        for rate in (3.0, 0.5)
    ),
    Family("bristles", "slip", bristles.scene(bristles.slide), "other mechanics"),
    Family("bristles, rocking", "slip", bristles.scene(bristles.rocking), "speed and slope swing"),
    Family(
        "bristles, one of two pads", "slip", bristles.scene(bristles.slide, pads=2),
        "the other holds",
    ),
    Family("bristles, pivot", "twist", bristles.scene(bristles.pivot), "other mechanics"),
    Family("bristles, part pull", "held", bristles.scene(bristles.part_pulled), "other mechanics"),
    Family(
        "bristles, oblique touch, 3 Hz", "held", bristles.scene(bristles.oblique(3.0)),
        "other mechanics",
    ),
    Family("bristles, swaying", "held", bristles.scene(bristles.swaying), "rocks, and sticks"),
)  # fmt: skip
"""A table of results has them in this order."""


STILL = 60.0
"""s of a still hold."""


def still(arrays: Arrays, family: str, seed: int) -> Trial:
    """Return a minute in which a sphere is held and nothing moves: taxels creep and are noisy."""
    draw = Draw.of(family, seed, Array(rate=100.0))
    array, count = arrays.made(draw, Array(rate=100.0)), draw.scans(STILL)
    strain = strain_of(array, [state for state, _ in array.scans()])
    strain = np.concatenate([strain, np.repeat(strain[-1:], count - len(strain), axis=0)])
    zeros = np.zeros(count)
    return Trial(
        family=family,
        name=f"{family} {seed}",
        rate=draw.rate,
        frames=SHAKEN.read(array, strain, draw.rng).astype(np.float32),
        slips=zeros,
        scored=np.arange(count) >= SETTLED * draw.rate,
        early=zeros > 0,
        slid=zeros,
        sense=np.zeros(count, dtype=np.int64),
        direction=float("nan"),
        rows=np.arange(count),
        setting={"rate": draw.rate},
    )


def begun(make: Make, begin: Callable[[Trial], int]) -> Make:
    """Return scenes from a frame on, as of a stream that begins in the middle of something."""

    def cut(arrays: Arrays, family: str, seed: int) -> Trial:
        trial = make(arrays, family, seed)
        kept = slice(begin(trial), None)
        frames = trial.frames[kept]
        return replace(
            trial,
            frames=frames,
            slips=trial.slips[kept],
            scored=np.arange(len(frames)) >= SETTLED * trial.rate,
            early=trial.early[kept],
            slid=trial.slid[kept],
            sense=trial.sense[kept],
            rows=trial.rows[kept],
        )

    return cut


def in_hold(trial: Trial) -> int:
    """Return the first frame of the hold before a pull: 0.4 s of it are left for the rest."""
    return round((REST + PRESS) * trial.rate)


def in_slide(trial: Trial) -> int:
    """Return the first frame of the slide, or a frame before the middle of a scene without."""
    return min(trial.onset, len(trial.frames) // 2)


SPHERE, BODY = pulled(EVEN), bristles.scene(bristles.slide)
SHEAR = FORCE_AXES[:2]

HANDS = (
    Family("held still", "held", still, "spheres; taxels creep"),
    *(
        Family(f"gripped: {family.name}", "held", family.make, family.about)
        for family in [family for family in FAMILIES if family.kind == "held"][:8]
    ),
    Family("held start: spheres", "slip", begun(SPHERE, in_hold), "begins in the hold"),
    Family("held start: bristles", "slip", begun(BODY, in_hold), "begins in the hold"),
    Family("start in a slide: spheres", "slip", begun(SPHERE, in_slide), "begins in the slide"),
    Family("start in a slide: bristles", "slip", begun(BODY, in_slide), "begins in the slide"),
    Family(
        "slide, then a turn: bristles", "twist", bristles.scene(bristles.slid_then_turned),
        "0.4 s of rest between them",
    ),
    Family("one of two pads: bristles", "slip", bristles.scene(bristles.slide, pads=2), "pads"),
    *(
        Family(f"oblique touch, {rate:g} Hz: {body}", "held", make, "sticks")
        for rate in (3.0, 0.5)
        for body, make in (
            ("spheres", held.oblique(rate)),
            ("bristles", bristles.scene(bristles.oblique(rate))),
        )
    ),
    Family("rocking slide: bristles", "slip", bristles.scene(bristles.rocking), "slope swings"),
    Family("shear alone, slide: spheres", "slip", SPHERE, "markers", SHEAR),
    Family("shear alone, slide: bristles", "slip", BODY, "markers", SHEAR),
    Family("shear alone, turn: spheres", "twist", twisted(), "markers", SHEAR),
    Family(
        "shear alone, turn: bristles", "twist", bristles.scene(bristles.pivot), "markers", SHEAR
    ),
    Family("shear alone, grip: spheres", "held", held.held(held.grips), "markers", SHEAR),
    Family("24 electrodes: fingertip", "slip", fingertip.scene, "one axis", FORCE_AXES[2:]),
)  # fmt: skip
"""Situations of real hands; those with the same name before the colon share a row of `hands`."""
