"""Gradients by the adjoint: against closed forms, differences, and JAX where it is installed."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
from own_process import in_own_process, jax_gradients

from cnnum import Engine, Template, get_template
from cnnum.design.learning import adjoint
from cnnum.errors import TemplateError

SHAPE = (5, 6)


def drawn(seed, *, layers=1, inputs=1, output="tanh", boundary="periodic", tau=1.3, size=3):
    rng = np.random.default_rng(seed)
    template = Template(
        "drawn",
        rng.normal(size=(layers, layers, 3, 3)) * 0.4,
        rng.normal(size=(layers, inputs, size, size)) if inputs else None,
        rng.normal(size=layers).tolist(),
        tau=(tau + 0.3 * np.arange(layers)).tolist(),
        boundary=boundary,
        output=output,
        duration=2.0,
    )
    several = (lambda n: ()) if layers == 1 else (lambda n: (n,))
    maps = {"state": rng.normal(size=(3, *several(layers), *SHAPE))}
    if inputs:
        own = () if inputs == 1 else (inputs,)
        maps["input"] = rng.normal(size=(3, *own, *SHAPE))
    return template, maps, rng.normal(size=maps["state"].shape)


CASES = {
    "tanh": {},
    "constant rim": {"boundary": 0.7},
    "zero-flux": {"boundary": "zero-flux"},
    "standard": {"output": "standard"},
    "no input": {"inputs": 0},
    "a control wider than the feedback": {"size": 5, "boundary": "zero-flux"},
    "two layers, two inputs": {"layers": 2, "inputs": 2},
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", ["euler", "heun", "rk4"])
@pytest.mark.parametrize("case", CASES)
def test_gradients_are_those_of_differences(case, method):
    template, maps, weights = drawn(3, **CASES[case])
    options = {"step": 0.25, "method": method}
    made = adjoint(template, **maps, **options).pull(weights)
    rng = np.random.default_rng(0)

    def loss(template, maps):
        return float((adjoint(template, **maps, **options).output * weights).sum())

    for part in ("A", "B", "z", "tau"):
        array, found = getattr(template, part), getattr(made, part)
        if not array.size:
            continue
        way = rng.normal(size=array.shape)
        ends = []
        for h in (1e-5, -1e-5):
            moved = array + h * way
            given = moved if part in "AB" else moved.tolist()
            ends.append(loss(replace(template, **{part: given}), maps))
        # central differences: h² of the third derivative, and roundings over h
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx((found * way).sum(), rel=2e-6, abs=1e-7)
    way = rng.normal(size=weights.shape)
    ends = [loss(template, maps | {"state": maps["state"] + h * way}) for h in (1e-5, -1e-5)]
    assert (ends[0] - ends[1]) / 2e-5 == pytest.approx((made.state * way).sum(), rel=2e-6, abs=1e-7)


@pytest.mark.parametrize("case", CASES)
def test_the_run_is_that_of_the_engine(case):
    template, maps, _ = drawn(5, **CASES[case])
    ours = adjoint(template, **maps, step=0.02)
    result = Engine("reference").run(template, **maps, rtol=1e-9, atol=1e-9)
    # a step across a bend of the standard output is of second order: h² times a jump of rates
    assert ours.state == pytest.approx(result.state, abs=2e-4 if case == "standard" else 1e-7)


def test_a_decay_has_the_gradients_of_its_closed_form():
    """Of x' = −x/τ + z/τ: ∂x/∂z = 1 − exp(−T/τ), ∂x/∂x₀ = exp(−T/τ), ∂x/∂τ = (x₀ − z) T/τ² exp."""
    template = Template("decay", [[0.0]], z=0.3, tau=2.0, output="linear", duration=3.0)
    run = adjoint(template, state=np.full((1, 1), 1.5))
    result = Engine("reference").run(template, state=np.full((1, 1), 1.5))
    assert run.output == pytest.approx(result.output, abs=1e-8)
    found, time = run.pull(np.ones((1, 1))), 3.0
    left = np.exp(-time / 2.0)
    assert found.z[0] == pytest.approx(1.0 - left, abs=1e-8)
    assert found.state[0, 0] == pytest.approx(left, abs=1e-8)
    assert found.tau[0] == pytest.approx(1.2 * time / 4.0 * left, abs=1e-8)


def test_gradients_are_those_of_jax():
    if importlib.util.find_spec("jax") is None:
        pytest.skip("the extra 'autodiff' is not installed")
    template, maps, weights = drawn(7)
    run = adjoint(template, **maps, step=0.5, method="euler")
    numbers = (template.A[0, 0], template.B[0, 0], template.z[0], template.tau[0], maps["state"])
    theirs = in_own_process(jax_gradients, numbers, maps["input"], weights, run.times)
    ours = run.pull(weights)
    for one, other in zip(theirs, (ours.A, ours.B, ours.z, ours.tau, ours.state), strict=True):
        # both are exact but for the order of their sums
        assert np.asarray(one) == pytest.approx(np.asarray(other).reshape(one.shape), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "words"),
    [("HOLE", "needs a duration"), ("CORNER", "needs a state|needs an input"), ("MAXLOC", "no gr")],
)
def test_templates_without_a_gradient_are_refused(name, words):
    with pytest.raises(TemplateError, match=words):
        adjoint(get_template(name))
