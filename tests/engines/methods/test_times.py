"""The state of a transient at times: that of runs which end there, on every engine."""

from dataclasses import replace

import numpy as np
import pytest
import random_networks
import scipy.linalg
from scipy.integrate import solve_ivp

import cnnum
from cnnum.integrators.closed_forms import propagator
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.network import Network

ENGINES = ("opencl", "numba", "reference")
TIMES = (0.0, 0.5, 1.0, 2.5)
RING = -np.ones((8, 9))
RING[2:6, 2:7] = 1.0
RING[3:5, 4] = -1.0
CENTRE = np.array([[0.0, 0.1, 0.0], [0.2, 1.5, 0.0], [0.0, -0.1, 0.0]])


def late():
    """A cell that follows its neighbour's output of 0.7 time constants ago."""
    weights = np.zeros((1, 1, 3, 3))
    weights[0, 0, 1, 0] = 0.8
    delayed = DelayedCoupling(0.7, weights, np.zeros((1, 1, 3, 3)))
    return cnnum.Template("late", CENTRE, [[0.5]], -0.2, delayed=delayed, duration=3.0)


def swelling():
    """Feedback that grows in time."""
    grows = Gain(0, 0, Table("linear", ((0.0, 0.2), (3.0, 1.0))))
    return cnnum.Template("swelling", CENTRE, [[0.5]], -0.2, gains=(grows,), duration=3.0)


CASES = {
    "uncoupled": (lambda: cnnum.get_template("EDGE"), {"input": RING}),
    "coupled": (lambda: cnnum.get_template("HOLE"), {"input": RING}),
    "linear": (lambda: cnnum.get_template("tactile_diffusion"), {"state": 0.3 * RING}),
    "a batch with a mask": (
        lambda: cnnum.get_template("HOLE"),
        {"input": np.stack([RING, -RING]), "mask": RING > 0},
    ),
    "delayed": (late, {"input": RING}),
    "gains in time": (swelling, {"input": RING}),
}


@pytest.mark.one_in(5)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", CASES)
def test_states_are_those_of_runs_that_end_there(engine, name):
    make, maps = CASES[name]
    template = make()
    used = cnnum.Engine(engine, precision="float64")
    got = used.run(template, **maps, at=TIMES, rtol=1e-6, atol=1e-8)
    trusted = cnnum.Engine("reference")
    assert got.state.shape == (len(TIMES), *np.shape(maps[next(iter(maps))]))
    for n, time in enumerate(TIMES):
        want = trusted.run(template, **maps, duration=time, rtol=1e-6, atol=1e-8)
        # the tolerance over a few stretches, and corners of f between a step's stages
        assert np.abs(got.state[n] - want.state).max() < 2e-4
        assert np.asarray(got.time[n]) == pytest.approx(time)
    assert not np.array_equal(got.state[1], got.state[-1])


def test_errors_are_those_of_runs_that_end_there():
    """A run in float32 keeps within its stated error of the exact one."""
    template, used = cnnum.get_template("HOLE"), cnnum.Engine("numba")
    got = used.run(template, input=RING, at=TIMES)
    exact = cnnum.Engine("reference").run(template, input=RING, at=TIMES, rtol=1e-9, atol=1e-10)
    off = np.abs(got.state - exact.state).max(axis=(1, 2))
    assert (off <= got.error + 1e-6).all()  # float32 rounds states of up to 10 by 6e-7


@pytest.mark.parametrize("engine", ENGINES)
def test_times_change_nothing(engine):
    """The end is that of the run without them, to the bit, and so are its error and its steps."""
    used = cnnum.Engine(engine)
    for how in ({}, {"method": "dormand-prince"}, {"dt": 0.125}, {"dt": 0.125, "estimate": True}):
        if engine == "opencl" and "estimate" in how:
            continue
        whole = used.run("HOLE", input=RING, duration=2.0, **how)
        got = used.run("HOLE", input=RING, at=[0.3, 1.1, 2.0], **how)
        assert np.array_equal(got.state[-1], whole.state)
        assert (got.error[-1], got.steps[-1]) == (whole.error, whole.steps)
        assert (got.steps[:-1] <= whole.steps).all()


