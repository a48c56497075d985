"""Saturating arrays that never saturate are exact, and only those are taken for it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cnnum.engine import Engine
from cnnum.errors import MethodError
from cnnum.runs.linear_range import as_linear, room, stays_linear
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

ENGINES = [Engine(), Engine(precision="float64"), Engine("numba"), Engine("reference")]
IDS = ["opencl-float32", "opencl-float64", "numba", "reference"]
SHAPE = (6, 7)
EDGES = {"zero-flux": "symmetric", "periodic": "wrap", 0.5: "constant"}


def drawn(seed, share):
    """Return a random network whose drive takes that share of the room, its input and start."""
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(2, 3, 3))
    A[1, 1] = 0.0
    A *= rng.uniform(0.3, 0.9) / np.abs(A).sum()
    left = 1.0 - np.abs(A).sum()
    edge = list(EDGES)[seed % 3]
    z = 0.3 * share * left
    B *= 0.7 * share * left / np.abs(B).sum()
    template = Template("drawn", A, B, z, boundary=edge, duration=3.0)
    return template, rng.choice([-1.0, 1.0], SHAPE), rng.uniform(-1.0, 1.0, SHAPE)


def rate_of(template, u):
    """Return dx/dt of the saturating array, by shifted copies."""
    edge = template.boundary.constant
    how = {"constant_values": edge} if edge is not None else {}
    mode = EDGES[template.boundary.name]

    def near(weights, maps):
        wide = np.pad(maps, 1, mode=mode, **how)
        shifts = [(r, c) for r in range(3) for c in range(3)]
        return sum(weights[r, c] * wide[r : r + SHAPE[0], c : c + SHAPE[1]] for r, c in shifts)

    drive = near(template.B[0, 0], u) + template.z[0]
    return lambda x: near(template.A[0, 0], np.clip(x, -1.0, 1.0)) - x + drive


def truth(template, u, x0, times):
    rate = rate_of(template, u)
    found = solve_ivp(
        lambda _, x: rate(x.reshape(SHAPE)).ravel(),
        (0.0, times[-1]),
        x0.ravel(),
        "DOP853",
        times,
        rtol=1e-11,
        atol=1e-12,
    )
    return found.y.T.reshape(-1, *SHAPE)


@pytest.mark.parametrize("seed", range(6))
def test_no_cell_leaves_where_it_is_said(seed):
    template, u, x0 = drawn(seed, 0.999)
    given = {"input": u[None], "state": x0[None]}
    assert stays_linear(template, given)
    path = truth(template, u, x0, np.linspace(0.0, 20.0, 101))
    # an integrator's tolerance beyond the edge
    assert np.abs(path).max() <= 1.0 + 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_the_room_is_all_that_there_is(seed):
    """A cell at 1 whose neighbours and inputs all push moves on as soon as the drive is larger."""
    template, _, _ = drawn(seed, 1.01)
    at = (2, 3)
    x, u = np.zeros(SHAPE), np.zeros(SHAPE)
    around = np.s_[at[0] - 1 : at[0] + 2, at[1] - 1 : at[1] + 2]
    x[around], u[around] = np.sign(template.A[0, 0]), np.sign(template.B[0, 0])
    x[at] = 1.0
    assert rate_of(template, u)(x)[at] == pytest.approx(0.01 * room(template)[0], rel=1e-6)
    assert not stays_linear(template, {"input": u[None], "state": x[None]})


@pytest.mark.parametrize("engine", ENGINES, ids=IDS)
@pytest.mark.parametrize("seed", range(3))
def test_the_answer_is_exact(engine, seed):
    template, u, x0 = drawn(seed, 0.99)
    got = engine.run(template, input=u, state=x0)
    assert got.method == "propagator"
    wanted = truth(template, u, x0, [3.0])[-1]
    # 42 states: float32 rounds a product of as many numbers below 1
    assert np.abs(got.state - wanted).max() <= (1e-6 if engine.precision == "float32" else 1e-10)
    assert np.abs(got.output).max() <= 1.0


@pytest.mark.parametrize(
    ("what", "more"), [("state", 1.01), ("input", 2.0), ("bias", 1.0), ("mask", 0.0)]
)
def test_steps_are_taken_where_a_cell_might_leave(engines, what, more):
    engine = engines["opencl-float64"]
    template, u, x0 = drawn(0, 0.99)
    given = {"input": u, "state": x0}
    kinds = {"bias": np.full(SHAPE, more), "mask": np.zeros(SHAPE, bool)}
    given[what] = kinds[what] if what in kinds else more * np.sign(given[what])
    got = engine.run(template, **given)
    assert got.method != "propagator"
    plain = given["bias"] if what == "bias" else 0.0
    asked = Template("same", template.A, template.B, template.z, boundary=template.boundary)
    step = rate_of(asked, given["input"])
    found = solve_ivp(
        lambda _, x: (step(x.reshape(SHAPE)) + plain).ravel(),
        (0.0, 3.0),
        given["state"].ravel(),
        "DOP853",
        rtol=1e-10,
        atol=1e-11,
    )
    # rtol 1e-4 of a state of 1, a few steps of which add up
    assert np.abs(got.state - found.y[:, -1].reshape(SHAPE)).max() <= 1e-3
    with pytest.raises(MethodError, match="propagator"):
        engine.run(template, **given, method="propagator")


def test_one_frame_of_a_batch_that_leaves_takes_all_to_steps(engines):
    engine = engines["opencl-float32"]
    heat = get_template("DIFFUS")
    frames = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 8, 8))
    assert engine.run(heat, input=frames, duration=2.0).method == "propagator"
    frames[1, 4, 4] = 1.5
    assert engine.run(heat, input=frames, duration=2.0).method != "propagator"


def test_heat_on_saturating_cells_is_heat(engines):
    """DIFFUS, by the closed form of its linear twin: the reference engine's own linear answer."""
    heat = get_template("DIFFUS")
    start = np.random.default_rng(2).uniform(-1.0, 1.0, (64, 48))
    got = engines["opencl-float32"].run(heat, input=start, duration=5.0)
    wanted = Engine("reference").run(as_linear(heat), input=start, duration=5.0)
    assert got.method == wanted.method == "propagator"
    # float32 transforms of values up to 1
    assert np.abs(got.output - wanted.output).max() <= 1e-6
