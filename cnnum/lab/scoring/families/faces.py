"""Bodies other than spheres: flat punches, rings, bars, two bodies, ridges, rough faces.

Friction follows Ciavarella's and Jäger's principle: the shear under a pull is μ (p(P) − p(P*)). The
pressures are those of the same body under its load and under a smaller one. The way is μ E*/G*
times the difference of the two approaches. A flat face is pressed evenly at any load, so all of it
sticks until all of it slides. The rough faces' pressures come from another solver
(`rough_faces.npz`: see `tests/oracle/rough_faces.py`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import YOUNGS_MODULUS, Draw

SIDE, POINTS = 6.0e-3, 60
"""m, of the square that holds a face, and its points a side."""

HALF = (1.5e-3, 2.5e-3)
"""m, half the width of a punch, and radius of a ring."""

PRESSURE = (15e3, 40e3)
"""Pa, mean under a face."""

RIDGE = 0.8e-3
"""m, from one ridge to the next; half of it touches."""

ROOM, ROUGH = "cnnum.lab.scoring.families", "rough_faces.npz"


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A body under loads from none to the whole.

    Attributes
    ----------
    x, y : (points,) float, m
        From its middle.
    loads : (loads,) float
        Shares of the whole load, from 0 to 1.
    pressed : (loads, points) float
        Share of the whole load on each point.
    approach : (loads,) float
        As a share of the approach under the whole load.
    radius : float, m
        Radius of the circle with the area of the face.
    stiffness : float
        Load over approach, as a share of that of a flat punch of that radius.
    """

    x: Floats
    y: Floats
    loads: Floats
    pressed: Floats
    approach: Floats
    radius: float
    stiffness: float = 1.0

    def pressure(self, load: float) -> Floats:
        """Return the share of the whole load on each point under a share of that load."""
        at = np.interp(load, self.loads, np.arange(len(self.loads)))
        low = min(int(at), len(self.loads) - 2)
        return np.asarray(
            self.pressed[low] + (at - low) * (self.pressed[low + 1] - self.pressed[low])
        )

    def shear(self, way: float) -> Floats:
        """Return the shear on each point, over μP, at a share of the way to gross slip."""
        left = float(np.interp(1.0 - way, self.approach, self.loads))
        return self.pressure(1.0) - self.pressure(left)

    def travel(self, load: float, friction: float) -> float:
        """Return the way (m) to gross slip under a load (N)."""
        tangential = YOUNGS_MODULUS * 4 / (2 * 1.5 * 1.5)  # 4G/(2 − ν), ν = 0.5
        return friction * load / (2 * tangential * self.radius * self.stiffness)


Shaping = Callable[[Draw], Face]


def punch(draw: Draw) -> Face:
    """Return a flat square punch; its pressure rises to the rim, and is finite there."""
    x, y = _points()
    half = draw.uniform(*HALF)
    u, w = (np.clip(1.0 - (at / half) ** 2, 0.05, None) for at in (x, y))
    return _flat(x, y, np.where(np.maximum(np.abs(x), np.abs(y)) < half, (u * w) ** -0.5, 0.0))


def ring(draw: Draw) -> Face:
    """Return a flat ring, just over half as wide inside as outside."""
    x, y = _points()
    radius, rho = draw.uniform(*HALF), np.hypot(x, y)
    return _flat(x, y, ((rho < radius) & (rho > 0.55 * radius)).astype(np.float64))


def bar(_: Draw) -> Face:
    """Return a flat bar, 1.6 mm by 6 mm."""
    x, y = _points()
    return _flat(x, y, (np.abs(y) < 0.8e-3).astype(np.float64))


def two_bodies(_: Draw) -> Face:
    """Return two round punches on one handle."""
    x, y = _points()
    near = np.hypot(np.abs(x) - 1.6e-3, y)
    return _flat(x, y, (near < 1.1e-3).astype(np.float64))


def ridges(draw: Draw) -> Face:
    """Return a flat square punch with a texture of ridges."""
    x, y = _points()
    half, phase = draw.uniform(*HALF), draw.uniform(0.0, 1.0)
    inside = np.maximum(np.abs(x), np.abs(y)) < half
    return _flat(x, y, (inside & ((x / RIDGE + phase) % 1.0 < 0.5)).astype(np.float64))


def rough(draw: Draw) -> Face:
    """Return a rough face whose pressures another solver (tamaas) worked out."""
    with resources.files(ROOM).joinpath(ROUGH).open("rb") as file:
        table = np.load(file)
        which = int(draw.rng.integers(len(table["pressed"])))
        pressed = np.asarray(table["pressed"][which], dtype=np.float64)
        loads, approach = table["loads"], np.asarray(table["approach"][which], dtype=np.float64)
        side, half = float(table["side"]), float(table["half"])
        stiffness = float(table["stiffness"][which])
    x, y = _points(side, pressed.shape[-1])
    flat = pressed.reshape(len(pressed), -1)
    flat *= (loads / np.maximum(flat.sum(axis=1), 1e-30))[:, None]
    radius = 2.0 * half / np.pi**0.5
    return Face(x, y, loads, flat, approach / approach[-1], radius, stiffness)


def _points(side: float = SIDE, count: int = POINTS) -> tuple[Floats, Floats]:
    at = ((np.arange(count) + 0.5) / count - 0.5) * side
    x, y = np.meshgrid(at, at)
    return x.reshape(-1), y.reshape(-1)


def _flat(x: Floats, y: Floats, weight: Floats) -> Face:
    used = weight > 0
    area = used.sum() * (SIDE / POINTS) ** 2
    share = weight[used] / weight.sum()
    ends = np.array([0.0, 1.0])
    return Face(x[used], y[used], ends, ends[:, None] * share, ends, float((area / np.pi) ** 0.5))
