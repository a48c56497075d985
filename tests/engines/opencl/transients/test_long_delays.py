"""Delays of many steps: outputs of all of them are kept, which no stack of a thread holds."""

import numpy as np
import pytest

import cnnum
from cnnum.templating.couplings import DelayedCoupling

STEPS = 20_000
"""Steps of a delay: of 64 cells 10 MB in float64, where a thread's stack usually has 8."""

DELAY = 5.0


@pytest.mark.parametrize("batch", [1, 9])
def test_delays_of_many_steps_run(batch):
    """The `reference` engine keeps its outputs in memory of its own."""
    rng = np.random.default_rng(batch)
    template = cnnum.Template(
        "late",
        [[0.5]],
        output="linear",
        delayed=DelayedCoupling(
            DELAY, rng.uniform(-0.2, 0.2, (1, 1, 3, 3)), np.zeros((1, 0, 1, 1))
        ),
    )
    start = rng.uniform(-1.0, 1.0, (batch, 8, 8))
    how = {"duration": 0.1, "method": "euler", "dt": DELAY / STEPS}
    result, other = (
        cnnum.Engine(name, precision="float64").run(template, state=start, **how)
        for name in ("opencl", "reference")
    )
    np.testing.assert_allclose(result.state, other.state, atol=1e-13)  # 400 roundings of 1e-16
    assert np.abs(result.state - start).max() > 0.01
