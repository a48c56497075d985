"""Runs to equilibrium end where the network rests, however slowly it passes by other places."""

import numpy as np
import pytest

import cnnum
from cnnum import Template
from cnnum.runs.equilibrium import verdict

TOLERANCES = {"rtol": 1e-4, "atol": 1e-5, "precision": "float64"}
SADDLE = Template(
    "saddle", [[0.0, 0.1, 0.0], [0.1, 2.0, 0.1], [0.0, 0.1, 0.0]], z=1e-7, boundary="zero-flux"
)
BOTTLENECK = Template(
    "bottleneck", [[0.0, 0.0, 0.0], [1e-3, 2.0, 1e-3], [0.0, 0.0, 0.0]], z=-1.00101
)


@pytest.fixture(scope="module")
def engine():
    return cnnum.Engine("numba", precision="float32")


def test_a_saddle_is_left_however_slowly(engine):
    """Rates of 1e-7 are below every tolerance; cells that saturate rest at 2 + 4·0.1 + 1e-7."""
    found = engine.run(SADDLE, state=np.zeros((8, 8)), duration="settle")
    assert found.settled
    # at rest within the tolerance of 1e-4 of the state
    np.testing.assert_allclose(found.state, 2.4, atol=3e-4)


def test_a_bottleneck_is_passed(engine):
    """All at 2 they come by 1.001 at a rate of 1e-5; the rim, which lacks a neighbour, goes on."""
    found = engine.run(BOTTLENECK, state=np.full((8, 8), 2.0), duration="settle")
    expected = np.where(np.isin(np.arange(8), (0, 7)), -3.00201, -3.00301)
    np.testing.assert_allclose(found.state, np.broadcast_to(expected, (8, 8)), atol=4e-4)
    assert found.settled
    assert np.isinf(found.error)  # it ran on, and nothing is known of the error along the way


def test_frames_that_rest_are_left_alone_by_those_that_do_not(engine):
    """Of a batch only the frame on the saddle runs on."""
    states = np.stack([np.zeros((8, 8)), np.full((8, 8), 1.5)])
    found = engine.run(SADDLE, state=states, duration="settle")
    alone = engine.run(SADDLE, state=states[1], duration="settle")
    np.testing.assert_array_equal(found.state[1], alone.state)
    assert found.time[0] > found.time[1] == alone.time
    assert found.settled.all()


def test_a_slow_linear_end_is_gone_to():
    """Rates of 1e-5 at a decay of 1e-3 are still 0.01 off; one linear solve is not."""
    weights = [[0.0, 0.0, 0.0], [0.0, 0.999, 0.0], [0.0, 0.0, 0.0]]
    template = Template("slow", weights, z=5e-4, output="linear")
    state = np.full((1, 1, 4, 4), 0.49)
    seen = verdict(template, {}, state, **TOLERANCES)
    assert seen.rests.all()
    np.testing.assert_allclose(seen.state, 0.5, atol=1e-9)


@pytest.mark.parametrize(
    "label", ["opencl float32", "opencl float64", "numba float32", "reference"]
)
@pytest.mark.parametrize("output", ["linear", "standard"])
def test_engines_go_to_the_same_slow_end(label, output):
    """x = z / (1 − a) takes 8,000 time constants; engines that stopped earlier were apart by 2."""
    name, _, precision = label.partition(" ")
    slow = Template("slow", [[0.999]], z=5e-4, output=output)
    start = np.full((4, 4), -0.9)
    engine = cnnum.Engine(name, precision=precision or None)
    found = engine.run(slow, state=start, duration="settle")
    assert found.settled
    off = np.abs(found.state - 0.5).max()
    # a weight of 0.999 in float32 is off by 2e-8, which counts a thousandfold
    assert off < (1e-4 if precision == "float32" else 1e-6)
    assert off <= found.error + 1e-4 * (precision == "float32")


@pytest.mark.parametrize(
    ("template", "value"),
    [(SADDLE, 0.0), (SADDLE, 1e-6), (BOTTLENECK, 1.00099)],
    ids=["saddle", "near", "neck"],
)
def test_small_rates_are_no_proof(template, value):
    assert not verdict(template, {}, np.full((1, 1, 8, 8), value), **TOLERANCES).rests.any()


def test_exact_balance_is_at_rest():
    """Where every term of the rates is 0 nothing moves, stable or not."""
    balanced = Template("balanced", SADDLE.A[0, 0], boundary="zero-flux")
    assert verdict(balanced, {}, np.zeros((1, 1, 8, 8)), **TOLERANCES).rests.all()


def test_turning_layers_do_not_rest():
    """Eigenvalues with a positive real part are found where A is not symmetric."""
    A = np.zeros((2, 2, 1, 1))
    A[0, 0] = A[1, 1] = 1.1
    A[0, 1], A[1, 0] = -1.0, 1.0
    state = np.full((1, 2, 3, 3), 1e-7)
    assert not verdict(Template("turn", A), {}, state, **TOLERANCES).rests.any()


@pytest.mark.parametrize("name", ["HOLE", "SHADOW"])
def test_a_run_that_is_kept_ready_says_the_same_as_a_batch(engine, name):
    """Single frames whose cells are all saturated are not looked at closely: nothing differs."""
    picture = np.where(np.random.default_rng(3).random((8, 8)) < 0.4, 1.0, -1.0)
    template = cnnum.get_template(name)
    batch = engine.run(template, input=picture[np.newaxis], duration="settle")
    for _ in range(3):  # the first of them prepares the run
        alone = engine.run(template, input=picture, duration="settle")
        assert alone.settled == batch.settled[0]
        np.testing.assert_allclose(alone.state, batch.state[0], atol=1e-4)
        # the tolerance of the largest state is all that both add
        assert alone.error == pytest.approx(batch.error[0], rel=0.05)


def test_a_saddle_is_left_by_a_run_that_is_kept_ready(engine):
    """The second run is prepared, and its rates are as small as those of the first."""
    for _ in range(3):
        found = engine.run(SADDLE, state=np.zeros((8, 8)), duration="settle")
        np.testing.assert_allclose(found.state, 2.4, atol=3e-4)


def test_an_equilibrium_beyond_a_corner_is_none():
    """x' = −x/2 + 0.9 within the linear range would rest at 1.8, where the output is 1: 1.4."""
    template = Template("beyond", [[0.5]], z=0.9)
    state = np.full((1, 1, 1, 1), 0.5)
    found = verdict(template, {}, state, rtol=1e-4, atol=1e-5, precision="float64")
    assert not found.rests.any()
    assert found.state.item() == 0.5
