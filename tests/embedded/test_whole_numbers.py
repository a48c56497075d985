"""Whole numbers against exact rational arithmetic: rounding, saturation, and intervals."""

from fractions import Fraction
from math import isqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cnnum.embedded.arithmetic import (
    PRIMITIVES,
    Fixed,
    Quantity,
    call,
    constant,
    cube_root,
    limited,
    quotient,
    root,
    shifted,
    significant,
)
from cnnum.embedded.emulator import Emulator
from cnnum.embedded.formats import Format, fitting, is_integer, precision_named
from cnnum.embedded.program import IntegerProgram
from cnnum.errors import NotSupportedError, UnknownNameError
from cnnum.kernels import Accumulate, Integer, Name

WORDS = st.integers(-(2**30), 2**30 - 1)
FRACTIONS = st.integers(0, 30)


def value_of(expression):
    """The emulator's value of an expression without variables."""
    return int(Emulator(IntegerProgram("none", (1, 1), {}, (), {})).value(expression))


def test_a_sum_in_single_precision_is_that_of_a_loop():
    """Also where a cell is infinite, as in C."""
    emulator = Emulator(IntegerProgram("none", (1, 3), {}, (), {}), single=True)
    for cells in ([1.0, np.inf, 2.0], [np.inf, 1.0, 2.0], [1e8, 1.0, -1e8]):
        emulator.values = {"sum": np.full((1, 1), 1.0), "cells": np.array([cells])}
        wanted = np.float32(1.0)
        for one in cells:
            wanted += np.float32(one)
        emulator.accumulate(Accumulate(Name("sum"), "+", Name("cells")))
        assert emulator.values["sum"].tolist() == [[float(wanted)]]


def exact(quantity):
    return Fraction(value_of(quantity.value)) / Fraction(2) ** quantity.fraction


def of(whole, fraction):
    return Quantity(Integer(whole), fraction)


@given(WORDS, st.integers(1, 40))
def test_a_shift_down_rounds_to_the_nearest_and_halves_up(whole, places):
    wanted = (Fraction(whole, 2**places) + Fraction(1, 2)).__floor__()
    assert value_of(shifted(Integer(whole), -places)) == wanted


@given(st.integers(-(2**61), 2**61), st.integers(-(2**61), 2**61))
def test_a_quotient_rounds_halves_away_from_zero(a, b):
    if b == 0:
        assert quotient(np.int64(a), np.int64(b)) == 0
        return
    sign = -1 if (a < 0) != (b < 0) else 1
    wanted = sign * (Fraction(abs(a), abs(b)) + Fraction(1, 2)).__floor__()
    assert quotient(np.int64(a), np.int64(b)) == wanted


@given(st.integers(-5, 2**62 - 1))
def test_roots_are_rounded_down(a):
    assert root(np.int64(a)) == isqrt(max(a, 0))
    found = int(cube_root(np.int64(a)))
    assert found**3 <= max(a, 0) < (found + 1) ** 3


@given(st.integers(4, 32), st.integers(-5, 40), st.floats(-1e3, 1e3))
def test_a_format_holds_the_nearest_number_or_saturates(bits, fraction, number):
    form = Format(bits, fraction)
    whole = form.quantised(number)
    off = abs(Fraction(whole) / Fraction(2) ** fraction - Fraction(number))
    if form.least < whole < form.largest:
        assert off <= Fraction(1, 2) / Fraction(2) ** fraction
    assert form.least <= whole <= form.largest


@given(st.integers(4, 31), st.floats(1e-4, 1e4))
def test_a_fitting_format_holds_its_range_with_the_last_bit_in_use(bits, largest):
    form = fitting(bits, largest)
    assert form.largest * form.step >= largest * (1 - 2.0 ** (1 - bits))
    assert form.largest * form.step / 2 < largest * 1.01


@given(WORDS, FRACTIONS, WORDS, FRACTIONS, st.integers(5, 30))
def test_sums_and_products_are_near_the_exact_ones(a, fa, b, fb, finest):
    """Each operand of a sum is rounded once at the most; a product as a whole."""
    arithmetic, one, two = Fixed(16), of(a, fa), of(b, fb)
    for which, wanted, roundings in (
        ("add", exact(one) + exact(two), 2),
        ("subtract", exact(one) - exact(two), 2),
        ("multiply", exact(one) * exact(two), 1),
    ):
        found = getattr(arithmetic, which)(one, two, finest)
        half = Fraction(1, 2) / Fraction(2) ** found.fraction
        assert abs(exact(found) - wanted) <= roundings * half
        assert found.fraction <= max(finest, 0)


