"""Runs the statements of a program in NumPy, for a batch of frames: exact 64-bit whole numbers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.embedded.arithmetic import BY_SIGN, PRIMITIVES
from cnnum.embedded.program import IntegerProgram

Numbers = NDArray[Any]
_FOLDS: dict[str, Any] = {"+": np.sum, "maximum": np.max, "minimum": np.min}
_PAIRS: dict[str, Any] = {"+": np.add, "maximum": np.maximum, "minimum": np.minimum}


def cleared(program: IntegerProgram, batch: int) -> dict[str, Numbers]:
    """Return the state before the first frame, (batch, length) each."""
    dtype = _dtype(program)
    return {
        array.name: np.zeros((batch, max(1, array.length)), np.int64 if array.logic else dtype)
        for array in program.of_kind("state")
    }


def _dtype(program: IntegerProgram) -> np.dtype[Any]:
    return np.dtype(np.float64 if program.real else np.int64)


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
    values : dict of str to (batch or 1, 1 or cells) int or float
        Variables and arrays after a frame.
    """

    program: IntegerProgram
    single: bool = False
    sizes: dict[str, float] | None = None
    values: dict[str, Numbers] = field(default_factory=dict[str, Numbers])
    _running: Numbers | None = None
    _cells: int = 1

    def run(
        self,
        inputs: Mapping[str, Numbers],
        state: dict[str, Numbers],
        *,
        first: bool,
        batch: int = 1,
    ) -> dict[str, Numbers]:
        """Run a frame and update the state.

        Parameters
        ----------
        inputs : mapping of str to (batch, cells) int or float
        state : mapping of str to (batch, length) int or float
        first : bool
        batch : int
            Number of streams, for a program that reads no channel and has no memory.

        Returns
        -------
        dict of str to (batch, length) int or float
            Values by output array.
        """
        batch = max([batch, *(len(numbers) for numbers in (*inputs.values(), *state.values()))])
        values: dict[str, Numbers] = {"first": np.full((batch, 1), int(first))}
        dtype = _dtype(self.program)
        for array in self.program.arrays.values():
            if array.kind == "table":
                assert array.values is not None
                whole = np.int64 if array.format is not None or array.logic else dtype
                values[array.name] = self.table(array.name, np.asarray(array.values, dtype=whole))
            elif array.kind in ("work", "output"):
                kind = np.dtype(np.int64) if array.logic else dtype
                zeros: Numbers = np.zeros((batch, max(1, array.length)), kind)
                values[array.name] = zeros
        values |= {name: self._rounded(np.asarray(given)) for name, given in inputs.items()}
        values |= state
        self.values = values
        with np.errstate(all="ignore"):
            self._block(self.program.body)
        for name in state:
            state[name] = values[name]
        return {output.name: values[output.name] for output in self.program.of_kind("output")}

    def _rounded(self, value: Numbers) -> Numbers:
        if self.single and value.dtype == np.float64:
            return value.astype(np.float32).astype(np.float64)
        return value

    def _block(self, body: tuple[ir.Statement, ...]) -> None:
        for statement in body:
            _RUN[type(statement)](self, statement)

    def value(self, expression: ir.Expression) -> Numbers:
        """Return the value of an expression, (batch or 1, 1 or cells)."""
        result: Numbers = _VALUES[type(expression)](self, expression)
        return result

    def table(self, name: str, values: Numbers) -> Numbers:
        """Return the numbers of a table."""
        del name
        return self._rounded(values)

    def literal(self, record: ir.Integer | ir.Number) -> Numbers:
        """Return a literal."""
        return self._rounded(np.asarray(record.value))

    def name(self, record: ir.Name) -> Numbers:
        """Return a variable."""
        return self.values[record.text]

    def element(self, record: ir.Element) -> Numbers:
        """Return array elements."""
        at = np.atleast_1d(self.value(record.at))
        return np.take(self.values[record.array.text], at, axis=-1)

    def call(self, record: ir.Call) -> Numbers:
        """Return the result of a function."""
        return self._applied(PRIMITIVES[record.function].numpy, *record.arguments)

    def binary(self, record: ir.Binary) -> Numbers:
        """Return the result of a binary operator."""
        return self._applied(BY_SIGN[record.sign].numpy, record.left, record.right)

    def negative(self, record: ir.Negative) -> Numbers:
        """Return a number with the other sign."""
        return self._applied(np.negative, record.value)

    def choice(self, record: ir.Choice) -> Numbers:
        """Return one of two."""
        return self._applied(PRIMITIVES["pick"].numpy, record.condition, record.yes, record.no)

    def cast(self, record: ir.Cast) -> Numbers:
        """Return whole numbers as real ones."""
        return self._applied(PRIMITIVES["to_real"].numpy, record.value)

    def _applied(self, function: Callable[..., Any], *operands: ir.Expression) -> Numbers:
        return self._rounded(np.asarray(function(*map(self.value, operands))))

    def _note(self, name: str, value: Numbers) -> None:
        if self.sizes is not None:
            size = float(np.abs(value).max(initial=0.0))
            self.sizes[name] = max(size, self.sizes.get(name, 0.0))

    def declare(self, statement: ir.Declare) -> None:
        """Make variables."""
        for name, value in statement.variables:
            assert value is not None
            self.values[name.text] = self.value(value)
            if statement.type == "real":
                self._note(name.text, self.values[name.text])

    def assign(self, statement: ir.Assign) -> None:
        """Set, or change, a variable or numbers of an array."""
        target, new = statement.target, self.value(statement.value)
        if isinstance(target, ir.Element):
            self._store(target, new)
            return
        old = self.values.get(target.text, new)
        if statement.sign == "+=":
            new = self._rounded(np.asarray(old + new))
        if self._running is not None:
            new = np.where(self._running, new, old)
        # numbers of the state are (batch, 1)
        self.values[target.text] = np.broadcast_to(new, np.broadcast_shapes(new.shape, old.shape))
        self._note(target.text, new)

    def _store(self, target: ir.Element, new: Numbers) -> None:
        """Store array elements."""
        name = target.array.text
        array, at = self.values[name], np.atleast_1d(self.value(target.at))
        if self._running is not None:
            new = np.where(self._running, new, array[:, at])
        array = array.copy() if not array.flags.writeable else array
        array[:, at] = new
        self.values[name] = array
        self._note(name, new)

    def accumulate(self, statement: ir.Accumulate) -> None:
        """Take in a value of each cell."""
        name, value = statement.target.text, self.value(statement.value)
        whole = np.broadcast_to(value, np.broadcast_shapes(value.shape, (1, self._cells)))
        if self.single and statement.how == "+" and whole.dtype == np.float64:
            # one after the other, each rounded, as in the loop over cells
            before = np.broadcast_to(self.values[name], (*whole.shape[:-1], 1))
            whole = np.concatenate([before, whole], axis=-1)
            added = np.add.accumulate(whole.astype(np.float32), axis=-1)
            self.values[name] = added[..., -1:].astype(np.float64)
        else:
            folded = _FOLDS[statement.how](whole, axis=-1, keepdims=True)
            self.values[name] = _PAIRS[statement.how](self.values[name], folded)
        self._note(name, self.values[name])

    def loop(self, statement: ir.Loop) -> None:
        """Run a loop that accumulates terms; only the sums are recorded."""
        sizes, self.sizes = self.sizes, None
        assert isinstance(statement.start, int)
        assert isinstance(statement.end, int)
        for number in range(statement.start, statement.end, statement.step):
            self.values[statement.variable.text] = np.asarray(number)
            self._block(statement.body)
        self.sizes = sizes
        for name in added_in(statement):
            self._note(name, self.values[name])

    def sweep(self, statement: ir.Sweep) -> None:
        """Run a loop over cells, or over rows of cells, all at once."""
        count, body, name = statement.count, statement.body, statement.variable.text
        inner = body[0]
        if isinstance(inner, ir.Sweep):
            rows, cols = np.divmod(np.arange(count * inner.count), inner.count)
            self.values |= {name: rows, inner.variable.text: cols}
            count, body = count * inner.count, inner.body
        else:
            self.values[name] = np.arange(count)
        self._cells = count
        self._block(body)

    def counted(self, statement: ir.Counted) -> None:
        """Iterate while a flag holds; frames that have stopped keep their values."""
        assert isinstance(statement.end, int)
        outer, flag = self._running, statement.running
        for number in range(statement.start, statement.end):
            self.values[statement.variable.text] = np.asarray(number)
            if flag is not None:
                running = self.values[flag.text] != 0
                now: Numbers = running if outer is None else running & outer
                if not now.any():
                    break
                self._running = now
            self._block(statement.body)
        self._running = outer


def added_in(loop: ir.Loop) -> set[str]:
    """Return the sums of a loop, and of loops within it."""
    result = set[str]()
    for statement in loop.body:
        if isinstance(statement, ir.Loop):
            result |= added_in(statement)
        elif isinstance(statement, ir.Assign) and isinstance(statement.target, ir.Name):
            result.add(statement.target.text)
    return result


_VALUES: dict[type, Any] = {
    ir.Integer: Emulator.literal,
    ir.Number: Emulator.literal,
    ir.Name: Emulator.name,
    ir.Element: Emulator.element,
    ir.Call: Emulator.call,
    ir.Binary: Emulator.binary,
    ir.Negative: Emulator.negative,
    ir.Choice: Emulator.choice,
    ir.Cast: Emulator.cast,
}
_RUN: dict[type, Any] = {
    ir.Declare: Emulator.declare,
    ir.Assign: Emulator.assign,
    ir.Accumulate: Emulator.accumulate,
    ir.Loop: Emulator.loop,
    ir.Sweep: Emulator.sweep,
    ir.Counted: Emulator.counted,
}
