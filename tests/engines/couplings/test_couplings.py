"""Nonlinear, delayed and time-varying couplings and discrete time, against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.ndimage import median_filter
from scipy.special import gammainc

import cnnum
from cnnum.errors import MethodError, TemplateError
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table

RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]])


def centre(value):
    return [[0, 0, 0], [0, value, 0], [0, 0, 0]]


@pytest.fixture(scope="module", params=["opencl-float32", "opencl-float64", "numba", "reference"])
def engine(request):
    name, _, precision = request.param.partition("-")
    return cnnum.Engine(name, precision=precision or None)


def delayed(feedback, delay=1.0, control=None, **more):
    a = np.array(feedback, dtype=float)[None, None]
    b = np.zeros((1, 0, 1, 1)) if control is None else np.array(control, dtype=float)[None, None]
    return cnnum.Template(
        "delayed", [[0]], None if control is None else [[0]], output="linear",
        delayed=DelayedCoupling(delay, a, b), **more,
    )  # fmt: skip


def test_delayed_cell_follows_the_method_of_steps(engine):
    """x' = −x + a x(t − 1), x = 1 before 0: by hand up to t = 2."""
    a = -0.8
    template = delayed(centre(a), initial=1.0, duration=1.6)
    got = engine.run(template, state=np.ones((2, 2))).state
    # first stretch: x = a + (1 − a) e^{−t}; then x' = −x + a x₁(t − 1)
    end = a + (1 - a) * np.exp(-1)
    s = 0.6
    expected = end * np.exp(-s) + a * (a * (1 - np.exp(-s)) + (1 - a) * s * np.exp(-s))
    # the tolerance of a state of 0.2
    assert np.abs(got - expected).max() <= 3e-5


def test_delayed_wave_moves_one_cell_a_delay(engine):
    """x' = −x + x_west(t − T): a front that a chain of delayed cells hands on."""
    kernel = [[0, 0, 0], [1, 0, 0], [0, 0, 0]]
    template = delayed(kernel, delay=4.0, boundary=1.0, duration=12.5)
    state = engine.run(template, state=np.zeros((1, 6))).state[0]
    # a chain of k + 1 decays, each a delay later: the incomplete gamma function
    cell = np.arange(6)
    expected = gammainc(cell + 1, np.maximum(12.5 - 4.0 * cell, 0.0))
    # the tolerance of states up to 1
    assert np.abs(state - expected).max() <= 1.1e-4


def test_delayed_input_sees_what_was_before_the_start(engine):
    """Until the delay is over the cell sees the previous input, then the present one."""
    template = delayed(centre(0), delay=2.0, control=centre(1), duration=3.0)
    now, before = np.full((2, 3), 0.5), np.full((2, 3), -1.0)
    got = engine.run(template, input=now, previous=before).state
    at_two = -1.0 * (1 - np.exp(-2))
    expected = 0.5 + (at_two - 0.5) * np.exp(-1)
    # the tolerance of states up to 1
    assert np.abs(got - expected).max() <= 1.1e-4
    alone = engine.run(template, input=now).state
    assert np.abs(alone - 0.5 * (1 - np.exp(-3))).max() <= 1.1e-4


def test_delays_need_methods_that_keep_to_the_steps():
    with pytest.raises(MethodError, match="between the steps"):
        cnnum.Engine("reference").run(delayed(centre(0.5)), state=np.ones((2, 2)), method="rk4")


def test_gain_in_time_is_followed(engine):
    """x₀' = −x₀, x₁' = t x₀: x₁ = 1 − (1 + t) e^{−t}."""
    template = cnnum.Template(
        "gained", [[centre(0), centre(0)], [centre(1), centre(1)]], output="linear", duration=2.0,
        gains=[Gain(1, 0, Table("linear", ((0.0, 0.0), (2.0, 2.0))))],
    )  # fmt: skip
    start = np.stack([np.ones((2, 2)), np.zeros((2, 2))])
    got = engine.run(template, state=start, rtol=1e-6, atol=1e-6).state[1]
    # some 20 accepted steps of at most 1e-6, and float32's rounding
    assert np.abs(got - (1 - 3 * np.exp(-2))).max() <= 3e-5


