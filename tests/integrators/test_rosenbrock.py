"""Implicit steps: the conditions of their order, closed forms of stiff arrays, and saddles."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from cnnum.engine import Engine
from cnnum.errors import MethodError
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS, RODAS3
from cnnum.integrators.stability import stability_bound
from cnnum.lab.stability.cases.solving import integrated
from cnnum.templating.couplings import DelayedCoupling
from cnnum.templating.template import Template

REFERENCE = Engine("reference")
SHAPE = (4, 5)


@pytest.mark.parametrize("method", IMPLICIT_METHODS.values(), ids=IMPLICIT_METHODS)
def test_it_damps_all_that_decays(method):
    """|R| ≤ 1 on the imaginary axis, and so on the left half-plane (maximum principle)."""
    axis = 1j * np.concatenate([[0.0], np.geomspace(1e-3, 1e6, 4000)])
    assert np.abs(method.growth(axis)).max() <= 1.0 + 1e-12
    far = -np.geomspace(1e6, 1e12, 7) + 0j
    assert (np.abs(method.growth(far)) < 1e-5).all()
    small = np.array([-1e-2, 1e-2], dtype=complex)
    # R agrees with e^z to its order: the rest is c z⁴ with c = 0.02
    assert np.abs(method.growth(small) - np.exp(small)).max() < 0.1 * 1e-8


@pytest.mark.parametrize(
    "changed",
    [
        {"m": (Fraction(2), Fraction(0), Fraction(1), Fraction(3, 2))},
        {"gamma": Fraction(2, 5)},
        {"a": (*RODAS3.a[:3], (Fraction(2), Fraction(0), Fraction(9, 10)))},
        {"c": (*RODAS3.c[:3], (Fraction(1), Fraction(-1), Fraction(-7, 3)))},
    ],
    ids=["weights", "gamma", "a", "c"],
)
def test_a_wrong_coefficient_is_refused(changed):
    with pytest.raises(ValueError, match=r"does not satisfy the conditions of order|does not damp"):
        replace(RODAS3, **changed)


@pytest.mark.parametrize("name", ["reference", "numba"])
def test_a_linear_array_is_its_exponential(name):
    """The error falls as the tolerance does, and the stated one covers it."""
    A = np.array([[0.2, -0.6], [1.3, -0.4]])[:, :, np.newaxis, np.newaxis]
    template = Template("linear", A, tau=(1.0, 1e-5), output="linear", duration=2.0)
    start = np.stack([np.full((2, 2), 0.4), np.full((2, 2), -0.3)])
    matrix = (template.A[:, :, 0, 0] - np.eye(2)) / np.array([[1.0], [1e-5]])
    truth = expm(2.0 * matrix) @ np.array([0.4, -0.3])
    errors = []
    for tolerance in (1e-3, 1e-6):
        how = {"method": "rodas3", "rtol": tolerance, "atol": tolerance}
        run = Engine(name).run(template, state=start, **how)
        off = np.abs(run.state[:, 0, 0] - truth).max()
        assert off <= run.error
        assert run.method == "rodas3"
        errors.append(off)
    assert errors[0] < 1e-3
    assert errors[1] < 1e-6


@pytest.mark.parametrize("name", ["numba", "opencl"])
@pytest.mark.parametrize("ratio", [1e-6, 1e-8])
def test_auto_takes_implicit_steps_where_explicit_ones_are_too_many(name, ratio):
    """A slow layer that saturates drives a fast one, whose end is known."""
    A = np.zeros((2, 2, 1, 1))
    A[1, 0] = 1.0
    template = Template("chain", A, [[[[1.0]]], [[[0.0]]]], tau=(1.0, ratio), duration=2.0)
    run = Engine(name).run(template, input=np.full(SHAPE, 2.0))
    assert run.method == "rodas3"
    assert "explicit steps would be more than 100,000" in run.reason
    # x₀ = 2 (1 − e⁻²), and the fast layer has long followed y₀ = 1
    truth = np.stack([np.full(SHAPE, 2.0 * (1.0 - np.exp(-2.0))), np.ones(SHAPE)])
    off = np.abs(run.state - truth).max()
    assert off <= run.error
    assert off < 1e-4


@pytest.mark.parametrize("name", ["numba", "opencl"])
def test_symmetric_weights_of_1e5_run(name):
    """They were refused. Radau's method at 1e-10 is the truth, of states of 4e5."""
    rng = np.random.default_rng(1)
    kernel = rng.normal(size=(3, 3))
    kernel = (kernel + kernel[::-1, ::-1]) * 1e5
    start = rng.uniform(-0.5, 0.5, (3, 3))
    template = Template("large", kernel, duration=2.0)
    run = Engine(name).run(template, state=start)
    truth = integrated(kernel[np.newaxis, np.newaxis], 0.0, start[np.newaxis], 2.0)[0]
    off = np.abs(run.state - truth).max()
    assert off <= run.error
    assert off < 1e-3 * np.abs(truth).max()


