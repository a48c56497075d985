"""Records as text: OpenCL C, for a number type."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cnnum.kernels.expressions import (
    Binary,
    Call,
    Cast,
    Choice,
    Component,
    Constant,
    Element,
    Expression,
    Integer,
    Load,
    Name,
    Negative,
    Number,
    operand,
)
from cnnum.kernels.number_types import NumberType
from cnnum.kernels.statements import (
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
    Store,
    StripSteps,
    Sweep,
    Verbatim,
    While,
)

_CHOICE, _UNARY, _PRIMARY = 1, 9, 10
_RANKS = {
    "||": 2, "&&": 3, "|": 4, "==": 5, "!=": 5, "<": 6, "<=": 6, ">": 6, ">=": 6, "+": 7, "-": 7,
    "*": 8, "/": 8, "%": 8,
}  # fmt: skip
"""How tightly signs bind in C."""


@dataclass(frozen=True, slots=True)
class OpenCLPrinter:
    """Writes records as OpenCL C.

    Attributes
    ----------
    numbers : NumberType
    names : mapping of str to str
        Names, of functions too, that are written as others.
    """

    numbers: NumberType
    names: Mapping[str, str] = field(default_factory=dict[str, str])

    def expression(self, value: Expression) -> str:
        """Return the text of an expression."""
        return _EXPRESSIONS[type(value)](self, value)[0]

    def name(self, name: Name) -> str:
        """Return how a name is written."""
        return self.names.get(name.text, name.text)

    def lines(self, statements: Iterable[Statement], depth: int = 0) -> list[str]:
        """Return the lines of statements."""
        pad = "    " * depth
        return [
            pad + line if line and line[0] != "#" else line
            for statement in statements
            for line in self._written(statement)
        ]

    def within(self, value: Expression, least: int) -> str:
        """Return the text of an operand of a sign that binds so tightly."""
        text, rank = _EXPRESSIONS[type(value)](self, value)
        return text if rank >= least else f"({text})"

    # statements

    def _written(self, statement: Statement) -> list[str]:
        write = _STATEMENTS.get(type(statement))
        if write is not None:
            return write(self, statement)
        assert isinstance(statement, Block | Branch | Sweep | Loop | Counted | While)
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
            condition = f"{v} < {self.within(operand(statement.end), _RANKS['<'] + 1)}"
            return f"for (int {v} = {statement.start}; {condition}; {next})"
        condition = self.expression(statement.condition)
        return f"for (int {v} = {statement.start}; {condition}; ++{v})"


Ranked = tuple[str, int]
"""A text, and how tightly it binds."""


def _name(printer: OpenCLPrinter, name: Name) -> Ranked:
    return printer.names.get(name.text, name.text), _PRIMARY


def _constant(printer: OpenCLPrinter, word: Constant) -> Ranked:
    del printer
    return word.text, _PRIMARY


def _integer(printer: OpenCLPrinter, number: Integer) -> Ranked:
    del printer
    return str(number.value), _UNARY if number.value < 0 else _PRIMARY


def _number(printer: OpenCLPrinter, number: Number) -> Ranked:
    return printer.numbers.literal(number.value), _PRIMARY


def _element(printer: OpenCLPrinter, element: Element) -> Ranked:
    return f"{printer.name(element.array)}[{printer.expression(element.at)}]", _PRIMARY


def _component(printer: OpenCLPrinter, component: Component) -> Ranked:
    return f"{printer.name(component.vector)}.s{component.lane:x}", _PRIMARY


def _load(printer: OpenCLPrinter, load: Load) -> Ranked:
    return f"*(__global const vec *)({printer.expression(load.place)})", _UNARY


def _call(printer: OpenCLPrinter, call: Call) -> Ranked:
    inner = ", ".join([printer.expression(argument) for argument in call.arguments])
    return f"{printer.names.get(call.function, call.function)}({inner})", _PRIMARY


def _binary(printer: OpenCLPrinter, both: Binary) -> Ranked:
    rank = _RANKS[both.sign]
    left, right = printer.within(both.left, rank), printer.within(both.right, rank + 1)
    return f"{left} {both.sign} {right}", rank


def _negative(printer: OpenCLPrinter, negative: Negative) -> Ranked:
    return f"-{printer.within(negative.value, _PRIMARY)}", _UNARY


def _cast(printer: OpenCLPrinter, cast: Cast) -> Ranked:
    return f"({cast.type}){printer.within(cast.value, _UNARY)}", _UNARY


def _choice(printer: OpenCLPrinter, choice: Choice) -> Ranked:
    condition = printer.within(choice.condition, _CHOICE + 1)
    yes, no = printer.expression(choice.yes), printer.within(choice.no, _CHOICE)
    return f"{condition} ? {yes} : {no}", _CHOICE


_EXPRESSIONS: dict[type[Expression], Callable[[OpenCLPrinter, Any], Ranked]] = {
    Name: _name,
    Constant: _constant,
    Integer: _integer,
    Number: _number,
    Element: _element,
    Component: _component,
    Load: _load,
    Call: _call,
    Binary: _binary,
    Negative: _negative,
    Cast: _cast,
    Choice: _choice,
}


def _assign(printer: OpenCLPrinter, assign: Assign) -> list[str]:
    target, value = printer.expression(assign.target), printer.expression(assign.value)
    if (assign.sign, value) == ("+=", "1"):
        return [f"++{target};"]
    return [f"{target} {assign.sign} {value};"]


def _declare(printer: OpenCLPrinter, new: Declare) -> list[str]:
    parts = [
        name.text if value is None else f"{name.text} = {printer.expression(value)}"
        for name, value in new.variables
    ]
    return [f"{'const ' if new.fixed else ''}{new.type} {', '.join(parts)};"]


def _array(printer: OpenCLPrinter, array: Array) -> list[str]:
    if array.start is None:
        return [f"real {array.name.text}[{array.length}];"]
    return [f"__global real *const {array.name.text} = {printer.expression(array.start)};"]


def _store(printer: OpenCLPrinter, store: Store) -> list[str]:
    place, value = printer.expression(store.place), printer.expression(store.value)
    return [f"*(__global vec *)({place}) = {value};"]


def _accumulate(printer: OpenCLPrinter, taken: Accumulate) -> list[str]:
    target = printer.expression(taken.target)
    if taken.how == "+":
        return [f"{target} = {target} + {printer.within(taken.value, _RANKS['+'] + 1)};"]
    return [f"{target} = {taken.how}({target}, {printer.expression(taken.value)});"]


def _note(printer: OpenCLPrinter, note: Note) -> list[str]:
    del printer
    return [note.text]


def _strips(printer: OpenCLPrinter, steps: StripSteps) -> list[str]:
    levels = None if steps.levels is None else printer.expression(steps.levels)
    return [steps.strips.within(levels)]


def _verbatim(printer: OpenCLPrinter, text: Verbatim) -> list[str]:
    written = ""
    for piece in text.pieces:
        if isinstance(piece, str):
            written += piece
        elif isinstance(piece, Expression):
            written += printer.expression(piece)
        else:
            # statements stand as deep as the line that they begin
            pad = written[written.rfind("\n") + 1 :]
            depth = len(pad) // 4 if not pad.strip() else 0
            written += "\n".join(printer.lines(piece, depth))[len(pad) if depth else 0 :]
    return written.splitlines()


_STATEMENTS: dict[type, Callable[[OpenCLPrinter, Any], list[str]]] = {
    Assign: _assign,
    Declare: _declare,
    Array: _array,
    Store: _store,
    Accumulate: _accumulate,
    Note: _note,
    StripSteps: _strips,
    Verbatim: _verbatim,
}
"""All that have no body."""
