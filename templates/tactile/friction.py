"""How much friction a force would need if what it pulls at slipped.

Taxels under a cover read another share of a pull than of a push: under thin flat covers five times
as much, under thick ones and bumps about as much. Where the cover is known, so is that gain, for
what slides pulls where it presses, friction times as much.
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
from cnnum.templates.tactile.loads import RIM
from cnnum.templates.tactile.pressure import Carries
from cnnum.templates.tactile.pull import Place, Side
from cnnum.templates.tactile.twist import Cover

RADII = (1.0, 2.0)
"""Pitches: contact radii at which the gain is worked out; between them it is a line."""

OFFSETS = (0.0, 0.25, 0.5)
"""Pitches from the array's middle, along both axes, over which the gain is averaged: wide contacts
differ by 10 % of it, narrow ones on bumps by 20 %."""

FINE = 4
"""Cells to a pitch of the surface, each with an even traction."""

PUSH_AND_PULL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

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


def friction_needed(contact: Place, force: Side, skin: Skin) -> Field:
    """Return the force over the normal load, as taxels would read them of a friction of 1."""
    (narrow, low), (wide, high) = gains(contact.loads.frame.shape, skin)
    share = minimum(maximum((contact.spread - narrow) / max(wide - narrow, TINY), 0.0), 1.0)
    gain = low + (high - low) * share
    return force.growth.size / (gain * maximum(force.normal, TINY))


@cache
def gains(shape: Shape, skin: Skin) -> tuple[tuple[float, float], ...]:
    """Return how much more taxels near a sphere that slides read of its pull than of its load.

    Parameters
    ----------
    shape : (rows, cols) int
    skin : Skin

    Returns
    -------
    ((spread, gain), (spread, gain)) float
        For each of `RADII`: radius of gyration of the loads that are read, pitches; and the sums'
        ratio with a friction of 1, the contact being at the array's middle.

    Raises
    ------
    PhysicsError
        If depth or bumps are out of range.
    """
    tall, wide = (min(size, 2 * REACH + 1) for size in shape)
    rows, cols = np.indices((tall, wide), dtype=np.float64).reshape(2, -1, 1)
    down, right = (_cells(size) for size in (tall, wide))
    x, y = (axis.ravel() for axis in np.meshgrid(right, down))
    kernels = _read(rows, cols, y, x, skin)
    found = list[tuple[float, float]]()
    for radius in RADII:
        seen = list[tuple[float, float]]()
        for row, col in product(OFFSETS, OFFSETS):
            away = (y - down.mean() - row) ** 2 + (x - right.mean() - col) ** 2
            pressure = np.sqrt(np.maximum(radius * radius - away, 0.0))
            normal, shear = ((kernel @ pressure).reshape(tall, wide) for kernel in kernels)
            seen.append(_summed(normal, shear))
        spread, gain = np.mean(seen, axis=0).tolist()
        found.append((spread, gain))
    return tuple(found)


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


def _summed(normal: Floats, shear: Floats) -> tuple[float, float]:
    """Return the radius of gyration of what is read, and the ratio of sums, as `place_of` does."""
    weight = np.maximum(normal - RIM * normal.max(), 0.0)
    near = binary_dilation(weight > 0.0, np.ones((3, 3), dtype=bool))
    rows, cols = np.indices(normal.shape)
    row, col = ((weight * axis).sum() / weight.sum() for axis in (rows, cols))
    away = (rows - row) ** 2 + (cols - col) ** 2
    spread = np.sqrt((weight * away).sum() / weight.sum())
    return float(spread), float(shear[near].sum() / normal[near].sum())
