"""The analysis before a run, against eigenvalues of dense matrices and runs of the arrays."""

import math
from dataclasses import replace

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError, ProgramError, TemplateError, UnknownNameError
from cnnum.integrators.stability import METHODS
from cnnum.templating.functions import OutputFunction
from cnnum.templating.network import Network
from cnnum.templating.stability_class import stability_class

SHAPE = (5, 6)
EVEN = [[0.0, 0.2, 0.0], [0.3, -0.4, 0.3], [0.0, 0.2, 0.0]]
SKEW = [[0.0, 0.0, 0.0], [0.8, 0.5, -0.8], [0.0, 0.0, 0.0]]


@pytest.mark.parametrize("output", ["linear", "standard"])
@pytest.mark.parametrize("kernel", [EVEN, SKEW], ids=["even", "skew"])
@pytest.mark.parametrize("boundary", [0.0, "zero-flux", "periodic"])
def test_figures_are_those_of_the_dense_matrix(kernel, boundary, output):
    template = cnnum.Template("mine", kernel, boundary=boundary, output=output)
    found = cnnum.analyse(template, SHAPE)
    matrix = Network(template, SHAPE).linear_system().matrix
    values = np.linalg.eigvals(matrix)
    decays = -values.real[values.real < -1e-9]
    assert found.slowest == pytest.approx(decays.min())
    assert found.stiffness == pytest.approx(decays.max() / decays.min())
    assert found.growth == pytest.approx(max(0.0, values.real.max()), abs=1e-12)
    assert found.turning == pytest.approx(np.abs(values.imag).max(), abs=1e-12)
    assert found.condition == pytest.approx(np.linalg.cond(matrix))
    assert found.fastest >= np.abs(values).max() * (1.0 - 1e-12)
    assert found.exact == (output == "linear")
    assert tuple(found.bounds) == METHODS


def test_no_state_is_larger_than_the_bound():
    rng = np.random.default_rng(0)
    for _ in range(5):
        A, B = rng.normal(size=(2, 3, 3))
        template = cnnum.Template("mine", A, B, float(rng.normal()), duration=6.0)
        input, state = rng.uniform(-1.0, 1.0, (2, 4, *SHAPE))
        found = cnnum.Engine("numba").run(template, input=input, state=state)
        assert np.abs(found.state).max() <= cnnum.analyse(template, SHAPE).largest
    linear = cnnum.Template("mine", EVEN, output="linear")
    assert math.isinf(cnnum.analyse(linear, SHAPE).largest)


def test_a_linear_array_that_grows_is_of_no_class():
    """Energies of symmetric arrays, and cells that end black or white, need a bounded output."""
    for kernel in ([[2.0]], [[0, 1, 0], [1, 2, 1], [0, 1, 0]], [[0, 0, 0], [2, 1, 0], [0, 0, 0]]):
        grows = cnnum.Template("grows", kernel, output="linear", duration=5.0)
        assert stability_class(grows).name == "unknown"
        assert cnnum.analyse(grows, SHAPE).growth >= 0.0


def test_a_mirror_makes_a_slanting_coupling_one_sided():
    """Along a diagonal A is its own mirror image; at a rim of zero flux its matrix is not."""
    slanting = np.diag([0.5, 2.0, 0.5])
    for boundary, kind in ((0.0, "symmetric A"), ("zero-flux", "unknown")):
        template = cnnum.Template("slant", slanting, boundary=boundary, output="tanh")
        matrix = Network(template, SHAPE).linear_system().matrix
        assert np.array_equal(matrix, matrix.T) == (kind == "symmetric A")
        assert stability_class(template, SHAPE).name == kind


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirror_needs_couplings_between_layers_to_be_even_along_both_axes(axis):
    """The transpose of A[0, 1] is A[1, 0] here, and at a rim of zero flux the matrix is uneven."""
    A = np.zeros((2, 2, 3, 3))
    A[[0, 1], [0, 1], 1, 1] = 2.0
    A[0, 1] = np.roll(np.diag([0.0, 1.0, 0.0]), 1, axis)
    A[1, 0] = A[0, 1, ::-1, ::-1]
    template = cnnum.Template("between", A, boundary="zero-flux")
    matrix = Network(template, (4, 4)).linear_system().matrix
    assert not np.array_equal(matrix, matrix.T)
    assert stability_class(template, (4, 4)).name == "unknown"


