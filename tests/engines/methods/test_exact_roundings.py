"""Exact answers in single precision: the stated error covers their roundings, and is near them."""

import numpy as np
import pytest

import cnnum
from cnnum.integrators.propagator import rounded_gain


def test_each_term_counts_as_often_as_it_is_rounded():
    matrices = [np.array([[1.0, -2.0], [0.5, 0.5]]), np.array([[0.0, 1.0], [3.0, 0.0]])]
    passes = [np.array([4.0, 3.0]), np.array([2.0, 1.0])]
    assert rounded_gain(matrices, passes) == max(4.0 + 6.0 + 1.0, 2.0 + 1.5 + 6.0)


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
    assert np.median(found.error / off) < 60.0  # a count of every rounding in full gives 200


@pytest.fixture(params=["numba", "opencl"])
def numba_or_opencl(request):
    if request.param == "opencl":
        request.getfixturevalue("opencl")
    return request.param
