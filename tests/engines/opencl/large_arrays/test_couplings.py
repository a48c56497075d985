"""Nonlinear, delayed and time-varying couplings of large arrays: the reference's own steps."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.graph.nodes import RunSpec
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

RAMP = Table("linear", ((-1.0, -0.3), (-0.2, 0.1), (0.4, 0.1), (1.1, 0.5)))
STEPS = Table("constant", ((-0.5, -0.2), (0.3, 0.1), (0.9, 0.4)))
# without a point within a run, at which steps end: such steps are not taken strip by strip
SLOW = Table("linear", ((0.0, 0.2), (9.0, 1.0)))
RISING = Table("linear", ((0.0, 0.2), (0.4, 1.0), (0.9, -0.5)))


def coupling(weights, neighbour, centre=None, function=RAMP, **more):
    return NonlinearCoupling(weights, function, neighbour, centre, **more)


def nonlinear(rng, pairs, radius=1, function=RAMP):
    """Return one coupling for each (neighbour, centre), some with a factor or the other sign."""
    k = 2 * radius + 1
    found = []
    for n, (neighbour, centre) in enumerate(pairs):
        weights = rng.normal(size=(k, k)) * (0.3 / k)
        weights[rng.uniform(size=(k, k)) < 0.3] = 0.0
        flags = {"times_argument": n % 3 == 1, "reversed_sign": n % 2 == 1 and centre is not None}
        found.append(coupling(weights, neighbour, centre, function, **flags))
    return {"nonlinear": found}


def delayed(rng, delay, feedback=True, control=True, layers=1):
    """Return couplings that come a delay after the others."""
    weights = rng.normal(size=(layers, layers, 3, 3)) * 0.05, rng.normal(size=(layers, 1, 3, 3))
    used = (part * wanted for part, wanted in zip(weights, (feedback, control), strict=True))
    return {"delayed": DelayedCoupling(delay, *used)}


STATES = (("x", "x"), ("u", "x"), ("y", "u"), ("y", "y"))
CASES = {
    # couplings, boundary, boundary of inputs, output, method, dt, steps, shape, whether a mask
    # holds some cells
    "states": (lambda r: nonlinear(r, STATES), 0.3, "zero-flux", "standard", "euler", 0.1, 11,
               (47, 33), True),
    "states of two rows": (lambda r: nonlinear(r, STATES[:2], 2), "zero-flux", 0.2, "tanh", "heun",
                           0.1, 9, (58, 40), False),
    "states beyond": (lambda r: nonlinear(r, STATES), "periodic", "periodic", "standard", "rk4",
                      0.1, 5, (70, 29), True),
    "limited states": (lambda r: nonlinear(r, STATES[:3]), 1.5, 0.0, "full-range", "euler", 0.1,
                       20, (90, 21), False),
    "outputs": (lambda r: nonlinear(r, (("y", None), ("u", "y")), 1, STEPS), "zero-flux",
                "periodic", "standard", "euler", 0.1, 12, (44, 61), False),
    "gains": (lambda r: {"gains": [Gain(0, 0, SLOW)]}, 0.3, 0.0, "standard", "rk4", 0.1, 9,
              (50, 33), True),
    "late outputs": (lambda r: delayed(r, 0.3, control=False), "zero-flux", 0.0, "standard",
                     "euler", 0.05, 40, (64, 33), True),
    "late outputs, uneven": (lambda r: delayed(r, 0.3), 0.3, 0.1, "standard", "euler", 0.05, 20.4,
                             (41, 50), False),
    "late stages": (lambda r: delayed(r, 0.15), "periodic", "zero-flux", "tanh", "heun", 0.05, 17,
                    (93, 27), True),
    "late stages, uneven": (lambda r: delayed(r, 0.05), 0.3, 0.0, "full-range", "heun", 0.05, 12.3,
                            (60, 37), False),
    "late inputs": (lambda r: delayed(r, 0.4, feedback=False), "periodic", 0.2, "standard", "heun",
                    0.1, 9, (52, 33), False),
    "all": (lambda r: delayed(r, 0.3) | nonlinear(r, STATES) | {"gains": [Gain(0, 0, RISING)]},
            0.2, "periodic", "standard", "heun", 0.05, 15.5, (66, 35), True),
}  # fmt: skip


def template_of(rng, parts, boundary, edge, output, layers=1):
    radius = max([c.weights.shape[0] // 2 for c in parts.get("nonlinear", [])], default=1)
    k = 2 * radius + 1
    return Template(
        "coupled", rng.normal(size=(layers, layers, k, k)) * (0.3 / k / layers),
        rng.normal(size=(layers, 1, 3, 3)) * 0.3, 0.1, tau=1.3 + 0.4 * np.arange(layers),
        boundary=boundary, input_boundary=edge, output=output, **parts,
    )  # fmt: skip


def run_both(states_of, rng, template, shape, spec, masked=False, batch=1):
    """Return the figures of OpenCL and the reference, and all states; strips must have been.

    A frame alone is parted among all cores.
    """
    names = [f"x{layer}" for layer in range(template.layers)]
    figures = ("steps", "time", "settled")
    states = states_of(template, spec, figures, above=0.8 if masked else None)
    channels = ("u", "m", "before", *names)
    frames = rng.uniform(-1, 1, (batch, *shape, len(channels)))
    frames[..., 3:] *= np.linspace(1.0, 0.1, batch)[:, None, None, None]
    plan = Engine("opencl", precision="float64").compile(states, shape, channels=channels)
    got = plan(frames)
    assert "void advance_0(" in plan.source
    wanted = Engine("reference").compile(states, shape, channels=channels)(frames)
    both = (np.stack([found[each] for each in names]) for found in (got, wanted))
    return got, wanted, *both


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", CASES)
def test_couplings_of_strips_are_those_of_one_array(name, states_of, monkeypatch):
    """In strips that work items share, and a third of them in one work item a frame."""
    number = list(CASES).index(name)
    if number % 3:
        monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    rng = np.random.default_rng(number)
    couplings, boundary, edge, output, method, dt, steps, shape, masked = CASES[name]
    template = template_of(rng, couplings(rng), boundary, edge, output)
    spec = RunSpec(duration=steps * dt, dt=dt, method=method)
    batch = 1 if number % 3 else 2
    got, wanted, state, expected = run_both(states_of, rng, template, shape, spec, masked, batch)
    # some tens of evaluations of values of order 1; steps of a table are met or missed alike
    assert np.abs(state - expected).max() <= 1e-13 * np.abs(expected).max()
    np.testing.assert_array_equal(got["steps"], wanted["steps"])


LAYERS = {
    # from layer 1 to layer 0 and back, by inputs, by past outputs, and by gains that change in time
    "heun": lambda rng: {
        "nonlinear": [
            coupling(rng.normal(size=(3, 3)) * 0.1, "x", "x", source=1, centre_source=0),
            coupling(rng.normal(size=(3, 3)) * 0.1, "u", "x", STEPS, to=1, centre_source=1),
        ],
        "gains": [Gain(1, 0, RISING), Gain(0, 0, RAMP)],
        **delayed(rng, 0.2, layers=2),
    },
    "bogacki-shampine": lambda rng: {
        "nonlinear": [coupling(rng.normal(size=(3, 3)) * 0.1, "x", "y", to=1, source=1)],
        "gains": [Gain(0, 1, SLOW), Gain(0, 0, SLOW)],
    },
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", LAYERS)
def test_layers_are_coupled_in_strips(method, states_of, monkeypatch):
    """Steps of a pair follow from its error: they are the reference's, and so is the time."""
    monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    rng = np.random.default_rng(50)
    template = template_of(rng, LAYERS[method](rng), "periodic", 0.3, "standard", layers=2)
    dt = 0.1 if template.delayed is not None else None
    spec = RunSpec(duration=1.04, dt=dt, method=method, rtol=1e-3)
    got, wanted, state, expected = run_both(states_of, rng, template, (60, 35), spec, masked=True)
    np.testing.assert_array_equal(got["steps"], wanted["steps"])
    # a step's length follows from roundings of its error, 1e-16 of numbers of order 1
    assert np.abs(state - expected).max() <= 1e-11 * np.abs(expected).max()


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("feedback", "batch"), [(True, 1), (True, 3), (False, 2)])
def test_delays_end_with_the_step_that_sees_no_change(feedback, batch, states_of, monkeypatch):
    """Launches end amid the steps, and are taken again: the outputs a delay ago are still there."""
    monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    rng = np.random.default_rng(60)
    parts = delayed(rng, 0.5, feedback=feedback)
    template = template_of(rng, parts, "zero-flux", 0.0, "standard")
    for method in ("euler", "heun"):
        spec = RunSpec(duration="settle", dt=0.1, method=method, rtol=1e-3, atol=1e-3)
        got, wanted, state, expected = run_both(
            states_of, rng, template, (60, 35), spec, batch=batch
        )
        np.testing.assert_array_equal(got["steps"], wanted["steps"])
        assert got["settled"].all()
        assert len(set(got["steps"].tolist())) >= min(batch, 2)
        np.testing.assert_allclose(got["time"], wanted["time"], rtol=1e-13)
        assert np.abs(state - expected).max() <= 1e-13 * np.abs(expected).max()
