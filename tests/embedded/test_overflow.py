"""No value overflows, at any inputs and memories: intervals against extreme frames."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cnnum.embedded.arithmetic import PRIMITIVES
from cnnum.embedded.emulator import Emulator, cleared
from cnnum.embedded.measuring import ranges, widest
from tests.embedded.conftest import cases, made, streams


class Watched(Emulator):
    """Notes the least and the largest whole number of every variable and array."""

    def _note(self, name, value):
        if self.sizes is not None:  # of a loop that adds up, the sum alone is noted
            self.sizes.setdefault(name, []).append((int(value.min()), int(value.max())))


CASES = cases(("slip", "twist"), ("q15", "q31"))


@cache
def program_of(name, precision):
    return made(name, precision, method="euler").program


def left(program, seed, kind):
    """Return the values that leave their intervals, in three frames of four streams.

    Inputs are at their ends or anywhere. Memories may have any content, as a fault may leave them.
    """
    random = np.random.default_rng(seed)
    state = cleared(program, 4)
    if kind == "memory":
        for one in program.of_kind("state"):
            low, high = one.bounds
            state[one.name] = random.integers(low, high, state[one.name].shape, endpoint=True)
    known = {}
    for one in ranges(program):
        low, high = known.get(one.name, one.bounds)
        known[one.name] = min(low, one.bounds[0]), max(high, one.bounds[1])
    found = set()
    for frame in range(3):
        inputs = {}
        for one in program.of_kind("input"):
            low, high = one.bounds
            anywhere = random.integers(low, high, (4, one.length), endpoint=True)
            ends = np.where(anywhere > 0, high, low)
            inputs[one.name] = ends if kind == "ends" else anywhere
        watched = Watched(program, sizes={})
        watched.run(inputs, state, first=frame == 0)
        for name, seen in watched.sizes.items():
            low, high = known[name]
            found |= {name} if any(least < low or most > high for least, most in seen) else set()
    return found


@pytest.mark.parametrize(("name", "precision"), CASES)
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["ends", "any", "memory"]))
def test_no_value_leaves_its_interval(name, precision, seed, kind):
    assert not left(program_of(name, precision), seed, kind)


def test_values_leave_their_intervals_where_nothing_saturates(monkeypatch):
    unlimited = replace(PRIMITIVES["limit"], numpy=lambda value, low, high: value)
    monkeypatch.setitem(PRIMITIVES, "limit", unlimited)
    assert left(program_of("slip", "q15"), 0, "ends")


def test_all_that_lies_on_the_way_fits():
    programs = [program_of(name, "q15") for name in ("slip", "twist")]
    assert all(one.bits <= 64 for program in programs for one in ranges(program))
    assert any(one.saturates for one in ranges(programs[0]))
    assert not all(one.saturates for one in ranges(programs[0]))


def test_the_export_prints_the_intervals():
    text = made("twist", "q15").export(streams((8, 8))[:4, 0]).files["ranges.txt"]
    assert "none overflows" in text
    assert "in_normal" in text
    assert text.count("cannot be left") > 20


def test_a_sum_before_its_shift_is_counted():
    from cnnum.embedded.arithmetic import call, shifted
    from cnnum.kernels import Integer, Name

    product = call("multiply", Name("n", (0, 2**30)), Integer(2**30 + 1))
    assert widest(shifted(product, -40)) == 62
