"""Maps with a rim of virtual cells, so that a neighbour is a fixed distance away."""

from dataclasses import dataclass

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.embedded.arithmetic.fixed import Quantity
from cnnum.embedded.arithmetic.whole import call, item
from cnnum.embedded.formats import Format
from cnnum.embedded.lowering.builder import CELL, PLACE, Builder
from cnnum.embedded.program import Array
from cnnum.templating.boundary import Boundary, halo_sources


def reach(kernels: Floats) -> int:
    """Return how far the outermost weight is from the middle."""
    places = np.argwhere(kernels)[:, 2:] - kernels.shape[-1] // 2
    return int(np.abs(places).max(initial=0))


@dataclass(frozen=True, slots=True, eq=False)
class Padded:
    """A map with its rim.

    Attributes
    ----------
    to : Builder
    array : Array
        (rows + 2 halo) × (cols + 2 halo) numbers; without a rim, the map itself.
    halo : int
    boundary : Boundary
    """

    to: Builder
    array: Array
    halo: int
    boundary: Boundary

    @classmethod
    def made(cls, to: Builder, like: Array, name: str, boundary: Boundary, halo: int) -> "Padded":
        """Return a new padded array, and write the rim where that is constant."""
        rows, cols = to.shape
        length = (rows + 2 * halo) * (cols + 2 * halo)
        form, logic = _holding(to, like, boundary.constant if halo else None)
        array = to.array(name, "work", length, form, like.about, logic=logic)
        padded = cls(to, array, halo, boundary)
        if boundary.constant is not None:
            padded._constant_rim(float(boundary.constant))
        return padded

    @classmethod
    def copied(
        cls, to: Builder, name: str, given: Array | Quantity, boundary: Boundary, halo: int
    ) -> "Padded":
        """Return a padded copy of a map; the map itself where there is no rim."""
        if isinstance(given, Quantity):
            form = to.formats.stored(name)
            given_array = Array(name, "work", to.cells, form)
            padded = cls.made(to, given_array, name, boundary, halo)
            padded.fill(given)
            return padded
        if not halo:
            return cls(to, given, 0, boundary)
        padded = cls.made(to, given, name, boundary, halo)
        padded.fill(to.item(given))
        return padded

    def fill(self, value: Quantity) -> None:
        """Write the cells, and a rim that copies them."""
        stored = self.to.stored(value, self.array)
        store = self.to.store_to(self.array, stored, PLACE)
        self.to.loop([store], cols=True, halo=self.halo)
        self.copy_rim()

    def copy_rim(self) -> None:
        """Write a rim that copies cells."""
        if self.boundary.constant is not None or not self.halo:
            return
        to_name, from_name = self._rim_tables()
        at, seen = (item(one.name, CELL, one.bounds) for one in (to_name, from_name))
        copy = self.to.store_to(self.array, item(self.array.name, seen, self.array.bounds), at)
        self.to.body.append(ir.sweep(CELL, to_name.length, [copy]))

    def at(self, row: int, col: int) -> Quantity:
        """Return the neighbour that many rows below and columns to the right."""
        width = self.to.shape[1] + 2 * self.halo
        place = CELL if not self.halo else PLACE
        distance = row * width + col
        at: ir.Expression = call("add", place, ir.Integer(distance)) if distance else place
        return self.to.item(self.array, at)

    def _constant_rim(self, value: float) -> None:
        if not self.halo:
            return
        places, _ = self._rim_tables()
        at = item(places.name, CELL, places.bounds)
        store = self.to.store_to(self.array, self.to.whole(value, self.array), at)
        self.to.body.append(ir.sweep(CELL, places.length, [store]))

    def _rim_tables(self) -> tuple[Array, Array]:
        """Return where the rim is, and which place of the padded map each of it copies."""
        rows, cols = self.to.shape
        halo, width = self.halo, cols + 2 * self.halo
        kind = self.boundary.pad_mode
        names = f"rim_{halo}", f"rim_{kind}_{halo}"
        sources = halo_sources(self.boundary, self.to.shape, halo)
        inside = np.zeros(sources.shape, dtype=bool)
        inside[halo : halo + rows, halo : halo + cols] = True
        places = np.flatnonzero(~inside.ravel())
        seen = sources.ravel()[places]
        seen = (seen // cols + halo) * width + seen % cols + halo
        if names[0] not in self.to.arrays:
            self.to.places(names[0], places, "places of the rim")
        if kind == "constant":
            return self.to.arrays[names[0]], self.to.arrays[names[0]]
        if names[1] not in self.to.arrays:
            self.to.places(names[1], seen, "the cells that the rim copies")
        return self.to.arrays[names[0]], self.to.arrays[names[1]]


def _holding(to: Builder, like: Array, edge: float | None) -> tuple[Format | None, bool]:
    """Return the format of an array that also holds the rim's value, and whether it is logic."""
    form = like.format
    if edge is None or edge in (0.0, 1.0) or (form is None and not like.logic):
        return form, like.logic
    if like.logic:
        size = max(1.0, abs(edge))
    else:
        assert form is not None
        size = max(-form.least * form.step, abs(edge))
        if abs(edge) <= form.largest * form.step:
            return form, False
    if not to.integer:
        return None, False
    wider = to.formats.precision.stored(size)
    fits = abs(edge) <= wider.largest * wider.step
    # a fixed fraction leaves no room for it: as many bits as a memory has
    return wider if fits else to.formats.precision.kept(size), False
