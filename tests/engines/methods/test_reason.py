"""Every result says why its method was taken, on every engine."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

SPREAD = [[0.0, 0.2, 0.0], [0.2, 0.1, 0.2], [0.0, 0.2, 0.0]]
GROWING = [[0.0, 0.3, 0.0], [0.1, 2.0, -0.1], [0.0, 0.3, 0.0]]
CASES = {
    "decay": (
        Template("d", [[0.0]], [[2.0]], initial=0.5, duration=2.0),
        {},
        "propagator",
        "every cell decays on its own",
    ),
    "linear": (Template("l", SPREAD, initial="input", output="linear"), {}, "propagator", "linear"),
    "near": (
        Template("n", SPREAD, initial="input", duration=2.0),
        {},
        "propagator",
        "no cell leaves the linear range; the array is linear",
    ),
    "grows": (
        Template("g", GROWING, initial="input", duration=2.0),
        {},
        "dormand-prince",
        "evaluations of the rates, against",
    ),
    "asked": (
        Template("a", GROWING, initial="input", duration=2.0),
        {"method": "bogacki-shampine"},
        "bogacki-shampine",
        "steps follow the error estimate",
    ),
    "fixed": (
        Template("f", GROWING, initial="input", duration=2.0),
        {"dt": 0.1},
        "euler",
        "a fixed step was asked for",
    ),
    "forced": (
        Template("f", GROWING, initial="input", duration=4.0),
        {"dt": 2.0, "force": True},
        "euler",
        "outside its stability bound",
    ),
    "jumps": (get_template("MEDIAN"), {}, "euler", "its rates jump"),
}


@pytest.mark.parametrize("name", ["opencl", "numba", "reference"])
@pytest.mark.parametrize("case", CASES)
def test_a_result_says_why(name, case):
    template, how, method, words = CASES[case]
    picture = np.random.default_rng(2).uniform(-1.0, 1.0, (5, 6))
    result = Engine(name).run(template, input=picture, **how)
    assert result.method == method
    assert words in result.reason


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("linear", "solved to 1e-10"),
        ("near", "solved to 1e-10"),
        ("grows", "solved to 1e-10"),
        ("jumps", "in steps 1/4 as long"),
        ("decay", None),
        ("asked", None),
        ("fixed", None),
    ],
)
def test_the_reference_says_what_it_does_instead(case, words):
    """The method is that of other engines; only one that is asked for runs just so here, too."""
    template, how, method, _ = CASES[case]
    picture = np.random.default_rng(2).uniform(-1.0, 1.0, (5, 6))
    engine = Engine("reference")
    result = engine.run(template, input=picture, **how)
    (plan,) = engine._open.plans.values()
    assert result.method == method
    assert plan.explain().transients[0].removesuffix(")").endswith(result.reason[-40:])
    assert (f"; here {words}" in result.reason) if words else ("here" not in result.reason)
    assert "here" not in Engine("numba").run(template, input=picture, **how).reason


def test_a_plan_explains_what_its_result_says():
    template, how, _, _ = CASES["grows"]
    engine = Engine("numba")
    result = engine.run(template, input=np.zeros((5, 6)), **how)
    (plan,) = engine._open.plans.values()
    assert result.reason in plan.explain().transients[0]


@pytest.mark.parametrize("name", ["opencl", "numba", "reference"])
def test_a_forced_step_is_marked(name):
    """Heat cools down, and a step of eight bounds blows it up instead: nothing of it is known."""
    heat, start = get_template("tactile_diffusion"), np.eye(8)
    step = {"method": "euler", "dt": 2.0, "duration": 8.0}
    forced = Engine(name).run(heat, input=start, force=True, **step)
    assert np.isinf(forced.error)
    assert not forced.settled
    assert "outside its stability bound" in forced.reason
    assert np.abs(forced.state).max() > 10.0 * np.abs(start).max()
