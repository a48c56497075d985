"""Runs with a delay that end where a limited state comes to its limit: piecewise polynomials.

A cell with x' = w x(t - d) + z is, on each interval of the delay, the integral of the polynomial on
the one before. The root at which it comes to its limit is known, and how far it is from there.
"""

import os
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import cnnum
from cnnum.templating.couplings import DelayedCoupling

CASES = int(os.environ.get("CNNUM_ARRIVALS", "0"))
"""Runs of a long test, 5 to 10 a second."""

INTERVALS = 8


def arrival(w, z, start, delay):
    """Return the delays passed when |x| comes to 1, the time since then, and its polynomial.

    None if it does not come there within some intervals.
    """
    past, low = Polynomial([start]), start
    for number in range(INTERVALS):
        own = (w * past + z).integ(k=low)
        roots = np.concatenate([(own - 1.0).roots(), (own + 1.0).roots()])
        real = roots[np.abs(roots.imag) < 1e-12].real
        within = real[(real > 0.0) & (real <= delay)]
        if len(within):
            return number * delay, within.min(), own
        past, low = own, own(delay)
    return None


def drawn(rng):
    """Return a run that ends just before a cell comes to its limit, how it runs, and its state."""
    while True:
        w, z = rng.uniform(-4.0, 4.0), rng.normal() * rng.choice([0.0, 1.0])
        start = rng.uniform(-1.0, 1.0) * 10.0 ** rng.uniform(-2.0, -0.1)
        delay = 10.0 ** rng.uniform(-0.7, 0.5)
        came = arrival(w, z, start, delay)
        if came is None:
            continue
        passed, after, own = came
        rate = abs(own.deriv()(after))
        if rate < 1e-3:
            continue
        after -= 10.0 ** rng.uniform(-6.5, -2.0) / rate
        if after > 0.0 and passed > 0.0:
            break
    tolerance = float(10.0 ** rng.uniform(-6.0, -3.0))
    template = cnnum.Template(
        "arrives", [[1.0]], z=z, output="full-range", duration=passed + after,
        delayed=DelayedCoupling(delay, [[w]]),
    )  # fmt: skip
    return template, {"rtol": tolerance, "atol": tolerance}, start, own(after)


def covered(engine, run, place=0, **options):
    """Return whether the error of a run, or at a time of it, holds, and whether it is finite."""
    template, how, start, true = run
    result = engine.run(template, state=[[start]], **how, **options)
    error = float(np.ravel(result.error)[place])
    off = abs(float(np.ravel(result.state)[place]) - true)
    return off <= error, bool(np.isfinite(error))


@pytest.mark.parametrize("number", [58, 210])  # at the limit; just before it
@pytest.mark.parametrize("looked_at", [False, True])
def test_runs_that_end_before_an_arrival_that_their_steps_are_past(number, looked_at):
    """Runs in steps of any length come to the limit too early, and agree."""
    engine = cnnum.Engine("numba", precision="float64")
    run = drawn(np.random.default_rng([9, number]))
    end = run[0].duration
    # times so close that the cell is at its limit at all of them
    at = {"at": [end * (1.0 - 1e-9), end, 2.0 * end], "place": 1} if looked_at else {}
    assert covered(engine, run, **at) == (True, False)


def test_other_ends_of_a_limited_state_have_an_error():
    """Long before the arrival nothing has come to a limit; long after it, all has been there."""
    engine = cnnum.Engine("numba", precision="float64")
    template, how, start, _ = drawn(np.random.default_rng([9, 0]))
    for share in (0.4, 2.0):
        ended = replace(template, duration=share * template.duration)
        assert engine.run(ended, state=[[start]], **how).error < 1e-3


@pytest.mark.skipif(not CASES, reason="a long run: set CNNUM_ARRIVALS to a number of runs")
def test_no_error_before_an_arrival_is_below_the_true_one():
    engine, rng = cnnum.Engine("numba", precision="float64"), np.random.default_rng(1)
    verdicts = [covered(engine, drawn(rng)) for _ in range(CASES)]
    print(f"tried {CASES}, infinite {sum(not finite for _, finite in verdicts)}")
    assert all(right for right, _ in verdicts)
