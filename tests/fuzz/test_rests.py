"""Random networks that may settle: stated errors, certificates and bounds against an own oracle.

`make fuzz` takes its share of the minutes; `CNNUM_SEED` shifts the seeds, so that several runs add
up to more networks: `CNNUM_SEED=7 CNNUM_FUZZ=3600 pytest -s tests/fuzz/test_rests.py`.
"""

import importlib.util
import os
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import cnnum

SECONDS = float(os.environ.get("CNNUM_FUZZ", "0")) / 8.0
SEED = int(os.environ.get("CNNUM_SEED", "0"))
FEW = 40
PROVEN_OF = 10
"""Every so many of the networks have their proofs looked at, too: those take most of the time."""

_SPEC = importlib.util.spec_from_file_location("rests", Path(__file__).with_name("rests.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
rests = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(rests)


def test_stated_errors_and_proofs_of_rests_hold():
    """None states too little, proves what is not, or says that it rests where it does not."""
    engines = {
        "numba float64": cnnum.Engine("numba", precision="float64"),
        "numba float32": cnnum.Engine("numba", precision="float32"),
    }
    end, number, seen, wrong = time.monotonic() + SECONDS, 0, Counter(), []
    while number < FEW or time.monotonic() < end:
        case = rests.case_of(SEED, number)
        name = list(engines)[number % 2]
        result = rests.run(engines[name], case)
        proof = number % PROVEN_OF == 0
        if result is None:
            seen["refused"] += 1
        else:
            seen["known" if np.isfinite(result.error) else "unknown"] += 1
            seen["proven"] += int(proof and str(result.certified) == "proven")
            said = rests.judge(case, result, proof=proof)
            if said:
                wrong.append(f"seed {SEED}, number {number}, {name}, {case.kind}: {said}")
        number += 1
    print(f"{number} networks: {dict(seen)}, {len(wrong)} wrong")
    assert not wrong
    assert seen["known"] > 0.5 * number  # an infinite error everywhere would be right, too
    assert seen["proven"] > 0.4 * number / PROVEN_OF


@pytest.mark.parametrize("number", [3, 8, 14, 21])
def test_engines_mean_the_same_by_an_error(number):
    """Where two of them know their error, their states are as near as both say."""
    case = rests.case_of(77, number)
    found = {name: rests.run(cnnum.Engine(name), case) for name in ("opencl", "numba", "reference")}
    known = [one for one in found.values() if one is not None and np.isfinite(one.error)]
    for one in known:
        for other in known:
            off = np.abs(one.state - other.state).max()
            assert off <= one.error + other.error + 1e-7
            assert one.settled == other.settled
            assert one.stability == other.stability


@pytest.mark.parametrize("wrong", ["tiny", "zero", "elsewhere"])
def test_a_wrong_result_is_seen(wrong):
    """The judge fails for an error that is too small, and for another state."""
    case = rests.case_of(0, 1)
    engine = cnnum.Engine("numba", precision="float64")
    number = 1
    while True:
        case = rests.case_of(0, number)
        result = rests.run(engine, case)
        if result is not None and 1e-6 < result.error < 1e-2:
            break
        number += 1
    assert not rests.judge(case, result, proof=False)
    changed = {
        "tiny": {"state": result.state + 1.1e-3, "error": np.array(1e-9)},
        "zero": {"state": np.zeros_like(result.state), "error": np.array(0.0)},
        "elsewhere": {"state": result.state + 1.0},
    }[wrong]
    from dataclasses import replace

    assert rests.judge(case, replace(result, **changed), proof=False)
