"""The printer of LLVM intermediate code: one function that runs frames in sequence.

No operations are contracted or reordered, so that processors differ only where the functions of
their C libraries do. Whole numbers have 64 bits. Arrays lie in scratch that the caller hands over,
where later ones take the places of those whose blocks have ended.
"""

from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum import kernels as ir
from cnnum.kernels.expressions import operand
from cnnum.kernels.statements import uses

_LLVM: Any = import_module("llvmlite.ir")  # it has no types

INT, DOUBLE = _LLVM.IntType(64), _LLVM.DoubleType()

SCRATCH, INNER_SCRATCH = " scratch", " inner scratch"

BUFFERS = ("input", "output", "memory", "data", SCRATCH, INNER_SCRATCH)
"""The function's first parameters: the buffers of a plan, and scratch for its own arrays and for
those of the functions that it calls. Then come the numbers of the first frame and of the one after
the last, and whether they are the first of their streams."""

TOP = 2
"""Depth of a frame's statements: within the function, and within its loop over frames."""

Value = Any
"""A value of the code, with its `type`."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable, or an array, by the address of its first number."""

    address: Value
    element: Any
    array: bool


@dataclass(slots=True)
class Function:
    """A function while it is written.

    Attributes
    ----------
    body, entry : IRBuilder
        Where instructions come, and where variables are reserved.
    scopes : list of dict
        The meanings of names, by block, the outermost first.
    arrays : list of list of (int, Value)
        Lengths and addresses of the arrays of each block.
    free : dict of int to list of Value
        Addresses by length, whose arrays have ended.
    inner : bool
        Whether another function of the module calls it.
    used : int
        Numbers of scratch.
    """

    body: Any
    entry: Any
    scopes: list[dict[str, Any]]
    arrays: list[list[tuple[int, Value]]]
    inner: bool
    free: dict[int, list[Value]] = field(default_factory=dict[int, list[Value]])
    used: int = 0


