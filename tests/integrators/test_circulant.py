"""The equilibrium on a torus, from its waves: against a dense solve of all cells at once."""

import math

import numpy as np
import pytest

from cnnum.integrators.closed_forms import circulant, propagator
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
    np.testing.assert_allclose(
        found.reach(drive, drive), exact, rtol=0, atol=1e-12 * np.abs(exact).max()
    )


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


@pytest.mark.parametrize("poisson", [0.0, 0.45, 0.4999])
def test_the_stated_rounding_covers_the_weights(poisson):
    """Refined with residuals in extended precision, from which each round takes the answer."""
    template = ElasticLattice(4, 0.75, poisson).template()
    found = circulant(Network(template, (5, 4)))
    assert found is not None
    rng = np.random.default_rng(2)
    drive = np.sign(rng.normal(size=(template.layers, 5, 4)))
    first = found.reach(drive, drive)
    exact = first.astype(np.longdouble)
    for _ in range(3):
        around = np.zeros_like(exact)
        for to, source, row, col in np.argwhere(template.A):
            moved = np.roll(exact[source], (1 - row, 1 - col), axis=(0, 1))
            around[to] += np.longdouble(template.A[to, source, row, col]) * moved
        residual = (drive + around - exact).astype(np.float64)
        exact += found.reach(residual, residual)
    off = float(np.abs(first - exact).max())
    # the transforms of the check itself round each of its 240 numbers a few times
    assert off <= found.rounding + 1e-14 * np.abs(first).max()
    assert found.rounding <= 1e-6 * np.abs(first).max()
