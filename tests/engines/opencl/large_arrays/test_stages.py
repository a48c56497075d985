"""Steps of several stages on large arrays, strip by strip, are the reference's own steps."""

import numpy as np
import pytest

from cnnum import program, transient
from cnnum.engine import Engine
from cnnum.engines.opencl.lowering import kernel_source
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.exponential import EXPONENTIAL_METHODS, fixed_step
from cnnum.integrators.schemes import FixedSteps, stages_of
from cnnum.integrators.tableau import TABLEAUX
from cnnum.templating.template import Template

REFERENCE = Engine("reference")
METHODS = [*TABLEAUX, *EXPONENTIAL_METHODS]
BOUNDARIES = (0.3, "zero-flux", "periodic")
SEVERAL = [name for name in METHODS if name != "euler"]
PAIRS = [name for name, tableau in TABLEAUX.items() if tableau.adaptive]
OUTPUTS = ("standard", "linear", "full-range", "tanh")

STEP = 0.05


def random_template(rng, boundary, output, radius=1, equal=False, control=True):
    k = 2 * radius + 1
    feedback = rng.normal(size=(k, k)) * (0.3 / k)
    return Template(
        "random", 0.5 * (feedback + feedback[::-1]) if equal else feedback,
        rng.normal(size=(3, 3)) * control, 0.1, tau=0.7, boundary=boundary, output=output,
    )  # fmt: skip


def all_methods(methods, templates, steps):
    """Return a program that takes `steps` steps with all methods, of a template each."""

    @program
    def each(frame):
        found = {}
        for method, template in zip(methods, templates, strict=True):
            spec = RunSpec(duration=STEP * steps, method=method, dt=STEP)
            maps = {"input": frame.channel("u"), "state": frame.channel("x")}
            found[method] = transient(template, **maps, spec=spec).states[0]
        return found

    return each


def off_by(engine, each, maps):
    """Return how far states are from the reference's, of the largest of these, by method."""
    shape, channels = maps.shape[-3:-1], ("u", "x")
    plan = engine.compile(each, shape, channels=channels)
    got, wanted = plan(maps), REFERENCE.compile(each, shape, channels=channels)(maps)
    assert all(f"void advance_{n}(" in plan.source for n in range(len(wanted)))
    return {m: np.abs(got[m] - wanted[m]) / np.abs(wanted[m]).max() for m in wanted}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("seed", range(3))
def test_stages_of_strips_are_those_of_one_array(seed, monkeypatch):
    """Every method meets every boundary and three outputs, in strips high or low.

    Weights are equal or not, the drive is an input's or z alone, and launches end amid a step.
    """
    monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    monkeypatch.setattr(kernel_source, "PRIVATE_CELLS", 0)
    rng = np.random.default_rng(seed)
    batch, radius, steps = ((1, 1, 5), (2, 1, 7), (1, 2, 11))[seed]
    shape = tuple(int(2 * rng.integers(10 * radius, most) + 1) for most in (100, 50))
    templates = [
        random_template(
            rng, BOUNDARIES[(n + seed) % 3], OUTPUTS[(n + seed) % 4], radius,
            equal=(n + seed) % 2 == 0, control=(n + seed) % 4 > 0,
        )
        for n in range(len(SEVERAL))
    ]  # fmt: skip
    maps = rng.uniform(-1, 1, (batch, *shape, 2))
    found = off_by(
        Engine("opencl", precision="float64"), all_methods(SEVERAL, templates, steps), maps
    )
    # up to 11 steps of at most 6 stages, of values of order 1
    assert {m: off.max() for m, off in found.items() if off.max() > 1e-13} == {}


def test_stages_of_arrays_beyond_one_work_item():
    """The narrowest rows that several work items share, in single precision."""
    rng = np.random.default_rng(3)
    methods = ("heun", "rk4", "etd-rk2")
    templates = [random_template(rng, boundary, "standard") for boundary in BOUNDARIES]
    maps = rng.uniform(-1, 1, (257, 256, 2)).astype(np.float32)
    found = off_by(Engine("opencl", precision="float32"), all_methods(methods, templates, 33), maps)
    # 33 steps of values of order 1 in single precision
    assert {m: off.max() for m, off in found.items() if off.max() > 1e-5} == {}


