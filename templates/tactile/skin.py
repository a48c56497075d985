"""What taxels under a cover read of a sphere: of its push, of its pull, and as it comes to slide.

A shear load that is added nearer to the contact's middle, as the disc that sticks shrinks, is felt
more by the taxels near the contact; on few taxels, and under bumps, much more. Where the cover is
known, so is all of this.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import get_args

import numpy as np
from scipy.ndimage import binary_dilation

from cnnum.arrays import Floats, Shape
from cnnum.errors import name_error
from cnnum.programs.fields import Field, maximum, minimum
from cnnum.tactile.bumps_felt import REACH, bumps_felt
from cnnum.tactile.halfspace import rectangle_strain, rectangle_stress
from cnnum.templates.tactile.laws import NEARER
from cnnum.templates.tactile.loads import RIM
from cnnum.templates.tactile.pressure import Carries
from cnnum.templates.tactile.pull import Place
from cnnum.templates.tactile.twist import Cover

RADII = (1.0, 1.25, 1.5, 1.75, 2.0)
"""Pitches: contact radii that are looked at."""

OFFSETS = (0.0, 0.25, 0.5)
"""Pitches from the array's middle, along both axes, over which the mean is taken. Gains of wide
contacts differ by 10 %, of narrow ones on bumps by 20 %. Lags are 0 to 0.14 under 0.7 mm of a flat
cover; by the place as a program knows it they are told no better than by their mean."""

LESS = 0.01
"""By so much less pulls lag than the elastic half-space says, 0.012 with a standard error of 0.003
(61 pulls at 500 and 1000 frames a second, tuning seeds 31000 to 31999)."""

FINE = 4
"""Cells to a pitch of the surface, each with an even traction."""

SHARES = np.linspace(0.02, 1.0, 50)
"""Of a pull's time that are left: the disc that sticks is √ of that share of the contact."""

PUSH_AND_PULL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

APART = 1e-3
"""Pitches by which spreads differ at least."""

TINY = 1e-30


@dataclass(frozen=True, slots=True)
class Skin:
    """What the taxels lie under.

    Attributes
    ----------
    depth : float
        Of the taxels, pitches.
    reads : "strain", "stress" or "force"
        What they read: "force" where each carries its own share of the load, whatever the cover;
        under bumps otherwise strain.
    cover : "flat", "bumpy" or "bumps-fem"
        As the driver `simulated` has them.
    bump : float
        Radius of a bump, pitches.

    Raises
    ------
    UnknownNameError
        If the cover or the reading is unknown.
    """

    depth: float
    reads: Carries
    cover: Cover
    bump: float

    def __post_init__(self) -> None:
        for kind, name, known in (("cover", self.cover, Cover), ("reading", self.reads, Carries)):
            if name not in get_args(known):
                raise name_error(kind, name, get_args(known))


@dataclass(frozen=True, slots=True, eq=False)
class AsRead:
    """Spheres near the array's middle, as the taxels near them read them.

    All are (radius,) float, for `RADII`, means over `OFFSETS`.

    Attributes
    ----------
    spread : array
        Radius of gyration of the normal loads, pitches; rising.
    gain : array
        How much more they read of a pull that slides with a friction of 1 than of the load.
    lag : array
        By how much they lag behind Mindlin's force as it comes to slide: of s^(3/2) (1 − s), s the
        share of its time that is left.
    """

    spread: Floats
    gain: Floats
    lag: Floats

    def at(self, spread: Field, values: Floats) -> Field:
        """Return one of these for a contact: in lines between the radii, the last ones beyond."""
        found = spread * 0.0 + float(values[0])
        slopes = np.diff(values) / np.diff(self.spread)
        for begin, end, slope in zip(self.spread, self.spread[1:], slopes, strict=False):
            along = minimum(maximum(spread - float(begin), 0.0), float(end - begin))
            found = found + float(slope) * along
        return found


def lag_of(contact: Place, skin: Skin) -> Field:
    """Return by how much a pull that is read lags behind Mindlin's force; see `AsRead`."""
    if skin.reads == "force":
        return contact.loads.frame.constant(NEARER)
    seen = as_read(contact.loads.frame.shape, skin)
    return seen.at(contact.spread, seen.lag - LESS)


