"""Methods that are more than a tableau take the same steps, or none, on every engine."""

import math

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.engines.numba import transients
from cnnum.engines.reference.equation import Given, StateEquation
from cnnum.errors import MethodError
from cnnum.integrators.closed_forms import MODE_LIMIT
from cnnum.integrators.exponential import EXPONENTIAL_METHODS
from cnnum.templating.template import Template

EVEN = np.array([[0.02, 0.3, 0.02], [0.1, -1.7, 0.1], [0.02, 0.3, 0.02]])
BOUNDARIES = ["zero-flux", "periodic", 0.0, 0.4]
SHAPE = (6, 7)


def layered(rng, output, boundary=0.3):
    """Two layers with time constants of their own, ‖A‖∞ = 0.9: errors die out."""
    feedback = rng.normal(size=(2, 2, 3, 3))
    feedback *= 0.9 / np.abs(feedback).sum(axis=(1, 2, 3)).max()
    return Template(
        "layered", feedback, rng.normal(size=(2, 1, 3, 3)), [0.1, -0.4],
        tau=[0.4, 1.3], boundary=boundary, initial=0.0, duration=2.0, output=output,
    )  # fmt: skip


def exponential_steps(template, method, given, step, count):
    """Return x by Cox & Matthews' formulas, stage by stage, and the rates of the equation alone."""
    kept, first, second = (
        weight[:, np.newaxis, np.newaxis] for weight in method.weights(step, template.tau)
    )
    tau = template.tau[:, np.newaxis, np.newaxis]
    equation = StateEquation(template, given.inputs.shape[1:], given)
    drive, x = equation.drive(), equation.start()

    def coupled(x, within=False):
        # a cell that comes to its limit within a step is there at its end: its rate counts in full
        return tau * equation.rate(drive, x, None, 0.0, outwards=within) + x

    def limited(x):
        return np.clip(x, -1.0, 1.0) if template.output.limited else x

    for _ in range(count):
        start = coupled(x)
        x = limited(kept * x + first * start)
        if method.order == 2:
            x = limited(x + second * (coupled(x, within=True) - start))
    return x


@pytest.mark.one_in(5)
@pytest.mark.parametrize("label", ["opencl-float64", "numba-float64", "reference"])
@pytest.mark.parametrize("name", EXPONENTIAL_METHODS)
@pytest.mark.parametrize("output", ["standard", "linear", "tanh", "full-range"])
def test_exponential_steps_are_those_of_the_formulas(engines, label, name, output):
    rng = np.random.default_rng(3)
    template, method = layered(rng, output), EXPONENTIAL_METHODS[name]
    inputs, start = rng.uniform(-1, 1, (1, *SHAPE)), rng.uniform(-0.9, 0.9, (2, *SHAPE))
    held = rng.random(SHAPE) < 0.2
    maps = {"input": inputs[0], "state": start, "mask": held}
    engine = engines[label]
    got = engine.run(template, method=name, dt=0.1, **maps)
    wanted = exponential_steps(template, method, Given(inputs, None, start, None, held), 0.1, 20)
    assert (got.method, got.steps, got.error) == (name, 20, math.inf)
    # 20 steps of values of order 1 in float64
    assert np.abs(got.state - wanted).max() <= 1e-13
    assert np.abs(got.state - start)[:, held].max() <= 1e-14


@pytest.mark.parametrize("name", EXPONENTIAL_METHODS)
def test_exponential_steps_that_settle_stop_alike(engines, reference, name):
    rng = np.random.default_rng(4)
    template = layered(rng, "standard")
    inputs = rng.uniform(-1, 1, (5, *SHAPE)) * np.array([0.1, 1, 2, 3, 9])[:, None, None]
    plain, *others = (
        engine.run(template, input=inputs, method=name, dt=0.2, duration="settle")
        for engine in (reference, engines["opencl-float64"], engines["numba-float64"])
    )
    assert plain.settled.all()
    assert len(set(plain.steps.tolist())) > 1
    for other in others:
        np.testing.assert_array_equal(other.settled, plain.settled)
        np.testing.assert_array_equal(other.steps, plain.steps)
        # some 50 steps, of which contracting couplings keep a few roundings
        assert np.abs(other.state - plain.state).max() <= 1e-12