def test_a_small_growth_next_to_a_fast_decay_is_not_damped():
    """An implicit method would hold the slow layer on its saddle, from which it starts 1e-9 off."""
    A = np.zeros((2, 2, 1, 1))
    A[0, 0], A[1, 0] = 11.0, 1.0
    template = Template("saddle", A, tau=(1.0, 1e-7), duration=1.5, output="linear")
    start = np.stack([np.full(SHAPE, 1e-9), np.zeros(SHAPE)])
    run = REFERENCE.run(template, state=start, method="rodas3")
    grown = 1e-9 * np.exp(10.0 * 1.5)
    # 70 steps of z = 0.22, a fifth of the growth's time constant, are off by 0.02 z⁴ each
    assert abs(run.state[0, 0, 0] / grown - 1.0) < 0.01


def test_held_cells_stay_and_rest_is_found():
    template = Template("rest", [[0, 0.2, 0], [0.2, 0.1, 0.2], [0, 0.2, 0]], [[1.0]], tau=0.5)
    rng = np.random.default_rng(2)
    maps = {"input": rng.uniform(-1, 1, SHAPE), "state": rng.uniform(-1, 1, SHAPE)}
    held = rng.random(SHAPE) < 0.3
    run = REFERENCE.run(template, **maps, mask=held, duration="settle", method="rodas3")
    known = REFERENCE.run(template, **maps, mask=held, duration="settle")
    assert run.settled
    assert np.abs(run.state - known.state).max() <= 1e-3
    assert np.array_equal(run.state[held], maps["state"][held])


def test_its_bound_and_its_refusals():
    plain = Template("plain", [[0.5]], duration=1.0)
    assert stability_bound(plain, SHAPE, "rodas3").step == np.inf
    late = DelayedCoupling(0.5, np.full((1, 1, 1, 1), 0.5), np.zeros((1, 1, 1, 1)))
    given = {"state": np.zeros(SHAPE), "method": "rodas3"}
    seen = given | {"input": np.zeros(SHAPE)}
    for other in (
        Template("limited", [[0.5]], output="full-range", duration=1.0),
        Template("late", [[0.5]], [[1.0]], delayed=late, duration=1.0),
    ):
        assert stability_bound(other, SHAPE, "rodas3").step == 0.0
        with pytest.raises(MethodError, match=r"'rodas3' supports only plain couplings"):
            REFERENCE.run(other, **(seen if other.inputs else given))
    with pytest.raises(MethodError, match=r"'rodas3' chooses its own steps: leave dt out"):
        REFERENCE.run(plain, **given, dt=0.1)
    with pytest.raises(MethodError, match=r"'rodas3' factorises .* up to 20,000 states"):
        REFERENCE.run(plain, state=np.zeros((200, 200)), method="rodas3")


@pytest.mark.filterwarnings("ignore:.*overflow:RuntimeWarning")
@pytest.mark.filterwarnings("ignore:.*invalid value:RuntimeWarning")
def test_a_state_beyond_the_range_of_numbers_is_refused():
    """It is e^{2t}: no step is short enough, and the shortest was a division by zero."""
    template = Template("grows", [[3.0]], output="linear")
    with pytest.raises(MethodError, match="did not reach its end"):
        REFERENCE.run(template, state=[[1.0]], duration=1000.0, method="rodas3")
