"""A plan's kernel for large arrays, parted at its sweeps so that all cores share each of them.

A sweep over the cells becomes a kernel whose work items take a piece each; what stands between
sweeps becomes a kernel of one work item a frame. Numbers that outlive a part are kept in
registers, one a frame. The host repeats what stands in loops; where frames of a batch take
different ways, a register of their own says whether a part is theirs.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypedDict

from cnnum.engines.opencl.parts import Launch, Part, Parts, Rounds, Steps, Strips
from cnnum.engines.opencl.scopes import NAME, Array, Fixed, Register, Scope, parted_at_commas
from cnnum.engines.opencl.statements import (
    Block,
    Branch,
    Counted,
    Note,
    Plain,
    Statement,
    Sweep,
    parse,
)
from cnnum.engines.opencl.text import fill, indented

PIECE = 1024
"""Values that a work item takes of a sweep that does not go by rows."""

_ARRAY = re.compile(r"__global real \*const (\w+) = (\w+ \+ [^;]*)$")
_NUMBER = re.compile(r"(const )?(real|int|scalar) (.+)$", re.DOTALL)
_FIXED = re.compile(r"R\([-+.\def]*\)$|-?(ZERO|ONE|HUGE)$")
_TIMES = re.compile(r"\w+ < (\d+)$")
_UP_TO = re.compile(r"\w+ < (\w+)$")


def take_apart(body: str, rows: int, strips: Mapping[str, Strips]) -> Parts:
    """Return the parts of a kernel's body.

    Parameters
    ----------
    body : str
        What `cnnum.engines.opencl.statements` reads.
    rows : int
        Of the array.
    strips : mapping of str to Strips
        Steps that are kernels already, by the name that stands for them in the body.
    """
    taken = _Apart(rows, strips)
    scope = Scope()
    scope.meanings["first"] = Fixed("R(is_first)")
    taken.declare("real", "unfinished = ZERO", scope, None)
    taken.walk(parse(body), scope, None)
    taken.flush()
    return Parts(tuple(taken.parts), "\n".join(taken.kernels), taken.registers, taken.partials)


class _Ends(TypedDict, total=False):
    count: int
    bound: tuple[int, int]
    flag: int


@dataclass(slots=True)
class _Apart:
    """Walks the statements once; numbers wait in `waiting`, each with its guard."""

    rows: int
    strips: Mapping[str, Strips]
    parts: list[Part] = field(default_factory=list[Part])
    kernels: list[str] = field(default_factory=list[str])
    waiting: list[tuple[Register | None, str]] = field(
        default_factory=list[tuple[Register | None, str]]
    )
    known: dict[str, Register] = field(default_factory=dict[str, Register])
    arrays: dict[str, Array] = field(default_factory=dict[str, Array])
    partials: int = 0
    note: str = ""

    @property
    def registers(self) -> int:
        """Registers so far."""
        return len(self.known)

    def walk(self, statements: tuple[Statement, ...], scope: Scope, guard: Register | None) -> None:
        """Take statements apart, for the frames whose guard is not 0."""
        for statement in statements:
            if isinstance(statement, Note):
                self.note = statement.text
            elif isinstance(statement, Plain):
                self._plain(statement.text, scope, guard)
            elif isinstance(statement, Block):
                self.walk(statement.body, Scope(scope), guard)
            elif isinstance(statement, Sweep):
                self._sweep(statement, scope, guard)
            elif isinstance(statement, Branch):
                within = self._guard(guard, scope.renamed(statement.condition))
                self.walk(statement.body, Scope(scope), within)
            else:
                self._counted(statement, Scope(scope), guard)

    def flush(self) -> None:
        """Make a kernel of the numbers that wait."""
        if not self.waiting:
            return
        lines: list[str] = []
        for guard, text in self.waiting:
            lines.append(text if guard is None else f"if ({guard.name} != 0) {{ {text} }}")
        words = set(NAME.findall("\n".join(lines)))
        arrays = [array.load for name, array in self.arrays.items() if name in words]
        used = [register for name, register in self.known.items() if name in words]
        lines = [*arrays, *(r.load for r in used), *lines, *(r.store for r in used)]
        self.waiting = []
        self._launch(lines, 1)

    # numbers

    def _plain(self, text: str, scope: Scope, guard: Register | None) -> None:
        if text in self.strips:
            self._strips(self.strips[text], scope, guard)
            return
        array, number = _ARRAY.match(text), _NUMBER.match(text)
        if array is not None:
            meaning = Array(f"{array[1]}_{len(self.arrays)}", array[2])
            scope.meanings[array[1]] = self.arrays[meaning.name] = meaning
        elif number is not None:
            for part in parted_at_commas(number[3]):
                name, _, value = part.partition(" = ")
                if number[1] and _FIXED.match(value):
                    scope.meanings[name] = Fixed(f"({value})")
                else:
                    self.declare(number[2], part, scope, guard)
        else:
            self.waiting.append((guard, scope.renamed(text) + ";"))

    def _strips(self, strips: Strips, scope: Scope, guard: Register | None) -> None:
        self.flush()
        levels = scope.find(strips.told) if strips.told else None
        told = levels.place if isinstance(levels, Register) else None
        self.parts.append(Steps(strips, guard.place if guard else None, told))

    def declare(self, kind: str, text: str, scope: Scope, guard: Register | None) -> Register:
        """Give a declared number a register, and what it starts from."""
        name, _, value = text.partition(" = ")
        value = scope.renamed(value)  # before the name means the new one
        register = Register(f"{name}_{self.registers}", kind, self.registers)
        self.known[register.name] = register
        scope.meanings[name] = register
        if value:
            self.waiting.append((guard, f"{register.name} = {value};"))
        return register

    # sweeps

    def _sweep(self, sweep: Sweep, scope: Scope, guard: Register | None) -> None:
        self.flush()
        by_rows = sweep.variable == "r"
        pieces = sweep.count if by_rows else min(self.rows, max(1, sweep.count // PIECE))
        text = scope.renamed(sweep.body)
        lines = [] if guard is None else [f"if ({guard.where} == 0) {{ return; }}"]
        sums: list[tuple[Register, str]] = []
        for meaning in scope.used(sweep.body):
            if isinstance(meaning, Fixed):
                continue
            lines.append(meaning.load)
            if isinstance(meaning, Register) and (how := _adds_up(meaning.name, text)):
                sums.append((meaning, how))
        # a sum starts from what it is in the first piece, and from nothing in the others
        lines += [f"{r.name} = piece == 0 ? {r.name} : ZERO;" for r, how in sums if how == "+"]
        lines += [
            f"const int begin = (int)((long){sweep.count} * piece / {pieces});",
            f"const int end = (int)((long){sweep.count} * (piece + 1) / {pieces});",
            f"for (int {sweep.variable} = begin; {sweep.variable} < end; ++{sweep.variable}) {{",
            *(line.strip() for line in text.splitlines()),
            "}",
        ]
        for slot, (register, _) in enumerate(sums):
            lines.append(f"{_partial(slot, pieces, 'piece')} = {register.name};")
        self._launch(lines, pieces)
        for slot, (register, how) in enumerate(sums):
            self.partials = max(self.partials, (slot + 1) * pieces)
            self.waiting.append((guard, _gathered(register.name, how, slot, pieces)))

    # ways that frames take by themselves

    def _guard(self, outer: Register | None, condition: str) -> Register:
        """Return the register of a new condition within another one."""
        register = Register(f"go_{self.registers}", "int", self.registers)
        self.known[register.name] = register
        self._renew(register, outer, condition)
        return register

    def _renew(self, register: Register, outer: Register | None, condition: str) -> None:
        both = f"({condition})" if outer is None else f"{outer.name} != 0 && ({condition})"
        self.waiting.append((None, f"{register.name} = {both};"))

    def _counted(self, loop: Counted, scope: Scope, guard: Register | None) -> None:
        times = _TIMES.match(loop.condition)
        count: Register | None = None
        if loop.counts or times is None:
            count = self.declare("int", f"{loop.variable} = {loop.start}", scope, guard)
        condition = scope.renamed(loop.condition)
        within = guard if times else self._guard(guard, condition)
        self.flush()
        outside, self.parts = self.parts, []
        self.walk(loop.body, scope, within)
        if count is not None:
            self.waiting.append((within, f"++{count.name};"))
        if within is not None and not times:
            self._renew(within, within, condition)
        self.flush()
        rounds = Rounds(tuple(self.parts), **self._ends(loop, scope, within))
        self.parts = [*outside, rounds]

    def _ends(self, loop: Counted, scope: Scope, within: Register | None) -> _Ends:
        """Return what the host has to ask for to know when a loop is over."""
        times, up_to = _TIMES.match(loop.condition), _UP_TO.match(loop.condition)
        if times:
            return {"count": int(times[1]) - loop.start}
        bound = scope.find(up_to[1]) if up_to else None
        if isinstance(bound, Register):
            return {"bound": (bound.place, loop.start)}
        assert within is not None
        return {"flag": within.place}

    def _launch(self, lines: list[str], pieces: int) -> None:
        name = f"part_{len(self.kernels)}"
        self.kernels.append(fill("part", note=self.note, kernel=name, body=indented(lines, 1)))
        self.note = ""
        self.parts.append(Launch(name, pieces))


def _adds_up(name: str, text: str) -> str | None:
    """Return how a sweep adds to a number: the function's name, or "+"; None where it only reads.

    Raises
    ------
    ValueError
        If it does anything else to it, which no order of pieces would give again.
    """
    if not re.search(rf"\b{name}\s*[-+*/]?=(?!=)", text):
        return None
    extreme = re.search(rf"\b{name} = (fmax|fmin|greater)\(\(?{name}\b", text)
    if extreme is not None:
        return extreme[1]
    if re.search(rf"\b{name} = \(?{name}\)? \+ ", text):
        return "+"
    raise ValueError(f"A sweep changes '{name}' in a way that has no pieces.")


def _partial(slot: int, pieces: int, piece: str) -> str:
    return f"partials[({slot} * batch + frame) * {pieces} + {piece}]"


def _gathered(name: str, how: str, slot: int, pieces: int) -> str:
    """Return the statement that puts a number together from its pieces, always in their order."""
    part = _partial(slot, pieces, "k")
    if how == "+":
        each = f"{name} += {part};"
        return f"{name} = ZERO; for (int k = 0; k < {pieces}; ++k) {{ {each} }}"
    return f"for (int k = 0; k < {pieces}; ++k) {{ {name} = {how}({name}, {part}); }}"
