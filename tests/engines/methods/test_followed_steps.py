"""Fixed steps whose error is followed: the same steps, and an error that covers the true one."""

import math
from fractions import Fraction

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.errors import MethodError
from cnnum.integrators.estimate import FLOOR, SAFETY
from cnnum.integrators.stability import METHODS as EVERY_METHOD
from cnnum.integrators.stability import stability_bound
from cnnum.integrators.tableau import TABLEAUX, ButcherTableau
from cnnum.lab.bench.followed_steps import (
    EXPONENTIAL,
    METHODS,
    OUTPUTS,
    frames,
    judged,
    network,
    sample,
)
from cnnum.templating.couplings import DelayedCoupling
from cnnum.templating.template import Template

REFERENCE = Engine("reference")
LABELS = ("opencl-float64", "numba-float64", "reference")


@pytest.fixture(scope="module")
def known():
    """Networks with their frames and true states, far wider than the estimate's own cases."""
    return list(sample(10, 4))


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_error_covers_the_truth(engines, known, precision):
    """At least 99 % of all runs, in steps of the whole stability bound down to its hundredth."""
    rng = np.random.default_rng(25 if precision == "float32" else 26)
    covered, medians = list[np.ndarray](), dict[str, float]()
    for at, method in enumerate((*METHODS, *EXPONENTIAL)):
        # kernels take a second to compile: of each method one network is OpenCL's, of each another
        runs = [
            judged(
                engines[f"{'numba' if number != at else 'opencl'}-{precision}"], method, one, rng
            )
            for number, one in enumerate(known)
        ]
        stated = [run for run in runs if run is not None]
        assert len(stated) >= 7
        covered += [estimate >= error for estimate, error in stated]
        loose = [(estimate[error > 1e-8] / error[error > 1e-8]) for estimate, error in stated]
        medians[method] = float(np.median(np.concatenate(loose)))
    assert np.concatenate(covered).mean() >= 0.99
    # an estimate that says nothing would cover, too: 3 to 30 in the median of 100 networks. In
    # single precision the error of steps of high order is roundings, which cancel where the
    # estimate adds them up
    low = ("euler", "heun", *EXPONENTIAL)
    assert max(medians[name] for name in low) < 20.0
    assert max(medians[name] for name in (low if precision == "float32" else medians)) < 200.0


@pytest.mark.one_in(2)
@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("method", [*METHODS, *EXPONENTIAL])
def test_the_steps_are_those_that_are_not_followed(engines, label, method):
    """Layers with their own τ and a mask, to the roundings of the sums."""
    number = (*METHODS, *EXPONENTIAL).index(method) + LABELS.index(label)
    rng = np.random.default_rng(number)
    engine = engines[label]
    template = network(rng, OUTPUTS[number % (3 if method == "etd-rk2" else 4)])
    maps = frames(rng, template, 3, (5, 6)) | {"mask": rng.random((5, 6)) < 0.2}
    dt = min(0.07, 0.9 * stability_bound(template, (5, 6), method).step)
    how = {"method": method, "duration": 20 * dt, "dt": dt}
    plain = engine.run(template, **how, **maps)
    followed = engine.run(template, **how, estimate=True, **maps)
    assert followed.method == plain.method == method
    assert followed.reason == plain.reason
    np.testing.assert_array_equal(followed.steps, plain.steps)
    np.testing.assert_allclose(followed.time, plain.time, rtol=1e-12)
    np.testing.assert_array_equal(followed.settled, plain.settled)
    assert np.isinf(plain.error).all()
    assert np.isfinite(followed.error).all()
    # 20 steps in float64, within their stability bound
    scale = 1.0 + np.abs(plain.state).max()
    assert np.abs(followed.state - plain.state).max() <= 1e-12 * scale


@pytest.mark.parametrize("method", ["euler", "rk4", "exponential-euler"])
def test_engines_estimate_the_same(engines, method):
    rng = np.random.default_rng(23)
    template = network(rng, "standard")
    maps = frames(rng, template, 4, (6, 7))
    dt = 0.5 * min(0.2, stability_bound(template, (6, 7), method).step)
    plain, *others = (
        engine.run(template, method=method, dt=dt, estimate=True, **maps)
        for engine in (REFERENCE, engines["opencl-float64"], engines["numba-float64"])
    )
    for one in others:
        # differences of rates, each of 1e-16
        np.testing.assert_allclose(one.error, plain.error, rtol=1e-6)


