"""Depth layers at rest: against the waves' transform, and by relaxation."""

import numpy as np
import pytest
from scipy.fft import dctn, idctn

from cnnum.engine import Engine
from cnnum.errors import ProgramError
from cnnum.templates.tactile.halfspace_layers import halfspace_layers, stack_of
from cnnum.templates.tactile.halfspace_stress import halfspace_stress

Z = 2 / 3
STRESS = ["stress_xz", "stress_yz", "stress_zz"]


def load(shape):
    return np.random.default_rng(1).normal(size=(*shape, 3))


def low_pass(p, z):
    """Normal stress under a pressure that goes on mirrored, by cosine transform."""
    squares = [2 - 2 * np.cos(np.pi * np.arange(n) / n) for n in p.shape]
    k = np.sqrt(squares[0][:, None] + squares[1][None])
    return -idctn(dctn(p, norm="ortho") * (1 + k * z) * np.exp(-k * z), norm="ortho")


def test_slabs_converge_to_the_transform_as_their_order():
    frame = load((8, 8))
    frame[..., :2] = 0.0
    exact = low_pass(frame[..., 2], Z)
    engine = Engine(precision="float64")
    for order in (2, 4):
        errors = []
        for layers in (2, 4):
            program = halfspace_layers.bind(thickness=Z, pitch=1.0, layers=layers, order=order)
            got = engine.compile(program, (8, 8), ["stress_zz"])(frame)["stress_zz"]
            errors.append(np.abs(got - exact).max())
        # halving the slabs: 4 and 16, coarse as they are within the first quarter of it
        assert 0.7 * 2**order <= errors[0] / errors[1] <= 1.5 * 2**order


@pytest.mark.parametrize("shape", [(4, 4), (8, 8)])
def test_eight_layers_are_the_waves(fast, shape):
    frame = load(shape)
    layers = halfspace_layers.bind(thickness=Z, pitch=1.0)
    waves = halfspace_stress.bind(thickness=Z, pitch=1.0)
    got = fast.compile(layers, shape, STRESS)(frame)
    wanted = fast.compile(waves, shape, STRESS)(frame)
    for name in STRESS:
        # order 4 at 8 slabs: 2e-5 of a wave at most, in a map of white noise
        assert np.abs(got[name] - wanted[name]).max() <= 3e-5 * np.abs(frame).max()


def test_relaxation_ends_where_the_product_is(fast):
    frame = load((4, 4))
    options = {"thickness": Z, "pitch": 1.0, "layers": 4, "order": 2}
    exact = fast.compile(halfspace_layers.bind(**options), (4, 4), STRESS)(frame)
    relaxing = halfspace_layers.bind(**options, method="runge-kutta-chebyshev")
    got = fast.compile(relaxing, (4, 4), STRESS)(frame)
    for name in STRESS:
        # 1e-6 a time constant, times the 1000 and more that the slowest wave takes, in float32
        assert np.abs(got[name] - exact[name]).max() <= 1e-3 * np.abs(frame).max()


def test_the_end_of_the_stack_is_as_deep_as_stated():
    stack = stack_of(Z, (8, 8), 8, 4, 1e-6)
    slowest = 2 * np.sin(np.pi / 16)
    assert np.exp(-2 * slowest * (sum(stack.slabs) - Z)) <= 1e-6
    assert abs(sum(stack.slabs[: stack.taxels]) - Z) < 1e-12


@pytest.mark.parametrize("options", [{"layers": 0}, {"order": 3}, {"tolerance": 1.0}])
def test_what_cannot_be_is_refused(options):
    with pytest.raises(ProgramError, match="number of layers"):
        halfspace_layers.bind(**options).trace((8, 8))
