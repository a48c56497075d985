"""Strips of large arrays of several layers, and with cells that a mask holds."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.graph.nodes import RunSpec
from cnnum.templating.template import Template

STEP = 0.05


def random_template(rng, boundary, output, layers, radius=1, equal=False, control=True):
    """Return a template whose layers all couple, each with a time constant of its own."""
    k = 2 * radius + 1
    feedback = rng.normal(size=(layers, layers, k, k)) * (0.3 / k / layers)
    return Template(
        "random",
        0.5 * (feedback + feedback[:, :, ::-1]) if equal else feedback,
        rng.normal(size=(layers, 1, 3, 3)) * control, rng.normal(size=layers) * 0.2,
        tau=[0.7, 1.3, 0.9][:layers], boundary=boundary, output=output,
    )  # fmt: skip


CASES = {
    "euler": (("periodic", "standard", 2), True, {"dt": STEP}),
    "rk4": ((0.3, "full-range", 2), False, {"dt": STEP}),
    "etd-rk2": (("zero-flux", "linear", 3), True, {"dt": STEP}),
    "heun": (("periodic", "full-range", 1), True, {"dt": STEP}),
    "exponential-euler": ((0.3, "standard", 2), True, {"dt": STEP, "estimate": True}),
    "bogacki-shampine": (("zero-flux", "linear", 2), False, {"rtol": 1e-3}),
}
"""By method: the template, whether a mask holds some cells, and how it runs."""


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", CASES)
def test_layers_and_held_cells_step_as_one_array(method, states_of, monkeypatch):
    """Weights equal or not, the drive an input's or z of each layer alone."""
    monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    monkeypatch.setattr(kernel_source, "PRIVATE_CELLS", 0)
    number = list(CASES).index(method)
    parts, masked, settings = CASES[method]
    rng = np.random.default_rng(40 + number)
    template = random_template(
        rng, *parts, radius=2 if method == "heun" else 1, equal=number in (1, 2),
        control=method != "rk4",
    )  # fmt: skip
    names = [f"x{layer}" for layer in range(template.layers)]
    spec = RunSpec(duration=7 * STEP, method=method, **settings)
    states = states_of(template, spec, ("error",), above=0.5 if masked else None)
    channels, shape = ("u", "m", *names), (93 + number, 51)
    # numbers that either precision holds
    frames = rng.uniform(-1, 1, (2, *shape, len(channels))).astype(np.float32)
    precision = "float32" if method == "heun" else "float64"
    plan = Engine("opencl", precision=precision).compile(states, shape, channels=channels)
    got = plan(frames)
    wanted = Engine("reference").compile(states, shape, channels=channels)(frames)
    assert "void advance_0(" in plan.source
    # 7 steps of values of order 1
    tolerance = 2e-6 if precision == "float32" else 1e-13
    for name in names:
        assert np.abs(got[name] - wanted[name]).max() <= tolerance * np.abs(wanted[name]).max()
        if masked:
            held = frames[..., 1] > 0.5
            start = frames[..., channels.index(name)]
            np.testing.assert_array_equal(got[name][held], start[held])
    if np.isfinite(wanted["error"]).all():
        np.testing.assert_allclose(got["error"], wanted["error"], rtol=1e-6)