@pytest.mark.parametrize("label", ["opencl-float32", "numba-float32"])
def test_many_steps_of_single_precision_are_as_many_as_asked_for(engines, label):
    """Rounded sums of 20,000 steps would reach the end some steps early or late."""
    template = Template("decay", [[0.5]], initial=1.0, duration=19.0, output="tanh")
    run = engines[label].run(template, state=np.ones((2, 3)), dt=0.00095, estimate=True)
    assert run.steps == 20_000
    assert run.time == pytest.approx(19.0, rel=1e-6)


def test_linear_cells_have_the_error_of_their_formula(engines):
    """Of x' = −x a step of Euler's adds h²/2 of its state, which then decays by e^{−h} a step."""
    template = Template("decay", [[0.0]], output="linear")
    how = {"state": np.ones((2, 3)), "duration": 1.0, "method": "euler", "estimate": True}
    for count in (10, 40):
        h, error = 1.0 / count, abs((1.0 - 1.0 / count) ** count - math.exp(-1.0))
        got = engines["opencl-float64"].run(template, dt=h, **how).error
        added = [h**2 / 2 * (1 - h) ** n * math.exp(-h * (count - 1 - n)) for n in range(count)]
        # roundings are counted, too: 4 a step
        assert got == pytest.approx(SAFETY * sum(added) + FLOOR * 1e-5, rel=1e-11)
        assert error <= got <= 1.1 * SAFETY * error


@pytest.mark.parametrize("weight", [-0.9, 0.9])
@pytest.mark.parametrize("method", ["rk4", "heun"])
def test_a_step_over_a_corner_states_what_it_is_off_by(method, weight):
    """The stages of a step may all lie on one side of the corner, and show no error."""
    template = Template("bends", [[weight]], None, min(0.0, -weight), duration=1.0)
    start = np.linspace(1.001, 3.0, 100).reshape(-1, 1, 1)
    known = REFERENCE.run(template, state=start).state
    for steps in (1, 2, 3):
        how = {"method": method, "dt": 1.0 / steps, "estimate": True}
        run = Engine("numba", precision="float64").run(template, state=start, **how)
        off = np.abs(run.state - known).max(axis=(1, 2))
        assert np.all(off <= run.error)
        assert np.median(run.error / off) < 3.0


@pytest.mark.in_full("test_error_covers_the_truth")
@pytest.mark.one_in(2)
@pytest.mark.parametrize("seed", range(3))
def test_large_arrays_are_followed_strip_by_strip(seed, monkeypatch):
    """All methods and boundaries and outputs, as the reference follows them."""
    if seed:
        monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    rng = np.random.default_rng(30 + seed)
    output = ("standard", "linear", "full-range")[seed]
    kernel = rng.normal(size=(3, 3)) * 0.2
    boundary = (0.3, "zero-flux", "periodic")[seed]
    template = Template("large", kernel, [[1.0]], 0.1, boundary=boundary, output=output)
    maps = {name: rng.uniform(-1, 1, (2, 48 + seed, 51)) for name in ("input", "state")}
    engine = Engine("opencl", precision="float64")
    for method in [*METHODS, *EXPONENTIAL][seed::3]:
        how = {"method": method, "duration": 0.5, "dt": 0.1, "estimate": True}
        got, wanted = (one.run(template, **how, **maps) for one in (engine, REFERENCE))
        np.testing.assert_array_equal(got.steps, 5)
        np.testing.assert_allclose(got.error, wanted.error, rtol=1e-6)
        assert np.abs(got.state - wanted.state).max() <= 1e-13 * np.abs(wanted.state).max()


def test_runs_to_equilibrium_are_followed(engines):
    rng = np.random.default_rng(24)
    template = Template("settles", rng.normal(size=(3, 3)) * 0.1, [[1.0]], duration="settle")
    maps = {name: rng.uniform(-1, 1, (3, 6, 7)) for name in ("input", "state")}
    for label in LABELS:
        engine = engines[label]
        run = engine.run(template, dt=0.1, estimate=True, **maps)
        assert run.settled.all()
        assert (run.time < 50.0).all()
        assert np.isfinite(run.error).all()


