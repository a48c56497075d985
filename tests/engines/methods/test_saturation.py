"""An answer without time steps is never given to an array that leaves its linear range."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cnnum.engine import Engine
from cnnum.errors import MethodError, TemplateError
from cnnum.templating.template import Template

ENGINES = [Engine(), Engine(precision="float64"), Engine("numba"), Engine("reference")]
IDS = ["opencl-float32", "opencl-float64", "numba", "reference"]

# feedback that spreads and grows: without its limits the state would grow as e^{0.6 t}
SPREADS = np.array([[0.05, 0.1, 0.05], [0.1, 1.0, 0.1], [0.05, 0.1, 0.05]])
SHAPE = (6, 7)


def template(output="standard"):
    return Template(
        "spreads", SPREADS, np.zeros((3, 3)), 0.3, boundary=0.0, output=output, duration=4.0
    )


def truth(x0, end, *, clip):
    """Return x(end) by an integrator and a coupling of its own."""

    def rate(_, flat):
        x = flat.reshape(SHAPE)
        y = np.pad(np.clip(x, -1, 1) if clip else x, 1)
        near = sum(
            SPREADS[r, c] * y[r : r + SHAPE[0], c : c + SHAPE[1]]
            for r in range(3)
            for c in range(3)
        )
        return (near - x + 0.3).ravel()

    found = solve_ivp(rate, (0.0, end), x0.ravel(), "DOP853", rtol=1e-11, atol=1e-12)
    return found.y[:, -1].reshape(SHAPE)


@pytest.mark.parametrize("engine", ENGINES, ids=IDS)
def test_a_cell_that_saturates_on_the_way_is_followed(engine):
    """Within 1e-3 of the truth at rtol 1e-5, where the linear answer is off by much more."""
    x0 = np.random.default_rng(8).uniform(-0.3, 0.3, SHAPE)
    wanted, linear = (truth(x0, 4.0, clip=clip) for clip in (True, False))
    assert np.abs(x0).max() < 1 < np.abs(wanted).max()
    assert np.abs(linear - wanted).max() > 1.0
    got = engine.run(
        template(), input=np.zeros(SHAPE), state=x0, duration=4.0, rtol=1e-5, atol=1e-6
    )
    assert got.method != "propagator"
    assert np.abs(got.state - wanted).max() <= 1e-3


@pytest.mark.parametrize("engine", ENGINES, ids=IDS)
@pytest.mark.parametrize("duration", [0.1, 4.0, "settle"])
def test_the_propagator_is_refused_where_outputs_saturate(engine, duration):
    """Even for runs that would stay linear with these numbers: others would not."""
    with pytest.raises(MethodError, match="its output saturates"):
        engine.run(template(), input=np.zeros(SHAPE), duration=duration, method="propagator")


@pytest.mark.parametrize("engine", ENGINES, ids=IDS)
def test_uncoupled_cells_are_exact_beyond_their_range(engine):
    """A = 0: x(t) = w + (x0 - w) e^-t holds at any size, and only the output is limited."""
    alone = Template("alone", np.zeros((3, 3)), np.eye(3), 2.5, duration=1.0)
    x0 = np.random.default_rng(9).uniform(-3, 3, SHAPE)
    got = engine.run(alone, input=np.zeros(SHAPE), state=x0, duration=1.0)
    wanted = 2.5 + (x0 - 2.5) * np.exp(-1.0)
    assert got.method == "propagator"
    # float32: values of order 3
    assert np.abs(got.state - wanted).max() <= 3e-6
    assert np.abs(got.output - np.clip(wanted, -1, 1)).max() <= 3e-6


@pytest.mark.parametrize("method", ["euler", "rk4", "dormand-prince", "etd-rk2"])
@pytest.mark.parametrize("engine", ENGINES, ids=IDS)
def test_a_limited_state_starts_within_its_limits(engine, method):
    """A state beyond them becomes the limit itself, on every engine and to the bit."""
    options = {"method": method} | ({} if method == "dormand-prince" else {"dt": 0.1})
    given = np.random.default_rng(4).uniform(-2.0, 2.0, SHAPE)
    limited = template("full-range")
    still = np.zeros(SHAPE)
    beyond, within = (
        engine.run(limited, input=still, state=x, **options) for x in (given, given.clip(-1, 1))
    )
    np.testing.assert_array_equal(beyond.state, within.state)


def test_a_limited_template_does_not_begin_beyond():
    with pytest.raises(TemplateError, match=r"limited to \[-1, 1\], got initial = 1\.5"):
        Template("beyond", SPREADS, np.zeros((3, 3)), output="full-range", initial=1.5)
