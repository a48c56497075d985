"""The analysis before a run, against eigenvalues of dense matrices and runs of the arrays."""

import math

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError, ProgramError, TemplateError, UnknownNameError
from cnnum.integrators.stability import METHODS
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
    for boundary, kind in ((0.0, "symmetric A"), ("zero-flux", "positive cell-linking")):
        template = cnnum.Template("slant", slanting, boundary=boundary)
        matrix = Network(template, SHAPE).linear_system().matrix
        assert np.array_equal(matrix, matrix.T) == (kind == "symmetric A")
        assert stability_class(template).name == kind


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
    with pytest.raises(TemplateError, match="'template' must be of the type Template"):
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
