"""Steps at the stability bound, against eigenvalues of dense matrices and runs of the arrays."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

import cnnum
from cnnum.errors import MethodError
from cnnum.integrators.exponential import EXPONENTIAL_METHODS
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS
from cnnum.integrators.spectrum import field_of_values, spectrum
from cnnum.integrators.stability import METHODS, _scanned, stability_bound, tableau_step
from cnnum.integrators.tableau import TABLEAUX
from cnnum.templating.couplings import DelayedCoupling, NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.network import Network
from cnnum.templating.template import Template

OWN_STEPS = ("runge-kutta-chebyshev", *IMPLICIT_METHODS)
STEPPING = [name for name in METHODS if name not in OWN_STEPS]
BOUNDARIES = np.array([0.0, -1.0, "zero-flux", "periodic"], dtype=object)
ADVECTION = [[0, 0, 0], [-3.0, 0, 3.0], [0, 0, 0]]


def factors(method, step, rates):
    """Factors of modes in a step, stage by stage: x' = λx, or x' = −x + (λ + 1)x."""
    rates = np.asarray(rates, dtype=complex)
    if method in EXPONENTIAL_METHODS:
        kept, first = math.exp(-step), -math.expm1(-step)
        once = kept + first * (rates + 1.0)
        second = (first / step - 1.0) / -step * step  # h φ₂(−h)
        return once if method == "exponential-euler" else once + second * (rates + 1) * (once - 1)
    tableau, slopes = TABLEAUX[method], []
    for row in tableau.a:
        stage = 1.0 + sum(step * float(a) * k for a, k in zip(row, slopes, strict=True))
        slopes.append(rates * stage)
    return 1.0 + sum(step * float(b) * k for b, k in zip(tableau.b, slopes, strict=True))


def sampled(rng, output):
    radius = int(rng.choice([1, 1, 2]))
    k = 2 * radius + 1
    feedback = rng.normal(size=(k, k)) * (rng.random((k, k)) < rng.uniform(0.2, 1.0))
    if rng.random() < 0.3:
        feedback -= feedback[::-1, ::-1]  # it only turns
    feedback *= rng.uniform(0.1, 6.0) / max(1e-9, float(np.abs(feedback).sum()))
    return Template("sampled", feedback, boundary=rng.choice(BOUNDARIES), output=output)


@pytest.mark.parametrize("shape", [(5, 6), (8, 8), (3, 90)], ids=str)
def test_no_mode_of_a_linear_array_that_decays_grows(shape):
    """(3, 90) has more states than eigenvalues are computed of: its bound is that of a region."""
    rng = np.random.default_rng(5)
    known = 0
    for _ in range(15 if shape != (3, 90) else 8):
        template = sampled(rng, "linear")
        rates = np.linalg.eigvals(Network(template, shape).linear_system().matrix)
        # a mode that the decomposition cannot set apart from one that only turns is left out
        decaying = rates[rates.real <= -1e-6]
        for method in STEPPING:
            step = stability_bound(template, shape, method).step
            if method in ("rk4", "bogacki-shampine", "dormand-prince"):
                # their regions hold rates that only turn: some step is always stable
                reach = 1.0 + float(np.abs(template.A).sum())
                assert step > 0.2 * TABLEAUX[method].real_stability / reach
            if 0.0 < step < math.inf and len(decaying):
                known += 1
                # 1e-9 a step is allowed; of it, rounding of eigenvalues of a skew matrix is 1e-7
                assert np.abs(factors(method, 0.999 * step, decaying)).max() <= 1.0 + 2e-7
    assert known > 30


def test_modes_that_saturate_grow_no_faster_than_the_array():
    """Any pattern of slopes from 0 to 1: no mode grows faster than the array's largest norm."""
    rng, shape = np.random.default_rng(6), (5, 6)
    contracting = 0
    for _ in range(12):
        template = sampled(rng, str(rng.choice(["standard", "tanh", "full-range"])))
        linear = Network(template, shape).linear_system().matrix + np.eye(30)
        # the logarithmic norm, over all patterns, by its rows
        own = np.diag(linear)
        others = np.abs(linear).sum(axis=1) - np.abs(own)
        growth = max(0.0, float((np.maximum(own, 0.0) + others - 1.0).max()))
        contracting += growth == 0.0
        slopes = [np.ones(30), *rng.integers(0, 2, (4, 30)), *rng.random((4, 30))]
        patterns = np.array([np.linalg.eigvals(linear * d - np.eye(30)) for d in slopes])
        for method in STEPPING:
            step = 0.999 * stability_bound(template, shape, method).step
            if not 0.0 < step < math.inf:
                continue
            grown = np.abs(factors(method, step, patterns[patterns.real < -1e-6])).max()
            own_growth = abs(factors(method, step, growth))
            assert grown <= max(math.exp(growth * step), own_growth) * (1.0 + 2e-7)
    assert contracting > 2


