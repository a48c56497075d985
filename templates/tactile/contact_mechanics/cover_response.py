"""What taxels under a cover read of a sphere: of its push, and of its pull."""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from cnnum.arrays import Floats, Shape
from cnnum.errors import name_error
from cnnum.programs.fields import Field, maximum, minimum
from cnnum.tactile.bumps_felt import REACH, bumps_felt
from cnnum.tactile.halfspace import rectangle_strain, rectangle_stress
from cnnum.templates.tactile.shared.loads import RIM
from cnnum.templates.tactile.shared.pressure import Carries
from cnnum.templates.tactile.twist import Cover

RADII = (1.0, 1.25, 1.5, 1.75, 2.0)
"""Pitches: contact radii that are looked at."""

OFFSETS = (0.0, 0.25, 0.5)
"""Pitches from the array's middle, along both axes, over which the mean is taken. Gains of wide
contacts differ by 10 %, of narrow ones on bumps by 20 %."""

FINE = 4
"""Cells to a pitch of the surface, each with an even traction."""

PUSH_AND_PULL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

APART = 1e-3
"""Pitches by which spreads differ at least."""


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
class Felt:
    """What taxels read of loads in the cells of the surface around the array's middle.

    Attributes
    ----------
    shape : (rows, columns) int
        Taxels that are looked at: an array's, or so many of a large one's as feel the middle.
    y, x : (cells,) float
        Of the cells' middles, pitches from the first taxel.
    push : (taxels, cells) float
        Normal readings of a push in a cell, positive.
    pull, aside : (taxels, cells) float
        Shear readings of a pull along x: along it, and along y.
    """

    shape: Shape
    y: Floats
    x: Floats
    push: Floats
    pull: Floats
    aside: Floats

    def away(self, row: float, column: float) -> Floats:
        """Return the cells' squared distances from a place."""
        distance: Floats = (self.y - row) ** 2 + (self.x - column) ** 2
        return distance


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A contact as the programs see it.

    Attributes
    ----------
    normal : (rows, columns) float
        Normal readings.
    felt : (rows, columns) bool
        The taxels that count for a force, `Place.felt`.
    row, column : float
        Centroid.
    spread : float
        Radius of gyration, pitches.
    """

    normal: Floats
    felt: NDArray[np.bool_]
    row: float
    column: float
    spread: float


@dataclass(frozen=True, slots=True, eq=False)
class AsRead:
    """Spheres near the array's middle, as the taxels near them read them.

    Both are (radius,) float, for `RADII`, means over `OFFSETS`.

    Attributes
    ----------
    spread : array
        Radius of gyration of the normal loads, pitches; rising.
    gain : array
        How much more they read of a pull that slides with a friction of 1 than of the load.
    """

    spread: Floats
    gain: Floats

    def at(self, spread: Field, values: Floats) -> Field:
        """Return one of these for a contact: in lines between the radii, the last ones beyond."""
        found = spread * 0.0 + float(values[0])
        slopes = np.diff(values) / np.diff(self.spread)
        for begin, end, slope in zip(self.spread, self.spread[1:], slopes, strict=False):
            along = minimum(maximum(spread - float(begin), 0.0), float(end - begin))
            found = found + float(slope) * along
        return found


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
    felt = felt_by(shape, skin)
    row, column = felt.y.mean(), felt.x.mean()
    seen = list[tuple[float, float]]()
    for radius, down, right in product(RADII, OFFSETS, OFFSETS):
        pressure = hertz(radius, felt.away(row + down, column + right))
        contact = seen_as((felt.push @ pressure).reshape(felt.shape))
        shear = (felt.pull @ pressure).reshape(felt.shape)[contact.felt].sum()
        seen.append((contact.spread, float(shear / contact.normal[contact.felt].sum())))
    means: Floats = np.reshape(seen, (len(RADII), -1, 2)).mean(axis=1, dtype=np.float64)
    # what a small array sees of a wide contact may not become wider
    spread: Floats = np.maximum.accumulate(means[:, 0])
    return AsRead(spread + APART * np.arange(len(RADII)), means[:, 1])


@cache
def felt_by(shape: Shape, skin: Skin, fine: int = FINE) -> Felt:
    """Return what the taxels of an array read of loads around its middle.

    Parameters
    ----------
    shape : (rows, cols) int
    skin : Skin
    fine : int
        Cells to a pitch.

    Raises
    ------
    PhysicsError
        If depth or bumps are out of range.
    """
    tall, wide = (_felt(size) for size in shape)
    rows, cols = np.indices((tall, wide), dtype=np.float64).reshape(2, -1, 1)
    down, right = (_cells(size, fine) for size in (tall, wide))
    x, y = (axis.ravel() for axis in np.meshgrid(right, down))
    return Felt((tall, wide), y, x, *_read(rows, cols, y, x, skin, fine))


def seen_as(normal: Floats) -> Seen:
    """Return what the programs see of a contact in normal readings, (rows, columns), of whole
    taxels without noise.
    """
    weight = np.maximum(normal - RIM * normal.max(), 0.0)
    felt = binary_dilation(weight > 0.0, np.ones((3, 3), dtype=bool), iterations=2)
    rows, cols = np.indices(normal.shape)
    row, col = ((weight * axis).sum() / weight.sum() for axis in (rows, cols))
    distance = (rows - row) ** 2 + (cols - col) ** 2
    spread = np.sqrt((weight * distance).sum() / weight.sum())
    return Seen(normal, felt, float(row), float(col), float(spread))


def hertz(radius: float, away: Floats) -> Floats:
    """Return Hertz's pressure in each cell, over what it is in a unit of length."""
    return np.sqrt(np.maximum(radius * radius - away, 0.0))