@dataclass(slots=True)
class LLVMPrinter:
    """Writes the statements of a frame as a module.

    Attributes
    ----------
    dtype : dtype
        Data type of the kernel's numbers.
    tables : mapping of str to (n,) int
        Constant whole numbers, by name.
    scratch : list of int
        Numbers of both kinds of scratch that the function takes.
    """

    dtype: np.dtype[np.floating]
    tables: Mapping[str, NDArray[np.int64]]
    scratch: list[int] = field(default_factory=lambda: [0, 0])
    _module: Any = field(init=False)
    _real: Any = field(init=False)
    _now: Function = field(init=False)

    def function(self, name: str, body: Iterable[ir.Statement]) -> str:
        """Return the text of a module with the function of that name."""
        self._module = _LLVM.Module(name)
        self._real = _LLVM.FloatType() if self.dtype == np.float32 else DOUBLE
        buffers = [self._real.as_pointer()] * len(BUFFERS)
        made = self._new(name, [*buffers, INT, INT, INT])
        names: dict[str, Any] = {n: self._constants(n, held) for n, held in self.tables.items()}
        for buffer, argument in zip(BUFFERS, made.args, strict=False):
            argument.add_attribute("noalias")
            names[buffer] = Variable(argument, self._real, True)
        begin, end, first = made.args[len(BUFFERS) :]
        with self._written(made, names, depth=1):
            self._bind("first", self._now.body.sitofp(first, self._real))
            self._bind("last", end)
            with self._counting("frame", begin, end):
                self._reserve("unfinished", self._real, self._literal(0.0))
                self.statements(body)
        return str(self._module)

    def _new(self, name: str, parameters: list[Any]) -> Any:
        kind = _LLVM.FunctionType(_LLVM.VoidType(), parameters)
        return _LLVM.Function(self._module, kind, name)

    def _constants(self, name: str, values: NDArray[np.int64]) -> Variable:
        kind = _LLVM.ArrayType(INT, len(values))
        made = _LLVM.GlobalVariable(self._module, kind, name)
        made.linkage, made.global_constant = "internal", True
        made.initializer = _LLVM.Constant(kind, values.tolist())
        return Variable(made.gep([INT(0), INT(0)]), INT, True)

    @contextmanager
    def _written(self, made: Any, names: dict[str, Any], depth: int) -> Generator[None]:
        """Write the code of the block into a function."""
        entry, body = (_LLVM.IRBuilder(made.append_basic_block()) for _ in range(2))
        outer = getattr(self, "_now", None)
        scopes, arrays = [names, {}], [list[tuple[int, Value]]() for _ in range(depth)]
        self._now = Function(body, entry, scopes, arrays, inner=outer is not None)
        yield
        self._now.body.ret_void()
        entry.branch(made.basic_blocks[1])
        if outer is not None:
            self._now = outer

    # names

    def _bind(self, name: str, value: Any) -> None:
        self._now.scopes[-1][name] = value

    def _named(self, name: str) -> Any:
        return next(scope[name] for scope in reversed(self._now.scopes) if name in scope)

    def _reserve(self, name: str, kind: Any, value: Value | None) -> None:
        """Reserve a variable, whose name is known from now on."""
        address = self._now.entry.alloca(kind)
        if value is not None:
            self._now.body.store(value, address)
        self._bind(name, Variable(address, kind, False))

    @contextmanager
    def _block(self) -> Generator[None]:
        """Open a scope for names and arrays."""
        self._now.scopes.append({})
        self._now.arrays.append([])
        yield
        for length, array in self._now.arrays.pop():
            self._now.free.setdefault(length, []).append(array)
        self._now.scopes.pop()

    # statements

    def statements(self, statements: Iterable[ir.Statement]) -> None:
        """Append statements."""
        for statement in statements:
            getattr(self, _WRITERS[type(statement)])(statement)

    def note(self, note: ir.Note) -> None:
        """Leave a comment out."""

    def declare(self, new: ir.Declare) -> None:
        """Append new variables; those that nothing assigns to are values."""
        kind = INT if new.type == "int" else self._real
        for name, value in new.variables:
            begun = None if value is None else self._as(kind, self.value(value))
            if new.fixed:
                self._bind(name.text, begun)
            else:
                self._reserve(name.text, kind, begun)

    def array(self, array: ir.Array) -> None:
        """Give an array its place in scratch."""
        now, length = self._now, array.length
        if now.free.get(length):
            address = now.free[length].pop()
        else:
            base = self._named(INNER_SCRATCH if now.inner else SCRATCH).address
            address = now.entry.gep(base, [INT(now.used)], inbounds=True)
            now.used += length
            self.scratch[now.inner] = max(self.scratch[now.inner], now.used)
        now.arrays[-1].append((length, address))
        self._bind(array.name.text, Variable(address, self._real, True))

    def alias(self, alias: ir.Alias) -> None:
        """Append another name of an array."""
        place = self._address(ir.Element(alias.array, operand(alias.start)))
        if alias.fixed:
            self._bind(alias.name.text, Variable(place, self._real, True))
        else:
            self._reserve(alias.name.text, self._real.as_pointer(), place)

    def swap(self, swap: ir.Swap) -> None:
        """Append a swap of two aliases."""
        places = [self._named(name.text).address for name in (swap.first, swap.second)]
        first, other = (self._now.body.load(place) for place in places)
        self._now.body.store(other, places[0])
        self._now.body.store(first, places[1])

    def assign(self, assign: ir.Assign) -> None:
        """Append an assignment."""
        value = self.value(assign.value)
        if isinstance(assign.target, ir.Element):
            address, kind = self._address(assign.target), self._real
        else:
            variable = self._named(assign.target.text)
            address, kind = variable.address, variable.element
        value = self._as(kind, value)
        if assign.sign != "=":
            value = self._arithmetic(assign.sign[0], self._now.body.load(address), value)
        self._now.body.store(value, address)

    def accumulate(self, taken: ir.Accumulate) -> None:
        """Append an accumulation into a variable."""
        value: ir.Expression = ir.call(taken.how, taken.target, taken.value)
        if taken.how == "+":
            value = taken.target + taken.value
        self.assign(ir.Assign(taken.target, value))

    def do(self, do: ir.Do) -> None:
        """Append that a buffer takes in a number of the frame."""
        assert do.call.function == "scatter"
        place, _, _, stride, value = do.call.arguments
        self._now.body.store(self._as(self._real, self.value(value)), self._far(place, stride))

    def block(self, block: ir.Block) -> None:
        """Append a block: one of a frame, such as a template, is a function of its own.

        Compilers take more than twice as long for a function that is twice as long.
        """
        if len(self._now.arrays) <= TOP and not self._now.inner:
            self._apart(block)
            return
        with self._block():
            self.statements(block.body)

    def _apart(self, block: ir.Block) -> None:
        used = uses((block,))
        changed = {*used.taken_in, *used.changed}
        inner = self._named(INNER_SCRATCH)
        given, places = [inner.address], dict[str, Variable | None]({INNER_SCRATCH: inner})
        for name in used.names:
            if name in self.tables:
                continue
            variable = self._named(name)
            by_address = isinstance(variable, Variable) and (variable.array or name in changed)
            given.append(variable.address if by_address else self.name(ir.Name(name)))
            places[name] = variable if by_address else None
        number = len(self._module.functions)
        made = self._new(f"{self._module.name}_{number}", [value.type for value in given])
        made.linkage = "internal"
        made.attributes.add("noinline")
        self._now.body.call(made, given)
        names = {table: self._named(table) for table in self.tables}
        for (name, place), argument in zip(places.items(), made.args, strict=True):
            names[name] = argument
            if place is not None:
                argument.add_attribute("noalias")
                names[name] = Variable(argument, place.element, place.array)
        with self._written(made, names, depth=TOP + 1):
            self.statements(block.body)

    def branch(self, branch: ir.Branch) -> None:
        """Append a branch."""
        with self._now.body.if_then(self.value(branch.condition)), self._block():
            self.statements(branch.body)

    def sweep(self, sweep: ir.Sweep) -> None:
        """Append a sweep as a loop."""
        with self._counting(sweep.variable.text, INT(0), INT(sweep.count)):
            self.statements(sweep.body)

    def loop(self, loop: ir.Loop) -> None:
        """Append a loop over numbers."""
        start, end = (self.value(operand(bound)) for bound in (loop.start, loop.end))
        with self._counting(loop.variable.text, start, end, loop.step):
            self.statements(loop.body)

    def counted(self, rounds: ir.Counted) -> None:
        """Append a counted loop."""
        start, end = INT(rounds.start), self.value(operand(rounds.end))
        with self._counting(rounds.variable.text, start, end, 1, rounds.running):
            self.statements(rounds.body)

    def during(self, rounds: ir.While) -> None:
        """Append a loop that runs while a condition holds."""
        head, body, after = (self._now.body.append_basic_block() for _ in range(3))
        self._now.body.branch(head)
        self._now.body.position_at_end(head)
        self._now.body.cbranch(self.value(rounds.condition), body, after)
        self._now.body.position_at_end(body)
        with self._block():
            self.statements(rounds.body)
        self._now.body.branch(head)
        self._now.body.position_at_end(after)

    @contextmanager
    def _counting(
        self, name: str, start: Value, end: Value, step: int = 1, running: ir.Name | None = None
    ) -> Generator[None]:
        """Let what comes run for every number, as long as a variable is not 0."""
        at, before = self._now.body, self._now.body.block
        head, body, after = (at.append_basic_block() for _ in range(3))
        at.branch(head)
        at.position_at_end(head)
        number = at.phi(INT)
        number.add_incoming(start, before)
        goes_on = at.icmp_signed("<", number, end)
        if running is not None:
            goes_on = at.and_(goes_on, self.value(running.differs(ir.ZERO)))
        at.cbranch(goes_on, body, after)
        at.position_at_end(body)
        with self._block():
            self._bind(name, number)
            yield
        number.add_incoming(at.add(number, INT(step), flags=["nsw"]), at.block)
        at.branch(head)
        at.position_at_end(after)

    # expressions

    def value(self, expression: ir.Expression) -> Value:
        """Return the value of an expression."""
        return getattr(self, _WRITERS[type(expression)])(expression)

    def _literal(self, value: float) -> Value:
        with np.errstate(over="ignore"):
            return _LLVM.Constant(self._real, float(self.dtype.type(value)))

    def _as(self, kind: Any, value: Value) -> Value:
        """Return a value as one of another type."""
        if value.type == kind:
            return value
        if isinstance(value, _LLVM.Constant) and kind == self._real:
            return self._literal(value.constant)
        at = self._now.body
        return at.sitofp(value, kind) if kind == self._real else at.fptosi(value, kind)

    def _alike(self, value: Value, other: Value) -> tuple[Value, Value]:
        """Return two values of one type: real numbers, unless both are whole."""
        if value.type == other.type:
            return value, other
        return self._as(self._real, value), self._as(self._real, other)

    def name(self, name: ir.Name) -> Value:
        """Return the value of a variable."""
        result = self._named(name.text)
        return self._now.body.load(result.address) if isinstance(result, Variable) else result

    def constant(self, word: ir.Constant) -> Value:
        """Return a word's number."""
        words = {"ZERO": 0.0, "ONE": 1.0, "HUGE": float(np.finfo(self.dtype).max)}
        result = words.get(word.text)
        return self._literal(float(word.text.removesuffix("f")) if result is None else result)

    def integer(self, number: ir.Integer) -> Value:
        """Return a whole number."""
        return INT(number.value)

    def number(self, number: ir.Number) -> Value:
        """Return a number of the kernel's type."""
        return self._literal(number.value)

    def element(self, element: ir.Element) -> Value:
        """Return an array element."""
        return self._now.body.load(self._address(element))

    def _address(self, element: ir.Element) -> Value:
        variable, at = self._named(element.array.text), self._now.body
        start = variable.address if variable.array else at.load(variable.address)
        return at.gep(start, [self.value(element.at)], inbounds=True)

    def _far(self, place: ir.Expression, stride: ir.Expression) -> Value:
        """Return the address of a frame's number; its place in the first one is a buffer's sum."""
        base = place
        while isinstance(base, ir.Binary):
            base = base.left
        assert isinstance(base, ir.Name)
        at = ir.Binary("+", ir.Name("frame") * stride, _without(place, base))
        return self._address(ir.Element(base, at))

    def binary(self, both: ir.Binary) -> Value:
        """Return the result of a binary operator."""
        at, (left, right) = self._now.body, (self.value(both.left), self.value(both.right))
        if both.sign in ("&&", "||"):
            return (at.and_ if both.sign == "&&" else at.or_)(left, right)
        left, right = self._alike(left, right)
        if both.sign not in ("<", "<=", ">", ">=", "==", "!="):
            return self._arithmetic(both.sign, left, right)
        if left.type == INT:
            return at.icmp_signed(both.sign, left, right)
        # what is not a number differs from every number
        compare = at.fcmp_unordered if both.sign == "!=" else at.fcmp_ordered
        return compare(both.sign, left, right)

    def _arithmetic(self, sign: str, left: Value, right: Value) -> Value:
        at = self._now.body
        if left.type != INT:
            signs = {"+": at.fadd, "-": at.fsub, "*": at.fmul, "/": at.fdiv}
            return signs[sign](left, right)
        if sign == "+" and isinstance(left, _LLVM.Constant) and left.constant == 0:
            return right
        if sign == "%":
            return at.srem(left, right)
        signs = {"+": at.add, "-": at.sub, "*": at.mul}
        return signs[sign](left, right, flags=["nsw"])

    def negative(self, negative: ir.Negative) -> Value:
        """Return an operand with the other sign."""
        value, at = self.value(negative.value), self._now.body
        return at.neg(value) if value.type == INT else at.fneg(value)

    def cast(self, cast: ir.Cast) -> Value:
        """Return a value as a number of the kernel's type; whole numbers have one type."""
        value = self.value(cast.value)
        return self._as(self._real, value) if cast.type in ("real", "scalar") else value

    def choice(self, choice: ir.Choice) -> Value:
        """Return one of two."""
        yes, no = self._alike(self.value(choice.yes), self.value(choice.no))
        return self._now.body.select(self.value(choice.condition), yes, no)

    def call(self, call: ir.Call) -> Value:
        """Return the result of a function."""
        if call.function == "gather":
            place, _, _, stride = call.arguments
            return self._now.body.load(self._far(place, stride))
        if call.function == "PICK":
            condition, yes, no = call.arguments
            return self.choice(ir.Choice(condition, yes, no))
        values = [self.value(argument) for argument in call.arguments]
        if call.function == "max":  # of whole numbers
            first, other = values
            return self._now.body.select(
                self._now.body.icmp_signed("<", first, other), other, first
            )
        numbers = [self._as(self._real, value) for value in values]
        own: Callable[..., Value] | None = getattr(self, _OWN.get(call.function, ""), None)
        return own(*numbers) if own else self._of_library(call.function, numbers)

    def same(self, value: Value) -> Value:
        """Return a number as it is."""
        return value

    def larger(self, value: Value, other: Value) -> Value:
        """Return the larger of two; the first one if it is not a number."""
        less = self._now.body.fcmp_ordered("<", value, other)
        return self._now.body.select(less, other, value)

    def smaller(self, value: Value, other: Value) -> Value:
        """Return the smaller of two; the first one if it is not a number."""
        less = self._now.body.fcmp_ordered("<", other, value)
        return self._now.body.select(less, other, value)

    def within(self, value: Value, low: Value, high: Value) -> Value:
        """Return a value kept between two."""
        return self.smaller(self.larger(value, low), high)

    def greater(self, first: Value, other: Value) -> Value:
        """Return the larger of two that are not negative: as bits, compared many at a time."""
        at, kind = self._now.body, _LLVM.IntType(8 * self.dtype.itemsize)
        bits = [at.bitcast(value, kind) for value in (first, other)]
        less = at.icmp_signed("<", *bits)
        return at.bitcast(at.select(less, bits[1], bits[0]), self._real)

    def _of_library(self, name: str, numbers: list[Value]) -> Value:
        """Return the result of an instruction, or of C's library in double precision."""
        at = self._now.body
        if name in ("ceil", "fabs", "sqrt"):
            return at.call(self._module.declare_intrinsic(f"llvm.{name}", [self._real]), numbers)
        assert name in ("exp", "expm1", "log", "log1p", "pow", "tanh"), name
        if name not in self._module.globals:
            kind = _LLVM.FunctionType(DOUBLE, [DOUBLE] * len(numbers))
            _LLVM.Function(self._module, kind, name)
        single = self._real != DOUBLE
        wide = [at.fpext(value, DOUBLE) if single else value for value in numbers]
        result = at.call(self._module.globals[name], wide)
        return at.fptrunc(result, self._real) if single else result


