"""The equilibrium on a torus, from its waves: against a dense solve of all cells at once."""

import math

import numpy as np
import pytest

from cnnum.integrators.propagator import circulant, propagator
from cnnum.templates.tactile.cover_model.elastic_lattice import ElasticLattice
from cnnum.templating.network import Network
from cnnum.templating.template import Template

LATTICE = ElasticLattice(2, 0.75, 0.3).template()
ONE_WAY = Template(
    "one way", [[0.0, 0.2, 0.0], [0.5, 0.1, -0.3], [0.0, 0.0, 0.1]], boundary="periodic",
    output="linear", duration="settle",
)  # fmt: skip


@pytest.mark.parametrize("shape", [(4, 4), (3, 5), (2, 1)])
@pytest.mark.parametrize("template", [LATTICE, ONE_WAY], ids=["lattice", "one way"])
def test_it_is_the_dense_solution(template, shape):
    network = Network(template, shape)
    drive = np.random.default_rng(0).normal(size=(3, template.layers, *shape))
    found, wanted = circulant(network), propagator(network, math.inf)
    assert found is not None
    assert wanted is not None
    exact = wanted.reach(np.zeros_like(drive), drive)
    # the rates of the lattice span three decades; roundings grow by that
    np.testing.assert_allclose(found.reach(drive), exact, rtol=0, atol=1e-12 * np.abs(exact).max())


def changed(**options):
    given = {"A": ONE_WAY.A[0, 0], "boundary": "periodic", "output": "linear", "duration": "settle"}
    return Template("changed", **(given | options))


@pytest.mark.parametrize(
    "options",
    [
        {"boundary": "zero-flux"},
        {"output": "standard"},
        {"A": [[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]},
    ],
    ids=["a rim", "saturates", "a uniform map stays"],
)
def test_there_is_none_where_waves_are_no_solutions_or_stay(options):
    assert circulant(Network(changed(), (4, 4))) is not None
    assert circulant(Network(changed(**options), (4, 4))) is None
