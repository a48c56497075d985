"""Errors that engines state in chaos, where they grow, against 40 digits of the same circuit.

Chua's circuit with the double scroll (Chua, Komuro & Matsumoto, IEEE Trans. CAS 33 (1986)) is
linear in each of three ranges of x. There a Taylor series of 33 terms is exact to 40 digits at
steps of 1/32: rates are below 20, so that its next term is (20/32)³⁴/34! < 1e-45 of the state.
Crossings are halved 120 times.
"""

import numpy as np
import pytest

from cnnum import Template
from cnnum.engine import Engine
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import Table

mpmath = pytest.importorskip("mpmath")

ALPHA, BETA, INNER, OUTER = 9.0, 14.286, -1.0 / 7.0, 2.0 / 7.0
BEND = ALPHA * (OUTER - INNER)
A = np.array([[1.0 - ALPHA * OUTER, ALPHA, 0.0], [1.0, 0.0, 1.0], [0.0, -BETA, 1.0]])
START = np.array([0.3, -0.1, 0.05])
TIMES = (4.0, 12.0, 20.0)


@pytest.fixture(scope="module")
def truth():
    """The state at each of the times."""
    with mpmath.workdps(40):
        return dict(_states())


def _states():
    rates = mpmath.matrix(A.tolist()) - mpmath.eye(3)
    state, time = mpmath.matrix(START.tolist()), mpmath.mpf(0)
    for end in TIMES:
        while time < end:
            step, within = min(mpmath.mpf(1) / 32, end - time), _range(state)
            after = _taylor(rates, state, step, within)
            if _range(after) != within:
                low, high = mpmath.mpf(0), step
                for _ in range(120):
                    middle = (low + high) / 2
                    inside = _range(_taylor(rates, state, middle, within)) == within
                    low, high = (middle, high) if inside else (low, middle)
                after, step = _taylor(rates, state, high, within), high
            state, time = after, time + step
        yield end, np.array([float(number) for number in state])


def _range(state):
    return int(state[0] > 1) - int(state[0] < -1)


def _taylor(rates, state, step, within):
    """The circuit's diode adds BEND · x between −1 and 1, and ±BEND beyond."""
    term = total = state
    for power in range(1, 34):
        rate = rates * term
        if within == 0:
            rate[0] += BEND * term[0]
        elif power == 1:
            rate[0] += within * mpmath.mpf(BEND)
        term = rate * (step / power)
        total = total + term
    return total


@pytest.mark.parametrize("time", TIMES)
@pytest.mark.parametrize(
    "label", ["reference", "numba float64", "numba float32", "opencl float64", "opencl float32"]
)
def test_the_stated_error_covers_the_true_one_in_chaos(request, truth, label, time):
    name, _, precision = label.partition(" ")
    if name == "opencl":
        request.getfixturevalue("opencl")
    diode = NonlinearCoupling(np.ones((1, 1)), Table("linear", ((-1.0, -BEND), (1.0, BEND))), "x")
    template = Template(
        "chua", A[:, :, np.newaxis, np.newaxis], nonlinear=[diode], output="linear", duration=time
    )
    state = START[:, np.newaxis, np.newaxis]
    run = Engine(name, precision=precision or None).run(template, state=state)
    off = np.abs(run.state[:, 0, 0] - truth[time]).max()
    assert off <= run.error
    # measured 9e-7, 1.3e-7 and 3.1e-6, of steps at 1e-10; the adaptive engines' grow without end
    assert name != "reference" or run.error < 1e-5