@pytest.mark.one_in(3)
@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", EXPONENTIAL_METHODS)
def test_exponential_steps_without_a_length_are_alike(engines, reference, name, boundary):
    """Half of the stability bound, on every engine; and not the answer at 1e-10."""
    rng = np.random.default_rng(10)
    template = layered(rng, "standard", boundary)
    inputs = rng.uniform(-1, 1, (3, *SHAPE))
    plain = reference.run(template, input=inputs, method=name)
    assert np.isinf(plain.error).all()
    for label in ("opencl-float64", "numba-float64"):
        other = engines[label].run(template, input=inputs, method=name)
        np.testing.assert_array_equal(other.steps, plain.steps)
        np.testing.assert_allclose(other.time, plain.time, rtol=1e-14)
        # a few steps of values of order 1 in float64
        assert np.abs(other.state - plain.state).max() <= 1e-13
    known = reference.run(template, input=inputs)
    # steps of this length are off by their own error, which is far above 1e-10
    assert np.abs(plain.state - known.state).max() > 1e-4


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("boundary", "output", "duration"),
    [
        ("zero-flux", "standard", 9.0),
        ("periodic", "linear", 0.3),
        (0.0, "tanh", "settle"),
        (0.4, "standard", "settle"),
    ],
)
def test_chebyshev_steps_are_the_same_on_all(engines, reference, boundary, output, duration):
    """The same stages in the same steps; their results agree within their own estimate."""
    rng = np.random.default_rng(5)
    template = Template(
        "stiff", 9.0 * EVEN, [[1.0]], 0.1, tau=0.7, boundary=boundary, initial=0.0,
        duration=duration, output=output,
    )  # fmt: skip
    maps = {"input": rng.uniform(-3, 3, SHAPE), "state": rng.uniform(-1, 1, SHAPE)}
    maps["mask"] = rng.random(SHAPE) < 0.2
    known = reference.run(template, **maps)
    plain, opencl, numba = (
        engine.run(template, method="runge-kutta-chebyshev", **maps)
        for engine in (reference, engines["opencl-float64"], engines["numba-float64"])
    )
    assert numba.method == "runge-kutta-chebyshev"
    for one in (opencl, numba):
        assert (one.steps, one.settled) == (plain.steps, plain.settled)
        # roundings in the error estimates move the ends of steps by parts of 1e-12
        assert np.abs(one.state - plain.state).max() <= 1e-9
        assert one.error == pytest.approx(plain.error, rel=1e-4)
    assert np.abs(numba.state - known.state).max() <= numba.error + 20 * known.error
    # the weights of a stage add up to 1 but for roundings: 1e-14 after some 100 stages
    held = maps["state"][maps["mask"]]
    np.testing.assert_allclose(numba.state[maps["mask"]], held, rtol=0.0, atol=1e-13)
    single = engines["numba-float32"].run(template, method="runge-kutta-chebyshev", **maps)
    assert np.abs(single.state - known.state).max() <= single.error


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("name", "output", "duration"),
    [  # every two of these meet, each of them once in a short run
        ("bogacki-shampine", "standard", 2.0),
        ("bogacki-shampine", "tanh", "settle"),
        ("dormand-prince", "full-range", "settle"),
        ("bogacki-shampine", "full-range", 2.0),
        ("dormand-prince", "tanh", 2.0),
        ("dormand-prince", "standard", "settle"),
    ],
)
def test_pairs_that_are_asked_for_take_the_same_steps_on_all(
    engines, reference, name, output, duration
):
    rng = np.random.default_rng(11)
    template = layered(rng, output)
    maps = {
        "input": rng.uniform(-1, 1, (4, *SHAPE)),
        "state": rng.uniform(-0.9, 0.9, (4, 2, *SHAPE)),
    }
    maps["mask"] = rng.random((4, *SHAPE)) < 0.2
    plain = reference.run(template, method=name, duration=duration, **maps)
    first = {role: values[0] for role, values in maps.items()}
    known = reference.run(template, duration=duration, rtol=1e-7, atol=1e-7, **first)
    assert plain.settled.all() == (duration == "settle")
    for label in ("opencl-float64", "numba-float64"):
        other = engines[label].run(template, method=name, duration=duration, **maps)
        np.testing.assert_array_equal(other.steps, plain.steps)
        np.testing.assert_array_equal(other.settled, plain.settled)
        # roundings in the error estimates move the ends of steps by parts of 1e-12
        assert np.abs(other.state - plain.state).max() <= 1e-9
        # an error that is a distance from rest is of the order of the roundings of values of 1
        np.testing.assert_allclose(other.error, plain.error, rtol=1e-4, atol=1e-15)
    # its own steps at 1e-4, and not the answer at 1e-10
    assert np.abs(plain.state[0] - known.state).max() > 1e-8


