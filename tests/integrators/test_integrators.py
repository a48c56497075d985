"""Methods as data: their order, their stability, and the bounds that follow for templates."""

import math
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import RK23, RK45
from scipy.linalg import expm

from cnnum.errors import MethodError, UnknownNameError
from cnnum.integrators.choice import FixedSteps
from cnnum.integrators.closed_forms import Spectral, propagator, spectral
from cnnum.integrators.exponential import (
    ETD_RK2,
    EXPONENTIAL_EULER,
    EXPONENTIAL_METHODS,
    followed_step,
    phi,
)
from cnnum.integrators.schemes import ChebyshevSteps
from cnnum.integrators.spectrum import spectrum
from cnnum.integrators.stability import stability_bound
from cnnum.integrators.tableau import (
    BOGACKI_SHAMPINE,
    DORMAND_PRINCE,
    TABLEAUX,
    ButcherTableau,
    chebyshev_method,
    followed,
    stages_for,
)
from cnnum.templating.library import get_template
from cnnum.templating.network import Network
from cnnum.templating.template import Template

EVEN = np.array([[0.02, 0.3, 0.02], [0.1, -1.7, 0.1], [0.02, 0.3, 0.02]])


@pytest.mark.parametrize("stages", [2, 3, 7, 20, 40])
def test_chebyshev_is_of_second_order_and_reaches_far(stages):
    method = chebyshev_method(stages)
    steps = np.array([-0.08, -0.04, -0.02])
    errors = np.abs(method.growth(steps) - np.exp(steps))
    slopes = np.log2(errors[:-1] / errors[1:])
    # a local error of order 3; the next order still shows at these steps
    assert np.all(np.abs(slopes - 3.0) < 0.15)
    assert method.real_stability > 0.65 * (stages**2 - 1)
    beyond = method.growth(-np.linspace(1.0, 1.3, 200) * method.real_stability)
    assert np.abs(beyond).max() > 1.0


def test_stages_are_the_fewest_that_are_stable():
    for reach in (0.5, 3.0, 50.0, 700.0):
        stages = stages_for(reach)
        assert chebyshev_method(stages).real_stability >= reach
        assert stages == 2 or chebyshev_method(stages - 1).real_stability < reach


@pytest.mark.parametrize(("method", "order"), [(EXPONENTIAL_EULER, 1), (ETD_RK2, 2)])
def test_exponential_steps_have_their_order(method, order):
    """x' = −x + a x, one mode: the error of a fixed time falls with the order of the method."""
    mode = np.array([-0.6 + 0.8j])
    errors = []
    for count in (16, 32, 64):
        factor = method.growth(np.array([1.0 / count]), mode)[0, 0] ** count
        errors.append(abs(factor - np.exp(mode[0])))
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(slopes - order) < 0.1)


def test_phi_has_no_cancellation():
    z = np.array([-1e-9, -1e-3, -0.4999, -0.5001, -5.0])
    assert phi(1, z) == pytest.approx([1 - 5e-10, *np.expm1(z[1:]) / z[1:]], rel=1e-13)
    # φ₂ at −10⁻³ by its series: 1/2 + z/6 + z²/24 + z³/120
    assert phi(2, z)[1] == pytest.approx(0.5 - 1e-3 / 6 + 1e-6 / 24 - 1e-9 / 120, rel=1e-14)


@pytest.mark.parametrize("boundary", ["zero-flux", "periodic", 0.0, 0.4])
@pytest.mark.parametrize("duration", [0.7, math.inf])
@pytest.mark.parametrize("layers", [1, 2])
def test_modes_give_what_the_dense_matrix_gives(boundary, duration, layers):
    rng = np.random.default_rng(3)
    feedback = EVEN * rng.uniform(0.2, 0.6, (layers, layers, 1, 1))
    template = Template(
        "even", feedback, None, [0.1] * layers, tau=[0.7, 1.9][:layers],
        boundary=boundary, output="linear",
    )  # fmt: skip
    network = Network(template, (5, 6))
    modes, dense = spectral(network, duration), propagator(network, duration)
    start, drive = rng.normal(size=(2, layers, 5, 6))
    got = modes.reach(start, drive)
    wanted = dense.state @ start.ravel() + dense.drive @ drive.ravel() + dense.constant
    # two ways to add up 60 products of order 1
    assert np.abs(got.ravel() - wanted).max() < 1e-13


def test_modes_are_not_claimed_where_they_are_not():
    lopsided = EVEN.copy()
    lopsided[1, 0] = 0.2
    for template in (
        Template("lopsided", lopsided, output="linear"),
        Template("wide", np.pad(EVEN, 1, constant_values=0.01), boundary=0.0, output="linear"),
    ):
        assert spectral(Network(template, (6, 6)), 1.0) is None


