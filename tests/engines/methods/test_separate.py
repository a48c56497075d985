"""Cells that see only themselves are solved without a step: held to many small Runge-Kutta steps.

The steps are written here, and know nothing of pieces. Where f has its kinks, their error is of the
order of the square of a step. That is (3/4000)² · rate < 4e-6 for the templates below.
"""

import numpy as np
import pytest

import cnnum
from cnnum.integrators.closed_forms import LONGEST, Separate, separate

STEPS = 4000
TOLERANCE = {"float64": 4e-6, "float32": 4e-5}
"""float32 adds its rounding (1e-7), grown by e^{(a−1)T} ≤ e^3 = 20 on the way out of the middle."""


def template(a, duration, tau=1.0, **more):
    A, B = np.zeros((3, 3)), np.zeros((3, 3))
    A[1, 1], B[1, 1] = a, 1.0
    return cnnum.Template("own", A, B, 0.1, tau=tau, duration=duration, **more)


def stepped(a, drive, start, time):
    x, h = start.copy(), time / STEPS

    def rate(x):
        return -x + a * np.clip(x, -1.0, 1.0) + drive

    for _ in range(STEPS):
        k1 = rate(x)
        k2 = rate(x + 0.5 * h * k1)
        k3 = rate(x + 0.5 * h * k2)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(x + h * k3))
    return x


@pytest.fixture(scope="module")
def start_and_input():
    rng = np.random.default_rng(11)
    start, given = rng.uniform(-3.0, 3.0, (2, 18, 5, 6))
    start[0, 0] = [1.0, -1.0, 0.0, 1.0, -1.0, 3.0]  # at the kinks too
    return start, given


OWN = (-3.0, -0.5, 0.5, 1.0, 1.3, 2.0)
TIMES = (0.2, 3.0)
CASES = [
    (engine, precision, a, TIMES[(n + m) % 2] if engine == "opencl" else time)
    for n, a in enumerate(OWN)
    for m, precision in enumerate(TOLERANCE)
    for engine, times in (("opencl", TIMES[:1]), ("numba", TIMES))
    for time in times
]
"""OpenCL builds a kernel for each: a weight takes one time in each precision, both times in all."""


@pytest.mark.one_in(5)
@pytest.mark.parametrize(("engine", "precision", "a", "time"), CASES)
def test_state_is_that_of_small_steps(engine, precision, a, time, start_and_input):
    start, given = start_and_input
    engine = cnnum.Engine(engine, precision=precision)
    got = engine.run(template(a, time), input=given, state=start)
    assert (got.method, np.max(got.steps)) == ("propagator", 0)
    want = stepped(a, given + 0.1, start, time)
    np.testing.assert_allclose(got.state, want, atol=TOLERANCE[precision])
    # rounding is stated, and no more than it can be: 8 roundings of numbers below 10
    # that grow by e^3
    rounding = np.finfo(precision).eps
    assert np.all(got.error > rounding)
    assert np.all(got.error < 8 * 10 * 20 * rounding)


def test_one_frame_is_as_a_batch(start_and_input):
    """A single frame runs in other lanes, and elsewhere."""
    start, given = start_and_input
    engine, own = cnnum.Engine(), template(2.0, 3.0)
    one = engine.run(own, input=given[4], state=start[4])
    all_of_them = engine.run(own, input=given, state=start)
    # two roundings of numbers below 4, grown by e^3
    np.testing.assert_allclose(one.state, all_of_them.state[4], atol=2e-5)


@pytest.mark.parametrize("engine", ["opencl", "numba"])
@pytest.mark.parametrize("a", [-0.5, 0.5, 2.0])
def test_rest_is_where_nothing_changes(engine, a, start_and_input):
    start, given = start_and_input
    engine = cnnum.Engine(engine, precision="float64")
    got = engine.run(template(a, "settle"), input=given, state=start)
    assert np.all(got.settled)
    rate = -got.state + a * np.clip(got.state, -1.0, 1.0) + given + 0.1
    assert np.abs(rate).max() < 1e-12  # rounding of numbers below 6
    # it is the rest that the state itself comes to: 40 time constants leave e^{-20} of its way
    np.testing.assert_allclose(got.state, stepped(a, given + 0.1, start, 40.0), atol=1e-6)