@pytest.mark.one_in(3)
@pytest.mark.parametrize("method", PAIRS)
@pytest.mark.parametrize("seed", range(3))
def test_pairs_step_strips_as_one_array(seed, method, monkeypatch):
    """Every boundary; frames of a batch end after steps of their own number.

    Some steps are refused; some rows have lanes without a cell, of which nothing may be judged.
    """
    if seed:
        monkeypatch.setattr(kernel_source, "WHOLE_CELLS", 0)
    rng = np.random.default_rng(20 + seed)
    template = random_template(rng, BOUNDARIES[seed], OUTPUTS[seed], 1 + seed % 2)
    maps = {name: rng.uniform(-1, 1, (3, 48 + seed, 51 + seed)) for name in ("input", "state")}
    maps["input"] *= np.array([0.1, 1.0, 4.0])[:, None, None]
    engine = Engine("opencl", precision="float64")
    for duration in (1.0,) if seed else (1.0, "settle"):
        settings = {"method": method, "duration": duration, "rtol": 1e-3}
        got, wanted = (one.run(template, **settings, **maps) for one in (engine, REFERENCE))
        np.testing.assert_array_equal(got.steps, wanted.steps)
        np.testing.assert_array_equal(got.settled, wanted.settled)
        assert len(set(got.steps.tolist())) > 1
        # a step's length follows from roundings of its error, 1e-16 of numbers of order 1
        np.testing.assert_allclose(got.time, wanted.time, rtol=1e-9)
        np.testing.assert_allclose(got.error, wanted.error, rtol=1e-6)
        assert np.abs(got.state - wanted.state).max() <= 1e-11 * np.abs(wanted.state).max()


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", METHODS)
def test_stages_of_a_linear_cell_are_the_methods_growth(method):
    """Of x' = −x/τ + w a step makes the method's own R(−h/τ) of the distance to w τ.

    The stages are worked out with numbers in place of arrays.
    """
    tau, drive, x = 0.7, 0.4, 2.0
    if method in EXPONENTIAL_METHODS:
        tableau = fixed_step(EXPONENTIAL_METHODS[method], STEP, tau)
        growth = np.exp(-STEP / tau)
    else:
        tableau = TABLEAUX[method]
        growth = TABLEAUX[method].growth(np.array([-STEP / tau + 0j]))[0].real
    scheme = FixedSteps((tableau,), STEP, 1, settle=False, last=STEP)
    stages = stages_of(scheme, 0, tau)
    places = [x] + [np.nan] * (stages.arrays - 1)
    for stage in stages.stages:
        d = stages.scale * (drive - places[stage.state])
        for one in stage.sums:
            places[one.place] = sum(f * places[at] for at, f in one.terms) + one.factor * d
    # a few roundings of numbers of order 1
    assert abs(places[0] - drive - growth * (x - drive)) <= 1e-15 * 8


def test_arrays_are_as_few_as_the_method_needs():
    """Heun: a stage's state and the sum; RK4: the state before too; Euler's states stay."""
    needed = {"euler": 1, "heun": 2, "rk4": 3, "bogacki-shampine": 3, "dormand-prince": 6}
    for name, arrays in needed.items():
        scheme = FixedSteps((TABLEAUX[name],), STEP, 1, settle=False, last=STEP)
        assert stages_of(scheme, 0, 1.0).arrays == arrays


def test_stages_that_nothing_needs_are_left_out():
    """The last stage of a pair is the first of its next step: alone it changes nothing."""
    for name, count in {"heun": 2, "rk4": 4, "bogacki-shampine": 3, "dormand-prince": 6}.items():
        scheme = FixedSteps((TABLEAUX[name],), STEP, 1, settle=False, last=STEP)
        assert len(stages_of(scheme, 0, 1.0).stages) == count
