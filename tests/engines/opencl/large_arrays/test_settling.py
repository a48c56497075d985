"""Fixed steps of large arrays until nothing changes, strip by strip: the reference's own steps."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.graph.nodes import RunSpec
from cnnum.templating.template import Template

CASES = {
    # boundary, output, layers, radius, whether a mask holds some cells, rows and columns
    "euler": (0.3, "standard", 1, 1, True, (48, 51)),
    "heun": ("zero-flux", "full-range", 2, 1, False, (97, 30)),
    "rk4": ("periodic", "tanh", 1, 2, True, (63, 40)),
    "bogacki-shampine": ("periodic", "linear", 1, 1, False, (50, 20)),
    "exponential-euler": ("zero-flux", "linear", 2, 1, True, (120, 33)),
    "etd-rk2": (0.3, "standard", 1, 1, False, (150, 17)),
}
PARTED = ("heun", "bogacki-shampine", "exponential-euler", "etd-rk2")
"""Those whose strips work items share; the others' arrays have one each."""


def resting(rng, boundary, output, layers, radius):
    """Return a template whose cells decay faster than all their neighbours drive them."""
    k = 2 * radius + 1
    feedback = rng.normal(size=(layers, layers, k, k))
    feedback *= 0.5 / np.abs(feedback).sum(axis=(1, 2, 3), keepdims=True)
    return Template(
        "resting", feedback, np.ones((layers, 1, 1, 1)), tau=1.0 + 0.4 * np.arange(layers),
        boundary=boundary, output=output,
    )  # fmt: skip


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", CASES)
def test_strips_end_with_the_step_that_sees_no_change(method, states_of, monkeypatch):
    """Frames of a batch end after steps of their own number, amid launches; one with its first."""
    *parts, masked, shape = CASES[method]
    if method in PARTED:
        monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    rng = np.random.default_rng(80 + list(CASES).index(method))
    template = resting(rng, *parts)
    names = [f"x{layer}" for layer in range(template.layers)]
    spec = RunSpec(duration="settle", method=method, dt=0.17, rtol=1e-3, atol=1e-4)
    figures = ("steps", "time", "settled")
    states = states_of(template, spec, figures, above=0.8 if masked else None)
    channels = ("u", "m", *names)
    frames = rng.uniform(-1, 1, (4, *shape, len(channels)))
    frames[..., 0] *= np.array([0.0, 0.02, 0.3, 1.0])[:, None, None]
    frames[..., 2:] *= np.array([0.0, 0.02, 0.3, 1.0])[:, None, None, None]
    if template.boundary.constant is None:
        assert template.z.max() == template.z.min() == 0.0  # so that the first frame is at rest
    plan = Engine("opencl", precision="float64").compile(states, shape, channels=channels)
    got = plan(frames)
    wanted = Engine("reference").compile(states, shape, channels=channels)(frames)
    assert "void advance_0(" in plan.source
    np.testing.assert_array_equal(got["steps"], wanted["steps"])
    assert len(set(got["steps"].tolist())) > 2
    assert (got["steps"][0] == 1) == (template.boundary.constant is None)
    assert got["settled"].all()
    # a sum of up to a hundred steps of 0.17 on one side, a product on the other
    np.testing.assert_allclose(got["time"], wanted["time"], rtol=1e-13)
    for each in names:
        # values of order 1 of cells that forget roundings as they decay
        assert np.abs(got[each] - wanted[each]).max() <= 1e-14
        if masked:
            held = frames[..., 1] > 0.8
            np.testing.assert_array_equal(got[each][held], frames[..., channels.index(each)][held])


def test_steps_to_rest_of_arrays_beyond_one_work_item():
    """In single precision, as a run of a duration of as many steps, which nothing watches."""
    rng = np.random.default_rng(90)
    template = resting(rng, "zero-flux", "standard", 1, 1)
    maps = {name: rng.uniform(-1, 1, (2, 200, 193)) for name in ("input", "state")}
    maps["input"] *= np.array([0.01, 1.0])[:, None, None]
    maps["state"] *= np.array([0.01, 1.0])[:, None, None]
    engine = Engine("opencl", precision="float32")
    for method in ("euler", "rk4"):
        rest = engine.run(template, duration="settle", method=method, dt=0.125, **maps)
        assert rest.settled.all()
        assert rest.steps[0] < rest.steps[1]
        again = engine.run(template, duration="settle", method=method, dt=0.125, **maps)
        np.testing.assert_array_equal(again.state, rest.state)
        for frame, steps in enumerate(rest.steps):
            one = {name: value[frame] for name, value in maps.items()}
            fixed = engine.run(template, duration=0.125 * steps, method=method, dt=0.125, **one)
            assert fixed.steps == steps
            # Euler's d is added by itself where it is watched: in either run roundings of 1.2e-7
            # (of values up to 2) a step, of which the next step keeps 1 − 0.125 · 0.5
            assert np.abs(fixed.state - rest.state[frame]).max() <= 2 * 16 * 1.2e-7
            if method == "rk4":
                np.testing.assert_array_equal(fixed.state, rest.state[frame])


def test_steps_that_find_no_rest_end_at_the_limit():
    """Cells that turn over with each step of discrete time, x⁺ = −2 sign(x), a thousand times."""
    turning = np.zeros((3, 3))
    turning[1, 1] = -2.0
    template = Template("turns", turning, tau=1.0, output="sign", duration="settle")
    start = np.random.default_rng(91).uniform(-1, 1, (60, 50))
    result = Engine("opencl").run(template, state=start)
    assert not result.settled
    assert result.steps == result.time == 1000
    np.testing.assert_array_equal(result.state, 2.0 * np.where(start >= 0, 1.0, -1.0))
