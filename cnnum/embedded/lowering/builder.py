"""The store that lowering writes into: arrays with rims, statements, known quantities."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cnnum import kernels as ir
from cnnum.arrays import Floats, Shape
from cnnum.embedded.arithmetic import Arithmetic, Fixed, Quantity, call, item, limited, nearest
from cnnum.embedded.formats import Format, Formats
from cnnum.embedded.program import Array, Kind
from cnnum.graph.nodes import Transient
from cnnum.graph.schedule import Schedule, everything
from cnnum.integrators.choice import choose, in_one_sum, only_output_matters
from cnnum.integrators.closed_forms import (
    SHIFTS,
    Circulant,
    Decay,
    Propagator,
    Separate,
    Spectral,
    circulant,
)
from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import EULER
from cnnum.templating.boundary import Boundary, rim_copies
from cnnum.templating.network import Network

CELL = ir.Name("i", (0, 1 << 16))
PLACE = ir.Name("p", (0, 1 << 16))
ROW, COLUMN = ir.Name("r", (0, 1 << 16)), ir.Name("c", (0, 1 << 16))
FINE = 40
"""Fraction that is asked for where a format follows at once."""


@dataclass(slots=True, eq=False)
class Builder:
    """A program while it is lowered.

    Attributes
    ----------
    shape : (rows, cols)
    arithmetic : Fixed or Reals
    formats : Sizes or NoFormats
    body : list of Statement
        Where statements go now.
    arrays : dict of str to Array
    fractions : dict of str to int
        Number of fractional bits of each variable.
    """

    shape: Shape
    arithmetic: Arithmetic
    formats: Formats
    body: list[ir.Statement] = field(default_factory=list[ir.Statement])
    arrays: dict[str, Array] = field(default_factory=dict[str, Array])
    fractions: dict[str, int] = field(default_factory=dict[str, int])

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    @property
    def integer(self) -> bool:
        """Whether it uses fixed-point arithmetic."""
        return isinstance(self.arithmetic, Fixed)

    def array(
        self,
        name: str,
        kind: Kind,
        length: int,
        format: Format | None,
        description: str = "",
        *,
        logic: bool = False,
    ) -> Array:
        """Return a new array."""
        made = Array(name, kind, length, None if logic else format, description, logic=logic)
        self.arrays[name] = made
        return made

    def table(
        self, name: str, values: ArrayLike, description: str = "", bits: int = 0
    ) -> tuple[Array, int]:
        """Return a table of constants, and the fraction of its numbers.

        Parameters
        ----------
        name : str
        values : (...) float
        description : str
        bits : int
            Bits of a number; 0 for those of the precision.
        """
        flat = np.asarray(values, dtype=np.float64).ravel()
        if not isinstance(self.arithmetic, Fixed):
            made = Array(name, "table", flat.size, None, description, flat)
            self.arrays[name] = made
            return made, 0
        weights, fraction = self.arithmetic.weights(flat.tolist(), bits)
        whole = np.asarray(weights, dtype=np.int64)
        exact = bool(np.all(np.ldexp(whole.astype(np.float64), -fraction) == flat))
        return self._table(name, whole, fraction, description, exact=exact), fraction

    def bits_beside(self, arrays: Sequence[Array], terms: int) -> int:
        """Return the bits of a table whose numbers multiply arrays, in sums of so many terms."""
        if not isinstance(self.arithmetic, Fixed):
            return 0
        return self.arithmetic.bits_beside([self.item(array) for array in arrays], terms)

    def places(self, name: str, values: ArrayLike, description: str = "") -> Array:
        """Return a table of whole numbers: places in an array."""
        flat = np.asarray(values, dtype=np.int64).ravel()
        return self._table(name, flat, 0, description, places=True, exact=True)

    def _table(
        self,
        name: str,
        values: Any,
        fraction: int,
        description: str,
        *,
        places: bool = False,
        exact: bool = False,
    ) -> Array:
        most = int(np.abs(values).max(initial=0))
        bits = next(bits for bits in (8, 16, 32) if most < 1 << (bits - 1))
        form = Format(bits, fraction)
        made = Array(
            name, "table", values.size, form, description, values, places=places, exact=exact
        )
        self.arrays[name] = made
        return made

    def item(self, array: Array, at: ir.Expression = CELL) -> Quantity:
        """Return an array element."""
        return self.loaded(array, item(array.name, at, array.held))

    def loaded(self, array: Array, value: ir.Expression) -> Quantity:
        """Return a number that is read of an array; what comes from outside is kept in its format.

        A caller, or a fault of the memory, may leave any bits in inputs and in the state.
        """
        fraction = 0 if array.format is None else array.format.fraction
        if array.held is not None and array.bounds is not None and array.held != array.bounds:
            value = (
                call("greater", value, ir.Integer(0))
                if array.logic
                else limited(value, *array.bounds)
            )
        return Quantity(value, fraction)

    def let(self, name: str, quantity: Quantity) -> Quantity:
        """Return a quantity by a new name."""
        made = ir.Name(name, quantity.value.bounds)
        self.body.append(ir.fixed(made, quantity.value))
        self.fractions[name] = quantity.fraction
        return Quantity(made, quantity.fraction)

    def stored(self, quantity: Quantity, array: Array) -> ir.Expression:
        """Return the expression that an array holds for a quantity."""
        if array.logic:
            return (
                quantity.value if quantity.exact is None else ir.Integer(int(quantity.exact != 0))
            )
        if not isinstance(self.arithmetic, Fixed):
            # logic values are whole numbers, in reals too
            return (
                quantity.value if quantity.value.bounds is None else call("to_real", quantity.value)
            )
        assert array.format is not None
        return self.arithmetic.stored(quantity, array.format)

    def store(self, array: Array, quantity: Quantity, at: ir.Expression = CELL) -> None:
        """Store a quantity in an array."""
        self.body.append(self.store_to(array, self.stored(quantity, array), at))

    def store_to(self, array: Array, value: ir.Expression, at: ir.Expression = CELL) -> ir.Assign:
        """Return the statement that stores a number of an array."""
        return ir.Assign(item(array.name, at, array.bounds), value)

    def zero(self) -> ir.Expression:
        """Return 0."""
        return ir.Integer(0) if self.integer else ir.Number(0.0)

    def whole(self, value: float, array: Array) -> ir.Expression:
        """Return a constant as an array holds it."""
        if array.format is None:
            return ir.Number(value)
        from fractions import Fraction

        result = nearest(Fraction(value) * Fraction(2) ** array.format.fraction)
        return ir.Integer(max(array.format.least, min(array.format.largest, result)))

    @contextmanager
    def within(self) -> Generator[list[ir.Statement]]:
        """Collect statements into the body of a loop, which is written later."""
        outer, self.body = self.body, []
        try:
            yield self.body
        finally:
            self.body = outer

    def loop(self, body: Sequence[ir.Statement], *, cols: bool = False, halo: int = 0) -> None:
        """Write a loop over cells."""
        if body:
            over = ir.grid(*self.shape, halo, body) if cols else ir.sweep(CELL, self.cells, body)
            self.body.append(over)


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
        at, seen = (item(table.name, CELL, table.bounds) for table in (to_name, from_name))
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
        halo, kind = self.halo, self.boundary.pad_mode
        names = f"rim_{halo}", f"rim_{kind}_{halo}"
        places, seen = rim_copies(self.boundary, self.to.shape, halo)
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
    precision = to.formats.precision
    wider = precision.stored(size)
    # a memory's bits stay so many; a fixed fraction leaves no room for the rim: as many, too
    short = like.bits <= precision.container and abs(edge) <= wider.largest * wider.step
    return wider if short else precision.kept(size), False


EXPORTED = (Decay, Propagator, Spectral, Circulant, FixedSteps)
METHODS = ("auto", "euler")


def solvers_for(schedule: Schedule, method: str = "auto") -> dict[int, Solver]:
    """Return how each transient runs, by the index of its node.

    Uncoupled cells, and equilibria that are one product, are exact by any method.
    """
    result = dict[int, Solver]()
    for node in schedule.transients:
        operation = node.operation
        assert isinstance(operation, Transient)
        spec = replace(operation.spec, method=method)
        ends = only_output_matters(node, everything(schedule.nodes))
        result[node.index] = whole_solver(replace(operation, spec=spec), schedule.shape, ends=ends)
    return result


def whole_solver(transient: Transient, shape: Shape, *, ends: bool = False) -> Solver:
    """Return how a transient runs in whole numbers, by the method of its specification.

    If only where it `ends` matters, an output may be taken without its state.
    """
    method = transient.spec.method
    exact = _exact(transient, shape)
    if ends and method in ("auto", "propagator") and isinstance(exact.scheme, Separate):
        end = in_one_sum(exact)
        if end is not exact:
            return end
    steps = method not in ("auto", "propagator") or not isinstance(exact.scheme, EXPORTED)
    if isinstance(exact.scheme, FixedSteps) and exact.scheme.tableau != EULER:
        steps = True  # those of Heun's method, which "auto" takes for a delay
    uncoupled = isinstance(exact.scheme, Decay)
    settled = exact.settle and isinstance(exact.scheme, Propagator | Spectral | Circulant)
    if uncoupled or settled or not steps:
        return exact
    explicit = "euler" if method == "auto" else method
    return choose(replace(transient, spec=replace(transient.spec, method=explicit)), shape)


def _exact(transient: Transient, shape: Shape) -> Solver:
    """Return the method that "auto" takes; on a torus the equilibrium as a product of shifts."""
    solver = choose(replace(transient, spec=replace(transient.spec, method="auto")), shape)
    if (
        not solver.settle
        or transient.has_mask
        or isinstance(solver.scheme, Decay | Spectral | Circulant)
    ):
        return solver
    around = circulant(Network(transient.template, shape))
    if around is None:
        return solver
    return replace(solver, method="propagator", reason=SHIFTS, scheme=around)