def _felt(size: int) -> int:
    """Return how many taxels of a row are looked at: bumps are felt no farther.

    As many more or less as keep the middle at a taxel, or between two.
    """
    return size if size <= 2 * REACH + 1 else 2 * REACH + 2 - size % 2


def _cells(size: int, fine: int) -> Floats:
    """Return the middles of cells of the surface around the middle of so many taxels."""
    reach = RADII[-1] + OFFSETS[-1]
    count = round(2 * fine * reach)
    return (size - 1) / 2 - reach + (np.arange(count) + 0.5) / fine


def _read(
    rows: Floats, cols: Floats, y: Floats, x: Floats, skin: Skin, fine: int
) -> tuple[Floats, Floats, Floats]:
    """Return `push`, `pull` and `aside` of `Felt`."""
    if skin.reads == "force":
        own = np.where(np.maximum(abs(rows - y), abs(cols - x)) < 0.5, 1.0, 0.0)
        return own, own, 0.0 * own
    if skin.cover == "flat":
        (along, down), (across, right) = (
            np.unique(away, return_inverse=True) for away in (rows - y, cols - x)
        )
        push, pull = (
            _under(*np.meshgrid(across, along), load, skin, fine) for load in PUSH_AND_PULL
        )
        return push[down, right, 2, 2], pull[down, right, 0, 2], pull[down, right, 1, 2]
    felt = bumps_felt(skin.cover, skin.depth, skin.bump)
    steps = [(taxel - np.rint(cell)).astype(int) for taxel, cell in ((rows, y), (cols, x))]
    near = np.maximum(*np.abs(steps)) <= REACH
    at = tuple(np.where(near, REACH + step, 0) for step in steps)
    kernels = (felt.normal, felt.shear[0, 0], felt.shear[0, 1])
    push, pull, aside = (np.where(near, kernel[at], 0.0) for kernel in kernels)
    return push, pull, aside


def _under(x: Floats, y: Floats, load: Floats, skin: Skin, fine: int) -> Floats:
    size = (1.0 / fine, 1.0 / fine)
    if skin.reads == "stress":
        return -rectangle_stress(x, y, skin.depth, load, size=size)
    return -rectangle_strain(x, y, skin.depth, load, size=size, youngs_modulus=1.5)
