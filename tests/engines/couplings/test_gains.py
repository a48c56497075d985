"""Gains in time: steps end where a table jumps or bends, on every engine and in every method."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cnnum
from cnnum.errors import TemplateError
from cnnum.graph.nodes import RunSpec
from cnnum.templating.couplings import DelayedCoupling, Gain
from cnnum.templating.functions import Table

ENGINES = ("opencl", "numba", "reference")
INPUT, START, END = 0.3, 0.1, 9.06
PULSES = {
    "constant": ((9.0, 1.0), (9.05, -1.0), (20.0, 1.0)),
    "linear": ((9.0, 1.0), (9.02, 6.0), (9.05, -4.0), (20.0, 1.0)),
    "at the start": ((0.0, 5.0), (9.0, 1.0), (9.05, -1.0), (20.0, 1.0)),
}
"""Tables whose pulse lasts 50 ms after 9 units of rest: a step at rest is longer."""


def pulsed(case):
    kind = "linear" if case == "linear" else "constant"
    gain = Gain(0, 0, Table(kind, PULSES[case]))
    return cnnum.Template("g", [[0.5]], [[1.0]], output="linear", gains=[gain], duration=END)


def truth(case):
    """Solve x' = −x + g(t) x/2 + u from point to point."""
    places, levels = np.array(PULSES[case]).T
    x, marks = START, [0.0, *(p for p in places if 0.0 < p < END), END]
    for begin, end in pairwise(marks):
        middle = 0.5 * (begin + end)

        def gain(t, middle=middle):
            if case == "linear":
                return np.interp(t, places, levels)
            return levels[min(int((places < middle).sum()), len(levels) - 1)]

        def right(t, x, gain=gain):
            return -x + 0.5 * gain(t) * x + INPUT

        x = solve_ivp(right, (begin, end), [x], method="DOP853", rtol=1e-12, atol=1e-14).y[0, -1]
    return x


def test_the_known_end():
    assert truth("constant") == pytest.approx(0.566114, abs=1e-6)


HOWS = (
    {},
    {"method": "bogacki-shampine", "rtol": 1e-6, "atol": 1e-8},
    {"method": "rk4", "dt": 0.25},
    {"method": "heun", "dt": 0.1, "estimate": True},
)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("case", PULSES)
def test_no_pulse_is_jumped_over(engine, case):
    used, true = cnnum.Engine(engine, precision="float64"), truth(case)
    maps = {"input": np.full((2, 3), INPUT), "state": np.full((2, 3), START)}
    for how in HOWS if engine != "opencl" else HOWS[:: len(HOWS) - 1]:
        run = used.run(pulsed(case), **maps, **how)
        off = float(np.abs(run.state - true).max())
        assert off <= (run.error if np.isfinite(run.error) else 1e-3)
        # jumped over, the pulses are off by 0.034 and 0.006
        assert off < 3e-3


@pytest.mark.parametrize("engine", ["opencl", "numba"])
@pytest.mark.parametrize(("place", "width"), [(0.7, 1e-3), (7.0, 1e-4)])
def test_single_precision_forgets_a_steep_pulse_after_it(engine, place, width):
    """Written as a sum of ramps, its roundings stayed in the gain: 114,129 for 0.884."""
    points = ((0.0, 1.0), (place, 1.0), (place + width, 1.0 / width), (place + 2.0 * width, 1.0))
    gains = [Gain(0, 0, Table("linear", points))]
    template = cnnum.Template("g", [[0.5]], [[1.0]], output="linear", gains=gains)
    x, places = START, [0.0, *(at for at, _ in points[1:]), place + 0.5]
    for begin, end in pairwise(places):
        x = solve_ivp(
            lambda t, x: -x + 0.5 * np.interp(t, *np.array(points).T) * x + INPUT, (begin, end),
            [x], method="DOP853", rtol=1e-12, atol=1e-14,
        ).y[0, -1]  # fmt: skip
    maps = {"input": np.full((1, 1), INPUT), "state": np.full((1, 1), START)}
    run = cnnum.Engine(engine, precision="float32").run(template, **maps, duration=place + 0.5)
    assert np.abs(run.state - x).max() <= run.error < 0.05


@pytest.mark.parametrize("engine", ["opencl", "numba"])
def test_programs_see_them_too(engine):
    @cnnum.program
    def sees(frame):
        spec = RunSpec(method="dormand-prince", rtol=1e-6, atol=1e-8)
        start = frame.channel("x")
        run = cnnum.transient(pulsed("constant"), input=frame.channel("u"), state=start, spec=spec)
        return {"x": run.states[0]}

    plan = cnnum.Engine(engine, precision="float64").compile(sees, (2, 3), channels=("u", "x"))
    frame = np.broadcast_to([INPUT, START], (2, 3, 2))
    assert np.abs(plan(frame)["x"] - truth("constant")).max() < 1e-5


