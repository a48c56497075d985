"""Proofs of runs: what they say of errors and of every cell, against closed forms and SciPy."""

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.ndimage import binary_fill_holes

import cnnum
from cnnum import Template
from cnnum.runs.cells import Cells, Frame
from cnnum.runs.certificate import Between, keeps_order
from cnnum.runs.enclosure import Enclosure
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import OutputFunction, Table

ENGINES = ["opencl float32", "numba float64", "reference"]


def opened(label):
    name, _, precision = label.partition(" ")
    return cnnum.Engine(name, precision=precision or None)


@pytest.fixture(scope="module")
def picture():
    return np.where(np.random.default_rng(0).random((8, 8)) < 0.4, 1.0, -1.0)


@pytest.mark.parametrize("label", ENGINES)
def test_errors_are_proven_estimated_or_unknown(label, picture):
    engine = opened(label)
    proven = engine.run(Template("one", [[0.5]], z=0.2), state=picture, duration="settle")
    assert proven.certified == "proven"
    assert proven.stability == "stable"
    # steps of one length are not followed
    steps = engine.run("EDGE", input=picture, duration=1.0, method="euler", dt=0.01)
    assert steps.certified == "unknown"
    own = OutputFunction("soft", lambda x: 0.5 * x, "R(0.5) * x", slope=(0.5, 0.5))
    own_run = engine.run(Template("own", [[0.5]], z=0.2, output=own), state=picture)
    assert np.isfinite(own_run.error)
    assert own_run.certified == "estimated"  # its slope is what its author says


def test_a_batch_has_a_word_for_each_frame():
    template = Template("tanh", [[2.0]], output="tanh")
    found = opened("numba float64").run(
        template, state=np.stack([np.zeros((3, 3)), np.full((3, 3), 0.5)]), duration="settle"
    )
    assert found.certified.tolist() == ["unknown", "proven"]
    assert found.stability.tolist() == ["unstable", "stable"]
    assert found.settled.tolist() == [False, True]
    decision = found.decision
    assert decision.open[0].all()
    assert (decision.sign[1] == 1).all()
    # x = 2 tanh x
    assert (decision.lower[1] <= 1.9150080481545355).all()
    assert (decision.upper[1] >= 1.9150080481545355).all()
    assert (decision.upper - decision.lower)[1].max() < 1e-9


@pytest.mark.parametrize("label", ENGINES)
def test_outputs_at_rest_are_told_from_states_at_rest(label, picture):
    """EDGE's cells are all saturated after a time constant; HOLE's wave has not come through."""
    engine = opened(label)
    edge = engine.run("EDGE", input=picture, duration=5.0)
    assert not edge.settled
    assert edge.decision.at_rest
    assert edge.decision.saturated.all()
    hole = engine.run("HOLE", input=picture, duration=1.0)
    assert not hole.settled
    assert not hole.decision.at_rest


def test_the_decision_of_a_long_way_is_proven_where_the_error_says_nothing():
    """HOLE grows errors by e^3 a cell of its wave; saturated cells add nothing to the enclosure."""
    picture = np.where(np.random.default_rng(0).random((16, 16)) < 0.4, 1.0, -1.0)
    how = {"input": picture, "duration": "settle", "method": "dormand-prince"}
    found = opened("numba float64").run("HOLE", **how)
    assert np.isinf(found.error)
    assert found.certified == "unknown"
    decision = found.decision
    assert not decision.open.any()
    assert decision.at_rest
    np.testing.assert_array_equal(decision.sign, np.sign(found.output))
    assert (decision.lower <= found.state + 1e-3).all()
    assert (decision.upper >= found.state - 1e-3).all()


def test_what_is_not_proven_is_open():
    """Without a proof every bound is infinite: of a start on a saddle, and of whole numbers."""
    found = opened("numba float64").run(Template("saddle", [[2.0]]), state=np.zeros((2, 2)))
    assert found.decision.open.all()
    assert np.isinf(found.decision.upper).all()
    assert not found.decision.at_rest


def test_a_proof_keeps_its_own_maps(picture):
    """A loop that writes into its arrays does not change what earlier results say."""
    engine, state = opened("opencl float32"), np.full((4, 4), 0.5)
    template = Template("grows", [[2.0]], output="tanh")
    results = []
    for sign in (1.0, -1.0, 1.0):
        state[...] = sign * 0.5
        results.append(engine.run(template, state=state, duration="settle"))
    state[...] = 0.0
    for sign, result in zip((1.0, -1.0, 1.0), results, strict=True):
        assert (result.decision.sign == sign).all()
        assert result.certified == "proven"


def test_a_result_takes_its_proof_along(picture):
    """Made or not, it is worked out anew in another process."""
    found = opened("numba float32").run("EDGE", input=picture, duration=5.0)
    for _ in range(2):
        came = pickle.loads(pickle.dumps(found))
        assert came == found
        assert came.certified == found.certified == "proven"
    soft = OutputFunction("softer", lambda x: 0.5 * x, "R(0.5) * x", slope=(0.5, 0.5))
    own = opened("numba float64").run(Template("own", [[0.5]], output=soft), state=np.zeros((2, 2)))
    assert pickle.loads(pickle.dumps(own)).proof is None