@given(WORDS, FRACTIONS, WORDS.filter(bool), FRACTIONS, st.integers(5, 30))
def test_a_division_is_near_the_exact_one(a, fa, b, fb, finest):
    found = Fixed(16).divide(of(a, fa), of(b, fb), finest)
    half = Fraction(1, 2) / Fraction(2) ** found.fraction
    # where the dividend itself is moved down it is rounded, too
    slack = half / abs(exact(of(b, fb))) / 2 ** (fa - found.fraction - fb) if False else 0
    assert abs(exact(found) - exact(of(a, fa)) / exact(of(b, fb))) <= 2 * half + slack


@given(st.integers(0, 2**30 - 1), FRACTIONS, st.integers(5, 28))
def test_a_root_is_the_exact_one_rounded_down(a, fa, finest):
    found = Fixed(16).root(of(a, fa), finest)
    step = Fraction(1) / Fraction(2) ** found.fraction
    low = exact(found)
    # the radicand is rounded by half of a step squared at the most
    assert low * low <= exact(of(a, fa)) + step * step
    assert (low + step) ** 2 > exact(of(a, fa)) - step * step


@given(st.floats(-100.0, 100.0).filter(lambda number: abs(number) > 1e-6), st.integers(8, 31))
def test_a_constant_factor_keeps_its_bits(number, bits):
    whole, fraction = significant(Fraction(number), bits)
    assert abs(whole) < 1 << (bits - 1)
    relative = abs(Fraction(whole) / Fraction(2) ** fraction / Fraction(number) - 1)
    assert relative <= Fraction(1, 2 ** (bits - 1))


@given(WORDS, st.integers(2, 31))
def test_what_does_not_fit_saturates(whole, bits):
    form = Format(bits, 0)
    assert value_of(limited(Integer(whole), form.least, form.largest)) == max(
        form.least, min(form.largest, whole)
    )


@given(WORDS, WORDS, st.sampled_from(["add", "subtract", "multiply", "minimum", "maximum"]))
def test_intervals_hold_the_values(a, b, which):
    low, high = sorted((a, b))
    value = value_of(call(which, Integer(a), Integer(b)))
    bounds = PRIMITIVES[which].bounds([(low, high), (low, high)])
    assert bounds[0] <= value <= bounds[1]


def test_an_intermediate_beyond_64_bits_is_refused():
    with pytest.raises(NotSupportedError, match="64 bits"):
        shifted(call("multiply", Name("n", (0, 2**40)), Integer(2**20)), 10)


def test_an_interval_of_one_number_is_that_number():
    # a product of two constants overflowed in the C text, where both were of 32 bits
    assert call("multiply", Integer(-76_303_427), Integer(8192)) == Integer(-76_303_427 * 8192)
    assert call("multiply", Name("n", (0, 0)), Integer(2**58)) == Integer(0)


def test_powers_of_two_only_move_the_point():
    found = Fixed(16).multiply(of(12345, 10), constant(0.25), 30)
    assert found == Quantity(Integer(12345), 12)


def test_precisions_by_name():
    assert [precision_named(n).word for n in ("q15", "q7", "q3.12", "float32")] == [16, 8, 16, 0]
    assert precision_named("q3.12").stored(1e9) == Format(16, 12)
    assert precision_named("q15").memory == 31
    assert is_integer("q15")
    assert not is_integer("float32")
    for name in ("q2", "q40", "q20.20", "int8", ""):
        with pytest.raises(UnknownNameError, match=r"float32"):
            precision_named(name)


@pytest.mark.parametrize(
    ("which", "other", "wanted"),
    [
        ("greater", 7, 0),
        ("greater", 1, 1),
        ("at_least", 8, 0),
        ("at_least", 2, 1),
        ("equal", 8, 0),
        ("equal", 5, None),
    ],
)
def test_a_comparison_that_intervals_decide_is_a_constant(which, other, wanted):
    """Strict compilers refuse `n > 7` where no n of its type is above 7."""
    found = call(which, Name("n", (2, 7)), Integer(other))
    assert (found.value if isinstance(found, Integer) else None) == wanted
