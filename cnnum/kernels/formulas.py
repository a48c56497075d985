"""Expressions that lower rooms hold as text, such as output functions, as records.

`cnnum.safety.names` lists their parts. Python's own parser reads them.
"""

import ast
import re
from collections.abc import Callable
from functools import cache

from cnnum.kernels.expressions import (
    Binary,
    Call,
    Constant,
    Expression,
    Negative,
)

_SIGNS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/",
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
}  # fmt: skip


_LITERAL = re.compile(r"(?<![\w.])[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?f?")

Values = dict[str, Expression]

Reader = Callable[[Values], Expression]
"""The maker of an expression of the values of its variables."""


def formula(text: str, **values: Expression) -> Expression:
    """Return the expression with its variables given.

    Raises
    ------
    SyntaxError
        If it is none.
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
        found = _reader(node.left, literals)
        for sign, right in zip(node.ops, node.comparators, strict=True):
            found = _both(_SIGNS[type(sign)], found, _reader(right, literals))
        return found
    raise SyntaxError(f"An expression has a part that kernels do not have: {ast.unparse(node)!r}.")


def _both(sign: str, left: Reader, right: Reader) -> Reader:
    return lambda values: Binary(sign, left(values), right(values))
