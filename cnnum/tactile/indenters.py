"""Readings of taxels under a cover from spheres, punches and other bodies of known outline.

The mean pressure of every indenter is 1. Signals are positive under a push: −σ_zz for stress, and
−(2E/3) ε_zz for strain. So the cover is (1 + kz) e^(−kz) for the one and kz e^(−kz) for the other
(ν = 0.5). Lengths are in any unit, the same for all.

Spheres pressed on a half-space and pulled, as an array under the cover reads them.

Tractions are Hertz's and Cattaneo–Mindlin's, averaged over cells of a part of the pitch. Readings
are Love's and Cerruti's solutions for these cells.

Rigid flat punches of any outline on a half-space, and readings of the taxels under the cover.

No part of it is the program's: the pressure comes from Boussinesq's equation, solved on cells of a
part of the pitch. The readings come from Love's solution for these cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from cnnum.tactile.checks import Array, positive
from cnnum.tactile.contact import sphere_traction
from cnnum.tactile.grid import make_grid
from cnnum.tactile.halfspace import (
    SurfaceToDepth,
    band_pass,
    low_pass,
    rectangle_strain,
    rectangle_stress,
)

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


Reads = Literal["strain", "stress"]
Pressure = Literal["uniform", "punch", "hertz"]

FADED = 30.0
"""kz beyond which the cover lets nothing through: e^(−30) = 1e−13."""

NODES = 20
"""Gauss points a panel of the wave numbers; a panel is 2.5 periods of the Bessel function."""


class Indenter(Protocol):
    """A body pressed on the cover."""

    def normal(self, x: Array, y: Array, depth: float, reads: Reads) -> Array:
        """Return the normal signal at points below the surface."""
        ...

    def distance(self, x: Array, y: Array) -> Array:
        """Return the distance from the outline, negative inside."""
        ...


@dataclass(frozen=True, slots=True)
class Disc:
    """A round contact.

    Attributes
    ----------
    radius : float
    centre : (x, y) float
    pressure : "uniform", "punch" (rigid and flat: 1/(2√(1 − ρ²/a²))) or "hertz" (a sphere's)
    """

    radius: float
    centre: tuple[float, float] = (0.0, 0.0)
    pressure: Pressure = "uniform"

    def normal(self, x: Array, y: Array, depth: float, reads: Reads) -> Array:
        """Return the normal signal at points below the surface."""
        away = np.hypot(x - self.centre[0], y - self.centre[1]) / self.radius
        profile = _radial(self.pressure, depth / self.radius, reads, _reach(away))
        return np.asarray(profile(away))

    def distance(self, x: Array, y: Array) -> Array:
        """Return the distance from the outline, negative inside."""
        return np.asarray(np.hypot(x - self.centre[0], y - self.centre[1]) - self.radius)


@dataclass(frozen=True, slots=True)
class Ring:
    """A uniform pressure between two circles.

    Attributes
    ----------
    inner, outer : float
        Radii.
    centre : (x, y) float
    """

    inner: float
    outer: float
    centre: tuple[float, float] = (0.0, 0.0)

    def normal(self, x: Array, y: Array, depth: float, reads: Reads) -> Array:
        """Return the normal signal at points below the surface."""
        disc, hole = Disc(self.outer, self.centre), Disc(self.inner, self.centre)
        return disc.normal(x, y, depth, reads) - hole.normal(x, y, depth, reads)

    def distance(self, x: Array, y: Array) -> Array:
        """Return the distance from the outline, negative inside."""
        away = np.hypot(x - self.centre[0], y - self.centre[1])
        return np.maximum(away - self.outer, self.inner - away)


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A uniform pressure on a rectangle (Love 1929).

    Attributes
    ----------
    width, length : float
    angle : float, rad
        Angle of the width, from x towards y.
    centre : (x, y) float
    """

    width: float
    length: float
    angle: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)

    def normal(self, x: Array, y: Array, depth: float, reads: Reads) -> Array:
        """Return the normal signal at points below the surface."""
        along, across = self._own(x, y)
        size, load = (self.width, self.length), [0.0, 0.0, 1.0]
        if reads == "stress":
            return np.asarray(-rectangle_stress(along, across, depth, load, size=size)[..., 2, 2])
        strain = rectangle_strain(along, across, depth, load, size=size, youngs_modulus=1.5)
        return np.asarray(-strain[..., 2, 2])

    def distance(self, x: Array, y: Array) -> Array:
        """Return the distance from the outline, negative inside."""
        along, across = self._own(x, y)
        u, v = np.abs(along) - self.width / 2, np.abs(across) - self.length / 2
        outside = np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0))
        return np.asarray(outside + np.minimum(np.maximum(u, v), 0.0))

    def _own(self, x: Array, y: Array) -> tuple[Array, Array]:
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        right, down = x - self.centre[0], y - self.centre[1]
        return cos * right + sin * down, cos * down - sin * right