@pytest.mark.parametrize("boundary", ["zero-flux", "periodic", 0.0])
@pytest.mark.parametrize("method", [*TABLEAUX, *EXPONENTIAL_METHODS])
def test_bounds_are_sharp_for_linear_arrays(boundary, method):
    """Just inside the bound the fastest mode dies out, just outside it grows."""
    template = Template("linear", EVEN, boundary=boundary, output="linear")
    bound = stability_bound(template, (6, 7), method)
    assert bound.exact
    matrix = Network(template, (6, 7)).linear_system().matrix
    eigenvalues = np.linalg.eigvals(matrix)
    for factor, stable in ((0.99, True), (1.01, False)):
        growth = np.abs(_growth(method, factor * bound.step, eigenvalues)).max()
        assert (growth <= 1.0 + 1e-9) == stable


def _growth(method, step, values):
    if method in EXPONENTIAL_METHODS:
        return EXPONENTIAL_METHODS[method].growth(np.array([step]), values)[0]
    return TABLEAUX[method].growth(step * values)


def test_turning_modes_have_a_bound_too():
    """x' = −x + (neighbour differences): λ = −1 + 2i sin k; Euler holds where |1 + hλ| ≤ 1."""
    turning = np.array([[0, 0, 0], [1.0, 0, -1.0], [0, 0, 0]])
    template = Template("turning", turning, boundary="periodic", output="linear")
    bound = stability_bound(template, (4, 8), "euler")
    # the worst mode has λ = −1 + 2i: h = 2·1/(1 + 4)
    assert bound.step == pytest.approx(0.4, rel=1e-3)
    assert not spectrum(template, (4, 8)).real


def test_saturating_symmetric_arrays_stay_within_their_linear_bound():
    """Eigenvalues of A D − 1, D any diagonal of 0..1, against the interval that is claimed."""
    template = Template("saturating", EVEN, boundary="zero-flux")
    found = spectrum(template, (5, 5))
    linear = Network(template, (5, 5)).linear_system().matrix + np.eye(25)
    rng = np.random.default_rng(0)
    for _ in range(50):
        jacobian = linear * rng.integers(0, 2, 25) - np.eye(25)
        values = np.linalg.eigvals(jacobian)
        assert values.real.min() >= found.values.real.min() - 1e-12
        assert np.abs(values.imag).max() < 1e-9


def test_unstable_steps_are_refused_unless_forced(solver_for):
    heat = get_template("tactile_diffusion")
    with pytest.raises(MethodError, match="stability bound"):
        solver_for(heat, (8, 8), dt=0.3)
    solver = solver_for(heat, (8, 8), dt=0.3, force=True)
    assert solver.forced
    assert isinstance(solver.scheme, FixedSteps)
    assert "outside" in solver.reason


def test_auto_is_stable_and_says_why(solver_for):
    heat = get_template("tactile_diffusion")
    long = solver_for(heat, (600, 600), duration=30.0)
    assert isinstance(long.scheme, ChebyshevSteps)
    assert "real" in long.reason
    small = solver_for(heat, (8, 8))
    assert isinstance(small.scheme, Spectral)
    assert "modes" in small.reason


def test_chebyshev_is_refused_where_rates_turn(solver_for):
    skew = Template("skew", [[0, 0, 0], [1.0, 0, -1.0], [0, 0, 0]], initial="input")
    with pytest.raises(MethodError, match="real"):
        solver_for(skew, (6, 6), duration=1.0, method="runge-kutta-chebyshev")


def test_unknown_methods_are_named(solver_for):
    with pytest.raises(UnknownNameError, match="etd-rk2"):
        solver_for(get_template("EDGE"), (4, 4), method="leapfrog")
    with pytest.raises(UnknownNameError):
        stability_bound(get_template("EDGE"), (4, 4), "leapfrog")


def test_spectral_solves_the_heat_equation():
    heat = get_template("tactile_diffusion")
    network = Network(heat, (4, 5))
    start = np.random.default_rng(1).normal(size=(1, 4, 5))
    got = spectral(network, 0.8).reach(start, np.zeros_like(start))
    wanted = expm(0.8 * network.linear_system().matrix) @ start.ravel()
    assert np.abs(got.ravel() - wanted).max() < 1e-13


ONE, HALF, QUARTER, SIXTH = (Fraction(1, n) for n in (1, 2, 4, 6))
SSP3 = ButcherTableau(  # Shu & Osher 1988: a method that is not in the house
    "ssp3", ((), (ONE,), (QUARTER, QUARTER)), (SIXTH, SIXTH, 4 * SIXTH), 3
)
METHODS_FOLLOWED = {**TABLEAUX, "ssp3": SSP3}
FOLLOWED = {name: followed(method) for name, method in METHODS_FOLLOWED.items()}
TOLD = {"pair": [BOGACKI_SHAMPINE, DORMAND_PRINCE], "followed": [*FOLLOWED.values()]}