def test_a_look_between_steps_is_a_step_that_ends_there():
    """Euler's step is linear in its length, so that looks lie on a straight line."""
    template = cnnum.get_template("HOLE")
    got = cnnum.Engine("numba", precision="float64").run(
        template, input=RING, at=[0.5, 0.55, 0.6, 0.75, 1.0], dt=0.25
    )
    before, after = got.state[0], got.state[3]
    for n, share in ((1, 0.2), (2, 0.4)):
        np.testing.assert_allclose(got.state[n], before + share * (after - before), atol=1e-12)
    assert np.isinf(got.error).all()


@pytest.mark.parametrize("engine", ["opencl", "numba"])
def test_times_are_not_rounded(engine):
    """Times 3e-10 apart were all 0, as they were rounded to 1e-9."""
    template = cnnum.Template("quick", [[0.0]], z=1.0, tau=2e-7)
    times = np.linspace(0.0, 1e-6, 3000)
    got = cnnum.Engine(engine).run(template, state=np.zeros((2, 3)), at=times)
    want = -np.expm1(-times / 2e-7)
    assert np.abs(got.state - want[:, np.newaxis, np.newaxis]).max() < 1e-6
    coupled = cnnum.Template("quick", [[0.5, 0.2, 0.0]] * 3, z=0.1, tau=2e-7, boundary="periodic")
    first, *_, last = cnnum.Engine(engine).run(coupled, state=np.zeros((3, 3)), at=times).state
    assert not first.any()
    # all alike, they grow until they saturate, and come to rest at 2.2
    until = np.log(1.0 + 1.1 / 0.1) / 1.1
    assert np.abs(last - (2.2 - 1.2 * np.exp(until - 5.0))).max() < 1e-3


def linear(rng):
    """Return a random linear array that is exact at every time, and where it ends."""
    layers, k = int(rng.integers(1, 3)), int(rng.choice([1, 3, 5]))
    A = rng.normal(size=(layers, layers, k, k)) * rng.uniform(0.1, 2.0) / k
    if rng.random() < 0.5:  # diagonal in the modes of its boundary
        A = A + A[..., ::-1, :]
        A = (A + A[..., ::-1]) / 4.0
    edge = (0.0, 0.7, "zero-flux", "periodic")[int(rng.integers(4))]
    tau = 10.0 ** rng.uniform(-1.0, 1.0, layers)
    template = cnnum.Template(
        "linear", A, z=rng.normal(size=layers).tolist(), tau=tau.tolist(), boundary=edge,
        output="linear",
    )  # fmt: skip
    fastest = np.abs(Network(template, (3, 4)).linear_system().matrix).sum(axis=1).max()
    return template, rng.uniform(1.0, 40.0) / fastest