@dataclass(frozen=True, slots=True)
class Several:
    """Indenters that do not overlap, pressed together.

    Attributes
    ----------
    parts : tuple of Indenter
    """

    parts: tuple[Indenter, ...]

    def normal(self, x: Array, y: Array, depth: float, reads: Reads) -> Array:
        """Return the normal signal at points below the surface."""
        return np.asarray(np.sum([p.normal(x, y, depth, reads) for p in self.parts], axis=0))

    def distance(self, x: Array, y: Array) -> Array:
        """Return the distance from the nearest outline, negative inside."""
        return np.asarray(np.min([part.distance(x, y) for part in self.parts], axis=0))


def two_bars(
    width: float,
    length: float,
    gap: float,
    angle: float = 0.0,
    centre: tuple[float, float] = (0.0, 0.0),
) -> Several:
    """Return two parallel bars with a gap between them; `angle` is that of the way across."""
    step = (width + gap) / 2
    shift = step * np.cos(angle), step * np.sin(angle)
    places = [(centre[0] + s * shift[0], centre[1] + s * shift[1]) for s in (-1.0, 1.0)]
    return Several(tuple(Rectangle(width, length, angle, place) for place in places))


def taxels(shape: Sequence[int]) -> tuple[Array, Array]:
    """Return x and y of the taxels of an array, (rows, cols) in pitches from its middle."""
    grid = make_grid(shape, 1.0)
    x, y = np.meshgrid(grid.x, grid.y)
    return x, y


def frame_under(indenter: Indenter, shape: Sequence[int], depth: float, reads: Reads) -> Array:
    """Return an array's readings of an indenter whose lengths are in pitches, (rows, cols).

    Raises
    ------
    PhysicsError
        If the depth is not positive.
    """
    positive("depth", depth)
    x, y = taxels(shape)
    return indenter.normal(x, y, depth, reads)


def _reach(away: Array) -> float:
    """Return a distance beyond all of these, one of few so that profiles are shared."""
    return float(2.0 ** np.ceil(np.log2(max(4.0, float(np.max(away))))))


@cache
def _radial(pressure: Pressure, depth: float, reads: Reads, reach: float) -> "CubicSpline":
    """Return the signal over the distance from the axis, of a disc of radius 1, by its waves."""
    from scipy.interpolate import CubicSpline

    inner: Array = np.arange(0.0, 1.0 + 6.0 * depth, min(0.05 * depth, 0.05))
    outer = np.asarray(np.geomspace(1.0 + 6.0 * depth, reach + 6.0 * depth + 1.0, 60))
    # waves turn slowly near the axis, where most of the places are
    near: list[float] = inner[inner < outer[0] - 1e-6].tolist()
    far: list[float] = outer.tolist()
    seen = [*_waves(pressure, depth, reads, near), *_waves(pressure, depth, reads, far)]
    return CubicSpline(np.array([*near, *far], dtype=np.float64), np.array(seen, dtype=np.float64))