def test_the_reference_refuses_steps_that_do_not_reach_the_end(reference, monkeypatch):
    template, maps = layered(np.random.default_rng(12), "tanh"), {"input": np.ones(SHAPE)}
    how = {"method": "dormand-prince", "rtol": 1e-8, "atol": 1e-8}
    steps = int(reference.run(template, **how, **maps).steps)
    monkeypatch.setattr("cnnum.engines.reference.adaptive.MAX_STEPS", steps)
    assert reference.run(template, **how, **maps).steps == steps > 2
    monkeypatch.setattr("cnnum.engines.reference.adaptive.MAX_STEPS", steps - 1)
    with pytest.raises(MethodError, match="did not reach its end"):
        reference.run(template, **how, **maps)


@pytest.mark.one_in(5)
@pytest.mark.parametrize(
    ("boundary", "layers", "duration"),
    [  # every two of these meet; all three would be twice the kernels to build
        (boundary, layers, (0.7, "settle")[(n + layers) % 2])
        for n, boundary in enumerate(BOUNDARIES)
        for layers in (1, 2)
    ],
)
def test_modes_of_more_states_than_a_dense_product_takes(
    engines, reference, boundary, layers, duration
):
    rng = np.random.default_rng(6)
    shape = (33, 41)
    template = Template(
        "even", EVEN * rng.uniform(0.2, 0.6, (layers, layers, 1, 1)),
        rng.normal(size=(layers, 1, 3, 3)), [0.1] * layers, tau=[0.7, 1.9][:layers],
        boundary=boundary, initial=0.0, duration=duration, output="linear",
    )  # fmt: skip
    maps = {"input": rng.uniform(-1, 1, (3, *shape))}
    lead = (3, layers) if layers > 1 else (3,)
    maps["state"] = rng.uniform(-1, 1, (*lead, *shape))
    known = reference.run(template, **maps)
    for label, engine in engines.items():
        got = engine.run(template, **maps)
        assert got.method == "propagator"
        assert got.settled.all() == (duration == "settle")
        off = np.abs(got.state - known.state).max(axis=tuple(range(1, known.state.ndim)))
        # the reference settles to 1e-3 of the tolerance of 1e-4, else is at 1e-10 a step
        assert np.all(off <= got.error + (1e-6 if duration == "settle" else 1e-8))
        rounding = np.finfo(engine.precision).eps
        # 1,024 roundings of numbers up to 10, times the growth of the modes
        assert np.all((got.error > rounding) & (got.error < 1e5 * rounding)), label


def test_longer_axes_than_modes_are_kept_of_take_steps(engines):
    template = Template("even", 0.3 * EVEN, initial="input", duration=0.5, output="linear")
    start = np.random.default_rng(7).uniform(-1, 1, (3, MODE_LIMIT + 1))
    for engine in engines.values():
        assert engine.run(template, state=start).method != "propagator"


