"""The store that lowering writes into: arrays, statements of a frame, known quantities."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cnnum import kernels as ir
from cnnum.arrays import Shape
from cnnum.embedded.arithmetic.elements import Arithmetic
from cnnum.embedded.arithmetic.fixed import Fixed, Quantity, nearest
from cnnum.embedded.arithmetic.whole import call, item, limited
from cnnum.embedded.formats import Format
from cnnum.embedded.program import Array, Kind
from cnnum.embedded.sizes import Formats

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
        Of variables.
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
        """Whether it is of whole numbers."""
        return isinstance(self.arithmetic, Fixed)

    def array(
        self,
        name: str,
        kind: Kind,
        length: int,
        format: Format | None,
        about: str = "",
        *,
        logic: bool = False,
    ) -> Array:
        """Return a new array."""
        made = Array(name, kind, length, None if logic else format, about, logic=logic)
        self.arrays[name] = made
        return made

    def table(self, name: str, values: ArrayLike, about: str = "") -> tuple[Array, int]:
        """Return a table of constants, and the fraction of its numbers."""
        flat = np.asarray(values, dtype=np.float64).ravel()
        if not isinstance(self.arithmetic, Fixed):
            made = Array(name, "table", flat.size, None, about, flat)
            self.arrays[name] = made
            return made, 0
        found, fraction = self.arithmetic.weights(flat.tolist())
        whole = np.asarray(found, dtype=np.int64)
        exact = bool(np.all(np.ldexp(whole.astype(np.float64), -fraction) == flat))
        return self._table(name, whole, fraction, about, exact=exact), fraction

    def places(self, name: str, values: ArrayLike, about: str = "") -> Array:
        """Return a table of whole numbers: places in an array."""
        flat = np.asarray(values, dtype=np.int64).ravel()
        return self._table(name, flat, 0, about, places=True, exact=True)

    def _table(
        self,
        name: str,
        values: Any,
        fraction: int,
        about: str,
        *,
        places: bool = False,
        exact: bool = False,
    ) -> Array:
        most = int(np.abs(values).max(initial=0))
        bits = next(bits for bits in (8, 16, 32) if most < 1 << (bits - 1))
        form = Format(bits, fraction)
        made = Array(name, "table", values.size, form, about, values, places=places, exact=exact)
        self.arrays[name] = made
        return made

    def item(self, array: Array, at: ir.Expression = CELL) -> Quantity:
        """Return a number of an array."""
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

    def let(self, name: str, one: Quantity) -> Quantity:
        """Return a quantity by a new name."""
        made = ir.Name(name, one.value.bounds)
        self.body.append(ir.fixed(made, one.value))
        self.fractions[name] = one.fraction
        return Quantity(made, one.fraction)

    def stored(self, one: Quantity, array: Array) -> ir.Expression:
        """Return the expression that an array holds for a quantity."""
        if array.logic:
            return one.value if one.exact is None else ir.Integer(int(one.exact != 0))
        if not isinstance(self.arithmetic, Fixed):
            # logic values are whole numbers, in reals too
            return one.value if one.value.bounds is None else call("to_real", one.value)
        assert array.format is not None
        return self.arithmetic.stored(one, array.format)

    def store(self, array: Array, one: Quantity, at: ir.Expression = CELL) -> None:
        """Store a quantity in an array."""
        self.body.append(self.store_to(array, self.stored(one, array), at))

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

        found = nearest(Fraction(value) * Fraction(2) ** array.format.fraction)
        return ir.Integer(max(array.format.least, min(array.format.largest, found)))

    @contextmanager
    def within(self) -> Generator[list[ir.Statement]]:
        """Let statements go into the body of a loop, which is written later."""
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
