"""A plan for large arrays, split at its sweeps so that all cores share each of them.

A sweep over the cells becomes a kernel whose work items take a piece each. Statements between
sweeps become a kernel of one work item a frame. Numbers that outlive a kernel are kept in
registers, one a frame. The host repeats the kernels of loops. Where frames of a batch take
different ways, a register of their own says whether a part is theirs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.program import FIRST
from cnnum.engines.opencl.lowering.split_scopes import Fixed, GlobalArray, Meaning, Register, Scope
from cnnum.engines.opencl.lowering.storage import UNFINISHED
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients.builder import ROW
from cnnum.kernels.launch_plan import Launch, LaunchPlan, LaunchStep, Rounds, Steps
from cnnum.kernels.opencl import OpenCLPrinter
from cnnum.kernels.uses import Uses, uses

PIECE = 1024
"""Values that a work item takes of a sweep that does not go by rows."""


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
    split = _Split(rows, printer)
    scope = Scope()
    scope.meanings[FIRST.text] = Fixed("R(is_first)")
    split.walk((ir.declare(UNFINISHED, ir.ZERO),), scope, None)
    split.walk(body, scope, None)
    split.flush()
    return LaunchPlan(tuple(split.parts), "\n".join(split.kernels), split.registers, split.partials)


@dataclass(frozen=True, slots=True)
class _Waiting:
    """Statements for one work item of a frame, for the frames whose guard is not 0."""

    guard: Register | None
    lines: list[str]
    used: tuple[Meaning, ...]


@dataclass(slots=True)
class _Split:
    """Walks the statements once; those that are no sweeps wait for a kernel of theirs."""

    rows: int
    printer: OpenCLPrinter
    parts: list[LaunchStep] = field(default_factory=list[LaunchStep])
    kernels: list[str] = field(default_factory=list[str])
    waiting: list[_Waiting] = field(default_factory=list[_Waiting])
    known: list[Register] = field(default_factory=list[Register])
    arrays: list[GlobalArray] = field(default_factory=list[GlobalArray])
    partials: int = 0
    note: str = ""

    @property
    def registers(self) -> int:
        """Registers so far."""
        return len(self.known)

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
        lines: list[str] = []
        used: set[Meaning] = set()
        for one in self.waiting:
            used |= {*one.used, *([] if one.guard is None else [one.guard])}
            if one.guard is None:
                lines += one.lines
            else:
                inner = (f"    {line}" for line in one.lines)
                lines += [f"if ({one.guard.name} != 0) {{", *inner, "}"]
        arrays = [array.load for array in self.arrays if array in used]
        registers = [register for register in self.known if register in used]
        lines = [*arrays, *(r.load for r in registers), *lines, *(r.store for r in registers)]
        self.waiting = []
        self._launch(lines, 1)

    # numbers

    def _wait(self, statement: ir.Statement, scope: Scope, guard: Register | None) -> None:
        found = scope.found(uses((statement,)).names)
        lines = self._printer(found).lines([statement])
        self.waiting.append(_Waiting(guard, lines, tuple(found.values())))

    def _printer(self, found: dict[str, Meaning]) -> OpenCLPrinter:
        names = {name: meaning.name for name, meaning in found.items()}
        return replace(self.printer, names=names)

    def _declare(self, new: ir.Declare, scope: Scope, guard: Register | None) -> None:
        for name, value in new.variables:
            if new.fixed and value is not None and _is_constant(value):
                scope.meanings[name.text] = Fixed(f"({self.printer.expression(value)})")
                continue
            # the value is that of the names before the new one is among them
            register = self._register(new.type, name)
            if value is not None:
                self._assign(register, value, scope, guard)
            scope.meanings[name.text] = register

    def _register(self, kind: str, name: ir.Name) -> Register:
        register = Register(f"{name.text}_{self.registers}", kind, self.registers)
        self.known.append(register)
        return register

    def _assign(
        self, register: Register, value: ir.Expression, scope: Scope, guard: Register | None
    ) -> None:
        found = scope.found(_names(value))
        line = f"{register.name} = {self._printer(found).expression(value)};"
        self.waiting.append(_Waiting(guard, [line], (register, *found.values())))

    def _array(self, array: ir.Array, scope: Scope) -> None:
        assert array.start is not None
        start = self.printer.expression(array.start)
        meaning = GlobalArray(f"{array.name.text}_{len(self.arrays)}", start)
        scope.meanings[array.name.text] = meaning
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
        if sweep.variable != ROW:
            pieces = min(self.rows, max(1, sweep.count // PIECE))
        found, done = self._used_by(sweep, scope)
        sums = [(found[name], how) for name, how in done.taken_in.items() if name in found]
        sums.sort(key=lambda each: list(found.values()).index(each[0]))
        v = sweep.variable.text
        lines = [] if guard is None else [f"if ({guard.where} == 0) {{ return; }}"]
        lines += [meaning.load for meaning in found.values() if not isinstance(meaning, Fixed)]
        # a sum goes on from its value in the first piece, and starts from 0 in the others
        lines += [f"{r.name} = piece == 0 ? {r.name} : ZERO;" for r, how in sums if how == "+"]
        lines += [
            f"const int begin = (int)((long){sweep.count} * piece / {pieces});",
            f"const int end = (int)((long){sweep.count} * (piece + 1) / {pieces});",
            f"for (int {v} = begin; {v} < end; ++{v}) {{",
            *self._printer(found).lines(sweep.body, 1),
            "}",
        ]
        for slot, (register, _) in enumerate(sums):
            lines.append(f"{_partial(slot, pieces, 'piece')} = {register.name};")
        self._launch(lines, pieces)
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
        found = scope.found(_names(condition))
        holds = f"({self._printer(found).expression(condition)})"
        both = holds if outer is None else f"{outer.name} != 0 && {holds}"
        used = (register, *([] if outer is None else [outer]), *found.values())
        self.waiting.append(_Waiting(None, [f"{register.name} = {both};"], used))

    def _counted(self, loop: ir.Counted, scope: Scope, guard: Register | None) -> None:
        often = loop.end if isinstance(loop.end, int) and loop.running is None else None
        count: Register | None = None
        if often is None or loop.variable.text in uses(loop.body).names:
            count = self._register("int", loop.variable)
            self._assign(count, ir.Integer(loop.start), scope, guard)
            scope.meanings[loop.variable.text] = count
        within = guard if often is not None else self._guard(guard, loop.condition, scope)
        self.flush()
        outside, self.parts = self.parts, []
        self.walk(loop.body, scope, within)
        if count is not None:
            self.waiting.append(_Waiting(within, [f"++{count.name};"], (count,)))
        if within is not None and often is None:
            self._renew(within, within, loop.condition, scope)
        self.flush()
        if often is not None:
            rounds = Rounds(tuple(self.parts), count=often - loop.start)
        else:
            assert within is not None
            bound = scope.find(loop.end.text) if isinstance(loop.end, ir.Name) else None
            rounds = Rounds(tuple(self.parts), flag=within.place)
            if isinstance(bound, Register) and loop.running is None:
                rounds = Rounds(tuple(self.parts), bound=(bound.place, loop.start))
        self.parts = [*outside, rounds]

    def _launch(self, lines: list[str], pieces: int) -> None:
        name = f"part_{len(self.kernels)}"
        self.kernels.append(fill("part", note=self.note, kernel=name, body=indented(lines, 1)))
        self.note = ""
        self.parts.append(Launch(name, pieces))


def _names(value: ir.Expression) -> tuple[str, ...]:
    return uses((ir.Assign(ir.Name(""), value),)).names


def _is_constant(value: ir.Expression) -> bool:
    """Return whether a value is the same in every frame."""
    inner = value.value if isinstance(value, ir.Negative) else value
    return isinstance(inner, ir.Number | ir.Constant)


def _partial(slot: int, pieces: int, piece: str) -> str:
    return f"partials[({slot} * batch + frame) * {pieces} + {piece}]"


def _gathered(name: str, how: str, slot: int, pieces: int) -> list[str]:
    """Return the statements that put a number together from its pieces, always in their order."""
    part = _partial(slot, pieces, "k")
    loop = f"for (int k = 0; k < {pieces}; ++k)"
    if how == "+":
        return [f"{name} = ZERO;", f"{loop} {{ {name} += {part}; }}"]
    return [f"{loop} {{ {name} = {how}({name}, {part}); }}"]
