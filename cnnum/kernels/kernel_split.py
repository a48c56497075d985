"""The pass that splits a plan for large arrays at its sweeps, so that all cores share each of them.

A sweep over the cells becomes a kernel whose work items take a piece each. Statements between
sweeps become a kernel of one work item per frame. Numbers that outlive a kernel are kept in
registers, one per frame. The host repeats the kernels of loops. Where frames of a batch take
different ways, a register of their own says whether a part is theirs.

A printer gives each kernel a head. It declares the names `piece`, `frame` and `batch`, and the
arrays `registers` and `partials`. The arrays' numbers are of the type `scalar`.
"""

from collections import ChainMap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any, TypeVar, cast

from cnnum import kernels as ir
from cnnum.kernels.expressions import Expression, Name
from cnnum.kernels.launch_plan import Launch, LaunchPlan, LaunchStep, Rounds, Steps
from cnnum.kernels.statements import uses

Record = TypeVar("Record")


def substituted(record: Record, by: Mapping[str, Expression]) -> Record:
    """Return a record, or a tuple of them, with names replaced by other expressions."""
    changed: Record = _changed(record, by)
    return changed


def _changed(value: Any, by: Mapping[str, Expression]) -> Any:
    if isinstance(value, Name):
        return by.get(value.text, value)
    if isinstance(value, tuple):
        return tuple([_changed(part, by) for part in value])  # pyright: ignore[reportUnknownVariableType]
    kind = cast("Callable[..., Any]", type(value))
    names = _fields_of(kind)
    return kind(*[_changed(getattr(value, name), by) for name in names]) if names else value


