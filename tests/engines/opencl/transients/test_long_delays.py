"""Delays of many steps: outputs of all of them are kept, which no stack of a thread holds."""

import numpy as np
import pytest

import cnnum
from cnnum.engines.opencl.lowering.kernel_source import lower
from cnnum.engines.opencl.lowering.storage import Tables
from cnnum.templating.couplings import DelayedCoupling

STEPS = 20_000
"""Steps of a delay: of 64 cells 10 MB in float64, where a thread's stack usually has 8."""

DELAY = 5.0


def late(rng):
    """Return a template with such a delay, and the options that take so many steps of it."""
    around = DelayedCoupling(DELAY, rng.uniform(-0.2, 0.2, (1, 1, 3, 3)), np.zeros((1, 0, 1, 1)))
    template = cnnum.Template("late", [[0.5]], output="linear", duration=0.05, delayed=around)
    return template, {"method": "euler", "dt": DELAY / STEPS}


@pytest.mark.parametrize("batch", [1, 9])
def test_delays_of_many_steps_run(batch):
    """The `reference` engine keeps its outputs in memory of its own."""
    rng = np.random.default_rng(batch)
    template, how = late(rng)
    start = rng.uniform(-1.0, 1.0, (batch, 8, 8))
    result, other = (
        cnnum.Engine(name, precision="float64").run(template, state=start, **how)
        for name in ("opencl", "reference")
    )
    np.testing.assert_allclose(result.state, other.state, atol=1e-13)  # 200 roundings of 1e-16
    assert np.abs(result.state - start).max() > 0.01


def test_such_delays_in_a_loop_run():
    """Frames of two channels, of which one is read, alone and in lanes."""
    rng = np.random.default_rng(5)
    template, how = late(rng)

    def function(frame):
        def body(x):
            return cnnum.transient(template, state=x).states[0]

        run = cnnum.loop(body, frame.b, limit=2, until=lambda x: x.max() < 0.95)
        return {"b": run.value, "finished": run.finished}

    frames = rng.uniform(-1.0, 1.0, (9, 4, 5, 2))
    result, other = (
        cnnum.Engine(name, precision="float64").compile(
            cnnum.Program(function, "p"), (4, 5), channels=("a", "b"), **how
        )
        for name in ("opencl", "reference")
    )
    want = other(frames)["b"]
    np.testing.assert_allclose(result(frames)["b"], want, atol=1e-13)
    np.testing.assert_allclose(result(frames[3])["b"], want[3], atol=1e-13)
    np.testing.assert_allclose(result.stream().push(frames[3])["b"], want[3], atol=1e-13)


def test_arrays_of_many_maps_fit_the_stack_of_a_thread():
    """One of those of `texture` is 9 MB in sixteen lanes of 16×16 cells; the process died."""
    plan = cnnum.Engine("opencl").compile(cnnum.get_program("texture").bind(rate=100.0), (16, 16))
    for lanes in (1, 16):
        text = lower(plan.schedule, plan.solvers, Tables(np.dtype("f4"), lanes, 16, 2**20, True))
        assert text.private * lanes * 4 < 2**21
        assert (text.scratch > 0) == (lanes > 1)
