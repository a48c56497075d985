"""The influence of a bump on the taxels under it, computed by finite elements."""

import math
from dataclasses import dataclass
from importlib import resources

import numpy as np

from cnnum.errors import ArrayError
from cnnum.tactile.checks import Array, finite

DEPTHS = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
"""Depths of the taxels under the surface, in bump radii."""

STRETCH = np.concatenate([np.arange(0, 2, 0.05), np.arange(2, 8.01, 0.25)])
"""Distances from the axis over 1 + depth, all in bump radii."""
STRETCH.setflags(write=False)

PATCH = math.sin(5 * math.pi / 32)
"""Radius of the bonded patch on top, in bump radii: 0.47, that of a rigid plate pressed 0.25 in.

A mesh has a node at its rim if its fineness is a multiple of eight.
"""

PROFILES = 7
"""σ_zz, σ_rz, Eε_zz pressed; σ_zz, σ_rz, σ_θz, Eε_zz dragged."""


@dataclass(frozen=True, slots=True)
class BumpTables:
    """Stress for unit force and radius, and also strain for unit modulus, at ν = 0.5.

    Attributes
    ----------
    depths : (depths,) float, bump radii
    lever : float, bump radii
        Height over the surface at which a drag's force makes the moment it does.
    half_space, rigid_base : (depths, 7, distances) float
        Profiles along STRETCH * (1 + depth). One is within a thick block at the depth. The other is
        on the rigid base of a layer that is as thick as the depth.
    """

    depths: Array
    lever: float
    half_space: Array
    rigid_base: Array

    def __post_init__(self) -> None:
        wanted = (np.size(finite("depths", self.depths)), PROFILES, STRETCH.size)
        for name in ("half_space", "rigid_base"):
            shape = finite(name, getattr(self, name)).shape
            if shape != wanted:
                raise ArrayError(f"'{name}': expected shape {wanted}, got {shape}.")


def load_tables() -> BumpTables:
    """Return the tables that ship with the package.

    They come from `cnnum.tactile.cover.fem.generate.regenerate`.
    """
    tables = load_arrays()
    return BumpTables(
        tables["depths"], float(tables["lever"]), tables["half_space"], tables["rigid_base"]
    )


def load_arrays() -> dict[str, Array]:
    """Return every array of the shipped file, by name."""
    file = resources.files("cnnum.tactile.cover") / "bump.npz"
    with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
        return {name: np.asarray(arrays[name], dtype=np.float64) for name in arrays.files}
