"""Every `error` that is stated covers the true one, or is infinite: nothing is known of it."""

import math

import numpy as np
import pytest

import cnnum
from cnnum.engine import Engine
from cnnum.errors import MethodError
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.estimate import LOST
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS
from cnnum.integrators.stability import METHODS, stability_bound
from cnnum.lab.bench.followed_steps import frames, network
from cnnum.templating.couplings import DelayedCoupling, NonlinearCoupling
from cnnum.templating.functions import Table

SHAPE, NETWORKS = (5, 6), 40
OWN_STEPS = ("runge-kutta-chebyshev", *IMPLICIT_METHODS)
STEPS = tuple(method for method in METHODS if method not in OWN_STEPS)


@pytest.fixture(scope="module")
def known():
    """Random networks with a frame, and their true end, to 1e-11 a step."""
    rng, engine = np.random.default_rng(31), Engine("numba", precision="float64")
    found = []
    for _ in range(NETWORKS):
        template = network(rng)
        maps = {name: values[0] for name, values in frames(rng, template, 1, SHAPE).items()}
        how = {"method": "dormand-prince", "rtol": 1e-11, "atol": 1e-11}
        found.append((template, maps, engine.run(template, **how, **maps)))
    return found


def covers(run, truth):
    """Whether a run states an error that its true one is below, that of the truth left out."""
    return np.abs(run.state - truth.state).max() <= run.error + truth.error


@pytest.mark.parametrize("name", ["numba", "reference", "opencl"])
def test_fixed_steps_cover_the_truth_or_are_infinite(name, known):
    engine, rng = Engine(name), np.random.default_rng(32)
    for number, (template, maps, truth) in enumerate(known):
        # kernels take a second to compile: of each network OpenCL runs one method, and of some
        methods = ("auto", *STEPS) if name != "opencl" else (("auto", *STEPS)[number % 8],)
        for method in methods if name != "opencl" or number < 8 else ():
            bound = stability_bound(template, SHAPE, "euler" if method == "auto" else method)
            dt = min(0.5, rng.uniform(0.1, 0.9) * bound.step)
            if dt == 0.0:  # no step is stable
                continue
            run = engine.run(template, method=method, dt=dt, **maps)
            assert np.isinf(run.error) or covers(run, truth)


def test_the_reference_covers_the_truth(known):
    """One of its solutions in three missed a kink of f, by up to 1e-3 where it stated 1e-10."""
    runs = [(Engine("reference").run(template, **maps), truth) for template, maps, truth in known]
    assert all(covers(run, truth) for run, truth in runs)
    # a tenth of others' tolerance, of states that may grow without end
    assert all(run.error < 1e-5 * max(1.0, np.abs(run.state).max()) for run, _ in runs)


def test_a_kink_that_all_stages_miss_is_found():
    """Dormand-Prince 8(5,3) at 1e-10 misses one of PROP2's fronts by 1e-3."""
    template = cnnum.get_template("PROP2")
    grows = np.where(np.arange(8) < 3, -1.0, 1.0)
    front = np.broadcast_to(grows, (8, 8))
    run = Engine("reference").run(template, input=front)
    how = {"method": "dormand-prince", "rtol": 1e-11, "atol": 1e-11}
    truth = Engine("numba", precision="float64").run(template, input=front, **how)
    assert covers(run, truth)
    assert np.abs(run.state - truth.state).max() < 1e-6


def cases():
    steps = Table("constant", ((-0.3, 1.0), (0.4, -0.6)))
    jumps = [NonlinearCoupling(np.full((3, 3), 0.2), steps, "x")]
    late = DelayedCoupling(0.5, np.full((1, 1, 1, 1), 0.5), np.zeros((1, 1, 1, 1)))
    kernel = np.random.default_rng(33).normal(size=(3, 3))
    return {
        "jumps": cnnum.Template("jumps", [[0.4]], [[1.0]], nonlinear=jumps, duration=2.0),
        "late": cnnum.Template("late", [[0.4]], [[1.0]], delayed=late, duration=2.0),
        "discrete": cnnum.Template("discrete", kernel, kernel, output="sign", duration=3.0),
    }


@pytest.mark.parametrize("case", cases())
@pytest.mark.parametrize("label", ["opencl-float32", "numba-float32", "reference"])
def test_nothing_is_stated_of_what_no_estimate_follows(engines, label, case):
    template, engine = cases()[case], engines[label]
    u = np.random.default_rng(34).uniform(-1, 1, SHAPE)
    asked = {"discrete": [{}], "late": [{"dt": 0.1}, {"dt": 0.05, "method": "euler"}]}
    for how in asked.get(case, [{}, {"dt": 0.1}]):
        assert np.isinf(engine.run(template, input=u, **how).error)
    with pytest.raises(MethodError, match=r"^The error of .* cannot be estimated: run template"):
        engine.run(template, input=u, estimate=True)


@pytest.mark.parametrize(
    "label", ["opencl-float32", "opencl-float64", "numba-float32", "reference"]
)
@pytest.mark.parametrize("method", ["euler", "rk4", "etd-rk2"])
def test_programs_read_more_than_any_tolerance(engines, label, method):
    """It was -1, which every comparison with a tolerance took for a good run."""
    template = cnnum.Template("blinks", np.full((3, 3), 0.3), [[1.0]], duration=2.0)

    @cnnum.program
    def trusts(frame):
        spec = RunSpec(method=method, dt=0.2)
        run = cnnum.transient(template, input=frame.channel("u"), spec=spec)
        return {"error": run.error, "good": run.error < 1e-2}

    engine = engines[label]
    out = engine.compile(trusts, shape=SHAPE, channels=("u",))(np.zeros((*SHAPE, 1)))
    assert not out["good"]
    assert LOST <= out["error"] < math.inf
