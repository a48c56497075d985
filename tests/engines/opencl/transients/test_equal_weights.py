"""Neighbours of equal weight share a product, and the sum stays the same."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.engines.opencl.transients.builder import (
    shared_products,
    shares_products,
    weighted_terms,
)
from cnnum.kernels.expressions import Number
from cnnum.kernels.number_types import FLOAT64
from cnnum.kernels.printer import OpenCLPrinter
from cnnum.templating.network import Tap, taps
from cnnum.templating.template import Template

REFERENCE = Engine("reference")
PRINTER = OpenCLPrinter(FLOAT64)


def symmetric(rng, radius, kind):
    """Return weights that are equal, or opposite, at mirrored places."""
    k = 2 * radius + 1
    weights = rng.normal(size=(k, k))
    if kind == "rows":
        weights += weights[::-1]
    elif kind == "isotropic":
        row, col = np.mgrid[-radius : radius + 1, -radius : radius + 1]
        weights = rng.normal(size=(2 * radius * radius + 1))[row**2 + col**2]
    elif kind == "opposite":
        weights -= weights[:, ::-1]
    return weights / np.abs(weights).sum()


def test_an_isotropic_template_takes_three_products():
    kernel = np.array([[1.0, 2, 1], [2, 3, 2], [1, 2, 1]])
    groups = shared_products(taps(kernel[np.newaxis, np.newaxis], 0))
    assert sorted(len(group) for group in groups) == [1, 4, 4]
    edges = np.array([[1.0, 0, -1], [2, 0, -2], [1, 0, -1]])
    assert len(shared_products(taps(edges[np.newaxis, np.newaxis], 0))) == 2


def test_few_equal_weights_can_stay_alone():
    kernel = np.array([[1.0, 2, 1], [2, 3, 2], [4, 2, 4]])
    groups = shared_products(taps(kernel[np.newaxis, np.newaxis], 0), least=4)
    assert sorted(len(group) for group in groups) == [1, 1, 1, 1, 1, 4]


def test_different_weights_share_nothing():
    assert not shares_products([Tap(0, 0, 0, 0.5), Tap(0, 0, 1, 0.25)])
    assert shares_products([Tap(0, 0, 0, 0.5), Tap(1, 0, 1, -0.5)])


@pytest.mark.parametrize("kind", ["none", "rows", "isotropic", "opposite"])
@pytest.mark.parametrize("radius", [1, 2, 3])
def test_terms_are_the_weighted_sum(kind, radius):
    rng = np.random.default_rng(radius)
    kernels = np.stack([symmetric(rng, radius, kind), -symmetric(rng, radius, kind)])
    found = taps(kernels[np.newaxis], 0)
    values = {tap: rng.normal() for tap in found}
    terms = weighted_terms(found, Number, lambda tap: Number(values[tap]))
    written = [PRINTER.expression(term).replace("R(", "(") for term in terms]
    wanted = sum(tap.weight * values[tap] for tap in found)
    # sums of up to 98 numbers of order 1 in another order
    assert sum(eval(term) for term in written) == pytest.approx(wanted, abs=1e-13)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("kind", "radius", "boundary"),
    [("rows", 2, "zero-flux"), ("isotropic", 1, 0.3), ("opposite", 1, "periodic")],
)
def test_kernels_with_shared_products_step_as_the_reference(kind, radius, boundary):
    """Single frames, frames in lanes, arrays in scratch, and strips with rows in lanes."""
    rng = np.random.default_rng(7)
    A = 0.8 * symmetric(rng, radius, kind)
    template = Template("shared", A, symmetric(rng, radius, kind), 0.1, boundary=boundary)
    for shape, batch in (((8, 9), 1), ((8, 9), 40), ((40, 36), 2), ((270, 261), 1)):
        maps = {name: rng.uniform(-1, 1, (batch, *shape)) for name in ("input", "state")}
        wanted = REFERENCE.run(template, duration=0.5, dt=0.05, **maps).state
        got = Engine().run(template, duration=0.5, dt=0.05, **maps).state
        # ten steps of values of order 1, to rounding
        assert np.abs(got - wanted).max() <= 3e-6 * np.abs(wanted).max()
