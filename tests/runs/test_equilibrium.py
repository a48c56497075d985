"""Runs to equilibrium end where the network rests, however slowly it passes by other places."""

import numpy as np
import pytest

import cnnum
from cnnum import Template
from cnnum.runs.cells import Cells, Frame
from cnnum.runs.equilibrium import verdict
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import Table


def judged(template, state, reach=0.0):
    """Return the verdict on one frame, by the tolerances of `Engine.run`."""
    x = np.asarray(state, dtype=float)
    frame = Frame(Cells(template, x.shape[-2:]), {})
    return verdict(frame, x.ravel(), reach, 1e-5 + 1e-4 * np.abs(x.ravel()))


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
    off = np.abs(found.state - np.broadcast_to(expected, (8, 8))).max()
    assert off <= found.error  # the longer run's own


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
    seen = judged(template, np.full((1, 4, 4), 0.49))
    assert seen.stability == "stable"
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
    assert judged(template, np.full((1, 8, 8), value)).stability != "stable"


def test_exact_balance_is_named_and_not_taken_for_rest(engine):
    """Where every term of the rates is 0 nothing moves, and the least push moves everything."""
    balanced = Template("balanced", SADDLE.A[0, 0], boundary="zero-flux")
    assert judged(balanced, np.zeros((1, 8, 8))).stability == "unstable"
    found = engine.run(balanced, state=np.zeros((8, 8)), duration="settle")
    assert found.stability == "unstable"
    assert not found.settled
    assert np.isinf(found.error)


def test_turning_layers_do_not_rest():
    """Eigenvalues with a positive real part are found where A is not symmetric."""
    A = np.zeros((2, 2, 1, 1))
    A[0, 0] = A[1, 1] = 1.1
    A[0, 1], A[1, 0] = -1.0, 1.0
    assert judged(Template("turn", A), np.full((2, 3, 3), 1e-7)).stability == "unstable"


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
    found = judged(template, np.full((1, 1, 1), 0.5))
    assert found.stability == "stable"
    assert found.state.item() == pytest.approx(1.4)


LINE = Table("linear", ((-1.0, -2.0), (1.0, 2.0)))
DOUBLED = NonlinearCoupling([[1.0]], LINE, "y")
EAST = [[0.0, 0.0, 0.0], [0.0, 2.0, 0.1], [0.0, 0.0, 0.0]]
EVEN = [[0.0, 0.0, 0.0], [0.1, 2.0, 0.1], [0.0, 0.0, 0.0]]


@pytest.mark.parametrize("label", ["opencl float32", "numba float64", "reference"])
@pytest.mark.parametrize(
    ("template", "size", "rest"),
    [
        # x = 2 tanh x
        (Template("tanh", [[2.0]], output="tanh"), 4, 1.9150080481545355),
        (Template("limited", [[2.0]], output="full-range"), 4, 1.0),
        (Template("doubled", [[0.0]], nonlinear=(DOUBLED,)), 4, 2.0),
        (Template("east", EAST), 20, 2.1),
    ],
    ids=["tanh", "full-range", "nonlinear", "many cells"],
)
def test_a_small_start_beside_a_saddle_grows_to_its_rest(label, template, size, rest):
    """At 1e-6 the rates are below the tolerance, and the array leaves all the same."""
    name, _, precision = label.partition(" ")
    engine = cnnum.Engine(name, precision=precision or None)
    found = engine.run(template, state=np.full((size, size), 1e-6), duration="settle")
    assert found.settled
    assert abs(found.state[0, 0] - rest) <= found.error + 1e-12
    assert found.error < 1e-3


@pytest.mark.parametrize("size", [20, 75])
def test_a_saddle_of_many_cells_is_found_by_inertia_or_by_one_eigenvalue(size, engine):
    for A in (EAST, EVEN):
        start = np.full((size, size), 1e-6)
        found = engine.run(Template("many", A), state=start, duration="settle")
        assert abs(found.state[2, 2] - (2.1 if A is EAST else 2.2)) < 1e-3