def test_nonlinear_control_is_computed_once(engine):
    """Σ |u_ij − u_kl| over the ring: the exact equilibrium, no steps where A = 0."""
    table = Table("linear", ((-4.0, 4.0), (0.0, 0.0), (4.0, 4.0)))
    template = cnnum.Template(
        "roughness", [[0]], output="linear", boundary="zero-flux",
        nonlinear=[NonlinearCoupling(RING, table, "u", "u")],
    )  # fmt: skip
    u = np.random.default_rng(0).uniform(-1, 1, (5, 6))
    padded = np.pad(u, 1, mode="symmetric")
    expected = sum(
        np.abs(u - padded[1 + r : 6 + r, 1 + c : 7 + c]) for r in (-1, 0, 1) for c in (-1, 0, 1)
    )
    got = engine.run(template, input=u, rtol=1e-6, atol=1e-6)
    assert np.abs(got.state - expected).max() <= 2e-5 * expected.max()


def test_anisotropic_diffusion_agrees_with_its_equation(engine):
    """d(x − x)·(x − x), against SciPy on the equation written out with shifted copies."""
    table = Table("linear", ((-2.0, -0.1), (-0.2, -0.1), (0.0, -0.5), (0.2, -0.1), (2.0, -0.1)))
    template = cnnum.Template(
        "anisotropic", centre(1), output="linear", boundary="zero-flux", duration=1.0,
        nonlinear=[NonlinearCoupling(RING, table, "x", "x", times_argument=True)],
    )  # fmt: skip
    x0 = np.random.default_rng(1).uniform(-1, 1, (4, 5))

    def right(_, flat):
        x = flat.reshape(4, 5)
        padded = np.pad(x, 1, mode="edge")
        total = np.zeros((4, 5))
        for r in (-1, 0, 1):
            for c in (-1, 0, 1):
                v = x - padded[1 + r : 5 + r, 1 + c : 6 + c]
                total += np.interp(v, *zip(*table.points, strict=True)) * v
        return total.ravel()

    expected = solve_ivp(right, (0, 1), x0.ravel(), rtol=1e-10, atol=1e-12).y[:, -1]
    got = engine.run(template, state=x0, rtol=1e-5, atol=1e-6).state.ravel()
    # contracting: the sum of some 30 local errors of 1e-5
    assert np.abs(got - expected).max() <= 3e-4


def test_matcnn_sign_is_the_other_way_round(engine):
    """f(neighbour − centre) equals the same table, mirrored, of centre − neighbour."""
    points = ((-2.0, -1.0), (0.5, 0.2), (2.0, 1.0))
    mirrored = tuple((-v, f) for v, f in reversed(points))
    u = np.random.default_rng(2).uniform(-1, 1, (4, 4))
    results = [
        engine.run(
            cnnum.Template(
                "sign", [[0]], output="linear",
                nonlinear=[
                    NonlinearCoupling(RING, Table("linear", p), "u", "u", reversed_sign=back)
                ],
            ),
            input=u,
        ).state
        for p, back in ((points, True), (mirrored, False))
    ]  # fmt: skip
    assert np.abs(results[0] - results[1]).max() <= 1e-5
    assert np.ptp(results[0]) > 0.1


