"""As `docs/adding.md` says: new parts are records, and every engine runs them as they are."""

from fractions import Fraction

import numpy as np
import pytest

from cnnum.errors import NotSupportedError, TemplateError
from cnnum.integrators import choice, schemes, stability
from cnnum.integrators.tableau import ButcherTableau
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.files import save_template
from cnnum.templating.functions import OutputFunction, PairFunction
from cnnum.templating.numbers import numbers_of
from cnnum.templating.template import Template

ENGINES = ["opencl-float64", "numba-float64", "reference"]


def algebraic(x):
    return x / (1.0 + np.abs(x))


def bump(x):
    return np.where(x > 0.5, np.exp(-x), 2.0 * np.clip(x, -0.25, 0.75))


OUTPUTS = {
    # f and its expression, between them every kind of operation, and the slopes of f
    "algebraic": OutputFunction(
        "algebraic", algebraic, "x / (ONE + fabs(x))", slope=(0.0, 1.0), smooth=True
    ),
    "bump": OutputFunction(
        "bump", bump, "PICK(x > 0.5f, exp(-x), R(2) * clamp(x, -0.25, 0.75))", slope=(-1.0, 2.0)
    ),
}


def template(**parts):
    rng = np.random.default_rng(5)
    feedback = rng.normal(size=(2, 2, 3, 3))
    feedback *= 0.4 / np.abs(feedback).sum(axis=(1, 2, 3)).max()
    settings = {"tau": [0.7, 1.3], "boundary": 0.3, "duration": 1.0, "initial": 0.0}
    return Template("own", feedback, rng.normal(size=(2, 1, 3, 3)), 0.1, **settings | parts)


@pytest.mark.parametrize("label", ENGINES)
@pytest.mark.parametrize("name", OUTPUTS)
@pytest.mark.parametrize("shape", [(6, 7), (20, 33)])
def test_an_output_function_is_one_record(engines, label, name, shape):
    """Of few cells and of many; 100 of Euler's steps, of numbers of order 1 in float64."""
    output, u = OUTPUTS[name], np.random.default_rng(6).uniform(-2, 2, shape)
    got = engines[label].run(template(output=output), input=u, method="euler", dt=0.01)
    wanted = engines["reference"].run(template(output=output), input=u, method="euler", dt=0.01)
    assert np.abs(got.state - wanted.state).max() <= 1e-12
    assert np.abs(got.output - output.numpy(got.state)).max() <= 1e-14


def test_bounds_go_by_the_slopes_of_an_output_function():
    """A cell of weight a and slope d has the rate a d − 1: twice the slope, half the weight."""
    steep = OutputFunction("steep", lambda x: 2.0 * x, "R(2) * x", slope=(2.0, 2.0))
    own = [Template("own", [[a]], output=f) for a, f in ((-3.0, steep), (-6.0, "linear"))]
    one, other = (stability.stability_bound(each, (4, 4), "euler").step for each in own)
    assert one == pytest.approx(2.0 / 7.0) == pytest.approx(other)


class ForwardMidpoint:
    """An integrator that is none of the package: the midpoint rule, by sums of rates."""

    name, order = "forward-midpoint", 2

    def fixed(self, steps, tau):
        a, b = [[0.0, 0.0], [0.5, 0.0]], [0.0, 1.0]
        ones = np.ones(len(steps))
        return np.multiply.outer(ones, a), np.multiply.outer(ones, b), 0.0 * ones

    def followed(self, steps, tau):
        a, part = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 1.0, 0.0]], [-1.0, 1.0, 0.0]
        ones = np.ones(len(steps))
        return np.multiply.outer(ones, a), np.multiply.outer(ones, part)

    def growth(self, steps, values):
        z = steps[:, np.newaxis] * values
        return 1.0 + z + 0.5 * z * z


@pytest.mark.parametrize("label", ENGINES)
@pytest.mark.parametrize("shape", [(6, 7), (20, 33)])
def test_an_integrator_is_one_file_and_a_line(engines, label, shape, monkeypatch):
    """It is registered by its name; a tenth of the step leaves a hundredth of the error."""
    method = ForwardMidpoint()
    monkeypatch.setitem(schemes.LAYER_METHODS, method.name, method)
    u = np.random.default_rng(7).uniform(-1, 1, shape)
    # no cell saturates, so that nothing bends
    own = template(output="linear")
    known = engines["reference"].run(own, input=u).state
    errors = [
        np.abs(engines[label].run(own, input=u, method=method.name, dt=dt).state - known).max()
        for dt in (0.1, 0.01)
    ]
    assert 80.0 <= errors[0] / errors[1] <= 125.0
    how = {"input": u, "method": method.name, "dt": 0.1, "estimate": True}
    followed = engines[label].run(own, **how)
    assert errors[0] <= float(np.max(followed.error)) < 1.0
    passed = engines[label].run(own, **how, at=[0.25, 1.0])
    amid = engines["reference"].run(own, input=u, duration=0.25).state
    assert np.abs(passed.state[0] - amid).max() <= float(np.max(passed.error[0])) < 1.0