def test_what_is_not_followed_is_refused_in_a_sentence(engines):
    engine, u = engines["numba-float64"], np.zeros((4, 5))
    coupling = DelayedCoupling(1.0, np.full((1, 1, 1, 1), 0.5), np.zeros((1, 1, 1, 1)))
    late = Template("late", [[0]], [[1]], delayed=coupling, duration=2)
    limited = Template("limited", [[0.5]], [[1]], output="full-range", duration=2)
    for template, how, why in (
        (late, {}, "steps with a delay cannot be estimated"),
        (
            limited,
            {"method": "etd-rk2", "dt": 0.1},
            "'etd-rk2' with a limited state cannot be estimated",
        ),
        (limited, {"dt": 1e-5}, "at most 100000 steps can be estimated, got 200000"),
    ):
        with pytest.raises(MethodError, match=why):
            engine.run(template, input=u, estimate=True, **how)


ONE = Fraction(1)
SSP3 = ButcherTableau(  # Shu & Osher 1988: a method that is not in the house
    "ssp3", ((), (ONE,), (ONE / 4, ONE / 4)), (ONE / 6, ONE / 6, 4 * ONE / 6), 3
)
APART = ButcherTableau(  # the third stage does not see the second, so that none reaches z³
    "apart", ((), (ONE / 2,), (ONE, 0 * ONE)), (0 * ONE, ONE, 0 * ONE), 2
)


ROW = np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.9], [0.0, 0.0, 0.0]])


@pytest.mark.parametrize("label", LABELS)
def test_a_method_that_is_added_is_followed(engines, label, monkeypatch):
    monkeypatch.setitem(TABLEAUX, "ssp3", SSP3)
    template = Template("added", ROW, [[1.0]], duration=2.0)
    rng = np.random.default_rng(3)
    maps = {name: rng.uniform(-1.5, 1.5, (2, 4, 5)) for name in ("input", "state")}
    engine = engines[label]
    run = engine.run(template, method="ssp3", dt=0.1, estimate=True, **maps)
    assert (run.method, run.steps.tolist()) == ("ssp3", [20, 20])
    off = np.abs(run.state - REFERENCE.run(template, **maps).state).max(axis=(1, 2))
    assert np.all(off > 1e-6)
    assert np.all(run.error >= off)
    # as loose as that of the methods of the house
    assert np.all(run.error <= 100.0 * off)


def test_stages_that_show_nothing_are_refused(engines, monkeypatch):
    monkeypatch.setitem(TABLEAUX, "apart", APART)
    template, start = Template("plain", [[0.5]], output="tanh", duration=1.0), np.ones((2, 3))
    with pytest.raises(MethodError, match="The error of 'apart', whose stages do not show it"):
        engines["numba-float64"].run(template, state=start, method="apart", estimate=True)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", EVERY_METHOD)
@pytest.mark.parametrize("dt", [None, 0.05])
def test_every_method_is_followed_or_says_why_not(engines, method, dt):
    feedback = np.array([[0.0, 0.2, 0.0], [0.2, 0.3, 0.2], [0.0, 0.2, 0.0]])
    rng = np.random.default_rng(4)
    maps = {name: rng.uniform(-1, 1, (4, 5)) for name in ("input", "state")}
    for output in OUTPUTS:
        template = Template("each", feedback, [[1.0]], 0.1, output=output, duration=1.0)
        how = {"method": method, "dt": dt, "estimate": True}
        own_steps = ("runge-kutta-chebyshev", "rodas3")
        limited = method in ("etd-rk2", *own_steps) and template.output.limited
        if limited or (method in own_steps and dt):
            with pytest.raises(MethodError, match=r"\.$"):
                engines["numba-float64"].run(template, **how, **maps)
            continue
        run = engines["numba-float64"].run(template, **how, **maps)
        off = np.abs(run.state - REFERENCE.run(template, **maps).state).max()
        assert off <= run.error < math.inf


def test_forced_steps_stay_marked(engines):
    template = Template("fast", [[-9.0]], [[1]], output="tanh", duration=2)
    run = engines["numba-float64"].run(
        template, input=np.zeros((4, 5)), state=np.ones((4, 5)), dt=0.5, force=True, estimate=True
    )
    assert math.isinf(run.error)
