"""Chebyshev's steps on large arrays, strip by strip, are the reference's own steps."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.graph.nodes import RunSpec
from cnnum.templating.template import Template

CASES = {
    # boundary, output, layers, radius, a mask holds some cells, in parts, duration
    "one work item": ("zero-flux", "standard", 1, 1, False, False, 2.0),
    "until it settles": ("periodic", "standard", 1, 2, True, True, "settle"),
    "layers": (0.3, "tanh", 2, 1, True, True, 2.0),
}


def spreading(rng, boundary, output, layers, radius):
    """Return a template of real rates up to about −100, layers coupled by a symmetric matrix."""
    k = 2 * radius + 1
    feedback = np.zeros((layers, layers, k, k))
    feedback[:, :, radius, radius] = 0.1
    for layer in range(layers):
        own = feedback[layer, layer]
        own += rng.uniform(0.5, 1.0, (k, k)) * 60 / k**2
        own += own[::-1, ::-1].copy()
        own += own[::-1].copy()
        own[radius, radius] -= own.sum()
    return Template(
        "spreading", feedback, rng.normal(size=(layers, 1, 3, 3)), rng.normal(size=layers) * 0.1,
        tau=0.9, boundary=boundary, output=output,
    )  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_chebyshev_steps_strips_as_one_array(name, states_of, monkeypatch):
    """Frames of a batch take steps, and stages, of their own number; launches end amid a step.

    Some rows have lanes without a cell, of which nothing may be judged.
    """
    *parts, masked, in_parts, duration = CASES[name]
    if in_parts:
        monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    number = list(CASES).index(name)
    rng = np.random.default_rng(60 + number)
    template = spreading(rng, *parts)
    names = [f"x{layer}" for layer in range(template.layers)]
    spec = RunSpec(duration=duration, method="runge-kutta-chebyshev", rtol=1e-3)
    figures = ("steps", "time", "error", "settled")
    states = states_of(template, spec, figures, above=0.8 if masked else None)
    channels, shape = ("u", "m", *names), (93 + number, 51)
    frames = rng.uniform(-1, 1, (3, *shape, len(channels)))
    # a diffusion that saturates in part is no diffusion there, and doubles roundings
    frames[..., 0] *= np.array([0.01, 0.1, 1.0])[:, None, None]
    plan = Engine("opencl", precision="float64").compile(states, shape, channels=channels)
    got = plan(frames)
    wanted = Engine("reference").compile(states, shape, channels=channels)(frames)
    assert "void advance_0(" in plan.source
    assert len(set(got["steps"].tolist())) > 1
    np.testing.assert_array_equal(got["steps"], wanted["steps"])
    np.testing.assert_array_equal(got["settled"], wanted["settled"])
    # roundings in the error estimates, which are small where it settles, move the ends of steps
    np.testing.assert_allclose(got["time"], wanted["time"], rtol=1e-9)
    np.testing.assert_allclose(got["error"], wanted["error"], rtol=1e-8)
    for each in names:
        assert np.abs(got[each] - wanted[each]).max() <= 1e-9
        if masked:
            held = frames[..., 1] > 0.8
            start = frames[..., channels.index(each)]
            np.testing.assert_array_equal(got[each][held], start[held])
    again = plan(frames)
    for each in got:
        np.testing.assert_array_equal(again[each], got[each])


def test_chebyshev_steps_beyond_one_work_item():
    """In single precision, of the narrowest rows that several work items share, up to 32 stages."""
    spread = 300.0 * np.array([[0, 1, 0], [1, -4, 1], [0, 1, 0]])
    template = Template("smooth", spread, [[1.0]], boundary="zero-flux", duration=3.0)
    across, down = (np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in (256, 257))
    wave = down[:, None] * across
    settings = {"method": "runge-kutta-chebyshev", "rtol": 1e-2}
    result = Engine("opencl").run(template, input=np.zeros_like(wave), state=wave, **settings)
    # the slowest wave of a closed array decays by itself
    rate = 1 + 300 * (4 - 2 * np.cos(np.pi / 256) - 2 * np.cos(np.pi / 257))
    off = np.abs(result.state - wave * np.exp(-3 * rate)).max()
    assert off <= result.error < 3e-2
    # steps of Euler's method of 1/1200 at most would be 3,600
    assert result.steps < 30
