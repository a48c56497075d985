"""Programs of small arrays are one compiled function: numbers, cache, and what is walked."""

from itertools import cycle

import numpy as np
import pytest

import cnnum
from cnnum.engines.numba import printed
from cnnum.engines.numba.evaluation import NumbaExecutable
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table

CHANNELS = {"channels": ("a", "b")}
WEIGHTS = 0.1 * np.arange(-4.0, 5.0).reshape(3, 3)
SYMMETRIC = 0.1 * np.array([[0.5, 1.0, 0.5], [1.0, -3.0, 1.0], [0.5, 1.0, 0.5]])
ONE, RAMP = np.full((1, 1, 1, 1), 0.2), Table("linear", ((-1.0, 0.1), (2.0, 0.3)))
STEPPED = Table("constant", ((0.4, 0.5), (2.0, 1.5)))


def template(**more):
    return cnnum.Template("any", WEIGHTS, [[0.8]], 0.1, **{"initial": 0.0, "duration": 0.7, **more})


TEMPLATES = {
    **{str(rim): template(boundary=rim) for rim in (0.3, "zero-flux", "periodic")},
    **{shape: template(output=shape) for shape in ("full-range", "linear", "tanh")},
    "settles": template(duration="settle"),
    "delayed": template(delayed=DelayedCoupling(0.2, ONE, ONE)),
    "gains": template(gains=[Gain(0, 0, RAMP)]),
    "jumps": template(gains=[Gain(0, 0, STEPPED)]),
    "nonlinear": template(nonlinear=[NonlinearCoupling(WEIGHTS, RAMP, "x", "u")]),
    "smooth": cnnum.Template("smooth", SYMMETRIC, [[0.8]], initial=0.0, duration=2.0),
    "alone": cnnum.Template("alone", [[2.0]], WEIGHTS, 0.1, initial=0.1, duration=0.7),
    "decay": cnnum.Template("decay", [[0.0]], WEIGHTS, 0.1, initial=0.5, duration=0.7),
    "layers": cnnum.Template(
        "two", np.full((2, 2, 3, 3), 0.05), np.full((2, 1, 1, 1), 0.5), duration=0.7
    ),
}
METHODS = dict(zip(TEMPLATES, cycle(["euler", "bogacki-shampine", "rk4", "etd-rk2"])))
METHODS |= {"smooth": "runge-kutta-chebyshev", "delayed": "heun", "gains": "rk4", "jumps": "euler"}


def shown(one, given):
    """Return the output of a template's last layer."""
    return cnnum.transient(one, input=given).outputs[-1]


def twice(one):
    """Return a program that runs a template twice: its own output is the input of the second."""

    def made(frame):
        first = shown(one, frame.a)
        second = shown(one, first + 0.5 * frame.b)
        return {"first": first, "second": second, "sum": second.sum(), "largest": second.max()}

    return cnnum.program(made)


def frames(count, shape=(5, 6), seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, *shape, 2))


def is_printed(plan):
    return "define void" in plan.source


def plan_of(program, shape=(5, 6), precision="float64", **how):
    return cnnum.Engine("numba", precision=precision).compile(program, shape, **CHANNELS, **how)


def walked(plan, given):
    """Return what the walk over the same operations gives, which shares no code with it."""
    walk = NumbaExecutable.of(plan.built, plan.solvers, np.dtype(np.float64))
    return walk.run(given, walk.new_memory(len(given)), first=True)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("kind", "method"), [*METHODS.items()])
def test_printed_transients_take_the_steps_of_the_walk(kind, method):
    """The same steps in float64: 100 of some 30 operations, whose roundings may grow tenfold.

    Where steps follow their error, a rounding moves their length: they agree to their tolerance.
    """
    followed = {"method": method, "rtol": 1e-7, "atol": 1e-7}
    fixed = {"method": method, "dt": 0.01}
    for how in ({}, fixed if method in ("euler", "heun", "rk4", "etd-rk2") else followed):
        plan, given = plan_of(twice(TEMPLATES[kind]), **how), frames(2)
        assert is_printed(plan)
        coarse = how is not fixed and kind != "alone"
        for name, values in walked(plan, given).items():
            np.testing.assert_allclose(
                plan(given)[name], values, rtol=0, atol=2e-5 if coarse else 1e-11, err_msg=name
            )


@pytest.mark.one_in(3)
@pytest.mark.parametrize("kind", TEMPLATES)
def test_printed_programs_agree_with_the_reference(kind):
    """With a tolerance of 1e-7 on the way, whose errors grow a hundredfold at most.

    A delay takes steps of a fixed length, whatever the tolerance.
    """
    share = 1e-3 if kind == "delayed" else 1e-5
    given, how = frames(2, seed=1), {"rtol": 1e-7, "atol": 1e-7}
    program = twice(TEMPLATES[kind])
    expected = cnnum.Engine("reference").compile(program, (5, 6), **CHANNELS, **how)(given)
    for name, values in plan_of(program, **how)(given).items():
        size = np.abs(expected[name]).max()
        np.testing.assert_allclose(values, expected[name], rtol=0, atol=share * (1 + size))


def leaky(frame):
    """A program with a memory, a loop that ends on its own in every frame, and a choice."""
    first = cnnum.apply(TEMPLATES["zero-flux"], input=frame.a)
    held = frame.memory()
    mean = 0.7 * held.value + 0.3 * first
    held.store(mean)
    larger = cnnum.maximum(mean, frame.b)
    run = cnnum.loop(lambda x: cnnum.where(x > 0.3, 0.5 * x, x), larger, limit=9)
    return {"mean": mean, "halved": run.value, "rounds": run.iterations}


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_frame_has_the_same_bits_alone_and_among_many_threads(monkeypatch, precision):
    monkeypatch.setattr(printed, "FRAMES_A_THREAD", 8)
    plan = plan_of(cnnum.program(leaky), precision=precision)
    assert is_printed(plan)
    given = frames(50)
    stream, alone = plan.stream((50,)), [plan.stream() for _ in given]
    for step in range(3):
        together = stream.push(given * (1 + step))
        for at, single in enumerate(alone):
            for name, values in single.push(given[at] * (1 + step)).items():
                np.testing.assert_array_equal(values, together[name][at])


def test_a_program_is_compiled_once_and_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    tmp_path.chmod(0o700)
    program, given = twice(TEMPLATES["0.3"]), frames(3)
    before = plan_of(program)(given)
    compile = printed.machine_code
    monkeypatch.setattr(printed, "machine_code", None)
    for name, values in plan_of(program)(given).items():
        np.testing.assert_array_equal(values, before[name])
    (entry,) = (tmp_path / "numba").iterdir()
    entry.write_bytes(entry.read_bytes()[:-9] + b"not a code")
    monkeypatch.setattr(printed, "machine_code", compile)
    for name, values in plan_of(program)(given).items():
        np.testing.assert_array_equal(values, before[name])


def test_other_programs_are_walked_and_say_why():
    @cnnum.program
    def one(frame):
        return {"y": cnnum.apply(TEMPLATES["0.3"], input=frame.a)}

    assert "a template alone needs no compiler" in str(plan_of(one).explain())
    program = str(plan_of(twice(TEMPLATES["0.3"])).explain())
    assert "in one compiled function of a frame" in program
    large = plan_of(twice(TEMPLATES["0.3"]), (17, 16))
    assert "a walk over the operations (an array of more than 256 cells" in str(large.explain())
    assert not is_printed(large)