@cache
def as_read(shape: Shape, skin: Skin) -> AsRead:
    """Return what taxels near a sphere read of it.

    Parameters
    ----------
    shape : (rows, cols) int
    skin : Skin

    Raises
    ------
    PhysicsError
        If depth or bumps are out of range.
    """
    tall, wide = (_felt(size) for size in shape)
    rows, cols = np.indices((tall, wide), dtype=np.float64).reshape(2, -1, 1)
    down, right = (_cells(size) for size in (tall, wide))
    x, y = (axis.ravel() for axis in np.meshgrid(right, down))
    kernels = _read(rows, cols, y, x, skin)
    seen = [
        _seen((tall, wide), kernels, radius, (y - row) ** 2 + (x - col) ** 2)
        for radius, row, col in product(
            RADII, down.mean() + np.array(OFFSETS), right.mean() + np.array(OFFSETS)
        )
    ]
    means: Floats = np.reshape(seen, (len(RADII), -1, 3)).mean(axis=1, dtype=np.float64)
    # what a small array sees of a wide contact may not become wider
    spread: Floats = np.maximum.accumulate(means[:, 0])
    return AsRead(spread + APART * np.arange(len(RADII)), means[:, 1], means[:, 2])


def _felt(size: int) -> int:
    """Return how many taxels of a row are looked at: bumps are felt no farther."""
    return min(size, 2 * REACH + 1)


def _cells(size: int) -> Floats:
    """Return the middles of cells of the surface around the middle of so many taxels."""
    reach = RADII[-1] + OFFSETS[-1]
    count = round(2 * FINE * reach)
    return (size - 1) / 2 - reach + (np.arange(count) + 0.5) / FINE


def _read(rows: Floats, cols: Floats, y: Floats, x: Floats, skin: Skin) -> tuple[Floats, Floats]:
    """Return normal readings of a push, and shear readings of a pull along x, (taxels, cells)."""
    if skin.reads == "force":
        own = np.where(np.maximum(abs(rows - y), abs(cols - x)) < 0.5, 1.0, 0.0)
        return own, own
    if skin.cover == "flat":
        (along, down), (across, right) = (
            np.unique(away, return_inverse=True) for away in (rows - y, cols - x)
        )
        push, pull = (_under(*np.meshgrid(across, along), load, skin) for load in PUSH_AND_PULL)
        return push[down, right, 2, 2], pull[down, right, 0, 2]
    felt = bumps_felt(skin.cover, skin.depth, skin.bump)
    steps = [(taxel - np.rint(cell)).astype(int) for taxel, cell in ((rows, y), (cols, x))]
    near = np.maximum(*np.abs(steps)) <= REACH
    at = tuple(np.where(near, REACH + step, 0) for step in steps)
    return np.where(near, felt.normal[at], 0.0), np.where(near, felt.shear[0, 0][at], 0.0)


def _under(x: Floats, y: Floats, load: Floats, skin: Skin) -> Floats:
    size = (1.0 / FINE, 1.0 / FINE)
    if skin.reads == "stress":
        return -rectangle_stress(x, y, skin.depth, load, size=size)
    return -rectangle_strain(x, y, skin.depth, load, size=size, youngs_modulus=1.5)


def _seen(
    shape: Shape, kernels: tuple[Floats, Floats], radius: float, away: Floats
) -> tuple[float, float, float]:
    """Return spread, gain and lag of a contact, whose cells are so far from its middle, squared.

    The taxels that count are those of `place_of`.
    """
    normal, shear = ((kernel @ _hertz(radius, away)).reshape(shape) for kernel in kernels)
    weight = np.maximum(normal - RIM * normal.max(), 0.0)
    near = binary_dilation(weight > 0.0, np.ones((3, 3), dtype=bool))
    rows, cols = np.indices(shape)
    row, col = ((weight * axis).sum() / weight.sum() for axis in (rows, cols))
    distance = (rows - row) ** 2 + (cols - col) ** 2
    spread = np.sqrt((weight * distance).sum() / weight.sum())
    lag = _lag(kernels[1][near.ravel()].sum(axis=0), radius, away)
    return float(spread), float(shear[near].sum() / normal[near].sum()), lag


def _hertz(radius: float, away: Floats) -> Floats:
    """Return Hertz's pressure in each cell, over what it is in a unit of length."""
    return np.sqrt(np.maximum(radius * radius - away, 0.0))


def _lag(felt: Floats, radius: float, away: Floats) -> float:
    """Return the lag of a sum of taxels that feels so much of a shear load in each cell.

    A pull's traction is that of sliding over the contact less that over the disc that sticks
    (Cattaneo, Mindlin). Both are of Hertz's form; so what is still missing of the last force is
    what the taxels feel of the disc, which of the force itself is s^(3/2).
    """
    missing = list[float]()
    for left in SHARES:
        disc = _hertz(radius * float(np.sqrt(left)), away)
        # in cells a small disc has not quite its load
        missing.append(float(felt @ disc) / max(float(disc.sum()), TINY) * left**1.5)
    law = SHARES**1.5
    read = np.array(missing) / missing[-1]
    fitted = np.stack([1.0 - law, law * (1.0 - SHARES), np.ones_like(law)], axis=1)
    (whole, bulge, _), *_ = np.linalg.lstsq(fitted, 1.0 - read)
    return float(-bulge / whole)
