"""Spheres pressed on a half-space and pulled, as an array under the cover reads them.

Tractions are Hertz's and Cattaneo–Mindlin's, averaged over cells of a part of the pitch. Readings
are Love's and Cerruti's solutions for these cells.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from cnnum.tactile.checks import Array
from cnnum.tactile.contact import sphere_traction
from cnnum.tactile.halfspace import SurfaceToDepth
from cnnum.tactile.indenters import Reads

FINER = 5
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
def _cover(cells: int, depth: float, reads: Reads, finer: int) -> SurfaceToDepth:
    # at E = 1.5 strain is in units of 2E/3: as large as the stress that it comes from
    modulus = 1.5 if reads == "strain" else None
    side = cells * finer
    return SurfaceToDepth((side, side), 1.0 / finer, depth, youngs_modulus=modulus)


def readings(touch: Touch, cells: int, depth: float, reads: Reads, finer: int = FINER) -> Array:
    """Return the readings of a square array, (cells, cells, 3), tension positive.

    Parameters
    ----------
    touch : Touch
    cells : int
        Of a side.
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
    seen = _cover(cells, depth, reads, finer)(traction)
    return seen[finer // 2 :: finer, finer // 2 :: finer]


def drawn(
    rng: np.random.Generator, radii: tuple[float, float], cells: int, count: int
) -> list[Touch]:
    """Draw touches that lie on the array as a whole, pulled by 0.1 to 0.65 of their load."""
    found: list[Touch] = []
    for _ in range(count):
        radius = float(rng.uniform(radii[0], min(radii[1], WIDEST * cells)))
        room = 0.9 * (cells / 2 - radius)
        x, y = (float(place) for place in rng.uniform(-room, room, 2))
        pull, angle = float(rng.uniform(0.1, 0.65)), float(rng.uniform(0.0, 2 * np.pi))
        found.append(Touch(radius, (x, y), pull, angle))
    return found
