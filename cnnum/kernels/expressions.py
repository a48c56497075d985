"""Expressions of a kernel, as records built with Python's operators.

    rate = (drive - x[i]) * tau        # is Binary("*", Binary("-", drive, Element(x, i)), tau)

A number is exact: the printer rounds it to the number type of its kernel. Integers may have
`bounds`, the interval that they cannot leave, from which a printer chooses a wide enough type.

Expressions that lower rooms hold as text, such as output functions, as records.

`cnnum.safety.values` lists their parts. Python's own parser reads them.
"""

import ast
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

Bounds = tuple[int, int]
"""The smallest and the largest value of a whole number."""


class Expression:
    """An expression with a value; operands may be whole numbers of Python, too."""

    __slots__ = ()

    bounds: Bounds | None = None
    """The interval of a whole number, if it is known."""

    def __add__(self, other: "Operand") -> "Binary":
        return Binary("+", self, operand(other))

    def __radd__(self, other: "Operand") -> "Binary":
        return Binary("+", operand(other), self)

    def __sub__(self, other: "Operand") -> "Binary":
        return Binary("-", self, operand(other))

    def __mul__(self, other: "Operand") -> "Binary":
        return Binary("*", self, operand(other))

    def __rmul__(self, other: "Operand") -> "Binary":
        return Binary("*", operand(other), self)

    def __truediv__(self, other: "Operand") -> "Binary":
        return Binary("/", self, operand(other))

    def __mod__(self, other: "Operand") -> "Binary":
        return Binary("%", self, operand(other))

    def __lt__(self, other: "Operand") -> "Binary":
        return Binary("<", self, operand(other))

    def __le__(self, other: "Operand") -> "Binary":
        return Binary("<=", self, operand(other))

    def __gt__(self, other: "Operand") -> "Binary":
        return Binary(">", self, operand(other))

    def __ge__(self, other: "Operand") -> "Binary":
        return Binary(">=", self, operand(other))

    def __and__(self, other: "Expression") -> "Binary":
        return Binary("&&", self, other)

    def __or__(self, other: "Expression") -> "Binary":
        return Binary("||", self, other)

    def __neg__(self) -> "Negative":
        return Negative(self)

    def equals(self, other: "Operand") -> "Binary":
        """Return a comparison of two expressions; Python's own operator compares the records."""
        return Binary("==", self, operand(other))

    def differs(self, other: "Operand") -> "Binary":
        """Return whether they are not the same."""
        return Binary("!=", self, operand(other))


Operand = Expression | int


@dataclass(frozen=True, slots=True)
class Name(Expression):
    """A variable or an array, depending on where it is used."""

    text: str
    bounds: Bounds | None = None

    def __getitem__(self, at: Operand) -> "Element":
        return Element(self, operand(at))


def names(words: str) -> list[Name]:
    """Return variables with these names, which are separated by blanks."""
    return [Name(word) for word in words.split()]


@dataclass(frozen=True, slots=True)
class Constant(Expression):
    """A word of every kernel, such as `ONE`, or a literal as it is written."""

    text: str


@dataclass(frozen=True, slots=True)
class Integer(Expression):
    """A whole number: a place, or a count."""

    value: int

    @property
    def bounds(self) -> Bounds:  # type: ignore[override]  # pyright: ignore[reportIncompatibleVariableOverride]
        """The number itself."""
        return self.value, self.value


@dataclass(frozen=True, slots=True)
class Number(Expression):
    """A number that is rounded to the kernel's type."""

    value: float


@dataclass(frozen=True, slots=True)
class Element(Expression):
    """An array element."""

    array: Name
    at: Expression
    bounds: Bounds | None = None


@dataclass(frozen=True, slots=True)
class Component(Expression):
    """A vector component."""

    vector: Name
    lane: int


@dataclass(frozen=True, slots=True)
class Load(Expression):
    """The vector `vec` of numbers that begins at a place of global memory."""

    place: Expression


@dataclass(frozen=True, slots=True)
class Call(Expression):
    """The result of a function of the kernel; `within` is the interval of intermediate values."""

    function: str
    arguments: tuple[Expression, ...]
    bounds: Bounds | None = None
    within: Bounds | None = None


@dataclass(frozen=True, slots=True)
class Binary(Expression):
    """Two operands and a C operator between them."""

    sign: str
    left: Expression
    right: Expression
    bounds: Bounds | None = None


@dataclass(frozen=True, slots=True)
class Negative(Expression):
    """The operand with its sign reversed."""

    value: Expression
    bounds: Bounds | None = None


@dataclass(frozen=True, slots=True)
class Choice(Expression):
    """One of two, by a condition that is the same in all lanes."""

    condition: Expression
    yes: Expression
    no: Expression
    bounds: Bounds | None = None


@dataclass(frozen=True, slots=True)
class Cast(Expression):
    """A number of another type of the kernel's."""

    type: str
    value: Expression
    bounds: Bounds | None = None