@pytest.mark.parametrize("method", STEPPING)
@pytest.mark.parametrize("output", ["linear", "standard"])
def test_advection_dies_out_in_the_steps_that_are_let_through(method, output):
    """Its row sums alone let steps through at which Euler's method made 1e50 of it."""
    template = Template("advect", ADVECTION, boundary="zero-flux", output=output, duration=60.0)
    bound = stability_bound(template, (8, 8), method).step
    start = np.random.default_rng(0).uniform(-0.1, 0.1, (8, 8))
    engine = cnnum.Engine("reference")
    result = engine.run(template, state=start, method=method, dt=0.999 * bound)
    # the array itself: 2e-11 after 60 time constants; at the bound a mode may hardly decay
    assert np.abs(result.state).max() < 3.0 * np.abs(start).max()
    inside = engine.run(template, state=start, method=method, dt=0.9 * bound)
    assert np.abs(inside.state).max() < 1e-3


def test_powers_of_a_one_sided_coupling_stay_near_the_truth():
    """All eigenvalues of x'_n = −x_n + 5 x_{n−1} are −1, which lets Euler take steps of 2."""
    template = Template("chain", [[0, 0, 0], [5.0, 0, 0], [0, 0, 0]], output="linear")
    bound = stability_bound(template, (1, 8), "euler").step
    matrix = Network(template, (1, 8)).linear_system().matrix
    power, largest = np.eye(8), 0.0
    for _ in range(200):
        power = power + bound * matrix @ power
        largest = max(largest, float(np.abs(power).max()))
    # e^{−t} (5t)⁷/7! at t = 7, the truth's own largest growth
    assert largest < 2.0 * math.exp(-7.0) * 35.0**7 / math.factorial(7)


@pytest.mark.parametrize("boundary", [0.0, 0.5, "zero-flux"])
@pytest.mark.parametrize("layers", [1, 2])
def test_the_box_holds_the_field_of_values(boundary, layers):
    """x* M x of random vectors, and of those where its parts are largest."""
    rng = np.random.default_rng(7)
    for radius in (1, 2):
        feedback = rng.normal(size=(layers, layers, 2 * radius + 1, 2 * radius + 1))
        tau = [0.4, 1.5][:layers]
        template = Template("any", feedback, z=[0.0] * layers, tau=tau, boundary=boundary)
        network = Network(template, (11, 12))
        system = network.linear_system()
        root = np.sqrt(system.rates)
        matrix = system.matrix / root[:, None] * root
        box = field_of_values(network)
        even, odd = 0.5 * (matrix + matrix.T), 0.5 * (matrix - matrix.T)
        real, turning = np.linalg.eigvalsh(even), np.linalg.eigvalsh(-1j * odd)
        assert box.left <= real[0] + 1e-9
        assert box.right >= real[-1] - 1e-9
        assert box.height >= turning[-1] - 1e-9
        # no needlessly large box: a fixed rim changes little at this size, rows add up to more
        room = 1.15 if boundary != "zero-flux" else 2.5
        assert box.right - box.left <= room * (real[-1] - real[0])


def test_symmetric_and_one_signed_couplings_keep_their_bound():
    """Two over the largest rate: 1 + Σ|a| where a row saturates, the modes' where A is even."""
    hole, shadow = cnnum.get_template("HOLE"), cnnum.get_template("SHADOW")
    for template in (hole, shadow):
        rate = 1.0 + float(np.abs(template.A).sum())
        assert stability_bound(template, (8, 8), "euler").step >= 0.999 * 2.0 / rate
        for name in ("rk4", "bogacki-shampine", "dormand-prince"):
            wanted = TABLEAUX[name].real_stability / rate
            assert stability_bound(template, (8, 8), name).step >= 0.99 * wanted