def test_a_fold_is_not_taken_for_a_rest(engine):
    """x = 2 tanh x + z has a rest at −0.881 up to its fold in z, and at 2.506 alone beyond."""
    fold = -np.arccosh(np.sqrt(2.0))
    z = float(fold - 2.0 * np.tanh(fold) + 5e-6)
    found = engine.run(
        Template("fold", [[2.0]], z=z, output="tanh"),
        state=np.full((3, 3), -1.5),
        duration="settle",
    )
    assert np.isinf(found.error) or (np.abs(found.state - 2.506) < 0.01).all()
    assert found.certified == ("unknown" if np.isinf(found.error) else "proven")


@pytest.mark.parametrize("label", ["opencl float32", "numba float64"])
def test_a_cell_balanced_exactly_falls_to_no_side(label):
    """x' = x in the middle piece: a start at 0 stays, and one beside it does not."""
    name, precision = label.split()
    found = cnnum.Engine(name, precision=precision).run(
        Template("balance", [[2.0]]), state=np.array([[0.0, 1e-6], [-1e-6, 0.3]]), duration="settle"
    )
    np.testing.assert_allclose(found.state, [[0.0, 2.0], [-2.0, 2.0]], atol=1e-6)
    assert not found.settled
    assert np.isinf(found.error)


@pytest.mark.parametrize("label", ["opencl float32", "numba float64", "reference"])
@pytest.mark.parametrize(
    ("output", "gain", "rest"),
    [
        # x = g a x + u + z after the last change, g a < 1
        ("linear", Table("constant", ((50.0, 0.0), (51.0, 3.0))), 0.15 / (1.0 - 0.9)),
        ("linear", Table("linear", ((50.0, 3.0), (60.0, 0.5))), 0.15 / (1.0 - 0.15)),
        ("linear", Table("linear", ((0.0, 0.5),)), 0.15 / (1.0 - 0.15)),
        # saturated: g a + u + z
        ("standard", Table("constant", ((50.0, 0.0), (51.0, 10.0))), 3.15),
    ],
    ids=["jumps", "bends", "constant", "saturates"],
)
def test_an_array_rests_after_its_gains_have_changed(label, output, gain, rest):
    """Rates are below the tolerance long before, at the equilibrium of the first gain."""
    name, *precision = label.split()
    engine = cnnum.Engine(name, precision=precision[0] if precision else None)
    gains = [cnnum.Gain(0, 0, gain)]
    template = Template("timed", [[0.3]], [[1.0]], 0.1, output=output, gains=gains)
    found = engine.run(template, input=[[0.05]], state=[[0.2]], duration="settle")
    assert bool(found.settled)
    assert abs(found.state.item() - rest) <= found.error + 1e-12 < 1e-3


def test_an_array_whose_gains_change_later_than_it_may_run_does_not_rest(engine):
    """A gain that changes after 1e9 τ."""
    gain = cnnum.Gain(0, 0, Table("linear", ((0.0, 1.0), (1e9, 3.0))))
    template = Template("late", [[0.3]], [[1.0]], 0.1, output="linear", gains=[gain])
    found = engine.run(template, input=[[0.05]], duration="settle")
    assert not bool(found.settled)
    assert np.isinf(found.error)


def test_a_program_wants_a_duration_for_gains_that_change():
    """Its transients stop at small rates, which come before the gain changes."""
    gain = cnnum.Gain(0, 0, Table("constant", ((50.0, 0.0), (51.0, 3.0))))
    template = Template("late", [[0.3]], [[1.0]], 0.1, output="linear", gains=[gain])

    def run(frame, spec=None):
        return {"x": cnnum.transient(template, input=frame.normal, spec=spec).states[0]}

    @cnnum.program
    def refused(frame):
        return run(frame)

    @cnnum.program
    def timed(frame):
        return run(frame, cnnum.RunSpec(duration=300.0))

    engine = cnnum.Engine("numba", precision="float64")
    with pytest.raises(cnnum.errors.ProgramError, match="give it a duration"):
        engine.compile(refused, (1, 1))
    found = engine.compile(timed, (1, 1))(np.full((1, 1, 1, 3), 0.05))
    assert found["x"].item() == pytest.approx(1.5, rel=1e-4)
