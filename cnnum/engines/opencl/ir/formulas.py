"""Expressions that lower rooms hold as text, such as output functions, as records.

`cnnum.expressions` says what they are made of. Python's own language has all of it, and reads it.
"""

import ast
from functools import cache

from cnnum.engines.opencl.ir.expressions import (
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


def formula(text: str, **values: Expression) -> Expression:
    """Return the expression with its variables given.

    Raises
    ------
    SyntaxError
        If it is none.
    """
    return _read(_parsed(text), text, values)


@cache
def _parsed(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


def _read(node: ast.expr, text: str, values: dict[str, Expression]) -> Expression:
    def read(inner: ast.expr) -> Expression:
        return _read(inner, text, values)

    if isinstance(node, ast.Name):
        return values[node.id] if node.id in values else Constant(node.id)
    if isinstance(node, ast.Constant):
        return Constant(ast.get_source_segment(text, node) or "")
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return Call(node.func.id, tuple(read(argument) for argument in node.args))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return Negative(read(node.operand))
    if isinstance(node, ast.BinOp) and type(node.op) in _SIGNS:
        return Binary(_SIGNS[type(node.op)], read(node.left), read(node.right))
    if isinstance(node, ast.Compare):
        found = read(node.left)
        for sign, right in zip(node.ops, node.comparators, strict=True):
            found = Binary(_SIGNS[type(sign)], found, read(right))
        return found
    raise SyntaxError(f"An expression has a part that kernels do not have: {text!r}.")