def _without(place: ir.Expression, base: ir.Name) -> ir.Expression:
    """Return a place, which is a sum that begins with a buffer, less that buffer."""
    if place == base:
        return ir.Integer(0)
    assert isinstance(place, ir.Binary)
    return ir.Binary(place.sign, _without(place.left, base), place.right)


_OWN: Mapping[str, str] = {
    "R": "same", "LARGEST_LANE": "same", "fmax": "larger", "fmin": "smaller", "clamp": "within",
    "greater": "greater",
}  # fmt: skip
"""Methods for the functions that kernels define."""

_WRITERS: dict[type, str] = {
    ir.Name: "name", ir.Constant: "constant", ir.Integer: "integer", ir.Number: "number",
    ir.Element: "element", ir.Call: "call", ir.Binary: "binary", ir.Negative: "negative",
    ir.Cast: "cast", ir.Choice: "choice", ir.Assign: "assign", ir.Declare: "declare",
    ir.Array: "array", ir.Alias: "alias", ir.Swap: "swap", ir.Do: "do",
    ir.Accumulate: "accumulate", ir.Note: "note", ir.Block: "block", ir.Branch: "branch",
    ir.While: "during", ir.Sweep: "sweep", ir.Loop: "loop", ir.Counted: "counted",
}  # fmt: skip
"""The method for each record. Vectors and strip kernels exist only in OpenCL."""