def test_median_within_its_chatter(engine):
    table = Table("constant", ((0.01, 0.5), (2.5, -0.5)))
    template = cnnum.Template(
        "median", centre(1), boundary="zero-flux", initial="input", duration=20.0,
        nonlinear=[NonlinearCoupling(np.ones((3, 3)), table, "u", "x")],
    )  # fmt: skip
    u = np.random.default_rng(3).uniform(-0.9, 0.9, (4, 5))
    got = engine.run(template, input=u)
    # nine neighbours change it by 0.09 in a step, and the table's own threshold lies at 0.01
    assert np.abs(got.output - median_filter(u, size=3, mode="nearest")).max() <= 0.09 + 0.01
    # which is no bound on the error: random networks of such tables were off by more
    assert np.isinf(got.error)


def test_discrete_time_takes_whole_steps_of_the_sign(engine):
    """A = east neighbour: every step moves the picture one cell to the west."""
    template = cnnum.Template(
        "move", [[0, 0, 0], [0, 0, 1], [0, 0, 0]], boundary=-1.0, initial="input",
        output="sign", duration=2.0,
    )  # fmt: skip
    u = np.where(np.random.default_rng(4).random((3, 7)) < 0.5, 1.0, -1.0)
    expected = np.pad(u, ((0, 0), (0, 2)), constant_values=-1.0)[:, 2:]
    got = engine.run(template, input=u)
    np.testing.assert_array_equal(got.output, expected)
    assert got.steps == 2


def test_couplings_that_do_not_fit_are_refused():
    table = Table("linear", ((0.0, 0.0), (1.0, 1.0)))
    with pytest.raises(TemplateError, match="does not exist"):
        cnnum.Template("bad", [[0]], nonlinear=[NonlinearCoupling(RING, table, "y", to=1)])
    with pytest.raises(TemplateError, match="increasing"):
        Table("linear", ((1.0, 0.0), (0.0, 1.0)))
    with pytest.raises(TemplateError, match="above 0"):
        DelayedCoupling(0.0, np.zeros((1, 1, 1, 1)), np.zeros((1, 0, 1, 1)))


@pytest.mark.parametrize("shape", [(1, 4), (260, 300)])
def test_a_turn_of_a_swing_is_no_rest(engine, shape):
    """Cells swing for long before they rest; at each turn their rates are small for a step."""
    if shape[0] > 1 and engine.name == "reference":
        pytest.skip("the reference engine takes minutes for an array of this size")
    template = delayed(centre(-0.85), delay=1.9, duration="settle")
    found = engine.run(template, state=np.full(shape, 0.2), rtol=1e-2, atol=2e-2)
    assert found.settled.all()
    # rates are below 0.02 for more than a delay. A swing of 1.5 a time constant turns nearly once
    # in it, and is below that tolerance itself
    assert np.abs(found.state).max() < 0.04
    assert float(np.max(found.time)) > 10.0


def test_an_input_that_is_to_come_is_no_rest(engine):
    """The cell rests under the input of before, until the delay is over."""
    template = delayed(centre(0), delay=2.0, control=centre(1), duration="settle")
    now, before = np.full((2, 3), 0.5), np.zeros((2, 3))
    found = engine.run(template, input=now, previous=before, state=np.zeros((2, 3)))
    assert found.settled.all()
    assert np.abs(found.state - 0.5).max() < 1e-3


def test_virtual_cells_of_a_limited_state_keep_theirs(engine):
    """x' = −x + g(x of the neighbour), whose virtual cells are beyond 1, where g still changes."""
    edge, table = 1.7, Table("linear", ((-2.0, -0.8), (2.0, 0.8)))
    weights = np.zeros((3, 3))
    weights[1, 0] = weights[1, 2] = 0.5
    coupling = NonlinearCoupling(weights, table, "x")
    template = cnnum.Template(
        "rim", [[0.0]], output="full-range", boundary=edge, nonlinear=[coupling], duration=1.0
    )
    got = engine.run(template, state=np.full((3, 1), 0.2), rtol=1e-6, atol=1e-7).state
    rest = 0.4 * edge  # both neighbours of a column are virtual
    assert got == pytest.approx(rest + (0.2 - rest) * np.exp(-1.0), abs=1e-5)