@cache
def _fields_of(kind: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else ()


PIECE = 1024
"""Values that a work item takes of a sweep that does not go by rows."""

BATCH, FRAME, AT, REGISTERS, PARTIALS = ir.names("batch frame piece registers partials")
"""Kernel parameters: the number of frames, a work item's frame and piece, and persistent values."""

BEGIN, END, K = ir.names("begin end k")
"""The ends of a work item's piece of a sweep, and a piece whose part of a sum is added."""


@dataclass(frozen=True, slots=True)
class PartKernel:
    """A kernel for a part of a plan; `note` is a comment, or empty."""

    name: str
    note: str
    body: tuple[ir.Statement, ...]


@dataclass(frozen=True, slots=True)
class Register:
    """A number of a frame that outlives the kernel that computes it.

    Attributes
    ----------
    name : Name
        Name that is unique among all registers.
    type : str
        Type in the kernels; the number is stored as a `scalar`.
    place : int
        Index among the registers.
    """

    name: ir.Name
    type: str
    place: int

    @property
    def where(self) -> ir.Element:
        """Where it is stored; the frames of a batch are adjacent."""
        return REGISTERS[ir.Integer(self.place) * BATCH + FRAME]

    @property
    def load(self) -> ir.Statement:
        """The statement that loads it in a kernel."""
        return ir.declare(self.name, ir.Cast(self.type, self.where), of=self.type)

    @property
    def store(self) -> ir.Statement:
        """The statement that stores it."""
        return ir.Assign(self.where, ir.Cast("scalar", self.name))


Meaning = Register | ir.Array | ir.Expression
"""What a name refers to: a register, an array under another name, or a constant value."""


def split_kernels(
    body: Sequence[ir.Statement], rows: int
) -> tuple[LaunchPlan, tuple[PartKernel, ...]]:
    """Return the launches of a plan for an array with a given number of rows, and their kernels.

    Raises
    ------
    ValueError
        If a sweep changes a number of the frame, so that it cannot be split into pieces.
    """
    split = _Split(rows)
    split.walk(body)
    split.flush()
    plan = LaunchPlan(tuple(split.parts), len(split.registers), split.partials)
    return plan, tuple(split.kernels)


@dataclass(frozen=True, slots=True)
class _Waiting:
    """Statements for one work item of a frame, for the frames whose guard is not 0."""

    guard: Register | None
    body: tuple[ir.Statement, ...]
    used: tuple[Meaning, ...]


@dataclass(slots=True)
class _Split:
    """Walks the statements once; those that are no sweeps wait for a kernel of theirs.

    `scope` holds the meanings of names between two braces and around them. Statements are for the
    frames whose `guard` is not 0 (None: all).
    """

    rows: int
    parts: list[LaunchStep] = field(default_factory=list[LaunchStep])
    kernels: list[PartKernel] = field(default_factory=list[PartKernel])
    registers: list[Register] = field(default_factory=list[Register])
    arrays: list[ir.Array] = field(default_factory=list[ir.Array])
    partials: int = 0
    note: str = ""
    waiting: list[_Waiting] = field(default_factory=list[_Waiting])
    scope: ChainMap[str, Meaning] = field(default_factory=ChainMap[str, Meaning])
    guard: Register | None = None

    def walk(self, statements: Iterable[ir.Statement]) -> None:
        """Split statements."""
        for statement in statements:
            match statement:
                case ir.Note():
                    self.note = statement.text
                case ir.Declare():
                    self._declare(statement)
                case ir.Array():
                    name = ir.Name(f"{statement.name.text}_{len(self.arrays)}")
                    self.arrays.append(replace(statement, name=name))
                    self.scope[statement.name.text] = self.arrays[-1]
                case ir.StripSteps():
                    self._strips(statement)
                case ir.Sweep():
                    self._sweep(statement)
                case ir.Block():
                    self._within(statement.body, self.guard)
                case ir.Branch():
                    self._within(statement.body, self._guarded(statement.condition))
                case ir.Counted():
                    self._counted(statement)
                case _:
                    self._wait(statement)

    def flush(self) -> None:
        """Make a kernel of the pending statements."""
        if not self.waiting:
            return
        body: list[ir.Statement] = []
        used: set[Meaning] = set()
        for statement in self.waiting:
            used.update(statement.used)
            if statement.guard is None:
                body += statement.body
            else:
                used.add(statement.guard)
                body.append(ir.Branch(statement.guard.name.differs(0), statement.body))
        self.waiting = []
        arrays = [array for array in self.arrays if array in used]
        registers = [register for register in self.registers if register in used]
        stores = [register.store for register in registers]
        self._launch([*_loads([*arrays, *registers]), *body, *stores], 1)

    def _launch(self, body: Sequence[ir.Statement], pieces: int) -> None:
        kernel = PartKernel(f"part_{len(self.kernels)}", self.note, tuple(body))
        self.note = ""
        self.kernels.append(kernel)
        self.parts.append(Launch(kernel.name, pieces))

    def _found(self, names: Iterable[str]) -> dict[str, Meaning]:
        """Return the meanings of names, those alone that are the plan's."""
        return {name: self.scope[name] for name in names if name in self.scope}

    # numbers

    def _wait(self, statement: ir.Statement, *own: Register, always: bool = False) -> None:
        """Defer a statement; `own` are registers that it refers to by name."""
        meanings = self._found(uses((statement,)).names)
        guard, body = None if always else self.guard, (_meant(statement, meanings),)
        self.waiting.append(_Waiting(guard, body, (*own, *meanings.values())))

    def _declare(self, new: ir.Declare) -> None:
        for name, value in new.variables:
            if new.fixed and value is not None and _is_constant(value):
                self.scope[name.text] = _bracketed(value)
                continue
            # the value is that of the names before the new one is among them
            register = self._register(new.type, name)
            if value is not None:
                self._wait(ir.Assign(register.name, value), register)
            self.scope[name.text] = register

    def _register(self, kind: str, name: ir.Name) -> Register:
        place = len(self.registers)
        self.registers.append(Register(ir.Name(f"{name.text}_{place}"), kind, place))
        return self.registers[-1]

    # sweeps

    def _strips(self, steps: ir.StripSteps) -> None:
        self.flush()
        levels = self.scope.get(steps.levels.text) if steps.levels else None
        place = levels.place if isinstance(levels, Register) else None
        self.parts.append(Steps(steps.strips, self.guard.place if self.guard else None, place))

    def _sweep(self, sweep: ir.Sweep) -> None:
        self.flush()
        pieces = sweep.count
        if sweep.variable != ir.ROW:
            pieces = min(self.rows, max(1, sweep.count // PIECE))
        used = uses(sweep.body)
        meanings = self._found(used.names)
        registers = {n: meant for n, meant in meanings.items() if isinstance(meant, Register)}
        if changed := registers.keys() & used.changed:
            raise ValueError(f"A sweep changes {sorted(changed)} in a way that cannot be split.")
        sums = [(r, used.taken_in[name]) for name, r in registers.items() if name in used.taken_in]
        body: list[ir.Statement] = []
        if self.guard is not None:
            body.append(ir.Branch(self.guard.where.equals(0), (ir.Verbatim(("return;",)),)))
        body += _loads(meanings.values())
        # a sum goes on from its value in the first piece, and starts from 0 in the others
        body += [
            ir.Assign(r.name, ir.Choice(AT.equals(0), r.name, ir.ZERO))
            for r, how in sums
            if how == "+"
        ]
        for end, piece in ((BEGIN, AT), (END, AT + 1)):
            place = ir.Cast("long", ir.Integer(sweep.count)) * piece / pieces
            body.append(ir.fixed(end, ir.Cast("int", place), of="int"))
        body.append(ir.Loop(sweep.variable, END, _meant(sweep.body, meanings), start=BEGIN))
        body += [ir.Assign(_partial(slot, pieces, AT), r.name) for slot, (r, _) in enumerate(sums)]
        self._launch(body, pieces)
        self.partials = max(self.partials, len(sums) * pieces)
        for slot, (register, how) in enumerate(sums):
            gathered = _gathered(register.name, how, slot, pieces)
            self.waiting.append(_Waiting(self.guard, gathered, (register,)))

    # ways that frames take by themselves

    def _within(self, body: Sequence[ir.Statement], guard: Register | None) -> None:
        """Split statements between two braces, for the frames whose guard is not 0."""
        outside = self.scope, self.guard
        self.scope, self.guard = self.scope.new_child(), guard
        self.walk(body)
        self.scope, self.guard = outside

    def _guarded(self, condition: ir.Expression) -> Register:
        """Return the register of a new condition within the current one."""
        register = self._register("int", ir.Name("go"))
        self._renew(register, self.guard, condition)
        return register

    def _renew(self, register: Register, outer: Register | None, condition: ir.Expression) -> None:
        """Let a register say, in every frame, whether a condition holds within an outer one."""
        holds: ir.Expression = _bracketed(condition)
        if outer is not None:
            holds = outer.name.differs(0) & holds
        used = (register,) if outer is None else (register, outer)
        self._wait(ir.Assign(register.name, holds), *used, always=True)

    def _counted(self, loop: ir.Counted) -> None:
        scope, guard = self.scope, self.guard
        self.scope = scope.new_child()
        asks_host = not isinstance(loop.end, int) or loop.running is not None
        count: Register | None = None
        if asks_host or loop.variable.text in uses(loop.body).names:
            count = self._register("int", loop.variable)
            self._wait(ir.Assign(count.name, ir.Integer(loop.start)), count)
            self.scope[loop.variable.text] = count
        if asks_host:
            self.guard = self._guarded(loop.condition)
        self.flush()
        before, self.parts = self.parts, []
        self.walk(loop.body)
        if count is not None:
            self._wait(ir.Assign(count.name, ir.Integer(1), "+="), count)
        if asks_host and self.guard is not None:
            self._renew(self.guard, self.guard, loop.condition)
        self.flush()
        self.parts = [*before, self._rounds(loop)]
        self.scope, self.guard = scope, guard

    def _rounds(self, loop: ir.Counted) -> Rounds:
        """Return the loop over the current parts."""
        parts = tuple(self.parts)
        if loop.running is None:
            if isinstance(loop.end, int):
                return Rounds(parts, count=loop.end - loop.start)
            bound = self.scope.get(loop.end.text)
            if isinstance(bound, Register):
                return Rounds(parts, bound=(bound.place, loop.start))
        assert self.guard is not None
        return Rounds(parts, flag=self.guard.place)


def _meant(record: Record, meanings: Mapping[str, Meaning]) -> Record:
    """Return a record with the meanings of its names."""
    by = {n: m if isinstance(m, ir.Expression) else m.name for n, m in meanings.items()}
    return substituted(record, by)


def _loads(meanings: Iterable[Meaning]) -> list[ir.Statement]:
    """Return the statements that bring registers and arrays into a kernel."""
    kept = (meaning for meaning in meanings if not isinstance(meaning, ir.Expression))
    return [value.load if isinstance(value, Register) else value for value in kept]


def _bracketed(value: ir.Expression) -> ir.Call:
    return ir.call("", value)


def _is_constant(value: ir.Expression) -> bool:
    """Return whether a value is the same in every frame."""
    inner = value.value if isinstance(value, ir.Negative) else value
    return isinstance(inner, ir.Number | ir.Constant)


def _partial(slot: int, pieces: int, piece: ir.Name) -> ir.Element:
    return PARTIALS[(ir.Integer(slot) * BATCH + FRAME) * pieces + piece]


def _gathered(name: ir.Name, how: str, slot: int, pieces: int) -> tuple[ir.Statement, ...]:
    """Return the statements that put a number together from its pieces, always in their order."""
    part = _partial(slot, pieces, K)
    if how == "+":
        return ir.Assign(name, ir.ZERO), ir.Loop(K, pieces, (ir.add(name, part),))
    return (ir.Loop(K, pieces, (ir.Accumulate(name, how, part),)),)
