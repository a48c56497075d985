"""The printer of C99: the type of every operation, and the passes before it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cnnum.kernels import (
    CELL,
    ROUND,
    Accumulate,
    Assign,
    Binary,
    Call,
    Choice,
    Counted,
    Element,
    Integer,
    Loop,
    Name,
    Negative,
    Number,
    add,
    declare,
    fixed,
    grid,
    sweep,
)
from cnnum.kernels.kernel_split import substituted
from cnnum.kernels.number_types import FLOAT32
from cnnum.kernels.printer import C99Printer, OpenCLPrinter
from cnnum.kernels.statements import live

NARROW, WIDE = (-(2**31), 2**31 - 1), (-(2**40), 2**40)
A, B, W = Name("a", NARROW), Name("b", NARROW), Name("w", WIDE)
PRINTER = C99Printer(FLOAT32, {"x": "m->x"}, {"x": "int8_t"}, {"limit32", "limit64", "limit_real"})

TREES = st.recursive(
    st.integers(-9, 9).map(Integer),
    lambda inner: st.one_of(
        st.builds(Binary, st.sampled_from("+-*"), inner, inner), st.builds(Negative, inner)
    ),
    max_leaves=12,
)


@settings(max_examples=100, deadline=None)
@given(TREES)
def test_both_targets_write_the_same_value(tree):
    assert eval(PRINTER.expression(tree)) == eval(OpenCLPrinter(FLOAT32).expression(tree))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Binary("+", A, B, NARROW), "a + b"),
        (Binary("*", A, B, WIDE), "(int64_t)a * (int64_t)b"),
        (Binary("-", W, W, NARROW), "(int32_t)(w - w)"),
        (Binary(">", W, A, (0, 1)), "w > (int64_t)a"),
        (Binary(">>", Binary("+", W, Integer(4), WIDE), Integer(3), WIDE), "(w + 4) >> 3"),
        (Choice(A, W, B, WIDE), "a ? w : (int64_t)b"),
        (Call("limit", (W, Integer(-8), Integer(7)), (-8, 7)), "(int32_t)limit64(w, (-8), 7)"),
        (Call("limit", (A, Integer(-8), Integer(7)), (-8, 7)), "limit32(a, (-8), 7)"),
        (Binary("*", Name("f"), Number(-0.1)), "f * (-0.1f)"),
        (Integer(2**40), "INT64_C(1099511627776)"),
        (Integer(-(2**31)), "(-2147483647 - 1)"),
    ],
)
def test_an_operation_has_the_type_that_its_intervals_need(value, text):
    assert PRINTER.expression(value) == text


def test_statements_are_written_as_c99():
    body = (
        declare(A, 0),
        Counted(ROUND, 0, 9, A, (Assign(Element(Name("x"), Integer(2)), B),)),
        Accumulate(A, "+", B),
    )
    assert PRINTER.lines(body) == [
        "int32_t a = 0;",
        "for (int32_t n = 0; n < 9 && a; ++n) {",
        "    m->x[2] = (int8_t)b;",
        "}",
        "a = a + b;",
    ]


def test_a_variable_that_nothing_reads_is_left_out():
    x, total = Element(Name("x"), CELL), Name("total", WIDE)
    lost = [declare(total, 0), Loop(Name("j"), 3, (add(total, B),))]
    kept = [fixed(A, Integer(3)), sweep(CELL, 4, [Assign(x, A)])]
    assert live([*lost, *kept], set()) == tuple(kept)
    found = live([*lost, sweep(CELL, 4, [Assign(x, total)])], set())
    assert found[:2] == tuple(lost)
    # of the places in a grid only those that are read
    lines = "\n".join(PRINTER.lines(live([grid(2, 3, 1, [Assign(x, A)])], set())))
    assert "i = " in lines
    assert "p = " not in lines


def test_a_loop_that_reads_its_own_variable_keeps_no_other_of_that_name():
    x, i = Element(Name("x"), CELL), Name("i")
    before = Loop(Name("c"), 3, (fixed(i, Integer(3)), Assign(Name("x")[Integer(0)], A)))
    body = live([before, sweep(CELL, 4, [Assign(x, A)])], set())
    assert body[0] == Loop(Name("c"), 3, (before.body[1],))
    # one from outside stays, for a statement after the loop reads it
    kept = [fixed(CELL, Integer(3)), sweep(CELL, 4, [Assign(x, A)]), Assign(x, A)]
    assert live(kept, set()) == tuple(kept)


def test_other_expressions_stand_in_the_places_of_names():
    statement = sweep(CELL, 4, [Assign(Name("y")[CELL], A + B)])
    other = substituted(statement, {"a": Number(1.0), "y": Name("z")})
    assert other == sweep(CELL, 4, [Assign(Name("z")[CELL], Number(1.0) + B)])
    assert substituted(statement, {}) == statement