def exact(template, start, times):
    """Return the states of a linear array in extended precision, (times, frames, states).

    Taylor's series over stretches of 1/‖M‖, from the matrix of another program.
    """
    real, layers = np.longdouble, template.layers
    if np.finfo(real).eps > 1e-18:
        pytest.skip("No numbers of more than double precision here.")
    frames, _, rows, cols = start.shape
    nothing = np.zeros((layers, 1, 1, 1)), np.zeros((frames, rows, cols))
    edge = template.boundary.constant
    edge = {"symmetric": "zero-flux", "wrap": "periodic"}.get(template.boundary.pad_mode, edge)
    net = random_networks.Network(
        A=template.A, B=nothing[0], z=template.z, tau=template.tau, boundary=edge, rim=0.0,
        output="linear", gains=(), late=None, bends=(), u=nothing[1], x=start, bias=None,
        held=None, times=tuple(times),
    )  # fmt: skip
    truth = random_networks.Truth(net)
    pace = np.repeat(1 / template.tau.astype(real), rows * cols)
    matrix = (truth.feedback - np.eye(len(pace), dtype=real)) * pace[:, np.newaxis]
    drive = truth.still.sum(axis=1).ravel() + np.repeat(template.z.astype(real), rows * cols)
    norm = float(np.abs(matrix).sum(axis=1).max())
    x, now, states = start.reshape(frames, -1).astype(real), real(0), []
    for time in times.astype(real):
        parts = max(1, int(np.ceil(norm * float(time - now))))
        h = (time - now) / parts
        for _ in range(parts):
            term = h * (x @ matrix.T + drive * pace)
            for order in range(2, 40):  # 1/39! is 5e-47
                x, term = x + term, term @ matrix.T * (h / order)
        states.append(x)
        now = time
    return np.array(states)


def test_the_truth_of_a_linear_array_is_its_closed_form():
    """Cells alone: x = w + (x₀ − w) e^{(a − 1)t/τ}, w = z/(1 − a)."""
    times = np.array([0.0, 0.3, 4.0])
    template = cnnum.Template("cell", [[0.25]], z=0.5, tau=0.5, output="linear")
    start, since = np.full((1, 1, 1, 2), 3.0), times.astype(np.longdouble)
    want = np.longdouble(2) / 3 + (3 - np.longdouble(2) / 3) * np.exp(-1.5 * since)
    off = exact(template, start, times)[:, 0] - want[:, np.newaxis]
    assert np.abs(off).max() < 1e-18


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("seed", range(12))
def test_many_times_of_a_linear_array_are_within_their_errors(seed, precision):
    """All but the first time of a stretch follow from that by series."""
    rng = np.random.default_rng(seed)
    template, end = linear(rng)
    times = np.unique([*rng.uniform(0.0, end, 30), *np.linspace(0.0, end, 20)])
    start = rng.uniform(-1.0, 1.0, (2, template.layers, 3, 4)).astype(precision)
    state = start if template.layers > 1 else start[:, 0]
    engine = cnnum.Engine("numba", precision=precision)
    got = engine.run(template, state=state, at=times)
    whole = engine.run(template, state=state, duration=times[-1])
    want = exact(template, start.astype(np.float64), times)
    off = np.abs(got.state.reshape(want.shape) - want).max(axis=2)
    assert (off <= got.error).all()
    alone = engine.run(template, state=state, duration=times[25])
    assert (got.error[25] <= 10.0 * alone.error).all()
    assert np.array_equal(got.state[-1], whole.state)
    assert np.array_equal(got.error[-1], whole.error)


def test_a_time_of_a_linear_array_takes_no_exponential(monkeypatch):
    """3,000 times took 3,000 exponentials, 30 ms each on 8×8 cells."""
    from cnnum.integrators import choice

    counted = []

    def counting(network, duration):
        counted.append(duration)
        return propagator(network, duration)

    monkeypatch.setattr(choice, "propagator", counting)
    sided = [[0.0, 0.0, 0.0], [0.3, 0.2, 0.0], [0.0, 0.0, 0.0]]
    template = cnnum.Template("one-sided", sided, z=0.1, output="linear")
    got = cnnum.Engine("numba").run(
        template, state=np.ones((8, 8)), at=np.linspace(0.0, 10.0, 3000)
    )
    assert got.method == "propagator"
    assert 0 < len(counted) < 10


@pytest.mark.parametrize("numbers", [(0.3, 0.2), (-2.0, 1.5)])
def test_series_grow_and_shrink_errors_as_states_part(numbers):
    """A cell alone: x' = (a − 1) x + w from x₀, off by e₀, with w off by e₁."""
    from cnnum.integrators.series import bounds, grown

    own, since = numbers
    template = cnnum.Template("cell", [[own]], output="linear")
    norm, rate = bounds(template)
    assert rate == pytest.approx(own - 1.0)
    assert norm == pytest.approx(abs(own) + 1.0)
    begun, along = grown(rate, np.array([since]))
    assert begun == pytest.approx(np.exp((own - 1.0) * since))
    assert along == pytest.approx(np.expm1((own - 1.0) * since) / (own - 1.0))


