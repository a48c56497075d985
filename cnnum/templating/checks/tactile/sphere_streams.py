"""Streams of a sphere that is pressed, then pulled or turned at a constant speed, without noise.

Tractions are those of Hertz, of Cattaneo and Mindlin, and of Lubkin. They are averaged over cells
of a fifth of the pitch; the strain under these cells is Love's and Cerruti's. Lengths are pitches,
and the contact modulus E* is 1.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain

import numpy as np
from scipy.optimize import brentq

from cnnum.arrays import Floats, Shape, frozen
from cnnum.tactile.contact import (
    Hertz,
    TorsionSlip,
    hertz,
    shear_compliance,
    sphere_traction,
    swirl_average,
    tangential_displacement,
)
from cnnum.tactile.grid import make_grid, sharpened
from cnnum.tactile.halfspace import SurfaceToDepth

FINER = 5
"""Cells of the surface to a pitch: an odd number, so that taxels lie below middles."""

DEPTH = 2 / 3
"""Depth of the taxels, in pitches: 1 mm at a pitch of 1.5 mm."""

MODULUS = 0.75
"""E of an incompressible cover whose E* = E/(1 − ν²) is 1."""

REST, PRESS, HOLD = 20, 16, 34
"""Frames without contact, of a load that grows as a constant speed makes it, and before it moves.
Programs learn rest from 16 frames, and a force at rest from 32."""

BEGIN = REST + PRESS + HOLD
"""The first frame in which the sphere has moved."""

KEPT = 16
"""Streams that are kept: several forms, on several engines, look at the same ones."""

Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Sphere:
    """A sphere on the cover, ten times as wide as its contact.

    Attributes
    ----------
    radius : float
        Radius of the contact.
    friction : float
    centre : (x, y) float
        From the array's middle.
    """

    radius: float
    friction: float
    centre: Place

    @property
    def size(self) -> float:
        """Radius of the sphere itself."""
        return 10.0 * self.radius

    @property
    def load(self) -> float:
        """Normal load, by Hertz's a³ = 3PR/4E*."""
        return 4.0 * self.radius**3 / (3.0 * self.size)

    @property
    def contact(self) -> Hertz:
        """Under the whole load."""
        return hertz(self.load, self.size, 1.0)

    def way(self) -> float:
        """Return how far a pull moves it until all of the contact slips (Mindlin)."""
        compliance = shear_compliance(MODULUS)
        return float(
            tangential_displacement(
                self.contact, self.load, self.friction * self.load, self.friction, compliance
            )
        )

    def slip(self, stick: float) -> TorsionSlip:
        """Return the contact in a turn (Lubkin), with the share of the radius that sticks."""
        peak = self.friction * float(self.contact.peak_pressure)
        return TorsionSlip(self.radius, stick * self.radius, peak)

    def turn(self, stick: float) -> float:
        """Return the angle at which a share of the contact radius sticks, rad (Lubkin)."""
        return self.slip(stick).twist(MODULUS / 3.0)


@lru_cache(KEPT)
def pulled(
    shape: Shape, sphere: Sphere, time: float, angle: float, frames: int, share: float = math.inf
) -> Floats:
    """Return strain under a sphere that is pulled at a constant speed.

    Parameters
    ----------
    shape : (rows, cols)
    sphere : Sphere
    time : float
        Frames from the start of the pull until all slips; c/a = √(1 − t/time).
    angle : float, rad
        Angle of the pull, from x to y.
    frames : int
        From the start of the pull on; a sphere that slides moves on.
    share : float
        Of that time after which it stops.

    Returns
    -------
    (frames, rows, cols, 3) float
        The pull's first frame is `BEGIN`.
    """
    direction, way = np.array([np.cos(angle), np.sin(angle)]), sphere.way()

    def moved() -> Iterator[Floats]:
        for frame in range(1, frames + 1):
            gone = min(frame / time, share)
            force = sphere.friction * sphere.load * (1.0 - max(1.0 - gone, 0.0) ** 1.5)
            slid = max(gone - 1.0, 0.0) * way * direction
            yield _traction(shape, sphere, pull=force * direction, slid=slid)

    return _seen(shape, sphere, moved())


@lru_cache(KEPT)
def turned(shape: Shape, sphere: Sphere, time: float, sense: int, frames: int) -> Floats:
    """Return strain under a sphere that turns about its normal at a constant rate.

    Parameters
    ----------
    shape : (rows, cols)
    sphere : Sphere
    time : float
        Frames from the start of the turn until half the contact radius sticks.
    sense : +1 or -1
        +1 turns x towards y.
    frames : int
        From the start of the turn on.

    Returns
    -------
    (frames, rows, cols, 3) float
        The turn's first frame is `BEGIN`.
    """
    step = sphere.turn(0.5) / time
    grid = make_grid((FINER * shape[0], FINER * shape[1]), 1.0 / FINER)

    def moved() -> Iterator[Floats]:
        traction = _traction(shape, sphere)
        for frame in range(1, frames + 1):
            slip = sphere.slip(_stick_at(sphere, step * frame))
            radii = (slip.contact_radius, slip.stick_radius)
            swirl = sense * swirl_average(slip.potential, grid, sphere.centre, radii)
            yield np.concatenate([swirl, traction[..., 2:]], axis=-1)

    return _seen(shape, sphere, moved())


def _stick_at(sphere: Sphere, angle: float) -> float:
    """Return c/a at an angle; it falls about as e^(−angle)."""
    depth = brentq(lambda s: sphere.turn(math.exp(-s)) - angle, 0.0, 20.0, xtol=1e-12)
    return math.exp(-float(depth))


def _traction(
    shape: Shape,
    sphere: Sphere,
    *,
    grown: float = 1.0,
    pull: Floats | None = None,
    slid: Floats | None = None,
) -> Floats:
    x, y = (0.0, 0.0) if slid is None else slid.tolist()
    traction, _ = sphere_traction(
        (FINER * shape[0], FINER * shape[1]),
        1.0 / FINER,
        load=grown * sphere.load,
        sphere_radius=sphere.size,
        modulus=1.0,
        friction=sphere.friction,
        centre=(sphere.centre[0] + x, sphere.centre[1] + y),
        tangential=(0.0, 0.0) if pull is None else (float(pull[0]), float(pull[1])),
    )
    return traction


def _seen(shape: Shape, sphere: Sphere, moved: Iterator[Floats]) -> Floats:
    """Return the strain of a touch and of its course."""
    fine = (FINER * shape[0], FINER * shape[1])
    cover = SurfaceToDepth(fine, 1.0 / FINER, DEPTH, youngs_modulus=MODULUS)
    middle = slice(FINER // 2, None, FINER)
    maps = (sharpened(step, (0, 1)) for step in chain(_touch(shape, sphere), moved))
    return frozen([cover(step)[middle, middle] for step in maps])


def _touch(shape: Shape, sphere: Sphere) -> Iterator[Floats]:
    """Yield the tractions up to `BEGIN`; at a constant speed a load grows as t^(3/2) (Hertz)."""
    for frame in range(BEGIN):
        share = min(max(frame + 1 - REST, 0) / PRESS, 1.0)
        yield _traction(shape, sphere, grown=share**1.5)