@pytest.mark.parametrize("label", ENGINES)
def test_a_runge_kutta_method_is_one_record(engines, label, monkeypatch):
    """Ralston's method of third order: half of the step leaves an eighth of the error."""
    rows = ((), (Fraction(1, 2),), (Fraction(0), Fraction(3, 4)))
    ralston = ButcherTableau("ralston", rows, (Fraction(2, 9), Fraction(1, 3), Fraction(4, 9)), 3)
    monkeypatch.setitem(choice.TABLEAUX, "ralston", ralston)
    u, own = np.random.default_rng(8).uniform(-1, 1, (5, 6)), template(output="tanh")
    known = engines["reference"].run(own, input=u).state
    errors = [
        np.abs(engines[label].run(own, input=u, method="ralston", dt=dt).state - known).max()
        for dt in (0.1, 0.05)
    ]
    assert 6.5 <= errors[0] / errors[1] <= 9.5


SHUNT = PairFunction("shunt", lambda c, n: c * n, "c * n", slope=4.0)
"""A shunting synapse: a neighbour's output is a conductance, and the state what it acts on."""

BELOW = PairFunction(
    "below", lambda c, n: np.where(n > c, np.exp(-n * n), c), "PICK(n > c, exp(-n * n), c)", 2.0
)
WEIGHTS = np.random.default_rng(9).normal(size=(2, 3, 3)) * 0.1


def coupled():
    """Two couplings that move, one of inputs alone, and linear ones."""
    return Template(
        "own", [[0.3]], [[1.0]], 0.1, boundary=0.2, input_boundary=-0.5, initial=0.0, duration=1.0,
        nonlinear=[
            NonlinearCoupling(WEIGHTS[0], SHUNT, "y", "x"),
            NonlinearCoupling(WEIGHTS[1], BELOW, "x", "u"),
            NonlinearCoupling(WEIGHTS[0], BELOW, "u", "u"),
        ],
    )  # fmt: skip


def euler(u, dt, steps):
    """Euler's steps of those cells as their definition says: no engine has a part in it."""
    x = np.zeros_like(u)
    for _ in range(steps):
        y = np.clip(x, -1.0, 1.0)
        rate = -x + 0.3 * y + u + 0.1
        for row, col in np.ndindex(3, 3):
            near = np.s_[row : row + u.shape[0], col : col + u.shape[1]]
            xn, yn = (np.pad(v, 1, constant_values=0.2)[near] for v in (x, y))
            un = np.pad(u, 1, constant_values=-0.5)[near]
            rate += WEIGHTS[0, row, col] * x * yn
            rate += WEIGHTS[1, row, col] * np.where(xn > u, np.exp(-xn * xn), u)
            rate += WEIGHTS[0, row, col] * np.where(un > u, np.exp(-un * un), u)
        x = x + dt * rate
    return x


@pytest.mark.parametrize("label", ENGINES)
@pytest.mark.parametrize("shape", [(6, 7), (20, 33)])
def test_a_coupling_kind_is_one_record(engines, label, shape):
    """50 of Euler's steps in float64, of numbers of order 1."""
    u = np.random.default_rng(10).uniform(-1, 1, shape)
    got = engines[label].run(coupled(), input=u, method="euler", dt=0.02)
    assert np.abs(got.state - euler(u, 0.02, 50)).max() <= 1e-12


@pytest.mark.parametrize("name", ["own.toml", "own.tem", "own.m"])
def test_a_coupling_kind_of_ones_own_bounds_steps_and_stays_in_python(tmp_path, name):
    """A slope of 4 and weights of 1 leave less than half of the step of a cell alone."""
    alone = Template("own", [[0.0]])
    own = Template("own", [[0.0]], nonlinear=[NonlinearCoupling([[1.0]], SHUNT, "y", "x")])
    bounds = [stability.stability_bound(each, (4, 4), "euler").step for each in (alone, own)]
    assert bounds[1] < 0.5 * bounds[0]
    assert "coupling 1" in numbers_of(own)
    assert "table 1" not in numbers_of(own)
    with pytest.raises(NotSupportedError, match=r"is not a table|centre less neighbour"):
        save_template(own, tmp_path / name)
    assert not list(tmp_path.iterdir())
    with pytest.raises(TemplateError, match="give the coupling a centre"):
        NonlinearCoupling([[1.0]], SHUNT, "y")
    with pytest.raises(TemplateError, match="must be one expression of c, n"):
        PairFunction("one", np.multiply, "c + 1", 1.0)
