"""Outputs of cells that see only themselves: one weighted sum in the exported program, no steps.

Compared with the equation of a cell, solved by SciPy.
"""

from pathlib import Path

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


def program(template, roles, duration=None, what="outputs", *, remembers=False):
    """Return a program that runs a template once, and may have a memory."""

    def function(frame):
        flag, layers = frame.x > 0.0, template.layers
        maps = {
            "input": frame.u, "mask": frame.m > 0.0, "bias": [frame.u] * layers,
            "state": [frame.x] * layers, "flag": [flag] * layers,
        }  # fmt: skip
        given = {"state" if role == "flag" else role: maps[role] for role in roles}
        run = cnnum.transient(template, spec=cnnum.RunSpec(duration=duration), **given)
        result = {f"y{n}": each for n, each in enumerate(getattr(run, what))}
        return result | ({"before": frame.previous(frame.u)} if remembers else {})

    return cnnum.Program(function, "one")


def planned(*given, shape=SHAPE):
    """Return the schedule of that program."""
    return schedule(program(*given).trace(shape, CHANNELS), CHANNELS, None)


def solved(own, drive, start, time):
    """Return the outputs of cells at a time in time constants, by short steps of order 8."""
    drive, start = np.broadcast_arrays(drive, start)
    ends = solve_ivp(
        lambda _, x: -x + own * np.clip(x, -1.0, 1.0) + drive.ravel(), (0.0, time), start.ravel(),
        method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.05,
    ).y[:, -1]  # fmt: skip
    return np.clip(ends, -1.0, 1.0).reshape(drive.shape)


def on_grid(rng, size, shape):
    return np.round(rng.uniform(-size, size, shape) / BITS) * BITS


def drawn(seed, shape=SHAPE):
    """Return a template of one or two layers, its roles, and frames whose numbers are exact."""
    rng = np.random.default_rng(seed)
    layers = int(rng.integers(1, 3))
    own = rng.choice([-0.5, 0.5, 0.9375, 1.0, 1.25, 2.0, 3.0, 5.0], layers)
    tau = rng.choice([0.5, 1.0, 2.0], layers)
    # a start beyond ±1 is for drives that cannot pull it back
    beyond = bool((own > 1.0).all()) and rng.random() < 0.5
    starts = "state" if beyond else str(rng.choice(["flag", "constant"]))
    A, B, z = np.zeros((layers, layers, 1, 1)), None, on_grid(rng, 1.5, layers)
    A[range(layers), range(layers), 0, 0] = own
    if beyond:
        z = np.clip(z, 1.0 - own, own - 1.0)
    else:
        B = on_grid(rng, 1.0, (layers, 1, 3, 3)) * (rng.random((layers, 1, 3, 3)) < 0.5)
        B[0, 0, 1, 1] = 0.75
    template = cnnum.Template(
        "drawn", A=A, B=B, z=z, tau=tau, duration=float(rng.choice([0.25, 1.0, 4.0, 10.0, 25.0])),
        boundary=float(on_grid(rng, 2.0, ())), initial=float(on_grid(rng, 1.0, ())),
    )  # fmt: skip
    roles = ["input"] * (B is not None) + [starts] * (starts != "constant")
    roles += ["mask"] * bool(rng.random() < 0.3)
    roles += ["bias"] * bool(not beyond and rng.random() < 0.3)
    frames = on_grid(rng, 1.0, (6, 1, *shape, 3))
    frames[..., 1] = np.clip(frames[..., 1] * (4.0 if beyond else 1.0), -3.0, 3.0)
    return template, roles, frames


def wanted(template, roles, frames):
    """Return the outputs of each layer of all frames, and the factor by which its errors grow."""
    u, x, m = (frames[:, 0, ..., n] for n in range(3))
    rim, shape = template.boundary.constant, u.shape[1:]
    padded = np.pad(u, ((0, 0), (1, 1), (1, 1)), constant_values=rim)
    for layer in range(template.layers):
        drive, own = np.full(u.shape, template.z[layer]), float(template.A[layer, layer].item())
        if "input" in roles:
            for (row, col), weight in np.ndenumerate(template.B[layer, 0]):
                drive = drive + weight * padded[:, row : row + shape[0], col : col + shape[1]]
        drive = drive + u if "bias" in roles else drive
        start = np.full(u.shape, float(template.initial))
        start = x if "state" in roles else (x > 0.0).astype(float) if "flag" in roles else start
        time, slope = float(template.duration / template.tau[layer]), own - 1.0
        ends = solved(own, drive, start, time)
        if "mask" in roles:
            ends = np.where(m > 0.0, np.clip(start, -1.0, 1.0), ends)
        gain = time if slope == 0.0 else np.expm1(slope * time) / slope
        yield ends, gain * max(1.0, abs(slope))


@pytest.mark.parametrize("seed", range(24))
def test_outputs_are_those_of_the_equation(seed):
    template, roles, frames = drawn(seed)
    plan = planned(template, roles)
    (solver,) = solvers_for(plan).values()
    assert isinstance(solver.scheme, Separate)
    expected = list(wanted(template, roles, frames))
    for precision, last in (("float32", 2.0**-21), ("q15", 2.0**-15)):
        given = make("one", plan, precision_named(precision), frames).run(frames)
        for layer, (ends, gain) in enumerate(expected):
            error = np.abs(given[f"y{layer}"][:, 0] - ends)
            # c has an error of its last place, which grows with the state; starts are at most 1
            assert error.max() <= min(gain, 1e9) * last + last * 2
            if gain * last > 0.1:  # the bound alone would let anything pass
                assert np.mean(error < 1e-3) > 0.9