@pytest.mark.parametrize(
    "method",
    [pytest.param(m, id=f"{kind}-{m.name}") for kind, found in TOLD.items() for m in found],
)
def test_truncation_is_the_error_of_a_linear_step(method):
    """A step of x' = λx, taken stage by stage: its parts add up to e^z − R(z)."""
    for z in (-0.02, 0.01 + 0.03j):
        slopes = []
        for row in method.a:
            slopes.append(z * (1 + sum(float(a) * k for a, k in zip(row, slopes, strict=True))))
        step = 1 + sum(float(b) * k for b, k in zip(method.b, slopes, strict=True))
        parts = [
            sum(float(d) * k for d, k in zip(row, slopes, strict=True)) for row in method.truncation
        ]
        # the rest is of the next order; of the difference, 1e-15 is rounding
        left = 1.1 * abs(z) ** (method.order + 2) / math.factorial(method.order + 2)
        assert abs(np.exp(z) - step - sum(parts)) <= left + 1e-15
        assert abs(sum(parts)) > 0


@pytest.mark.parametrize(
    ("method", "least"),
    [
        (BOGACKI_SHAMPINE, 0.37),
        (DORMAND_PRINCE, 0.19),
        (FOLLOWED["euler"], 1.0),
        (FOLLOWED["heun"], 0.66),
        (FOLLOWED["rk4"], 0.4),
        (FOLLOWED["ssp3"], 0.5),
    ],
    ids=lambda it: getattr(it, "name", ""),
)
def test_truncation_sees_corners(method, least):
    """The rate bends at θ: the parts are no less than `least` of the quadrature's error."""
    times = np.array([float(sum(row)) for row in method.a])
    weights = np.array(method.b, dtype=float)
    for theta in np.linspace(0.002, 0.998, 499):
        bent = np.maximum(times - theta, 0.0)
        error = abs(weights @ bent - (1 - theta) ** 2 / 2)
        parts = sum(abs(np.array(row, dtype=float) @ bent) for row in method.truncation)
        assert parts >= least * error


@pytest.mark.parametrize("name", METHODS_FOLLOWED)
def test_followed_steps_are_the_methods_own(name):
    """The same R(z), and no estimate that could refuse a step."""
    steps, z = FOLLOWED[name], np.array([-0.7 + 0.4j, 0.3j, -2.0])
    np.testing.assert_allclose(steps.growth(z), METHODS_FOLLOWED[name].growth(z), rtol=1e-14)
    assert steps.order == METHODS_FOLLOWED[name].order
    assert not any(steps.error)


def test_an_error_of_another_state_than_the_last_stage_is_refused():
    half, one = Fraction(1, 2), Fraction(1)
    with pytest.raises(ValueError, match="is not at the end"):
        ButcherTableau("heun", ((), (one,)), (half, half), 2, error=(half, -half))


@pytest.mark.parametrize("method", [EXPONENTIAL_EULER, ETD_RK2], ids=lambda m: m.name)
@pytest.mark.parametrize("decay", [0.01, 0.1, 1.0, 3.0])
def test_exponential_steps_state_their_error(method, decay):
    """A mode λ = (μ − 1)/τ, stage by stage: the step is the method's, its part e^z − R(z).

    Of short steps to a hundredth; of long ones, while the mode does not grow, to a factor of 3.
    """
    tau = 0.7
    followed = followed_step(method, decay * tau, tau)
    for mode in (-1.3, 0.3j, 0.6, -1.0 + 1.0j):
        z, slopes = decay * (mode - 1.0), []
        for row in followed.a:
            slopes.append(z * (1 + sum(float(a) * k for a, k in zip(row, slopes, strict=True))))
        step = 1 + sum(float(a) * k for a, k in zip(followed.a[-1], slopes, strict=False))
        growth = method.growth(np.array([decay]), np.array([mode - 1.0 + 0j]))[0, 0]
        assert abs(step - growth) <= 1e-13
        (part,) = followed.truncation
        stated = abs(sum(float(d) * k for d, k in zip(part, slopes, strict=True)))
        wanted = abs(np.exp(z) - growth)
        assert stated == pytest.approx(wanted, rel=0.02 if decay == 0.01 else 2.0)
        assert stated >= wanted / 3.0


@pytest.mark.parametrize(
    ("ours", "theirs"), [(BOGACKI_SHAMPINE, RK23), (DORMAND_PRINCE, RK45)], ids=["bs", "dp"]
)
def test_pairs_have_the_published_coefficients(ours, theirs):
    """SciPy typed them in on its own; its error is b̂ − b."""
    stages = [[float(a) for a in row] for row in ours.a[:-1]]
    for row, published in zip(stages, theirs.A, strict=True):
        np.testing.assert_allclose(row, published[: len(row)], rtol=1e-15)
    np.testing.assert_allclose([float(b) for b in ours.b[:-1]], theirs.B, rtol=1e-15)
    signs = 1.0 if float(ours.error[0]) * theirs.E[0] > 0 else -1.0
    np.testing.assert_allclose([signs * float(e) for e in ours.error], theirs.E, rtol=1e-15)