def test_large_arrays_see_them_too():
    maps = {"input": np.full((300, 300), INPUT), "state": np.full((300, 300), START)}
    run = cnnum.Engine("opencl").run(pulsed("constant"), **maps)
    assert np.abs(run.state - truth("constant")).max() <= run.error


LATE = {
    "a jump in the first step": ("constant", ((0.029, 1.04), (0.057, 1.75), (0.066, 0.4))),
    "a pulse": ("constant", ((1.31, 1.0), (1.33, -9.0), (2.0, 1.7))),
    "a steep line": ("linear", ((0.31, 1.0), (0.32, -3.0), (2.0, 1.7), (2.01, 0.3))),
    "a steep pulse": ("linear", ((1.7, 1.0), (1.7001, 900.0), (1.7002, 1.0))),
}
"""Tables whose points lie within steps: with a delay, steps end at its parts alone."""


def delayed(case, **options):
    kind, points = LATE[case]
    late = DelayedCoupling(0.7, np.full((1, 1, 1, 1), 0.4), np.full((1, 1, 1, 1), 0.1))
    return cnnum.Template(
        "late", [[1.5]], [[1.0]], output="tanh", gains=[Gain(0, 0, Table(kind, points))],
        delayed=late, **options,
    )  # fmt: skip


def truth_with_delay(case, end):
    """Solve the same by the method of steps, between all points and multiples of the delay."""
    kind, points = LATE[case]
    places, levels = np.array(points).T
    marks = sorted({0.0, end, *(p for p in places if p < end), *np.arange(0.7, end, 0.7)})
    x, ways = START, []

    def past(t):
        if t <= 0.0:
            return START
        return next(way.sol(t)[0] for low, high, way in ways if t <= high)

    for low, high in pairwise(marks):
        middle = 0.5 * (low + high)

        def right(t, x, middle=middle):
            gain = np.interp(t, places, levels)
            if kind == "constant":
                gain = levels[min(int((places < middle).sum()), len(levels) - 1)]
            seen = 0.4 * np.tanh(past(t - 0.7))
            return -x + 1.5 * gain * np.tanh(x) + 1.1 * INPUT + seen

        way = solve_ivp(
            right, (low, high), [x], method="DOP853", rtol=1e-11, atol=1e-13, dense_output=True
        )
        ways.append((low, high, way))
        x = way.y[0, -1]
    return x


@pytest.mark.parametrize("engine", [*ENGINES, "opencl float32", "numba float32"])
@pytest.mark.parametrize("case", LATE)
def test_with_a_delay_points_lie_within_steps(engine, case):
    end = 0.0565 if case == "a jump in the first step" else 3.0
    maps = {"input": np.full((1, 2), INPUT), "state": np.full((1, 2), START)}
    name, _, precision = engine.partition(" ")
    used = cnnum.Engine(name, precision=precision or "float64")
    got = used.run(delayed(case, duration=end), **maps)
    off = np.abs(got.state - truth_with_delay(case, end)).max()
    assert off <= got.error + 1e-9
    assert got.error < 1e-3


@pytest.mark.parametrize("kind", ["constant", "linear"])
def test_the_mean_of_a_table_is_that_of_many_places(kind):
    table = Table(kind, ((-0.5, 2.0), (0.2, -1.0), (0.25, 4.0), (1.0, 0.5)))
    for begin, end in ((-1.0, -0.6), (-1.0, 3.0), (0.21, 0.24), (0.1, 0.3), (0.9, 0.9001)):
        places = np.linspace(begin, end, 200_001)[1:] - 0.5 * (end - begin) / 200_000
        assert table.mean(begin, end) == pytest.approx(table(places).mean(), abs=1e-3)


def test_two_gains_of_the_same_couplings_are_refused():
    """Engines took the last of them, their sum, or their sum less 1."""
    gains = [Gain(0, 0, Table("constant", ((0.0, level),))) for level in (0.5, 2.0)]
    with pytest.raises(TemplateError, match="one gain"):
        cnnum.Template("two", [[1.0]], gains=gains)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_error_decays_no_faster_after_a_point_than_the_array(engine):
    """The length of the step after it was taken for that of the step up to it."""
    points = ((12.68, 1.0), (12.91, 1.0), (14.4, 1.0), (14.87, 1.0))
    gain = Gain(0, 0, Table("constant", points))
    template = cnnum.Template("decays", [[1e-9]], output="tanh", z=0.3, tau=4.58, gains=[gain])
    times = np.linspace(1.0, 22.0, 22)
    got = cnnum.Engine(engine, precision="float64").run(
        template, state=np.full((1, 1), 0.84), at=times, method="dormand-prince"
    )
    want = 0.3 + 0.54 * np.exp(-times / 4.58)
    assert (np.abs(got.state[:, 0, 0] - want) <= got.error + 1e-8).all()
