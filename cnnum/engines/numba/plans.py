"""From a template, its array and its solver to the arguments of the compiled functions."""

import ast
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.engines.numba import codes
from cnnum.engines.numba.coefficients import chebyshev_rows, tableaux
from cnnum.engines.numba.layout import Layout
from cnnum.engines.numba.methods import method_settings
from cnnum.engines.numba.records import SETTINGS, Plan, Real
from cnnum.engines.numba.stencil import couplings_of, gains_of, packed
from cnnum.integrators.solver import Solver
from cnnum.templating.reads import reads_states
from cnnum.templating.template import Template

RESPONSES = {
    "standard": codes.CLAMP,
    "full-range": codes.CLAMP,
    "linear": codes.IDENTITY,
    "tanh": codes.TANH,
    "sign": codes.SIGN,
}
"""Output functions that have a compiled form; others run by their expressions."""


FUNCTIONS = {
    "exp": codes.EXP,
    "fabs": codes.FABS,
    "log": codes.LOG,
    "sqrt": codes.SQRT,
    "tanh": codes.TANH_OF,
    "R": codes.REAL,
    "fmax": codes.FMAX,
    "fmin": codes.FMIN,
    "pow": codes.POW,
    "clamp": codes.WITHIN,
    "PICK": codes.PICK,
}
SIGNS: dict[type, int] = {
    ast.Add: codes.ADD,
    ast.Sub: codes.SUBTRACT,
    ast.Mult: codes.MULTIPLY,
    ast.Div: codes.DIVIDE,
    ast.Lt: codes.LESS,
    ast.LtE: codes.NOT_MORE,
    ast.Gt: codes.MORE,
    ast.GtE: codes.NOT_LESS,
    ast.Eq: codes.EQUAL,
    ast.NotEq: codes.OTHER,
}
"""Codes of the parts of an expression."""

# Python has no numbers that end with an f
_SUFFIX = re.compile(r"(?<=[0-9.])f\b")

Step = tuple[float, float]


def plan_of(template: Template, layout: Layout, solver: Solver, dtype: Real) -> Plan:
    """Return a template on an array, and how it runs."""
    couplings = couplings_of(template, layout)
    gains = gains_of(template, couplings)
    taps, first = couplings.packed_taps()
    tables, points = couplings.packed_tables(dtype)
    cells = {
        "layers": template.layers,
        "size": layout.size,
        "response": RESPONSES.get(template.output.name, codes.EXPRESSION),
        "limited": template.output.limited,
        "reads_states": reads_states(template),
    }
    return Plan(
        settings=packed(SETTINGS, [cells | method_settings(template, solver, dtype)]),
        tableau=tableaux(solver),
        taps=taps,
        first=first,
        tables=tables,
        points=points,
        gains=gains,
        rim=layout.rim(template.boundary),
        bands=layout.bands(template.layers),
        chebyshev=chebyshev_rows(solver, dtype),
        formula=_formula(template, dtype),
    )


def _formula(template: Template, dtype: Real) -> NDArray[np.float64]:
    if template.output.name in RESPONSES:
        return np.zeros((0, 2))
    return operations(template.output.opencl, dtype)


def operations(expression: str, dtype: np.dtype[Any]) -> NDArray[np.float64]:
    """Return (operations, 2) numbers: the code of each, and the number that is pushed.

    Parameters
    ----------
    expression : str
        Of `x`, as `cnnum.safety.expressions` has it.
    dtype : dtype
        Its largest number is `HUGE`.
    """
    words = {"ONE": 1.0, "ZERO": 0.0, "HUGE": float(np.finfo(dtype).max)}
    tree = ast.parse(_SUFFIX.sub("", expression), mode="eval").body
    return np.array(_steps(tree, words), dtype=np.float64)


def _steps(node: ast.AST, words: dict[str, float]) -> list[Step]:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return [(codes.TAKE_NUMBER, float(node.value))]
    if isinstance(node, ast.Name):
        return [(codes.TAKE_STATE, 0.0) if node.id == "x" else (codes.TAKE_NUMBER, words[node.id])]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        what, operands = FUNCTIONS[node.func.id], node.args
    elif isinstance(node, ast.UnaryOp):
        what, operands = codes.NEGATE, [node.operand]
    elif isinstance(node, ast.BinOp):
        what, operands = SIGNS[type(node.op)], [node.left, node.right]
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        what, operands = SIGNS[type(node.ops[0])], [node.left, *node.comparators]
    else:
        raise SyntaxError(f"An expression has a part that no engine has: {ast.unparse(node)!r}.")
    return [*(step for operand in operands for step in _steps(operand, words)), (what, 0.0)]
