"""How maps lie in memory, each with a rim of virtual cells around it, and the rims' sources."""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Shape
from cnnum.engines.numba.records import Ints, Real, Reals
from cnnum.templating.boundary import Boundary

BAND = 2048
"""Cells that are worked on at a time: the rows of numbers that a step reads of them stay in the
first-level cache."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Maps of (rows, cols), each with a rim of `radius`, one after the other.

    Attributes
    ----------
    shape : (rows, cols)
    radius : int
    """

    shape: Shape
    radius: int

    @property
    def pitch(self) -> int:
        """Length of a row with its rim."""
        return self.shape[1] + 2 * self.radius

    @property
    def padded(self) -> Shape:
        """Rows and columns with the rim."""
        return self.shape[0] + 2 * self.radius, self.pitch

    @property
    def size(self) -> int:
        """Length of a map with its rim."""
        return self.padded[0] * self.pitch

    def maps(self, batch: int, count: int, value: float, dtype: Real) -> Reals:
        """Return new maps (batch, count·size) of one value."""
        return np.full((batch, count * self.size), value, dtype)

    def inner(self, maps: Reals) -> Reals:
        """Return the cells of maps that are no rim, as a view (batch, count, rows, cols)."""
        count, r, (rows, cols) = maps.shape[1] // self.size, self.radius, self.shape
        blocks = maps.reshape(len(maps), count, *self.padded)
        return blocks[:, :, r : r + rows, r : r + cols]

    def fill_rims(self, maps: Reals, boundary: Boundary) -> None:
        """Set the rims of all maps by a boundary."""
        to, source = self.rim(boundary)
        blocks = maps.reshape(len(maps), maps.shape[1] // self.size, self.size)
        blocks[:, :, to] = blocks[:, :, source]

    def rim(self, boundary: Boundary) -> Ints:
        """Return (2, rim cells): a rim's places in a map, and the places that they copy."""
        if boundary.constant is not None:
            return np.zeros((2, 0), np.int64)
        rows, cols = (_sources(boundary, n, self.radius) + self.radius for n in self.shape)
        sources = (rows[:, np.newaxis] * self.pitch + cols).ravel()
        (places,) = np.nonzero(sources != np.arange(self.size))
        return np.array([places, sources[places]])

    def bands(self, layers: int) -> Ints:
        """Return pieces of the layers, without the rows of the rim before and after them.

        Returns
        -------
        (bands, 3) int
            Layer, first place, place after the last.
        """
        skipped = self.radius * self.pitch + self.radius
        starts = np.arange(skipped, self.size - skipped, BAND)
        ends = np.minimum(starts + BAND, self.size - skipped)
        return np.array(
            [
                (layer, layer * self.size + lo, layer * self.size + hi)
                for layer in range(layers)
                for lo, hi in zip(starts, ends, strict=True)
            ],
            dtype=np.int64,
        )


def _sources(boundary: Boundary, length: int, radius: int) -> Ints:
    """Return for every place along an axis with its rim the place (without rim) that it copies."""
    places = np.arange(-radius, length + radius)
    if boundary.pad_mode == "wrap":
        return places % length
    # a mirror at either end: there and back in 2·length places
    there = places % (2 * length)
    return np.where(there < length, there, 2 * length - 1 - there)
