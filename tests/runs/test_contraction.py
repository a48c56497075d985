"""Regions of contraction: every state in them comes to one equilibrium, as far off as they say."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cnnum
from cnnum.lab.bench.followed_steps import network
from cnnum.runs.cells import Cells, Frame
from cnnum.runs.equilibrium import region

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
    assert count >= 10
    assert np.median(loose) < 5.0


def cell(feedback, output="standard"):
    return cnnum.Template("one", [[feedback]], z=0.3, output=output)


def found(template, x, reach, given=None, shape=(1, 1)):
    frame = Frame(Cells(template, shape), given or {})
    return region(frame, np.atleast_1d(np.asarray(x, dtype=float)), np.atleast_1d(float(reach)))


@pytest.mark.parametrize("output", OUTPUTS)
def test_one_cell_is_as_far_as_it_is(output):
    # x* = 0.3 / (1 − 0.5), where f is x; of tanh the root is known from Newton's steps
    rest = 0.6
    if output == "tanh":
        for _ in range(50):
            rest = 0.3 + 0.5 * np.tanh(rest)
    near = found(cell(0.5, output), 0.55, 0.1)
    assert near is not None
    assert abs(rest - 0.55) <= near.off[0] < 2.0 * abs(rest - 0.55)


def test_nothing_is_known_where_an_array_does_not_contract():
    grows = cell(2.0)
    # saturated all over the box it rests, and else may leave it
    assert found(grows, 2.3, 0.5) is not None
    assert found(grows, 1.2, 0.5) is None
    assert found(grows, 2.2, 1.3) is None  # 0.9 is in the box


def test_a_held_cell_is_where_it_stays():
    held = {"mask": np.ones((1, 1, 1))}
    near = found(cell(2.0), 0.2, 0.0, held)
    assert near is not None
    assert near.off[0] == 0.0


def test_weights_that_balance_contract_by_a_quadratic_form():
    """Rows of sizes sum to 1.4, though the eigenvalues of A are 0.1 ± 1.3i at most."""
    A = np.zeros((2, 2, 1, 1))
    A[0, 0] = A[1, 1] = 0.1
    A[0, 1], A[1, 0] = -1.3, 1.3
    turning = cnnum.Template("turn", A, output="tanh")
    frame = Frame(Cells(turning, (1, 1)), {})
    x = np.zeros(2)
    assert region(frame, x, np.full(2, 0.01), close=False) is None
    near = region(frame, x, np.full(2, 0.01))
    assert near is not None
    assert near.off.max() < 1e-6
    # at z = 1 the same weights leave the box on their way
    assert region(frame, np.full(2, 0.5), np.full(2, 0.01)) is None


@pytest.mark.parametrize("output", OUTPUTS)
def test_every_state_in_a_region_comes_to_its_equilibrium(output):
    """From corners of the reach, followed by SciPy: whatever their signs, and however far."""
    rng, seen = np.random.default_rng(5), 0
    for _ in range(60):
        A = rng.normal(0.0, 0.25, (3, 3))
        template = cnnum.Template("random", A, z=0.2, output=output, boundary="zero-flux")
        cells = Cells(template, (3, 3))
        frame = Frame(cells, {})
        x, reach = rng.uniform(-0.6, 0.6, 9), np.full(9, 0.3)
        near = region(frame, x, reach)
        if near is None:
            continue
        seen += 1
        for _ in range(3):
            start = x + 0.3 * rng.choice([-1.0, 1.0], 9)

            def right(_, v, frame=frame):
                limited = output == "full-range"
                rate = frame.rates(np.clip(v, -1.0, 1.0) if limited else v)[0]
                outward = limited & (np.abs(v) >= 1.0) & (rate * v > 0.0)
                return np.where(outward, 0.0, rate)

            way = solve_ivp(right, (0.0, 60.0), start, rtol=1e-9, atol=1e-10)
            assert (np.abs(way.y[:, -1] - x) <= near.off + 1e-6).all()
            assert (np.abs(way.y - x[:, np.newaxis]).max(axis=1) <= near.width + 1e-8).all()
    assert seen >= 8