def test_auto_never_steps_outside_the_bound():
    """The mean of the steps that were taken, rejected ones counted, over long finite runs."""
    rng, engine = np.random.default_rng(3), cnnum.Engine("numba", precision="float64")
    near = 0
    for _ in range(8):
        feedback = rng.normal(size=(3, 3))
        feedback *= rng.uniform(2.0, 6.0) / np.abs(feedback).sum()
        template = Template("sampled", feedback, boundary="zero-flux", duration=200.0)
        result = engine.run(template, state=rng.uniform(-1, 1, (8, 8)), rtol=1e-2, atol=1e-3)
        bound = stability_bound(template, (8, 8), result.method).step
        assert 200.0 / result.steps <= bound * (1.0 + 1e-9)
        near += 200.0 / result.steps > 0.8 * bound
    assert near > 2


@pytest.mark.parametrize("kind", ["delayed", "jumping"])
def test_auto_takes_shorter_steps_for_fast_rates_where_its_own_are_fixed(kind):
    """A centre of −60 makes rates of 61, or −400 of 401: 0.05 and 0.01 are outside of the bound."""
    one = np.full((1, 1, 1, 1), 0.3)
    coupling = DelayedCoupling(0.5, one, np.zeros((1, 0, 1, 1)))
    steps = Table("constant", ((-1.0, -0.2), (0.0, 0.2)))
    jumping = NonlinearCoupling(np.ones((1, 1)), steps, "x")
    centre = -60.0 if kind == "delayed" else -400.0
    parts = {"delayed": coupling} if kind == "delayed" else {"nonlinear": [jumping]}
    template = Template(
        "fast", [[centre]], z=1.0, initial=0.01, duration=2.0, output="linear", **parts
    )
    result = cnnum.Engine("numba").run(template, state=np.full((2, 2), 0.01))
    step = 2.0 / result.steps
    assert step <= 0.5 * stability_bound(template, (2, 2), result.method).step * (1 + 1e-9)
    # at rest: (1 − centre) x = 1 + 0.3 x, or 1 ± 0.2
    rest = 1.0 / (60.7 if kind == "delayed" else 401.0)
    assert np.abs(result.state - rest).max() < (1e-6 if kind == "delayed" else 1e-3)


def test_where_no_step_is_known_to_be_stable_that_is_said_and_auto_runs():
    """More cells than eigenvalues are computed of, and a rim that may grow: Euler has no step."""
    template = Template("advect", ADVECTION, boundary="zero-flux", output="linear", duration=3.0)
    assert stability_bound(template, (3, 400), "euler").step == 0.0
    engine = cnnum.Engine("numba", precision="float64")
    start = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 400))
    for how in ({"dt": 0.001}, {"method": "heun", "dt": 0.1}):
        with pytest.raises(MethodError, match=r"stab.*auto"):
            engine.run(template, state=start, **how)
    result = engine.run(template, state=start, rtol=1e-6, atol=1e-8)
    row = Template("row", ADVECTION, boundary="zero-flux", output="linear")
    matrix = Network(row, (1, 400)).linear_system().matrix
    # each row on its own; the tolerance is that of 100 steps or so, each with 1e-6 of order 1
    assert np.abs(result.state - start @ expm(3.0 * matrix).T).max() < 1e-4


def test_a_bound_that_is_kept_is_that_of_its_own_couplings():
    """Arrays of one shape and of rates that turn, in turns: none gets the answer of another."""
    tableau = TABLEAUX["rk4"]
    given = [
        spectrum(cnnum.Template("t", [[0, 0, 0], [0, 2, size], [0, 0, 0]]), (9, 9))
        for size in (0.5, 2.0, 7.0)
    ]
    fresh = [_scanned.__wrapped__(tableau, one) for one in given]
    assert fresh[0] > fresh[1] > fresh[2] > 0.0
    for _ in range(2):
        assert [tableau_step(tableau, one) for one in given] == fresh