@pytest.mark.parametrize("engine", ["opencl", "numba"])
@pytest.mark.parametrize("precision", TOLERANCE)
def test_a_decay_to_nothing_keeps_its_digits(engine, precision):
    """Where x = x₀ e^{−(1−a)t}, the end is far below the last digit of the start."""
    own = cnnum.Template("own", [[-2.8]], boundary="periodic", duration=8.0)
    start = np.array([[0.25, -0.5], [0.75, 2.0]])  # the last one enters the middle piece
    got = cnnum.Engine(engine, precision=precision).run(own, state=start)
    # from 2 it falls to 1 as 2 + 2.8 = 4.8 of its way to −2.8 does to 3.8
    want = start * np.exp(-3.8 * 8.0)
    want[1, 1] = np.exp(-3.8 * (8.0 - np.log(4.8 / 3.8)))
    off = np.abs(got.state - want)
    np.testing.assert_allclose(got.state, want, rtol=200 * np.finfo(precision).eps)
    assert np.all(off <= got.error)


def test_time_is_in_time_constants(start_and_input):
    start, given = start_and_input
    engine = cnnum.Engine(precision="float64")
    slow = engine.run(template(1.3, 6.0, tau=2.0), input=given, state=start)
    quick = engine.run(template(1.3, 3.0), input=given, state=start)
    np.testing.assert_allclose(slow.state, quick.state, atol=1e-12)


@pytest.mark.parametrize("engine", ["opencl", "numba"])
def test_fixed_cells_stay(engine, start_and_input):
    start, given = start_and_input
    mask = np.zeros((5, 6))
    mask[2, 3] = 1.0
    engine = cnnum.Engine(engine, precision="float64")
    got = engine.run(template(2.0, 3.0), input=given, state=start, mask=mask)
    np.testing.assert_array_equal(got.state[:, 2, 3], start[:, 2, 3])
    assert np.abs(got.state[:, 2, 2] - start[:, 2, 2]).max() > 0.1


def test_what_has_no_such_answer_takes_steps():
    neighbour = np.zeros((3, 3))
    neighbour[1, 1], neighbour[0, 1] = 2.0, 0.1
    assert separate(cnnum.Template("sees", neighbour, duration=1.0), 1.0) is None
    assert separate(template(2.0, 1.0, output="tanh"), 1.0) is None
    assert separate(template(2.0, 1.0), 2.0 * LONGEST) is None
    assert separate(template(1.0, "settle"), np.inf) is None
    assert isinstance(separate(template(2.0, 1.0), 1.0), Separate)


def test_layers_have_weights_and_times_of_their_own(engines, start_and_input):
    """Every layer is as it is alone, on every engine."""
    start, given = start_and_input
    A, B = np.zeros((2, 2, 3, 3)), np.zeros((2, 2, 3, 3))
    A[0, 0, 1, 1], A[1, 1, 1, 1] = 1.0, 2.0
    B[0, 0, 1, 1] = B[1, 1, 1, 1] = 1.0
    both = cnnum.Template("both", A, B, [0.1, 0.1], tau=[1.0, 0.5], duration=1.5)
    pairs = np.stack([start, -start], axis=1), np.stack([given, -given], axis=1)
    want = stepped(1.0, given + 0.1, start, 1.5), stepped(2.0, -given + 0.1, -start, 3.0)
    for label, engine in engines.items():
        got = engine.run(both, state=pairs[0], input=pairs[1])
        assert got.method == "propagator"
        tolerance = TOLERANCE[label.partition("-")[2]]
        np.testing.assert_allclose(got.state, np.stack(want, axis=1), atol=tolerance)
