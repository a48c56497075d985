"""Records of kernels: their text and their names."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cnnum
from cnnum.engines.opencl.transients.strategies import STRATEGIES
from cnnum.graph.nodes import RunSpec
from cnnum.kernels.expressions import (
    CELL,
    ONE,
    Binary,
    Choice,
    Integer,
    Load,
    Name,
    Negative,
    Number,
    after,
    call,
    formula,
    shifted,
)
from cnnum.kernels.number_types import FLOAT32, FLOAT64, in_vectors
from cnnum.kernels.printer import OpenCLPrinter
from cnnum.kernels.statements import (
    Accumulate,
    Assign,
    Store,
    Verbatim,
    fixed,
    uses,
)

PRINTER = OpenCLPrinter(FLOAT64)
A, B, X, TOTAL = Name("a"), Name("b"), Name("x"), Name("total")

NUMBERS = st.integers(-9, 9).map(Integer)
TREES = st.recursive(
    NUMBERS,
    lambda inner: st.one_of(
        st.builds(Binary, st.sampled_from("+-*"), inner, inner), st.builds(Negative, inner)
    ),
    max_leaves=12,
)


def value(tree):
    """The value of a tree of whole numbers, without its text."""
    if isinstance(tree, Integer):
        return tree.value
    if isinstance(tree, Negative):
        return -value(tree.value)
    left, right = value(tree.left), value(tree.right)
    return {"+": left + right, "-": left - right, "*": left * right}[tree.sign]


@settings(max_examples=200, deadline=None)
@given(TREES)
def test_brackets_keep_the_tree(tree):
    """C and Python bind these signs alike; C has no `--` of two negations, and nor have we."""
    text = PRINTER.expression(tree)
    assert eval(text) == value(tree)
    assert "--" not in text


@pytest.mark.parametrize(
    ("tree", "text"),
    [
        (A - (B - X), "a - (b - x)"),
        ((A - B) - X, "a - b - x"),
        (-(A * B), "-(a * b)"),
        (Choice(A < B, A, B) + 1, "(a < b ? a : b) + 1"),
        (((A < B) & (B < X)) | A.equals(B), "a < b && b < x || a == b"),
        (X[CELL + 1] * Number(0.1), "x[i + 1] * R(0.1)"),
    ],
)
def test_expressions_are_written_as_c(tree, text):
    assert PRINTER.expression(tree) == text


def test_a_number_is_rounded_to_the_type_of_its_kernel():
    third = Number(1.0 / 3.0)
    single = OpenCLPrinter(FLOAT32).expression(third)
    assert np.float32(single[2:-2]) == np.float32(1.0 / 3.0)
    assert float(PRINTER.expression(third)[2:-1]) == 1.0 / 3.0
    assert PRINTER.expression(Number(-0.0)) == "R(-0.0)"
    assert PRINTER.expression(Number(0.0)) == "R(0.0)"
    with pytest.raises(cnnum.CnnumError, match="finite"):
        OpenCLPrinter(FLOAT32).expression(Number(1e39))


def test_formulas_of_lower_rooms_become_records():
    assert formula("clamp(x, -ONE, ONE)", x=A) == call("clamp", A, -ONE, ONE)
    assert PRINTER.expression(formula("a - b", a=A, b=A - B)) == "a - (a - b)"
    assert PRINTER.expression(formula("R(0.5) * x", x=A)) == "R(0.5) * a"
    assert PRINTER.expression(formula("x - 2.f * 1e-3f", x=A)) == "a - 2.f * 1e-3f"
    with pytest.raises(SyntaxError):
        formula("x if x else x", x=A)


def test_a_cell_beside_is_another_place():
    assert PRINTER.expression(shifted(X[Integer(8) + CELL] * ONE, 3)) == "x[8 + i + 3] * ONE"
    assert PRINTER.expression(after(A * 4, Integer(2) + CELL)) == "a * 4 + 2 + i"


def test_names_of_statements_are_fields():
    body = (fixed(A, X[CELL]), Accumulate(TOTAL, "+", A), Assign(B, ONE), Verbatim(("f(", X, ");")))
    found = uses(body)
    assert found.names == ("x", "i", "total", "b")
    assert found.taken_in == {"total": "+"}
    assert found.changed == {"b"}


def test_every_scheme_has_a_strategy_that_always_fits():
    """The last of each kind asks for nothing."""
    schemes = {scheme for strategy in STRATEGIES for scheme in strategy.schemes}
    for scheme in schemes:
        last = [strategy for strategy in STRATEGIES if scheme in strategy.schemes][-1]
        assert last.fits(None, None)


@pytest.mark.parametrize(
    ("how", "shape", "words"),
    [
        ({"method": "euler", "dt": 0.1}, (8, 8), "rows in registers in private memory of one"),
        ({"method": "dormand-prince"}, (8, 8), "rolled stages in private memory"),
        ({"method": "heun", "dt": 0.1}, (40, 40), "strips in global memory of one work item"),
        ({"method": "euler", "dt": 0.1}, (260, 260), "strips of states in kernels of many"),
    ],
)
def test_a_plan_says_how_its_transients_run(how, shape, words, opencl):
    spec = RunSpec(duration=2.0, **how)

    @cnnum.program
    def weak(frame):
        template = cnnum.Template("weak", [[0, 0.1, 0], [0.1, 0.3, 0.1], [0, 0.1, 0]], [[1.0]])
        return {"y": cnnum.transient(template, input=frame.channel("a"), spec=spec).outputs[0]}

    (said,) = opencl.compile(weak, shape, channels=("a",)).explain().transients
    assert words in said


def test_the_arithmetic_of_large_arrays_is_printed_for_vectors():
    """The records are those of small arrays; the printer knows the type and its functions."""
    statement = Store(X + 8 + A, Load(B + A) * Number(0.5) + call("clamp", TOTAL, A, B))
    printer = OpenCLPrinter(in_vectors(FLOAT32), {"clamp": "between"})
    assert printer.lines([statement]) == [
        "*(__global vec *)(x + 8 + a) = "
        "*(__global const vec *)(b + a) * (vec)(0.5f) + between(total, a, b);"
    ]
    assert set(uses((statement,)).names) == {"x", "a", "b", "total"}