METHODS = {
    "runge-kutta-chebyshev": {"method": "runge-kutta-chebyshev"},
    "exponential-euler": {"method": "exponential-euler", "dt": 0.1},
    "etd-rk2": {"method": "etd-rk2", "dt": 0.1},
    "modes": {"method": "propagator"},
    "a lopsided product": {"method": "propagator"},
    "pieces": {"method": "propagator"},
}


@pytest.mark.parametrize("label", ["numba-float32", "numba-float64"])
@pytest.mark.parametrize("name", METHODS)
def test_frames_have_the_bits_that_they_have_alone(engines, label, name, monkeypatch):
    """Alone, in a batch on one core or on several, and from run to run."""
    rng = np.random.default_rng(8)
    kinds = {"pieces": [[1.3]], "a lopsided product": EVEN + np.eye(3, k=1)}
    output = "linear" if name in ("modes", "a lopsided product") else "standard"
    template = Template(
        "any", kinds.get(name, EVEN), [[1.0]], 0.1, initial=0.0, duration=2.0, output=output
    )
    maps = {"input": rng.uniform(-1, 1, (19, 5, 6)), "state": rng.uniform(-1, 1, (19, 5, 6))}
    together = engines[label].run(template, **METHODS[name], **maps)
    # so few frames whose end is known lie on one core: now on several
    monkeypatch.setattr(transients, "CELLS_A_THREAD", 8 * 5 * 6)
    again = engines[label].run(template, **METHODS[name], **maps)
    np.testing.assert_array_equal(again.state, together.state)
    for frame in (0, 7, 18):
        own = {role: values[frame] for role, values in maps.items()}
        alone = engines[label].run(template, **METHODS[name], **own)
        np.testing.assert_array_equal(alone.state, together.state[frame])
        assert (alone.steps, alone.error) == (together.steps[frame], together.error[frame])


def test_arrays_on_all_cores_step_as_on_one(engines, reference):
    """From 128×128 cells on the bands of one frame are shared: Chebyshev's stages among them."""
    rng = np.random.default_rng(9)
    template = Template(
        "wide", 9.0 * EVEN, [[1.0]], 0.1, boundary="periodic", initial=0.0, duration=1.0
    )
    tile = rng.uniform(-1, 1, (32, 40))
    small = engines["numba-float64"].run(template, input=tile, method="runge-kutta-chebyshev")
    wide = engines["numba-float64"].run(
        template, input=np.tile(tile, (4, 4)), method="runge-kutta-chebyshev"
    )
    # a periodic array of tiles is the tile: every cell adds up the same numbers
    np.testing.assert_array_equal(wide.state, np.tile(small.state, (4, 4)))
    assert (wide.steps, wide.error) == (small.steps, small.error)
    for name in ("etd-rk2", "exponential-euler"):
        one = engines["numba-float64"].run(template, input=tile, method=name, dt=0.02)
        all_cores = engines["numba-float64"].run(
            template, input=np.tile(tile, (4, 4)), method=name, dt=0.02
        )
        np.testing.assert_array_equal(all_cores.state, np.tile(one.state, (4, 4)))


def test_the_reference_gives_up_where_steps_are_too_short_to_end():
    """Rates of 1e19, as fuzzing found them, take implicit steps of 1e-19."""
    A = np.full((5, 5), -155339.0)
    A[0, 3], A[2, 1:3], A[3, 2:4] = 524288, (-69, -9818747), (2.0**63, -622)
    A[4, 0], A[4, 4] = -534, -122033
    template = Template("fast", A, [[0, 0, 0], [0, 2, 0], [0, 0, 0]], 0.5, duration=1.0)
    picture = np.sign(np.sin(np.arange(64.0) + 0.5)).reshape(8, 8)
    with pytest.raises(
        MethodError, match=r"10000 implicit steps|evaluations of the rate of a cell"
    ):
        Engine("reference").run(template, input=picture, duration=0.5)