@pytest.mark.parametrize("engine", ["reference", "opencl"])
@pytest.mark.parametrize("seed", range(0, 24, 3))
def test_engines_in_whole_numbers_run_what_is_exported(seed, engine):
    """To the bit, by one sum as by steps where a state is read, and whatever a stream remembers."""
    template, roles, frames = drawn(seed)
    for precision, what in (("q15", "outputs"), ("q7", "outputs"), ("q15", "states")):
        one = program(template, roles, None, what, remembers=bool(seed % 2))
        plan = schedule(one.trace(SHAPE, CHANNELS), CHANNELS, None)
        exported = make("one", plan, precision_named(precision), frames).run(frames)
        compiled = cnnum.Engine(engine, precision=precision).compile(
            one, SHAPE, channels=CHANNELS, like=frames
        )
        stream = compiled.stream((1,))
        for number, frame in enumerate(frames):
            for name, values in stream.push(frame).items():
                np.testing.assert_array_equal(values, exported[name][number], name)


def at_rest(own, start):
    """Return a template, its roles, and frames: cells at rest, and beside it on both sides."""
    template = cnnum.Template(
        "resting", A=[[own]], B=[[4.0]], z=0.0, duration=50.0, boundary=0.0, initial=start
    )
    frames = np.zeros((3, 1, *SHAPE, 3))
    frames[..., 0] = (1.0 - own) * start / 4.0
    frames[:, 0, 0, 0, 0] += [0.0, BITS, -BITS]
    return template, ["input"], frames


RESTS = [(own, start) for own in (1.25, 2.0, 3.0, 5.0) for start in (1.0, -1.0, 0.5, 0.25)]


@pytest.mark.parametrize(("own", "start"), RESTS)
def test_a_cell_at_its_unstable_rest_stays(own, start):
    template, roles, frames = at_rest(own, start)
    plan = planned(template, roles)
    for precision in ("float32", "q15", "q7"):
        given = make("one", plan, precision_named(precision), frames).run(frames)["y0"][:, 0]
        expected = np.full(given.shape, start)
        expected[1:, 0, 0] = 1.0, -1.0
        # 1 lies half a step beyond the largest word of a fixed fraction
        assert np.abs(given - expected).max() <= (2.0**-6 if precision == "q7" else 2.0**-14)


def test_outputs_of_templates_start_within_one():
    """A start that is another template's output, a constant or a flag is known to be within ±1."""
    first = cnnum.Template("first", A=[[2.0]], B=[[1.0]], z=0.0, duration=8.0)
    second = cnnum.Template("second", A=[[2.0]], B=[[0.5]], z=0.25, duration=3.0)

    def function(frame):
        seen = cnnum.apply(first, input=frame.u)
        shown = cnnum.minimum(seen, 0.75) * cnnum.where(frame.m > 0.0, 1.0, -1.0)
        return {
            "y": cnnum.apply(second, input=frame.x, state=seen),
            "z": cnnum.apply(second, input=frame.x, state=shown),
            "flag": cnnum.apply(second, input=frame.x, state=(frame.m > 0.0).picture()),
        }

    plan = schedule(cnnum.Program(function, "two").trace(SHAPE, CHANNELS), CHANNELS, None)
    assert all(isinstance(solver.scheme, Separate) for solver in solvers_for(plan).values())
    frames = on_grid(np.random.default_rng(5), 1.0, (6, 1, *SHAPE, 3))
    u, x, m = (frames[:, 0, ..., n] for n in range(3))
    seen, sign = solved(2.0, u, np.zeros(u.shape), 8.0), np.where(m > 0.0, 1.0, -1.0)
    starts = {"y": seen, "z": np.minimum(seen, 0.75) * sign, "flag": sign}
    outputs = make("two", plan, precision_named("q15"), frames).run(frames)
    for name, start in starts.items():
        expected = solved(2.0, 0.5 * x + 0.25, start, 3.0)
        # a start's last place of 16 bits grows by e³
        assert np.abs(outputs[name][:, 0] - expected).max() < 20.0 * 2.0**-15


@pytest.mark.parametrize(
    ("roles", "duration", "what"),
    [
        (["input"], None, "states"),
        (["input"], "settle", "outputs"),
        # nothing says that a channel stays within ±1
        (["input", "state"], None, "outputs"),
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


def test_there_are_as_many_in_the_library_as_the_page_says():
    page = (Path(__file__).parents[2] / "docs/microcontrollers.md").read_text(encoding="utf-8")
    count = 0
    for name in cnnum.template_names():
        template = cnnum.get_template(name)

        def function(frame, template=template):
            maps = [frame.u, frame.x, frame.m]
            if template.inputs or template.initial == "input":
                given = {"input": maps[: template.inputs or template.layers]}
            else:
                given = {"state": (2 * maps)[: template.layers]}
            outputs = cnnum.transient(template, **given).outputs
            return {f"y{n}": output for n, output in enumerate(outputs)}

        plan = schedule(cnnum.Program(function, "one").trace((8, 8), CHANNELS), CHANNELS, None)
        (solver,) = solvers_for(plan).values()
        count += isinstance(solver.scheme, Separate)
    assert f"applies to {count} templates of the library" in page