def _waves(pressure: Pressure, depth: float, reads: Reads, places: list[float]) -> list[float]:
    """Return the signal at distances from the axis, the sum over all waves."""
    from scipy.special import j0

    panels = int(np.ceil(FADED / depth * (places[-1] + 1.0) / (5.0 * np.pi))) + NODES
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    half = FADED / depth / panels / 2
    k = (half * (2 * np.arange(panels)[:, None] + 1 + nodes)).ravel()
    passes = low_pass if reads == "stress" else band_pass
    rise = np.tile(half * weights, panels) * k * _spectrum(pressure, k) * passes(k, depth)
    return [float(rise @ j0(k * place)) for place in places]


def _spectrum(pressure: Pressure, k: Array) -> Array:
    """Return the Hankel transform of a pressure of mean 1 on the unit disc (Johnson, ch. 3)."""
    match pressure:
        case "uniform":
            from scipy.special import j1

            return np.asarray(j1(k) / k)
        case "punch":
            return np.asarray(np.sin(k) / (2.0 * k))
        case "hertz":
            return np.asarray(1.5 * (np.sin(k) - k * np.cos(k)) / k**3)


TOUCHES_FINER = 5
"""Cells of the surface to a pitch: an odd number, so that taxels lie below middles."""

WIDEST = 0.45
"""Largest radius of a drawn contact, as a share of the array's side."""


@dataclass(frozen=True, slots=True)
class Touch:
    """A sphere that carries a load of 1 and is pulled; lengths in pitches.

    Attributes
    ----------
    radius : float
        Radius of the contact.
    centre : (x, y) float
        From the array's middle.
    pull : float
        Tangential over normal load.
    angle : float, rad
        Angle of the pull, from x to y.
    friction : float
    """

    radius: float
    centre: tuple[float, float]
    pull: float = 0.0
    angle: float = 0.0
    friction: float = 0.7

    @property
    def pulls(self) -> tuple[float, float]:
        """Tangential load along x and y."""
        return self.pull * np.cos(self.angle), self.pull * np.sin(self.angle)


@cache
def _touches_cover(cells: int, depth: float, reads: Reads, finer: int) -> SurfaceToDepth:
    # at E = 1.5 strain is in units of 2E/3: as large as the stress that it comes from
    modulus = 1.5 if reads == "strain" else None
    side = cells * finer
    return SurfaceToDepth((side, side), 1.0 / finer, depth, youngs_modulus=modulus)


def readings(
    touch: Touch, cells: int, depth: float, reads: Reads, finer: int = TOUCHES_FINER
) -> Array:
    """Return the readings of a square array, (cells, cells, 3), tension positive.

    Parameters
    ----------
    touch : Touch
    cells : int
        Number of cells along a side.
    depth : float
        Pitches.
    reads : "strain" or "stress"
    finer : int
        Cells of the surface to a pitch, an odd number. Under 0.3 pitches a contact of a pitch in
        radius is off by 3 % with 5 of them (strain; stress 2 %), by 0.3 % with 15.
    """
    side = cells * finer
    traction, _ = sphere_traction(
        (side, side),
        1.0 / finer,
        load=1.0,
        # a³ = 3PR/4E* at P = E* = 1
        sphere_radius=4.0 * touch.radius**3 / 3.0,
        modulus=1.0,
        friction=touch.friction,
        centre=touch.centre,
        tangential=touch.pulls,
    )
    seen = _touches_cover(cells, depth, reads, finer)(traction)
    return seen[finer // 2 :: finer, finer // 2 :: finer]


def drawn(
    rng: np.random.Generator, radii: tuple[float, float], cells: int, count: int
) -> list[Touch]:
    """Draw touches that lie on the array as a whole, pulled by 0.1 to 0.65 of their load."""
    result: list[Touch] = []
    for _ in range(count):
        radius = float(rng.uniform(radii[0], min(radii[1], WIDEST * cells)))
        room = 0.9 * (cells / 2 - radius)
        x, y = (float(place) for place in rng.uniform(-room, room, 2))
        pull, angle = float(rng.uniform(0.1, 0.65)), float(rng.uniform(0.0, 2 * np.pi))
        result.append(Touch(radius, (x, y), pull, angle))
    return result
