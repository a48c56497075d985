"""Errors of runs to a rest: they cover the way that is left, and are not much longer."""

import numpy as np
import pytest

import cnnum
from cnnum.lab.bench.followed_steps import network
from cnnum.runs.contraction import distances, may_contract

OUTPUTS = ("standard", "tanh", "full-range")


@pytest.fixture(scope="module")
def host():
    return cnnum.Engine("numba", precision="float64")


def test_errors_cover_the_way_that_is_left(host):
    rng, loose, count = np.random.default_rng(29), [], 0
    for number in range(9):
        template = network(rng, OUTPUTS[number % 3])
        layers = (template.layers,) * (template.layers > 1)
        state = rng.uniform(-0.9, 0.9, (2, *layers, 5, 6))
        picture = rng.uniform(-1.0, 1.0, (2, 5, 6))
        try:
            found = host.run(template, input=picture, state=state, duration="settle")
        except cnnum.CnnumError:
            continue
        ahead = {"duration": 40.0 * float(template.tau.max()), "rtol": 1e-10, "atol": 1e-10}
        later = host.run(
            template, input=picture, state=found.state, method="dormand-prince", **ahead
        )
        off = np.abs(later.state - found.state).reshape(2, -1).max(axis=1)
        at_rest = found.settled & np.isfinite(found.error)
        assert (off <= found.error + later.error)[at_rest].all()
        loose += (found.error / np.maximum(off, 1e-12))[at_rest & (off > 1e-8)].tolist()
        count += int(at_rest.sum())
    assert count >= 12
    assert np.median(loose) < 5.0


def cell(feedback, output="standard"):
    return cnnum.Template("one", [[feedback]], z=0.3, output=output)


@pytest.mark.parametrize("output", OUTPUTS)
def test_one_cell_is_as_far_as_it_is(output):
    # x* = 0.3 / (1 − 0.5), where f is x; of tanh the root is known from Newton's steps
    template, x = cell(0.5, output), np.full((1, 1, 1, 1), 0.55)
    rest = 0.6
    if output == "tanh":
        for _ in range(50):
            rest = 0.3 + 0.5 * np.tanh(rest)
    found = distances(template, {}, x, np.array([0.1]))
    assert abs(rest - 0.55) <= found[0] < 2.0 * abs(rest - 0.55)


def test_nothing_is_known_where_an_array_does_not_contract():
    grows, near = cell(2.0), np.full((1, 1, 1, 1), 1.2)
    # saturated all over the box it rests, and else may leave it
    assert np.isfinite(distances(grows, {}, near + 1.1, np.array([0.5])))
    assert np.isinf(distances(grows, {}, near, np.array([0.5])))
    assert np.isinf(distances(grows, {}, near + 1.0, np.array([1.3])))  # 0.9 is in the box
    assert not may_contract(cell(0.5, "sign"))


def test_a_held_cell_is_where_it_stays():
    held = {"mask": np.ones((1, 1, 1, 1))}
    assert distances(cell(2.0), held, np.full((1, 1, 1, 1), 0.2), np.array([0.5])) == 0.0
