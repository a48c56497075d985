"""A plan for large arrays, split at its sweeps so that all cores share each of them.

A sweep over the cells becomes a kernel whose work items take a piece each. Statements between
sweeps become a kernel of one work item a frame. Numbers that outlive a kernel are kept in
registers, one a frame. The host repeats the kernels of loops. Where frames of a batch take
different ways, a register of their own says whether a part is theirs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.program import FIRST
from cnnum.engines.opencl.lowering.split_scopes import (
    BATCH,
    FRAME,
    Fixed,
    GlobalArray,
    Meaning,
    Register,
    Scope,
)
from cnnum.engines.opencl.lowering.storage import UNFINISHED
from cnnum.engines.opencl.text import fill, indented
from cnnum.kernels.launch_plan import Launch, LaunchPlan, LaunchStep, Rounds, Steps
from cnnum.kernels.opencl import OpenCLPrinter
from cnnum.kernels.substitution import Record, substituted
from cnnum.kernels.uses import Uses, uses

PIECE = 1024
"""Values that a work item takes of a sweep that does not go by rows."""

AT, BEGIN, END, K, PARTIALS = ir.names("piece begin end k partials")
"""A work item's piece of a sweep, its ends, and where its part of a sum is kept."""


def split_kernels(body: Sequence[ir.Statement], rows: int, printer: OpenCLPrinter) -> LaunchPlan:
    """Return the parts of a plan.

    Parameters
    ----------
    body : sequence of Statement
    rows : int
        Of the array.
    printer : OpenCLPrinter
        The printer of the kernels.
    """
    split = _Split(rows)
    scope = Scope()
    scope.meanings[FIRST.text] = Fixed(ir.real(ir.Name("is_first")))
    split.walk((ir.declare(UNFINISHED, ir.ZERO),), scope, None)
    split.walk(body, scope, None)
    split.flush()
    text = [
        fill("part", note=note, kernel=name, body=indented(printer.lines(lines), 1))
        for name, note, lines in split.kernels
    ]
    return LaunchPlan(tuple(split.parts), "\n".join(text), len(split.known), split.partials)


@dataclass(frozen=True, slots=True)
class _Waiting:
    """Statements for one work item of a frame, for the frames whose guard is not 0."""

    guard: Register | None
    body: tuple[ir.Statement, ...]
    used: tuple[Meaning, ...]


