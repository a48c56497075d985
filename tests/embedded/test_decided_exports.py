"""Outputs of cells that see only themselves: one weighted sum in the exported program, no steps.

Compared with the equation of a cell, solved by SciPy.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cnnum
from cnnum.embedded.formats import precision_named
from cnnum.embedded.lowering.builder import solvers_for
from cnnum.embedded.making import make
from cnnum.graph.schedule import schedule
from cnnum.integrators.closed_forms import Separate
from cnnum.integrators.schemes import FixedSteps

SHAPE, CHANNELS = (3, 4), ("u", "x", "m")
BITS = 2.0**-6
"""Inputs, weights and biases are multiples of it, so that drives are exact in q15, too."""


def planned(template, roles, duration=None, what="output"):
    """Return the schedule of a program that runs a template once."""

    def function(frame):
        maps = {"input": frame.u, "state": frame.x, "flag": frame.x > 0.0, "mask": frame.m > 0.0}
        run = cnnum.transient(
            template,
            spec=cnnum.RunSpec(duration=duration),
            **{"state" if role == "flag" else role: maps[role] for role in roles},
        )
        return {"y": run.outputs[0] if what == "output" else run.states[0]}

    return schedule(cnnum.Program(function, "one").trace(SHAPE, CHANNELS), CHANNELS, None)


def solved(own, drive, start, time):
    """Return the outputs of cells at a time, by small steps of a method of order 8."""
    drive, start = np.broadcast_arrays(drive, start)
    ends = [
        solve_ivp(
            lambda _, x, w=w: -x + own * np.clip(x, -1.0, 1.0) + w, (0.0, time), [x0],
            method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.2,
        ).y[0, -1]
        for w, x0 in zip(drive.ravel(), start.ravel(), strict=True)
    ]  # fmt: skip
    return np.clip(ends, -1.0, 1.0).reshape(drive.shape)


def on_grid(rng, size, shape):
    return np.round(rng.uniform(-size, size, shape) / BITS) * BITS


def drawn(seed):
    """Return a template, its roles, the bound on starts, and frames whose numbers are exact."""
    rng = np.random.default_rng(seed)
    own = float(rng.choice([0.5, 0.9375, 1.0, 1.25, 2.0, 3.0, 5.0]))
    time = float(rng.choice([0.25, 1.0, 4.0, 10.0, 40.0]))
    B = on_grid(rng, 1.0, (3, 3)) * (rng.random((3, 3)) < 0.5)
    B[1, 1] = 0.75
    # a start beyond ±1 is for drives that cannot pull it back
    beyond = own > 1.0 and rng.random() < 0.3
    if beyond:
        B = None
    z = float(on_grid(rng, own - 1.0 if beyond else 1.5, ()))
    # of a flag it is known that it is within ±1
    starts = "state" if beyond else str(rng.choice(["flag", "constant"]))
    template = cnnum.Template(
        "drawn", A=[[own]], B=B, z=z, duration=time, boundary=float(on_grid(rng, 1.0, ())),
        initial=float(on_grid(rng, 1.0, ())),
    )  # fmt: skip
    roles = ["input"] * (B is not None) + [starts] * (starts != "constant")
    roles += ["mask"] * bool(rng.random() < 0.3)
    frames = on_grid(rng, 1.0, (8, 1, *SHAPE, 3))
    frames[..., 1] = np.clip(frames[..., 1] * (4.0 if beyond else 1.0), -3.0, 3.0)
    return template, roles, frames, own, time


def wanted(template, roles, frames, own, time):
    """Return the outputs of all frames."""
    u, x, m = (frames[:, 0, ..., n] for n in range(3))
    rim = template.boundary.constant
    padded = np.pad(u, ((0, 0), (1, 1), (1, 1)), constant_values=rim)
    drive = np.full(u.shape, template.z[0])
    if "input" in roles:
        for (row, col), weight in np.ndenumerate(template.B[0, 0]):
            drive = drive + weight * padded[:, row : row + SHAPE[0], col : col + SHAPE[1]]
    start = np.full(u.shape, float(template.initial))
    start = x if "state" in roles else (x > 0.0).astype(float) if "flag" in roles else start
    ends = solved(own, drive, start, time)
    return np.where(m > 0.0, np.clip(start, -1.0, 1.0), ends) if "mask" in roles else ends


@pytest.mark.parametrize("seed", range(24))
def test_outputs_are_those_of_the_equation(seed):
    template, roles, frames, own, time = drawn(seed)
    plan = planned(template, roles)
    (solver,) = solvers_for(plan).values()
    assert isinstance(solver.scheme, Separate)
    expected = wanted(template, roles, frames, own, time)
    slope = own - 1.0
    gain = time if slope == 0.0 else np.expm1(slope * time) / slope
    for precision, last in (("float32", 2.0**-21), ("q15", 2.0**-15)):
        given = make("one", plan, precision_named(precision), frames).run(frames)["y"][:, 0]
        # c has an error of its last place, which grows with the state; starts are at most 1
        assert np.abs(given - expected).max() <= min(gain, 1e9) * last * max(1.0, slope) + last * 2
        if gain * last > 0.1:  # the bound alone would let anything pass
            assert np.mean(np.abs(given - expected) < 1e-3) > 0.9


def test_outputs_of_templates_start_within_one():
    """A start that is another template's output, a constant or a flag is known to be within ±1."""
    first = cnnum.Template("first", A=[[2.0]], B=[[1.0]], z=0.0, duration=8.0)
    second = cnnum.Template("second", A=[[2.0]], B=[[0.5]], z=0.25, duration=3.0)

    def function(frame):
        seen = cnnum.apply(first, input=frame.u)
        return {"y": cnnum.apply(second, input=frame.x, state=seen)}

    plan = schedule(cnnum.Program(function, "two").trace(SHAPE, CHANNELS), CHANNELS, None)
    assert all(isinstance(solver.scheme, Separate) for solver in solvers_for(plan).values())
    frames = on_grid(np.random.default_rng(5), 1.0, (6, 1, *SHAPE, 3))
    u, x, _ = (frames[:, 0, ..., n] for n in range(3))
    expected = solved(2.0, 0.5 * x + 0.25, solved(2.0, u, np.zeros(u.shape), 8.0), 3.0)
    given = make("two", plan, precision_named("q15"), frames).run(frames)["y"][:, 0]
    # a start's last place of 16 bits grows by e³
    assert np.abs(given - expected).max() < 20.0 * 2.0**-15


@pytest.mark.parametrize(
    ("roles", "duration", "what"),
    [
        (["input"], None, "state"),
        (["input"], "settle", "output"),
        # nothing says that a channel stays within ±1
        (["input", "state"], None, "output"),
    ],
)
def test_what_needs_the_way_takes_steps(roles, duration, what):
    template = cnnum.Template("kept", A=[[2.0]], B=[[1.0]], z=0.0, duration=5.0)
    (solver,) = solvers_for(planned(template, roles, duration, what)).values()
    assert isinstance(solver.scheme, FixedSteps)


def test_by_euler_it_takes_steps():
    template = cnnum.Template("kept", A=[[2.0]], B=[[1.0]], z=0.0, duration=5.0)
    (solver,) = solvers_for(planned(template, ["input"]), "euler").values()
    assert isinstance(solver.scheme, FixedSteps)