@pytest.mark.parametrize("engine", ENGINES)
def test_whole_steps_of_discrete_time(engine):
    """Half a step is one, as it is for a run that ends there."""
    grows = cnnum.Template(
        "grows", [[0, 1, 0], [1, 1, 1], [0, 1, 0]], z=4.0, boundary=-1.0, output="sign"
    )
    dot = -np.ones((7, 7))
    dot[3, 3] = 1.0
    got = cnnum.Engine(engine).run(grows, state=dot, at=[0, 0.5, 1, 1.5, 2])
    assert [(output > 0).sum() for output in got.output] == [1, 5, 5, 13, 13]
    assert got.time.tolist() == [0.0, 1.0, 1.0, 2.0, 2.0]
    assert got.times == (0.0, 0.5, 1.0, 1.5, 2.0)
    for duration, reached in ((0.0, 0.0), (0.4, 1.0), (1.0, 1.0), (1.0 + 1e-12, 1.0), (2.3, 3.0)):
        alone = cnnum.Engine(engine).run(grows, state=dot, duration=duration)
        assert (alone.time, alone.steps) == (reached, reached), duration


def test_a_run_in_discrete_time_goes_step_by_step():
    grows = cnnum.Template(
        "grows", [[0, 1, 0], [1, 1, 1], [0, 1, 0]], z=4.0, boundary=-1.0, output="sign"
    )
    dot = -np.ones((7, 7))
    dot[3, 3] = 1.0
    got = cnnum.Engine("numba").run(grows, state=dot, at=[0, 1, 2])
    assert [(output > 0).sum() for output in got.output] == [1, 5, 13]


@pytest.mark.parametrize(
    ("at", "said"),
    [
        ([], "'at' must be 1 to"),
        ([1.0, 1.0], "increasing times from 0 on"),
        ([-1.0], "from 0 on"),
        ([np.nan], "finite"),
        ("soon", "'at' must be an array of real numbers"),
        (2.0, "'at' must be 1 to"),
    ],
)
def test_what_is_no_list_of_times_is_said(at, said):
    with pytest.raises(cnnum.CnnumError, match=said):
        cnnum.Engine("numba").run("EDGE", input=RING, at=at)


def test_a_duration_and_times_are_too_much():
    with pytest.raises(cnnum.CnnumError, match="not both"):
        cnnum.Engine("numba").run("EDGE", input=RING, at=[1.0], duration=2.0)


def test_looks_within_the_first_step_of_a_run_with_a_delay_state_enough():
    """Coarser runs would take the same part of a step up to them, and agree."""
    weights = np.full((1, 1, 1, 1), 0.8)
    delayed = DelayedCoupling(0.1, weights, np.zeros((1, 0, 1, 1)))
    template = cnnum.Template("grows", [[20.0]], output="linear", tau=0.36, delayed=delayed)
    times = (0.004, 0.0129, 0.0417, 0.15, 0.37)
    got = cnnum.Engine("numba", precision="float64").run(
        template, state=np.ones((1, 2)), at=times, rtol=1e-3, atol=1e-3
    )
    # x' = (19 x + 0.8 x(t − 0.1)) / 0.36, by the method of steps
    want, ways, x = [], [], [1.0]
    for low in np.arange(0.0, 0.4, 0.1):
        before = ways[-1].sol if ways else np.ones_like
        way = solve_ivp(
            lambda t, x, seen=before: (19.0 * x + 0.8 * np.ravel(seen(t - 0.1))[0]) / 0.36,
            (low, low + 0.1), x, method="DOP853", rtol=1e-12, dense_output=True,
        )  # fmt: skip
        ways.append(way)
        x = way.y[:, -1]
        want += [way.sol(t)[0] for t in times if low < t <= low + 0.1]
    off = np.abs(got.state[:, 0, 0] - want)
    assert (off <= got.error).all()
    # a step is short against the growth, which two runs would else mistake for chaos
    assert (got.error < 0.05 * np.abs(want)).all()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", ["exponential-euler", "etd-rk2"])