def test_discrete_time_is_replayed_sign_by_sign():
    A = np.array([[0.0, 0.5, 0.0], [0.5, 1.0, 0.5], [0.0, 0.5, 0.0]])
    template = Template("majority", A, output="sign", z=0.1)
    start = np.random.default_rng(2).uniform(-1.0, 1.0, (6, 6))
    found = opened("numba float64").run(template, state=start, duration="settle")
    assert found.decision.at_rest
    np.testing.assert_array_equal(found.decision.sign, np.where(found.state >= 0.0, 1, -1))


def networks(count):
    """Yield random templates, shapes, starts and inputs of every kind that is enclosed."""
    rng = np.random.default_rng(11)
    bends = Table("linear", ((-1.0, -0.5), (0.1, 0.0), (0.8, 0.6)))
    for number in range(count):
        output = ("standard", "tanh", "full-range", "linear")[number % 4]
        A = rng.normal(0.0, 0.6, (3, 3)) * (0.4 if output in ("linear", "full-range") else 1.0)
        A[1, 1] += 0.7 if output != "linear" else 0.0
        boundary = ("zero-flux", "periodic", 0.3)[number % 3]
        more = (NonlinearCoupling([[0.7]], bends, "y"),) if number % 8 == 1 else ()
        template = Template(
            "random", A, rng.normal(0.0, 0.5, (3, 3)), 0.1, output=output, boundary=boundary,
            tau=float(rng.uniform(0.5, 2.0)), nonlinear=more)  # fmt: skip
        scale = 10.0 ** -rng.integers(0, 7)
        yield template, rng.uniform(-0.9, 0.9, (3, 4)) * scale, rng.uniform(-1.0, 1.0, (3, 4))


@pytest.mark.parametrize("case", list(networks(8)), ids=lambda case: case[0].output.name)
def test_enclosures_hold_the_way(case):
    """SciPy's tight solution lies within; where it does not decide, closely so."""
    template, start, picture = case
    cells = Cells(template, (3, 4))
    frame = Frame(cells, {"input": picture[np.newaxis]})
    way = Enclosure(frame, start.ravel(), budget=60.0)
    way.advance(4.0)
    assert way.time > 1.0
    limited = template.output.limited

    def right(_, v):
        rate = frame.rates(np.clip(v, -1.0, 1.0) if limited else v)[0] / cells.tau
        return np.where(limited & (np.abs(v) >= 1.0) & (rate * v > 0.0), 0.0, rate)

    # SciPy goes on beyond a limit to the end of its step
    how = {"max_step": 1e-3} if limited else {"rtol": 1e-11, "atol": 1e-12}
    truth = solve_ivp(right, (0.0, way.time), start.ravel(), method="DOP853", **how)
    off = np.abs(truth.y[:, -1] - way.x)
    # SciPy misses corners by some 1e-9
    assert (off <= way.off + (1e-2 if limited else 1e-8)).all()
    assert off.max() < (1e-2 if limited else 1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_bounds_of_an_array_that_keeps_the_order_hold_it_between_them(seed):
    """Held to small Runge-Kutta steps on a matrix that is written here."""
    rng = np.random.default_rng(seed)
    A = np.abs(rng.normal(size=(3, 3))) * (rng.random((3, 3)) < 0.7)
    A[1, 1] = rng.uniform(-1.0, 3.0)
    template = cnnum.Template("kept", A, z=rng.normal(), tau=rng.uniform(0.3, 3.0))
    start = rng.uniform(-2.0, 2.0, (1, 5, 6))
    held = rng.random((5, 6)) < 0.2
    frame = Frame(Cells(template, (5, 6)), {"state": start, "mask": held[np.newaxis] * 1.0})
    assert keeps_order(frame)
    way, x, time = Between(frame, frame.start()), start[0].copy(), 3.0

    def rate(x):
        y = np.pad(np.clip(x, -1.0, 1.0), 1)
        total = template.z[0] - x
        for row, col in np.ndindex(3, 3):
            total = total + A[row, col] * y[row : row + 5, col : col + 6]
        return np.where(held, 0.0, total / template.tau[0])

    assert way.advance(time)
    h = time / 6000
    for _ in range(6000):
        middle = x + 0.5 * h * rate(x)
        x = x + h * rate(middle)
    # steps of the midpoint rule are off by h² times some e³
    assert (np.abs(x.ravel() - way.x) <= way.off + 1e-5).all()
    assert np.median(way.off[~held.ravel()]) < 0.5
    assert (way.off[held.ravel()] == 0.0).all()


def test_an_array_with_a_negative_weight_between_cells_keeps_no_order():
    kernel = np.array([[0.0, 0.0, 0.0], [0.0, -2.0, -0.1], [0.0, 0.0, 0.0]])
    cells = Cells(cnnum.Template("falls", kernel), (3, 3))
    assert not keeps_order(Frame(cells, {}))
    kernel[1, 2] = 0.1
    cells = Cells(cnnum.Template("rises", kernel), (3, 3))
    assert keeps_order(Frame(cells, {}))


def test_all_cells_of_a_large_picture_are_proven_where_the_error_says_nothing():
    """HOLE's wave passes 48×48 cells, and an error may grow in each of them."""
    picture = np.where(np.random.default_rng(1).random((48, 48)) < 0.4, 1.0, -1.0)
    found = cnnum.Engine("numba").run("HOLE", input=picture, method="dormand-prince")
    filled = np.where(binary_fill_holes(picture > 0.0), 1, -1)
    assert not np.isfinite(found.error)
    np.testing.assert_array_equal(found.decision.sign, filled)
    assert found.decision.at_rest
    assert found.decision.saturated.all()
