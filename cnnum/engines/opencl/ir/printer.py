"""Records as text: OpenCL C, for a number type."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from cnnum.engines.opencl.ir.expressions import (
    Binary,
    Call,
    Cast,
    Choice,
    Component,
    Constant,
    Element,
    Expression,
    Integer,
    Name,
    Negative,
    Number,
    operand,
)
from cnnum.engines.opencl.ir.number_types import NumberType
from cnnum.engines.opencl.ir.statements import (
    Accumulate,
    Array,
    Assign,
    Block,
    Branch,
    Counted,
    Declare,
    Loop,
    Note,
    Statement,
    StripSteps,
    Sweep,
    Verbatim,
    While,
)

_CHOICE, _UNARY, _PRIMARY = 1, 9, 10
_RANKS = {
    "||": 2, "&&": 3, "==": 5, "!=": 5, "<": 6, "<=": 6, ">": 6, ">=": 6, "+": 7, "-": 7, "*": 8,
    "/": 8, "%": 8,
}  # fmt: skip
"""How tightly signs bind in C."""


@dataclass(frozen=True, slots=True)
class OpenCLPrinter:
    """Writes records as OpenCL C.

    Attributes
    ----------
    numbers : NumberType
    names : mapping of str to str
        Names that are written as others.
    """

    numbers: NumberType
    names: Mapping[str, str] = field(default_factory=dict[str, str])

    def expression(self, value: Expression) -> str:
        """Return the text of an expression."""
        return self._ranked(value)[0]

    def lines(self, statements: Iterable[Statement], depth: int = 0) -> list[str]:
        """Return the lines of statements."""
        pad = "    " * depth
        return [
            pad + line if line and line[0] != "#" else line
            for statement in statements
            for line in self._written(statement)
        ]

    def _within(self, value: Expression, least: int) -> str:
        text, rank = self._ranked(value)
        return text if rank >= least else f"({text})"

    def _ranked(self, value: Expression) -> tuple[str, int]:
        if isinstance(value, Name):
            return self.names.get(value.text, value.text), _PRIMARY
        if isinstance(value, Binary):
            rank = _RANKS[value.sign]
            left, right = self._within(value.left, rank), self._within(value.right, rank + 1)
            return f"{left} {value.sign} {right}", rank
        if isinstance(value, Element):
            name = self.names.get(value.array.text, value.array.text)
            return f"{name}[{self.expression(value.at)}]", _PRIMARY
        if isinstance(value, Call):
            inner = ", ".join(self.expression(argument) for argument in value.arguments)
            return f"{value.function}({inner})", _PRIMARY
        if isinstance(value, Number):
            return self.numbers.literal(value.value), _PRIMARY
        return self._rare(value)

    def _rare(self, value: Expression) -> tuple[str, int]:
        if isinstance(value, Integer):
            return str(value.value), _PRIMARY
        if isinstance(value, Constant):
            return value.text, _PRIMARY
        if isinstance(value, Negative):
            return f"-{self._within(value.value, _PRIMARY)}", _UNARY
        if isinstance(value, Cast):
            return f"({value.type}){self._within(value.value, _UNARY)}", _UNARY
        if isinstance(value, Component):
            return f"{value.vector.text}.s{value.lane:x}", _PRIMARY
        assert isinstance(value, Choice)
        condition, yes = self._within(value.condition, _CHOICE + 1), self.expression(value.yes)
        return f"{condition} ? {yes} : {self._within(value.no, _CHOICE)}", _CHOICE

    # statements

    def _written(self, statement: Statement) -> list[str]:
        if isinstance(statement, Assign):
            target, value = self.expression(statement.target), self.expression(statement.value)
            if (statement.sign, value) == ("+=", "1"):
                return [f"++{target};"]
            return [f"{target} {statement.sign} {value};"]
        if isinstance(statement, Declare):
            return self._declare(statement)
        if isinstance(statement, Accumulate):
            return self._accumulate(statement)
        if isinstance(statement, Array):
            return self._array(statement)
        if isinstance(statement, Note):
            return [statement.text]
        if isinstance(statement, Verbatim):
            return self._verbatim(statement)
        if isinstance(statement, StripSteps):
            levels = None if statement.levels is None else self.expression(statement.levels)
            return [statement.strips.within(levels)]
        hint = [statement.hint] if isinstance(statement, Loop | Counted) and statement.hint else []
        head = f"{self._head(statement)} {{".lstrip()
        return [*hint, head, *self.lines(statement.body, 1), "}"]

    def _head(self, statement: Block | Branch | Sweep | Loop | Counted | While) -> str:
        if isinstance(statement, Block):
            return ""
        if isinstance(statement, Branch):
            return f"if ({self.expression(statement.condition)})"
        if isinstance(statement, While):
            return f"while ({self.expression(statement.condition)})"
        v = statement.variable.text
        if isinstance(statement, Sweep):
            return f"for (int {v} = 0; {v} < {statement.count}; ++{v})"
        if isinstance(statement, Loop):
            next = f"++{v}" if statement.step == 1 else f"{v} += {statement.step}"
            condition = f"{v} < {self._within(operand(statement.end), _RANKS['<'] + 1)}"
            return f"for (int {v} = {statement.start}; {condition}; {next})"
        condition = self.expression(statement.condition)
        return f"for (int {v} = {statement.start}; {condition}; ++{v})"

    def _declare(self, new: Declare) -> list[str]:
        parts = [
            name.text if value is None else f"{name.text} = {self.expression(value)}"
            for name, value in new.variables
        ]
        return [f"{'const ' if new.fixed else ''}{new.type} {', '.join(parts)};"]

    def _array(self, array: Array) -> list[str]:
        if array.start is None:
            return [f"real {array.name.text}[{array.length}];"]
        return [f"__global real *const {array.name.text} = {self.expression(array.start)};"]

    def _accumulate(self, taken: Accumulate) -> list[str]:
        target = self.expression(taken.target)
        if taken.how == "+":
            return [f"{target} = {target} + {self._within(taken.value, _RANKS['+'] + 1)};"]
        return [f"{target} = {taken.how}({target}, {self.expression(taken.value)});"]

    def _verbatim(self, text: Verbatim) -> list[str]:
        written = ""
        for piece in text.pieces:
            if isinstance(piece, str):
                written += piece
            elif isinstance(piece, Expression):
                written += self.expression(piece)
            else:
                # statements stand as deep as the line that they begin
                pad = written[written.rfind("\n") + 1 :]
                depth = len(pad) // 4 if not pad.strip() else 0
                written += "\n".join(self.lines(piece, depth))[len(pad) if depth else 0 :]
        return written.splitlines()