def test_exponential_steps_end_at_each_time(engine, method):
    """A part of a step had the numbers of a whole one: 0.0043 off where each step is exact."""
    decays = cnnum.Template("decays", [[0.0]], z=1.0, output="tanh")
    times = np.array([0.3, 2.1, 3.3, 7.0])
    how = {"state": np.zeros((1, 2)), "at": times, "method": method}
    engine = cnnum.Engine(engine, precision="float64")
    for estimate in (False, True):
        got = engine.run(decays, **how, estimate=estimate)
        assert np.abs(got.state[:, 0, 0] + np.expm1(-times)).max() < 1e-14
        assert got.time.tolist() == times.tolist()


@pytest.mark.parametrize("engine", ENGINES)
def test_the_start_is_known_to_its_rounding(engine):
    template = cnnum.Template("start", [[0.5]], output="tanh")
    start = np.array([[1000.1, 0.1]])
    run = cnnum.Engine(engine, precision="float32" if engine != "reference" else "float64").run(
        template, state=start, at=[0.0, 1e-9, 1.0]
    )
    assert np.all(np.abs(run.state[0] - start) <= run.error[0])
    # four roundings of the largest number, as a run of no duration states
    alone = cnnum.Engine(engine).run(template, state=start, duration=0.0)
    assert run.error[0] <= 2.0 * max(alone.error, 1e-12)


def pulled(rng):
    """Return a template of two layers that grows and saturates, and a batch of starts."""
    A = rng.normal(size=(2, 2, 3, 3)) * 0.15
    A[0, 0, 1, 1] += 1.2
    template = cnnum.Template("pulled", A, z=[0.1, -0.2], tau=[1.0, 3.0], output="tanh")
    return template, rng.uniform(-1.0, 1.0, (2, 2, 3, 4))


@pytest.mark.parametrize("method", ["exponential-euler", "etd-rk2"])
def test_a_part_of_an_exponential_step_has_the_numbers_of_its_length(method):
    """It is a step of that length from where the last whole one ends."""
    template, start = pulled(np.random.default_rng(2))
    engine = cnnum.Engine("numba", precision="float64")
    how = {"method": method, "dt": 0.25}
    times = np.array([0.0, 0.1, 0.5, 0.77, 1.0, 2.0 + 1e-14, 2.9, 3.0])
    got = engine.run(template, state=start, **how, at=times)
    whole = engine.run(template, state=start, **how, duration=3.0)
    assert np.array_equal(got.state[-1], whole.state)
    assert got.steps[:, 0].tolist() == [0, 1, 2, 4, 4, 8, 12, 12]
    for at, time in enumerate(times):
        steps = int(time / 0.25)
        want, part = start, time - 0.25 * steps
        if steps:
            want = engine.run(template, state=want, **how, duration=0.25 * steps).state
        if part > 1e-12:
            want = engine.run(template, state=want, method=method, dt=part, duration=part).state
        assert np.abs(got.state[at] - want).max() < 1e-14
    followed = engine.run(template, state=start, **how, at=times, estimate=True)
    assert np.abs(followed.state - got.state).max() < 1e-14  # the same steps, added up otherwise
    true = cnnum.Engine("reference").run(template, state=start, at=times)
    off = np.abs(got.state - true.state).max(axis=(2, 3, 4))
    assert (off <= followed.error + true.error).all()
    assert (followed.error[1:] < 1.0).all()