ZERO, ONE, HUGE = Constant("ZERO"), Constant("ONE"), Constant("HUGE")
CELL, PLACE, ROUND = Name("i"), Name("p"), Name("n")
ROW, COL = Name("r"), Name("c")
"""Variables of loops: a cell, its place in a padded array, a step; a row, a column."""


def operand(value: Operand) -> Expression:
    """Return an expression unchanged, and a whole number as an expression."""
    return Integer(value) if isinstance(value, int) else value


def operands(value: Expression) -> tuple[Expression, ...]:
    """Return the expressions that an expression is made of, but for arrays."""
    if isinstance(value, Binary):
        return value.left, value.right
    if isinstance(value, Call):
        return value.arguments
    if isinstance(value, Element):
        return (value.at,)
    if isinstance(value, Choice):
        return value.condition, value.yes, value.no
    return (value.value,) if isinstance(value, Negative | Cast) else ()


def call(function: str, *arguments: Operand) -> Call:
    """Return the result of a function."""
    return Call(function, tuple(operand(argument) for argument in arguments))


def pick(condition: Expression, yes: Expression, no: Expression) -> Call:
    """Return an expression that selects one of two in each lane."""
    return call("PICK", condition, yes, no)


def clip(value: Expression) -> Call:
    """Return a value kept within −1 and 1."""
    return call("clamp", value, -ONE, ONE)


def size(value: Expression) -> Call:
    """Return |value|."""
    return call("fabs", value)


def real(value: Operand) -> Call:
    """Return a value as a number of the kernel's type."""
    return call("R", value)


def total(terms: Sequence[Expression]) -> Expression:
    """Return the sum of terms in their order, 0 of none."""
    if not terms:
        return ZERO
    expression = terms[0]
    for term in terms[1:]:
        expression = expression + term
    return expression


def after(start: Expression, at: Operand) -> Expression:
    """Return the place that comes so far after another one: their sum, without brackets."""
    if isinstance(at, Binary) and at.sign == "+":
        return after(start, at.left) + at.right
    return start + at


def shifted(expression: Expression, offset: int) -> Expression:
    """Return an expression of the cell that stands at a distance after `i`."""
    if expression == CELL:
        return CELL + offset
    if isinstance(expression, Element):
        return Element(expression.array, shifted(expression.at, offset))
    if isinstance(expression, Binary) and (expression.sign, expression.right) == ("+", CELL):
        return expression + offset
    if isinstance(expression, Binary):
        left, right = (shifted(side, offset) for side in (expression.left, expression.right))
        return Binary(expression.sign, left, right)
    if isinstance(expression, Call):
        inner = tuple(shifted(argument, offset) for argument in expression.arguments)
        return Call(expression.function, inner)
    if isinstance(expression, Negative | Cast):
        value = shifted(expression.value, offset)
        return Negative(value) if isinstance(expression, Negative) else Cast(expression.type, value)
    return expression


_SIGNS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/",
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
}  # fmt: skip


_LITERAL = re.compile(r"(?<![\w.])[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?f?")

Values = dict[str, Expression]

Reader = Callable[[Values], Expression]
"""The maker of an expression of the values of its variables."""


def formula(text: str, **values: Expression) -> Expression:
    """Return a formula as an expression of given variables.

    Raises
    ------
    SyntaxError
        If it is not a valid formula.
    """
    return _reader_of(text)(values)


@cache
def _reader_of(text: str) -> Reader:
    literals: dict[str, str] = {}

    def named(literal: re.Match[str]) -> str:
        name = f"_{len(literals)}"
        literals[name] = literal[0]
        return name

    # Python has no numbers that end with an f
    return _reader(ast.parse(_LITERAL.sub(named, text), mode="eval").body, literals)


def _reader(node: ast.expr, literals: dict[str, str]) -> Reader:
    """Return a reader of a part of a text, whose literals have names."""
    if isinstance(node, ast.Name):
        name, word = node.id, Constant(literals.get(node.id, node.id))
        return lambda values: values.get(name, word)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        function, arguments = node.func.id, [_reader(inner, literals) for inner in node.args]
        return lambda values: Call(function, tuple([read(values) for read in arguments]))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = _reader(node.operand, literals)
        return lambda values: Negative(value(values))
    if isinstance(node, ast.BinOp) and type(node.op) in _SIGNS:
        return _both(
            _SIGNS[type(node.op)], _reader(node.left, literals), _reader(node.right, literals)
        )
    if isinstance(node, ast.Compare):
        reader = _reader(node.left, literals)
        for sign, right in zip(node.ops, node.comparators, strict=True):
            reader = _both(_SIGNS[type(sign)], reader, _reader(right, literals))
        return reader
    raise SyntaxError(
        f"An expression contains something that kernels do not support: {ast.unparse(node)!r}."
    )


def _both(sign: str, left: Reader, right: Reader) -> Reader:
    return lambda values: Binary(sign, left(values), right(values))
