"""Random programs on all engines, in all precisions and as compiled C, against plain NumPy.

A few in the suite; more for as long as `CNNUM_FUZZ` gives, and with the C of `make embedded`.
"""

import os
import shutil
import time

import numpy as np
import pytest

from cnnum.errors import FrameError, NoOpenCLError
from cnnum.lab.embedded.cortex_m import missing_tools
from tests.fuzz.conftest import SECONDS, TESTS
from tests.fuzz.program_oracle import EXPORTED, FLOAT32, FLOAT64, WHOLE, Oracle, V
from tests.fuzz.program_writer import Writer
from tests.fuzz.random_programs import Shard

LONG = SECONDS > 0.0 or "CNNUM_FRAMES" in os.environ


def engines():
    import cnnum

    try:
        cnnum.Engine("opencl")
    except NoOpenCLError:
        return ("reference", "numba")
    return ("reference", "opencl", "numba")


def test_random_programs_give_what_numpy_gives():
    shard = Shard(compiler=shutil.which("cc") or shutil.which("gcc"), engines=engines())
    began, seed = time.monotonic(), 40_000 if LONG else 20_000
    wait = max(60.0, SECONDS / max(TESTS[0], 1)) if LONG else 0.0
    for _ in range(2):
        shard.one(seed)
        seed += 1
    while time.monotonic() - began < wait:
        shard.one(seed)
        seed += 1
        if len(shard.pending) > 40:
            shard.compile()
    shard.compile()
    assert not shard.wrong, f"of {shard.tried} programs: {shard.wrong[:5]}"
    assert shard.exact > shard.compared // 2


@pytest.mark.skipif(not LONG or bool(missing_tools()), reason="make embedded")
@pytest.mark.parametrize("seed", range(50_000, 50_012))
def test_random_programs_have_the_same_bits_on_cores(seed):
    shard = Shard(compiler="cc", engines=())
    shard.one(seed)
    shard.on_cores(("m0", "m4"))
    assert not shard.wrong
    assert shard.compared


@pytest.mark.parametrize("rounding", [FLOAT64, FLOAT32, *WHOLE], ids=lambda one: one.name)
def test_a_wrong_number_is_found(rounding):
    """An answer that is off by a step, in any frame, is outside the bounds of most programs."""
    found = 0
    for seed in range(12):
        writer = Writer(seed)
        steps, _, outputs = writer.program()
        frames = writer.eighths(1, (13, 2, 3, 4, 2))
        measured = Oracle(steps, outputs)
        measured.run(frames)
        answers = Oracle(steps, outputs, rounding, (measured.later, measured.early)).run(frames)
        shard = Shard()
        changed = [{name: one.v + 0.5 for name, one in answer.items()} for answer in answers]
        shapes = [
            {k: (v[:, 0, 0] if v.shape[-1] == 1 else v) for k, v in one.items()} for one in changed
        ]
        shard.compare(seed, "a step away", shapes, answers)
        found += bool(shard.wrong)
        assert all(isinstance(one, V) for answer in answers for one in answer.values())
    assert found >= 10


@pytest.mark.parametrize("seed", [400_003, 401_674, 402_053])
def test_numbers_at_the_ends_of_formats(seed):
    """Too large for a float32, too small for one, and beyond the room of a word within a loop."""
    shard = Shard(engines=("reference", "numba"))
    shard.one(seed)
    assert not shard.wrong


def test_a_refusal_of_numbers_that_fit_is_wrong():
    one = V(np.zeros((2, 1, 1)), np.zeros((2, 1, 1)))
    error = FrameError("Output 'a' of program 'p' is not finite: the values are too large for it.")
    shard = Shard()
    shard.refuse(1, "float32", error, [{"a": one}])
    assert shard.wrong


def test_terms_of_a_template_are_added_in_any_order():
    """0.28125 − 0.3 is exact; with −0.3 first, each sum on the way is rounded."""
    shard = Shard(engines=("numba",))
    shard.some([542_048, 542_056])
    assert not shard.wrong


def test_a_constant_that_float32_rounds_has_a_bound_where_its_product_is_exact():
    """0.3 · 25/64 has seven binary places, but float32 holds another number than 0.3."""
    assert FLOAT32.constant(0.25) == 0.0 < FLOAT32.constant(0.3)
    shard = Shard(engines=("numba",))
    shard.one(40_021)
    assert not shard.wrong


def test_a_map_over_a_number_is_times_its_rounded_inverse_in_c():
    """1.125 / −3 is exact, and 1.125 · (1 / −3) is not."""
    oracle = Oracle((), {}, EXPORTED, ({}, {}))
    oracle.number, oracle.last, oracle.count, oracle.key = 0, False, 0, ()
    whole = V(np.full((1, 1, 1), 1.125), np.zeros((1, 1, 1)))
    number = V(np.full((1, 1, 1), -3.0), np.zeros((1, 1, 1)))
    found = oracle.divided(whole, number)
    assert found.v[0, 0, 0] == -0.375
    assert 2.0**-26 < found.off[0, 0, 0] < 2.0**-20
