"""Runs the statements of a program in NumPy, for a batch of frames: exact 64-bit whole numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.embedded.ir.expressions import Expression, Item, Name, Real, Whole
from cnnum.embedded.ir.primitives import PRIMITIVES
from cnnum.embedded.ir.statements import (
    Cells,
    Fold,
    IntegerProgram,
    Let,
    Repeat,
    Rounds,
    Set,
    Statement,
    Store,
    Total,
)

Numbers = NDArray[Any]
_FOLDS: dict[str, Any] = {"add": np.sum, "maximum": np.max, "minimum": np.min}
_PAIRS: dict[str, Any] = {"add": np.add, "maximum": np.maximum, "minimum": np.minimum}


def cleared(program: IntegerProgram, batch: int) -> dict[str, Numbers]:
    """Return the state before the first frame, (batch, length) each."""
    dtype = _dtype(program)
    return {
        one.name: np.zeros((batch, max(1, one.length)), np.int64 if one.logic else dtype)
        for one in program.of_kind("state")
    }


def _dtype(program: IntegerProgram) -> np.dtype[Any]:
    real = any(one.format is None and not one.logic for one in program.arrays.values())
    return np.dtype(np.float64 if real else np.int64)


@dataclass(slots=True, eq=False)
class Emulator:
    """One frame of a batch.

    Attributes
    ----------
    program : IntegerProgram
    single : bool
        Whether reals are rounded to single precision after every operation.
    sizes : dict of str to float or None
        Where the largest magnitude of every variable and array is noted.
    """

    program: IntegerProgram
    single: bool = False
    sizes: dict[str, float] | None = None
    _values: dict[str, Numbers] = field(default_factory=dict[str, Numbers])
    _running: Numbers | None = None

    def run(
        self, inputs: Mapping[str, Numbers], state: dict[str, Numbers], *, first: bool
    ) -> dict[str, Numbers]:
        """Run a frame and bring the state up to date.

        Parameters
        ----------
        inputs : mapping of str to (batch, cells) int or float
        state : mapping of str to (batch, length) int or float
        first : bool

        Returns
        -------
        dict of str to (batch, length) int or float
            By the arrays of the outputs.
        """
        batch = len(next(iter(inputs.values()))) if inputs else 1
        values: dict[str, Numbers] = {"first": np.full((batch, 1), int(first))}
        dtype = _dtype(self.program)
        for one in self.program.arrays.values():
            if one.kind == "table":
                assert one.values is not None
                whole = np.int64 if one.format is not None or one.logic else dtype
                values[one.name] = self._rounded(np.asarray(one.values, dtype=whole))
            elif one.kind in ("work", "output"):
                kind = np.dtype(np.int64) if one.logic else dtype
                zeros: Numbers = np.zeros((batch, max(1, one.length)), kind)
                values[one.name] = zeros
        values |= {name: self._rounded(np.asarray(given)) for name, given in inputs.items()}
        values |= state
        self._values = values
        with np.errstate(all="ignore"):
            self._block(self.program.body)
        for name in state:
            state[name] = values[name]
        return {one.name: values[one.name] for one in self.program.of_kind("output")}

    def _rounded(self, value: Numbers) -> Numbers:
        if self.single and value.dtype == np.float64:
            return value.astype(np.float32).astype(np.float64)
        return value

    def _block(self, body: tuple[Statement, ...]) -> None:
        for statement in body:
            _RUN[type(statement)](self, statement)

    def value(self, expression: Expression) -> Numbers:
        """Return the value of an expression, (batch or 1, 1 or cells)."""
        if isinstance(expression, Whole | Real):
            return np.asarray(expression.value)
        if isinstance(expression, Name):
            return self._values[expression.text]
        if isinstance(expression, Item):
            at = np.atleast_1d(self.value(expression.at))
            return np.take(self._values[expression.array], at, axis=-1)
        arguments = [self.value(one) for one in expression.arguments]
        found = PRIMITIVES[expression.primitive].numpy(*arguments, *expression.parameters)
        return self._rounded(np.asarray(found))

    def _note(self, name: str, value: Numbers) -> None:
        if self.sizes is not None:
            size = float(np.abs(value).max(initial=0.0))
            self.sizes[name] = max(size, self.sizes.get(name, 0.0))

    def let(self, statement: Let) -> None:
        """Make a variable."""
        self._values[statement.name] = self.value(statement.value)
        self._note(statement.name, self._values[statement.name])

    def set(self, statement: Set) -> None:
        """Set a number of the state, of the outputs, or a variable."""
        new = self.value(statement.value)
        old = self._values.get(statement.name, new)
        if self._running is not None:
            new = np.where(self._running, new, old)
        # numbers of the state are (batch, 1)
        self._values[statement.name] = np.broadcast_to(
            new, np.broadcast_shapes(new.shape, old.shape)
        )
        self._note(statement.name, new)

    def store(self, statement: Store) -> None:
        """Store numbers of an array."""
        array, at = self._values[statement.array], np.atleast_1d(self.value(statement.at))
        new = self.value(statement.value)
        if self._running is not None:
            new = np.where(self._running, new, array[:, at])
        array = array.copy() if not array.flags.writeable else array
        array[:, at] = new
        self._values[statement.array] = array
        self._note(statement.array, new)

    def fold(self, statement: Fold) -> None:
        """Take in a value of each cell."""
        value, count = self.value(statement.value), self._values["i"].size
        whole = np.broadcast_to(value, np.broadcast_shapes(value.shape, (1, count)))
        folded = _FOLDS[statement.how](whole, axis=-1, keepdims=True)
        before = self._values[statement.name]
        self._values[statement.name] = _PAIRS[statement.how](before, folded)
        self._note(statement.name, self._values[statement.name])

    def total(self, statement: Total) -> None:
        """Add terms up."""
        total: Numbers = np.asarray(0)
        for number in range(statement.count):
            self._values[statement.variable] = np.asarray(number)
            total = self._rounded(np.asarray(total + self.value(statement.term)))
        self._values[statement.name] = total
        self._note(statement.name, total)

    def cells(self, statement: Cells) -> None:
        """Run a loop over cells, all at once."""
        i = np.arange(statement.count)
        self._values["i"] = i
        if statement.cols:
            rows, cols = np.divmod(i, statement.cols)
            width, halo = statement.cols + 2 * statement.halo, statement.halo
            self._values |= {"r": rows, "c": cols, "p": (rows + halo) * width + cols + halo}
        self._block(statement.body)

    def repeat(self, statement: Repeat) -> None:
        """Run rounds one after the other."""
        for _ in range(statement.count):
            self._block(statement.body)

    def rounds(self, statement: Rounds) -> None:
        """Run rounds while a flag holds; frames that have stopped keep their values."""
        outer = self._running
        for _ in range(statement.limit):
            running = self._values[statement.running] != 0
            now: Numbers = running if outer is None else running & outer
            if not now.any():
                break
            self._running = now
            self._block(statement.body)
        self._running = outer


_RUN: dict[type, Any] = {
    Let: Emulator.let,
    Set: Emulator.set,
    Store: Emulator.store,
    Fold: Emulator.fold,
    Total: Emulator.total,
    Cells: Emulator.cells,
    Repeat: Emulator.repeat,
    Rounds: Emulator.rounds,
}