def own(f, expression, **options):
    return OutputFunction("own", f, expression, **options)


STEEP = own(lambda x: np.tanh(3.0 * x), "tanh(R(3) * x)", smooth=True)
HUMP = own(lambda x: np.exp(-x * x), "exp(-x * x)", slope=(-0.86, 0.86), smooth=True)
WEST = [[0.0, 0.0, 0.0], [-2.0, 1.5, 0.0], [0.0, 0.0, 0.0]]
NORTH = [[0.5, 0.0, -0.5], [0.0, 1.2, 0.0], [0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("template", "shape", "kind"),
    [
        # in a ring a cell acts on itself through the others: this one swings by 6.4 for ever
        (cnnum.Template("t", WEST, boundary="periodic"), (1, 3), "unknown"),
        (cnnum.Template("t", WEST, boundary="zero-flux"), (1, 3), "feed-forward"),
        # mirrored, the two cells north of one are two beside it
        (cnnum.Template("t", NORTH), (4, 4), "feed-forward"),
        (cnnum.Template("t", NORTH, boundary="zero-flux"), (4, 4), "unknown"),
        # at radius 2 a mirror shows the first cell the second
        (cnnum.Template("t", [5 * [0], 5 * [0], [-2, 0, 1.5, 0, 0], 5 * [0], 5 * [0]]),
         (1, 3), "feed-forward"),
        (cnnum.Template("t", [5 * [0], 5 * [0], [-2, 0, 1.5, 0, 0], 5 * [0], 5 * [0]],
                        boundary="zero-flux"), (1, 3), "unknown"),
        # slopes that are not as declared, or not below one over the weights
        (cnnum.Template("t", [[0.9]], output=STEEP), (2, 2), "unknown"),
        (cnnum.Template("t", [[0.9]], output=replace(STEEP, slope=(0.0, 3.0))), (2, 2),
         "symmetric A"),
        (cnnum.Template("t", [[0.3]], output=replace(STEEP, slope=(0.0, 3.0))), (2, 2),
         "contracting"),
        # an output that falls somewhere has no energy that falls
        (cnnum.Template("t", [[0, 0, 0], [2, 0, 2], [0, 0, 0]], output=HUMP), (2, 3), "unknown"),
        (cnnum.Template("t", [[0, 0, 0], [2, 0, 2], [0, 0, 0]], tau=3.0), (2, 3), "symmetric A"),
        # an output that is flat somewhere is beyond the theorem of positive weights
        (cnnum.Template("t", [[0, 1, 0], [0.5, 2, 1], [0, 1, 0]]), (4, 4), "unknown"),
        (cnnum.Template("t", [[0, 1, 0], [0.5, 2, 1], [0, 1, 0]], output="tanh"), (4, 4),
         "positive cell-linking"),
        (cnnum.Template("t", [[0, 1, 0], [1, 2, 0], [0, 1, 0]], output="tanh"), (4, 4), "unknown"),
    ],
)  # fmt: skip
def test_a_theorem_is_named_where_its_conditions_hold(template, shape, kind):
    assert cnnum.analyse(template, shape).kind.name == kind


def test_slopes_that_samples_refute_are_said():
    found = cnnum.analyse(cnnum.Template("t", [[0.9]], output=STEEP))
    assert "declares slopes from 0 to 1, but samples" in found.kind.why
    # −1 + 0.9 · 3, as its samples show it, not −1 + 0.9
    assert found.fastest == pytest.approx(3.7, rel=1e-3)
    assert math.isnan(found.growth)
    broken = own(lambda x: np.where(np.abs(x) < 1.0, x, np.nan), "x")
    with pytest.raises(TemplateError, match="not finite everywhere"):
        cnnum.analyse(cnnum.Template("t", [[0.9]], output=broken))


def test_the_bound_on_states_counts_the_rim_and_the_output():
    """By hand: the sums of weights times the largest output and input that a cell can see."""
    control = [[0.0, 0.0, 0.0], [3.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    template = cnnum.Template("t", [[2.0]], control, 1.0, input_boundary=-7.0)
    assert cnnum.analyse(template).largest == 2.0 + 7.0 * 4.0 + 1.0
    high = own(lambda x: 3.0 + np.tanh(x), "R(3) + tanh(x)", smooth=True)
    found = cnnum.analyse(cnnum.Template("t", [[2.0]], output=high)).largest
    assert 8.0 - 1e-6 < found < 8.1  # it rests at 2 (3 + tanh 8)
    twice = own(lambda x: 2.0 * x, "R(2) * x", slope=(2.0, 2.0))
    assert math.isinf(cnnum.analyse(cnnum.Template("t", [[0.6]], output=twice)).largest)
    assert cnnum.analyse(
        cnnum.Template("t", [[0.4]], z=1.0, output=twice)
    ).largest == pytest.approx(5.0)
    assert cnnum.analyse(cnnum.Template("t", [[0.0]], initial=-9.0)).largest == 9.0


def test_the_condition_is_that_of_the_couplings_whatever_the_time_constants():
    A = [[[[0.5]], [[0.2]]], [[[0.1]], [[0.3]]]]
    slow = cnnum.Template("t", A, tau=[1.0, 100.0], output="linear")
    wanted = np.linalg.cond(np.eye(2) - [[0.5, 0.2], [0.1, 0.3]])
    for shape in ((2, 2), (20, 20)):  # of its matrix, and of its modes
        assert cnnum.analyse(slow, shape).condition == pytest.approx(wanted)


def test_exact_rates_are_the_eigenvalues_and_not_discs():
    template = cnnum.Template("t", SKEW, boundary="zero-flux", output="linear")
    found = cnnum.analyse(template, SHAPE)
    values = np.linalg.eigvals(Network(template, SHAPE).linear_system().matrix)
    assert found.exact
    assert found.fastest == pytest.approx(np.abs(values).max())
    # of more cells nothing is known one by one, and nothing is said
    large = cnnum.analyse(template, (20, 20))
    assert not large.exact
    assert np.isnan([large.growth, large.slowest, large.stiffness]).all()


def test_rates_that_are_not_known_are_not_zero():
    found = cnnum.analyse("HERRING")
    assert np.isnan([found.growth, found.turning, found.slowest, found.condition]).all()


def test_programs_and_templates_of_every_kind():
    names = ("EDGE", "HOLE", "INTERP", "LIFE", "MEDIAN", "DELAYED_WAVE", "HERRING")
    for name in (name for name in names if name in cnnum.template_names()):
        found = cnnum.analyse(name)
        assert found.template == name
        assert found.saturation.endswith(".")
        assert found.reason
    several = cnnum.analyse_program(cnnum.get_program("edges"), (8, 8))
    assert several
    assert len({one.template for one in several}) <= len(several)


def test_it_refuses_what_is_no_template_or_array():
    with pytest.raises(UnknownNameError, match="Unknown template"):
        cnnum.analyse("nope")
    with pytest.raises(TemplateError, match="Expected a template or the name of one, got int"):
        cnnum.analyse(7)
    with pytest.raises(ArrayError):
        cnnum.analyse("EDGE", (0, 8))
    with pytest.raises(ProgramError, match="'program' must be of the type Program"):
        cnnum.analyse_program("edges")


def test_the_condition_of_a_map_is_that_of_its_matrix():
    from cnnum.tactile.inverse import LoadMap

    place = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2) - 1.5
    make = lambda depth, shape: LoadMap(1e-3 * place, shape, 1e-3, depth, 1e6, 1e-4)  # noqa: E731
    thin, thick = make(0.5e-3, (4, 4)), make(2e-3, (4, 4))
    # a deeper taxel sees fine patterns less: by e^{−kz} and more
    assert 1.0 < thin.condition < thick.condition < math.inf
    assert math.isinf(make(1e-3, (6, 6)).condition)  # more tractions than strains