@dataclass(slots=True)
class _Split:
    """Walks the statements once; those that are no sweeps wait for a kernel of theirs."""

    rows: int
    parts: list[LaunchStep] = field(default_factory=list[LaunchStep])
    kernels: list[tuple[str, str, list[ir.Statement]]] = field(
        default_factory=list[tuple[str, str, list[ir.Statement]]]
    )
    waiting: list[_Waiting] = field(default_factory=list[_Waiting])
    known: list[Register] = field(default_factory=list[Register])
    arrays: list[GlobalArray] = field(default_factory=list[GlobalArray])
    partials: int = 0
    note: str = ""

    def walk(
        self, statements: Sequence[ir.Statement], scope: Scope, guard: Register | None
    ) -> None:
        """Split statements, for the frames whose guard is not 0."""
        for statement in statements:
            if isinstance(statement, ir.Note):
                self.note = statement.text
            elif isinstance(statement, ir.Declare):
                self._declare(statement, scope, guard)
            elif isinstance(statement, ir.Array):
                self._array(statement, scope)
            elif isinstance(statement, ir.StripSteps):
                self._strips(statement, scope, guard)
            elif isinstance(statement, ir.Block):
                self.walk(statement.body, Scope(scope), guard)
            elif isinstance(statement, ir.Sweep):
                self._sweep(statement, scope, guard)
            elif isinstance(statement, ir.Branch):
                within = self._guard(guard, statement.condition, scope)
                self.walk(statement.body, Scope(scope), within)
            elif isinstance(statement, ir.Counted):
                self._counted(statement, Scope(scope), guard)
            else:
                self._wait(statement, scope, guard)

    def flush(self) -> None:
        """Make a kernel of the statements that wait."""
        if not self.waiting:
            return
        body: list[ir.Statement] = []
        used: set[Meaning] = set()
        for one in self.waiting:
            used |= {*one.used, *([] if one.guard is None else [one.guard])}
            if one.guard is None:
                body += one.body
            else:
                body.append(ir.Branch(one.guard.name.differs(0), one.body))
        arrays = [array.load for array in self.arrays if array in used]
        registers = [register for register in self.known if register in used]
        self.waiting = []
        loads, stores = [r.load for r in registers], [r.store for r in registers]
        self._launch([*arrays, *loads, *body, *stores], 1)

    # numbers

    def _wait(
        self,
        statement: ir.Statement,
        scope: Scope,
        guard: Register | None,
        *own: Register,
    ) -> None:
        """Let a statement wait; `own` are registers that it names by their names."""
        found = scope.found(uses((statement,)).names)
        body = (_meant(statement, found),)
        self.waiting.append(_Waiting(guard, body, (*own, *found.values())))

    def _declare(self, new: ir.Declare, scope: Scope, guard: Register | None) -> None:
        for name, value in new.variables:
            if new.fixed and value is not None and _is_constant(value):
                scope.meanings[name.text] = Fixed(_bracketed(value))
                continue
            # the value is that of the names before the new one is among them
            register = self._register(new.type, name)
            if value is not None:
                self._wait(ir.Assign(register.name, value), scope, guard, register)
            scope.meanings[name.text] = register

    def _register(self, kind: str, name: ir.Name) -> Register:
        place = len(self.known)
        register = Register(ir.Name(f"{name.text}_{place}"), kind, place)
        self.known.append(register)
        return register

    def _array(self, array: ir.Array, scope: Scope) -> None:
        assert array.start is not None
        name = ir.Name(f"{array.name.text}_{len(self.arrays)}")
        meaning = scope.meanings[array.name.text] = GlobalArray(name, array.start)
        self.arrays.append(meaning)

    def _strips(self, steps: ir.StripSteps, scope: Scope, guard: Register | None) -> None:
        self.flush()
        levels = scope.find(steps.levels.text) if steps.levels else None
        place = levels.place if isinstance(levels, Register) else None
        self.parts.append(Steps(steps.strips, guard.place if guard else None, place))

    # sweeps

    def _sweep(self, sweep: ir.Sweep, scope: Scope, guard: Register | None) -> None:
        self.flush()
        pieces = sweep.count
        if sweep.variable != ir.ROW:
            pieces = min(self.rows, max(1, sweep.count // PIECE))
        found, done = self._used_by(sweep, scope)
        sums = [
            (meaning, done.taken_in[name])
            for name, meaning in found.items()
            if isinstance(meaning, Register) and name in done.taken_in
        ]
        body: list[ir.Statement] = []
        if guard is not None:
            body.append(ir.Branch(guard.where.equals(0), (ir.Verbatim(("return;",)),)))
        body += [meaning.load for meaning in found.values() if not isinstance(meaning, Fixed)]
        # a sum goes on from its value in the first piece, and starts from 0 in the others
        body += [
            ir.Assign(r.name, ir.Choice(AT.equals(0), r.name, ir.ZERO))
            for r, how in sums
            if how == "+"
        ]
        for end, piece in ((BEGIN, AT), (END, AT + 1)):
            place = ir.Cast("long", ir.Integer(sweep.count)) * piece / pieces
            body.append(ir.fixed(end, ir.Cast("int", place), of="int"))
        body.append(ir.Loop(sweep.variable, END, _meant(sweep.body, found), start=BEGIN))
        body += [
            ir.Assign(_partial(slot, pieces, AT), register.name)
            for slot, (register, _) in enumerate(sums)
        ]
        self._launch(body, pieces)
        for slot, (register, how) in enumerate(sums):
            self.partials = max(self.partials, (slot + 1) * pieces)
            gathered = _gathered(register.name, how, slot, pieces)
            self.waiting.append(_Waiting(guard, gathered, (register,)))

    def _used_by(self, sweep: ir.Sweep, scope: Scope) -> tuple[dict[str, Meaning], Uses]:
        """Return the meanings of the names in a sweep, and its uses of them.

        Raises
        ------
        ValueError
            If it changes a number of the frame, which no order of pieces would give again.
        """
        done = uses(sweep.body)
        found = scope.found(done.names)
        for name in done.changed:
            if isinstance(found.get(name), Register):
                raise ValueError(f"A sweep changes '{name}' in a way that has no pieces.")
        return found, done

    # ways that frames take by themselves

    def _guard(self, outer: Register | None, condition: ir.Expression, scope: Scope) -> Register:
        """Return the register of a new condition within another one."""
        register = self._register("int", ir.Name("go"))
        self._renew(register, outer, condition, scope)
        return register

    def _renew(
        self, register: Register, outer: Register | None, condition: ir.Expression, scope: Scope
    ) -> None:
        both: ir.Expression = _bracketed(condition)
        if outer is not None:
            both = outer.name.differs(0) & both
        used = (register,) if outer is None else (register, outer)
        self._wait(ir.Assign(register.name, both), scope, None, *used)

    def _counted(self, loop: ir.Counted, scope: Scope, guard: Register | None) -> None:
        often = loop.end if isinstance(loop.end, int) and loop.running is None else None
        count: Register | None = None
        if often is None or loop.variable.text in uses(loop.body).names:
            count = self._register("int", loop.variable)
            self._wait(ir.Assign(count.name, ir.Integer(loop.start)), scope, guard, count)
            scope.meanings[loop.variable.text] = count
        within = guard if often is not None else self._guard(guard, loop.condition, scope)
        self.flush()
        outside, self.parts = self.parts, []
        self.walk(loop.body, scope, within)
        if count is not None:
            self._wait(ir.Assign(count.name, ir.Integer(1), "+="), scope, within, count)
        if within is not None and often is None:
            self._renew(within, within, loop.condition, scope)
        self.flush()
        bound = scope.find(loop.end.text) if isinstance(loop.end, ir.Name) else None
        if often is not None:
            rounds = Rounds(tuple(self.parts), count=often - loop.start)
        elif isinstance(bound, Register) and loop.running is None:
            rounds = Rounds(tuple(self.parts), bound=(bound.place, loop.start))
        else:
            assert within is not None
            rounds = Rounds(tuple(self.parts), flag=within.place)
        self.parts = [*outside, rounds]

    def _launch(self, body: list[ir.Statement], pieces: int) -> None:
        name = f"part_{len(self.kernels)}"
        self.kernels.append((name, self.note, body))
        self.note = ""
        self.parts.append(Launch(name, pieces))


def _meant(record: Record, found: dict[str, Meaning]) -> Record:
    """Return a record with the meanings of its names."""
    return substituted(record, {name: meaning.name for name, meaning in found.items()})


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