WAYS = {
    "reference": {},
    "implicit": {"method": "rodas3"},
    "etd-rk2": {"method": "etd-rk2", "estimate": True},
}


@pytest.mark.parametrize("way", WAYS)
def test_one_run_passes_all_times(way, monkeypatch):
    """Each of 60 times was a run of its own."""
    from cnnum.runs import ladder

    template, start = pulled(np.random.default_rng(3))
    engine = cnnum.Engine("reference" if way == "reference" else "numba", precision="float64")
    times, runs = np.linspace(0.0, 3.0, 60), []

    def counting(request, down):
        runs.append(request)
        return ladder.plainly(request, down)

    plain = next(place for place, one in enumerate(ladder.LADDER) if one.name == "plain")
    counted = replace(ladder.LADDER[plain], run=counting)
    ways = (*ladder.LADDER[:plain], counted)
    monkeypatch.setattr(ladder, "LADDER", ways)
    got = engine.run(template, state=start, **WAYS[way], at=times)
    assert len(runs) <= 2  # and a finer one to compare with
    whole = engine.run(template, state=start, **WAYS[way], duration=3.0)
    for name in ("state", "error", "steps"):
        assert np.array_equal(getattr(got, name)[-1], getattr(whole, name))


def stiff(rng):
    """Return a linear array whose cells decay 2,000 times as fast as others, and its matrix."""
    A = rng.normal(size=(2, 2, 3, 3)) * 0.1
    A[1, 1, 1, 1] -= 1.0
    tau = [1.0, 1e-3]
    template = cnnum.Template("stiff", A, z=[0.3, -0.4], tau=tau, output="linear")
    return template, Network(template, (2, 3)).linear_system()


@pytest.mark.parametrize("way", ["reference", "implicit"])
def test_errors_on_the_way_cover_the_closed_form(way):
    """From the first time constant of the fast layer to the last of the slow one."""
    rng = np.random.default_rng(11)
    template, system = stiff(rng)
    times, n = np.array([0.0, 1e-6, 2e-4, 1e-3, 0.01, 0.2, 0.9, 4.0]), len(system.rim)
    start = rng.uniform(-1.0, 1.0, (2, 2, 2, 3))
    engine = cnnum.Engine("reference" if way == "reference" else "numba", precision="float64")
    got = engine.run(template, state=start, **WAYS[way], at=times)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n] = system.matrix
    block[:n, n] = system.rates * (system.rim + np.repeat(template.z, n // 2))
    for at, time in enumerate(times):
        power = scipy.linalg.expm(block * time)
        want = start.reshape(2, n) @ power[:n, :n].T + power[:n, n]
        off = np.abs(got.state[at].reshape(2, n) - want).max(axis=1)
        assert (off <= got.error[at] + 1e-13).all(), time
    assert (got.error < {"reference": 1e-7, "implicit": 1e-3}[way]).all()


def test_steps_of_rates_that_jump_are_looked_at_on_the_reference():
    """x' = −x − 1/2 above a step of the table, and −x + 1/2 below: known on both sides of it."""
    table = Table("constant", ((-5.0, 0.5), (0.5, 0.5), (5.0, -0.5)))
    jumping = NonlinearCoupling(np.ones((1, 1)), table, "x", None)
    template = cnnum.Template("jumps", [[0.0]], nonlinear=(jumping,), output="linear")
    times = np.array([0.0, 0.2, 0.4, 1.3])
    got = cnnum.Engine("reference").run(template, state=np.full((1, 2), 2.0), at=times)
    crossed = np.log(2.5)  # −0.5 + 2.5 e^{−t} comes to 0.5, where the rates point at each other
    assert times[-1] > crossed
    want = -0.5 + 2.5 * np.exp(-times[:3])
    assert np.abs(got.state[:3, 0, 0] - want).max() < 0.02  # steps of a fixed length
    assert np.isinf(got.error[1:]).all()
