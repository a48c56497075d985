"""Random networks give the same answer on every engine, within a derived tolerance."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import cnnum
from cnnum.templating.template import Template

NAMES = ("opencl-float32", "opencl-float64", "numba-float32", "numba-float64")
RTOL, ATOL = 1e-4, 1e-5
# the engines are made once and hold nothing of an example
FIXTURES = [HealthCheck.function_scoped_fixture]


def several(maps):
    """One layer or input comes without an axis of its own."""
    return (maps,) if maps > 1 else ()


@st.composite
def networks(draw):
    """A random linear template with all that it can be given, contracting: errors do not grow."""
    layers, inputs = draw(st.integers(1, 3)), draw(st.integers(0, 2))
    # three layers of 5×5 weights are 225 couplings: seconds of every compiler, and nothing new
    radius = draw(st.integers(0, 2 if layers < 3 else 1))
    shape = (draw(st.integers(1, 9)), draw(st.integers(1, 9)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    k = 2 * radius + 1
    feedback = rng.normal(size=(layers, layers, k, k)) * (rng.random((layers, layers, k, k)) < 0.6)
    # ‖A‖∞ ≤ 0.9 < 1: the Jacobian's logarithmic norm is below −0.1/τ, local errors die out
    feedback *= 0.9 / max(1e-9, np.abs(feedback).sum(axis=(1, 2, 3)).max())
    boundaries = [
        draw(st.sampled_from([0.0, -1.0, 0.5, "zero-flux", "periodic"])) for _ in range(2)
    ]
    template = Template(
        "random",
        feedback,
        rng.normal(size=(layers, inputs, k, k)) if inputs else None,
        rng.normal(size=layers).tolist(),
        tau=rng.uniform(0.5, 2.0, layers).tolist(),
        boundary=boundaries[0],
        input_boundary=boundaries[1],
        initial=0.25,
        duration=draw(st.floats(0.0, 3.0)),
        output=draw(st.sampled_from(["standard", "linear", "tanh", "full-range"])),
    )
    batch = draw(st.sampled_from([(), (1,), (2, 3), (17,)]))
    # the reference takes long for 17 frames: three by turns, whose neighbours in lanes are others
    places = np.arange(17) % 3 if batch == (17,) else ...
    batch = (3,) if batch == (17,) else batch
    maps = {}
    if inputs:
        maps["input"] = rng.uniform(-1, 1, (*batch, *several(inputs), *shape))
    if draw(st.booleans()) or not maps:
        maps["state"] = rng.uniform(-1, 1, (*batch, *several(layers), *shape))
    if draw(st.booleans()):
        maps["bias"] = rng.uniform(-1, 1, (*several(layers), *shape))
    if draw(st.booleans()):
        maps["mask"] = rng.random(shape) < 0.3
    return template, maps, places


def placed(maps, places):
    """Frames of a batch one after the other as said; bias and mask are those of all."""
    return {
        name: frames[places] if name in ("input", "state") else frames
        for name, frames in maps.items()
    }


def tolerance(reference):
    """Local errors of a contracting array add up to at most (steps kept ≤ tol each) a few tol.

    The logarithmic norm −0.1/τ damps them; 20 tolerances cover 3 time constants of steps.
    """
    return 20 * (ATOL + RTOL * np.abs(reference).max())


@settings(max_examples=8, deadline=None, suppress_health_check=FIXTURES)
@given(case=networks(), precision=st.sampled_from(["float32", "float64"]))
def test_engines_agree_with_the_reference(engines, names, reference, case, precision):
    template, maps, places = case
    expected = reference.run(template, **maps).state[places]
    for name in names:
        engine = engines[f"{name}-{precision}"]
        got = engine.run(template, rtol=RTOL, atol=ATOL, **placed(maps, places))
        assert got.state.shape == expected.shape
        assert np.abs(got.state - expected).max() <= tolerance(expected)


@settings(max_examples=4, deadline=None, suppress_health_check=FIXTURES)
@given(case=networks(), method=st.sampled_from(["euler", "heun", "rk4"]))
def test_fixed_steps_are_the_same_steps(engines, names, reference, case, method):
    """In float64 the same steps of the same method agree to rounding: 60 steps · 2⁻⁵² · values."""
    template, maps, places = case
    expected = reference.run(template, method=method, dt=0.05, **maps)
    steps, state = expected.steps[places], expected.state[places]
    for name in names:
        got = engines[f"{name}-float64"].run(
            template, method=method, dt=0.05, **placed(maps, places)
        )
        np.testing.assert_array_equal(got.steps, steps)
        # 1e-10: full-range cells sit on a kink that one rounding can move by a step's change
        assert np.abs(got.state - state).max() <= 1e-10 * (1 + np.abs(state).max())


@pytest.mark.parametrize("shape", [(33, 40), (70, 5)])
def test_large_arrays_agree_too(engines, reference, shape):
    """Beyond 256 cells values live in global memory."""
    rng = np.random.default_rng(5)
    template = Template(
        "large",
        rng.normal(size=(3, 3)) * 0.1,
        rng.normal(size=(5, 5)),
        0.1,
        boundary="zero-flux",
        duration=2.0,
    )
    u = rng.uniform(-1, 1, (2, *shape))
    expected = reference.run(template, input=u).state
    for engine in engines.values():
        assert np.abs(engine.run(template, input=u).state - expected).max() <= tolerance(expected)


@pytest.mark.parametrize("label", NAMES)
def test_frames_of_a_batch_do_not_know_each_other(engines, label):
    """In any order of frames, and run after run: the same bits."""
    rng = np.random.default_rng(6)
    template = Template("any", rng.normal(size=(3, 3)) * 0.3, rng.normal(size=(3, 3)), 0.1)
    u = rng.uniform(-1, 1, (19, 5, 6))
    together = engines[label].run(template, input=u).state
    np.testing.assert_array_equal(engines[label].run(template, input=u).state, together)
    backwards = engines[label].run(template, input=u[::-1]).state[::-1]
    np.testing.assert_array_equal(backwards, together)


@pytest.mark.parametrize("name", ["AVERAGE", "HOLE"])
@pytest.mark.parametrize("label", NAMES)
def test_a_frame_alone_and_in_a_batch(engines, label, name):
    """Of 40 frames at once, 5 at a time, and alone: `numba` gives the same bits.

    `opencl` takes lanes for batches that fill them; its roundings change steps, within tolerances.
    """
    rng = np.random.default_rng(6)
    u, x = rng.uniform(-1, 1, (2, 40, 8, 8))
    engine, template = engines[label], cnnum.get_template(name)

    def run(engine, frames):
        given = {"input": u[frames]} if template.inputs else {}
        return engine.run(template, state=x[frames], **given)

    together = run(engine, slice(None))
    fives = [run(engine, slice(first, first + 5)).state for first in range(0, 40, 5)]
    alone = [run(engine, number).state for number in range(40)]
    for apart in (np.concatenate(fives), np.stack(alone)):
        if label.startswith("numba"):
            np.testing.assert_array_equal(apart, together.state)
        # both ends are off by the tolerance at most, as saturated cells contract towards their rest
        np.testing.assert_allclose(apart, together.state, rtol=2 * RTOL, atol=2 * ATOL)
        np.testing.assert_array_equal(apart > 0.0, together.state > 0.0)


def test_a_frame_of_the_reference_alone_and_in_a_batch(reference):
    u, x = np.random.default_rng(6).uniform(-1, 1, (2, 3, 8, 8))
    together = reference.run("HOLE", input=u, state=x).state
    np.testing.assert_array_equal(reference.run("HOLE", input=u[1], state=x[1]).state, together[1])
