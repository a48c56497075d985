"""Exact answers in single precision: the stated error covers their roundings, and is near them."""

import numpy as np
import pytest

import cnnum
from cnnum.integrators.closed_forms import passes_in_fours, rounded_gain


def test_each_term_counts_as_often_as_it_is_rounded():
    matrices = [np.array([[1.0, -2.0], [0.5, 0.5]]), np.array([[0.0, 1.0], [3.0, 0.0]])]
    passes = [np.array([4.0, 3.0]), np.array([2.0, 1.0])]
    assert rounded_gain(matrices, passes) == max(4.0 + 6.0 + 1.0, 2.0 + 1.5 + 6.0)


@pytest.mark.parametrize("columns", [0, 1, 3, 4, 5, 8, 42, 63])
def test_columns_are_rounded_by_the_additions_from_their_own_on(columns):
    """The additions that the engines make, in their order; each rounds all that is in the sum."""
    whole, rounded, within = columns - columns % 4, np.zeros(columns), []
    for added in [range(k, k + 4) for k in range(0, whole, 4)] + [
        [k] for k in range(whole, columns)
    ]:
        within += added
        rounded[within] += 1
    np.testing.assert_array_equal(passes_in_fours(columns), rounded)


@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (2, 2), (1, 5), (3, 5)])
def test_products_of_few_columns_are_whole(opencl, shape):
    """Fewer than four columns, and those that are left of the fours."""
    rng = np.random.default_rng(4)
    template = cnnum.Template(
        "linear", [[0.1, 0.2, 0.1], [0.0, -0.3, 0.2], [0.1, 0.0, 0.1]], [[1.0]], 0.3,
        boundary=0.4, output="linear", duration=2.0,
    )  # fmt: skip
    maps = {role: rng.uniform(-1.0, 1.0, (9, *shape)) for role in ("input", "state")}
    for engine in (opencl, cnnum.Engine("opencl", precision="float64")):
        found = engine.run(template, **maps)
        known = cnnum.Engine("reference").run(template, **maps)
        assert found.method == "propagator"
        assert (
            np.abs(found.state - known.state).max(axis=(1, 2)) <= found.error + known.error
        ).all()


@pytest.mark.parametrize("boundary", [0.0, 0.4])
def test_roundings_are_covered_and_not_much_overestimated(numba_or_opencl, boundary):
    rng = np.random.default_rng(3)
    feedback = rng.normal(size=(3, 3))
    feedback /= 2.0 * np.abs(feedback).sum()
    template = cnnum.Template(
        "linear", feedback, [[1.0]], 0.3, boundary=boundary, output="linear", duration=2.0
    )
    maps = {role: rng.uniform(-1.0, 1.0, (16, 6, 7)) for role in ("input", "state")}
    found = cnnum.Engine(numba_or_opencl, precision="float32").run(template, **maps)
    known = cnnum.Engine("numba", precision="float64").run(template, **maps)
    assert found.method == "propagator"
    off = np.abs(found.state - known.state).max(axis=(1, 2))
    assert (found.error >= off).all()
    # measured 13 to 18; columns added one by one have 24 to 26, and all roundings in full 200
    assert np.median(found.error / off) < 22.0


@pytest.fixture(params=["numba", "opencl"])
def numba_or_opencl(request):
    if request.param == "opencl":
        request.getfixturevalue("opencl")
    return request.param


SMALL = np.random.default_rng(5).normal(size=(3, 3)) * 0.1
SMOOTH = np.array([[0.0, 0.1, 0.0], [0.1, 0.2, 0.1], [0.0, 0.1, 0.0]])
KINDS = {
    "uncoupled": ([[0.0]], "standard", 0.0),
    "own": ([[-0.5]], "standard", 0.0),
    "saturating": (SMALL, "standard", 0.0),
    "limited": (SMALL, "full-range", 0.0),
    "dense": (SMALL, "linear", 0.5),
    "modes": (SMOOTH, "linear", "zero-flux"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_of_no_time_is_its_start(engines, kind):
    """To the last bit, also where it is looked at as it begins."""
    A, output, boundary = KINDS[kind]
    template = cnnum.Template("t", A, SMALL, 0.3, output=output, boundary=boundary)
    start, given = np.random.default_rng(7).uniform(-1.0, 1.0, (2, 3, 5, 6))
    start = start.astype(np.float32).astype(np.float64)
    for label in (*engines, "reference"):
        ended = engines[label].run(template, input=given, state=start, duration=0.0)
        assert np.array_equal(ended.state, start), label
    looked = engines["numba-float32"].run(template, input=given, state=start, at=(0.0, 0.5))
    assert np.array_equal(looked.state[0], start)


@pytest.mark.parametrize("number", [68, 312])
def test_an_end_that_grew_far_states_the_rounding_of_its_exponential(number):
    """It was stated as a part of the start, which grows: 1.2e-15 for 1.4e-13."""
    from random_networks import Truth, network_of, template_of

    net = network_of(77, number)
    truth, end = Truth(net), net.times[-1]
    matrix = (truth.feedback - np.eye(len(truth.feedback))) * truth.pace[:, np.newaxis]
    drive = (truth.drive + truth.still.sum(axis=1).ravel()) * truth.pace
    start = net.x.reshape(truth.frames, -1)
    # Taylor's series step by step, in longer numbers
    long, steps = np.longdouble, 2 * int(np.ceil(np.abs(matrix).sum(axis=1).max() * end)) + 1
    x = start.astype(long)
    for _ in range(steps):
        slope = (x @ matrix.T.astype(long) + drive.astype(long)) * long(end) / steps
        for term in range(1, 30):
            x = x + slope
            slope = slope @ matrix.T.astype(long) * long(end) / steps / (term + 1)
    bias = {} if net.bias is None else {"bias": net.bias}
    got = cnnum.Engine("numba", precision="float64").run(
        template_of(net), input=net.u, state=net.x, duration=end, **bias
    )
    assert got.method == "propagator"
    off = np.abs(got.state.reshape(x.shape) - x).max(axis=1)
    assert (off <= got.error).all()
    assert (got.error < 1e-10 * np.abs(x).max(axis=1)).all()
