"""Sums once a run of a large array: its drive, and whether it rests at the end."""

import numpy as np
import pytest

from cnnum import program, transient
from cnnum.engine import Engine
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.graph.nodes import RunSpec
from cnnum.templating.couplings import DelayedCoupling, NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

RAMP = Table("linear", ((-1.0, -0.3), (0.4, 0.1), (1.1, 0.5)))

CASES = {
    # inputs, layers, radius, boundary of inputs, rows and columns, whether all cores share a sweep
    "one input": (1, 1, 1, 0.3, (60, 47), True),
    "few columns": (1, 1, 1, "zero-flux", (90, 5), False),
    "two rows around": (2, 1, 2, "periodic", (37, 64), True),
    "more around than a vector": (1, 1, 9, "zero-flux", (70, 33), True),
    "fewer columns than around": (1, 1, 3, "periodic", (150, 2), True),
    "one row": (1, 1, 2, "zero-flux", (1, 300), False),
    "layers": (2, 3, 1, 0.0, (33, 50), True),
    "layers of a plan in one kernel": (2, 3, 1, "zero-flux", (33, 50), False),
    "wide rows": (2, 2, 1, "periodic", (33, 50), True),
}


def program_of(template, spec):
    """Return a program that gives all states, and whether they rest; it has a bias a layer."""
    inputs, layers = range(template.inputs), range(template.layers)

    @program
    def states(frame):
        maps = {"input": [frame.channel(f"u{n}") for n in inputs]}
        maps["bias"] = [frame.channel("b") for _ in layers]
        if template.delayed is not None:
            maps["previous"] = [frame.channel("b") for _ in inputs]
        found = transient(template, **maps, spec=spec)
        return {f"x{n}": state for n, state in enumerate(found.states)} | {"settled": found.settled}

    return states, (*(f"u{n}" for n in inputs), "b")


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", CASES)
def test_drives_of_large_arrays_are_sums(name, monkeypatch):
    """Inputs, nonlinear ones, those before a delay, and a bias, all of them into every layer.

    A plan is several kernels where all cores share a sweep, else one.
    """
    inputs, layers, radius, edge, shape, split = CASES[name]
    if split:
        monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    rng = np.random.default_rng(list(CASES).index(name))
    k = 2 * radius + 1
    late = rng.normal(size=(layers, inputs, 3, 3))
    template = Template(
        "driven", np.zeros((layers, layers, 1, 1)), rng.normal(size=(layers, inputs, k, k)),
        rng.normal(size=layers), tau=1.0 + 0.3 * np.arange(layers), input_boundary=edge,
        nonlinear=[
            NonlinearCoupling(rng.normal(size=(3, 3)), RAMP, "u", "u", to=layers - 1),
            NonlinearCoupling(rng.normal(size=(3, 3)), RAMP, "u", "x", source=inputs - 1),
        ],
        delayed=DelayedCoupling(0.1, np.zeros((layers, layers, 1, 1)), late),
    )  # fmt: skip
    states, channels = program_of(template, RunSpec(duration=0.3, dt=0.05, method="heun"))
    frames = rng.uniform(-1, 1, (2, *shape, len(channels)))
    plan = Engine("opencl", precision="float64").compile(states, shape, channels=channels)
    got, wanted = (
        plan(frames),
        Engine("reference").compile(states, shape, channels=channels)(frames),
    )
    assert ("void part_0" in plan.source) == split
    for layer in range(layers):
        expected = wanted[f"x{layer}"]
        # sums of at most 400 products of order 1
        assert np.abs(got[f"x{layer}"] - expected).max() <= 1e-13 * np.abs(expected).max()


@pytest.mark.one_in(3)
@pytest.mark.parametrize("split", [True, False])
@pytest.mark.parametrize("method", ["euler", "auto"])
def test_rest_of_large_arrays_is_seen(method, split, monkeypatch):
    """Cells that their neighbours hold rest after 40 time constants, and do not after 2."""
    if split:
        monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    feedback = [[0.0, 0.1, 0.0], [0.1, 0.3, 0.1], [0.0, 0.1, 0.0]]
    template = Template("resting", feedback, [[1.0]], 0.1, boundary="periodic", output="tanh")
    u = np.random.default_rng(1).uniform(-1, 1, (40, 33))
    step = {} if method == "auto" else {"dt": 0.1}
    for engine in (Engine("opencl"), Engine("reference")):
        found = [
            engine.run(template, input=u, duration=duration, method=method, **step)
            for duration in (2.0, 40.0)
        ]
        assert [bool(each.settled) for each in found] == [False, True]
