"""Outputs of cells that see only themselves, in programs on the engines: one sum for each cell.

Compared with the equation of a cell, solved by SciPy, over the range of `drawn`.
"""

import numpy as np
import pytest

import cnnum
from cnnum.integrators.closed_forms import Separate
from tests.embedded.test_decided_exports import (
    CHANNELS,
    RESTS,
    SHAPE,
    at_rest,
    drawn,
    program,
    wanted,
)

LARGE = (17, 16)
"""`numba` walks over the operations of an array of more than 256 cells."""


@pytest.mark.parametrize(("engine", "shape"), [
    ("opencl", SHAPE), ("numba", SHAPE), ("numba", LARGE), ("opencl", (257, 3)),
])  # fmt: skip
@pytest.mark.parametrize("seed", range(12))
def test_outputs_are_those_of_the_equation(engine, shape, seed):
    template, roles, frames = drawn(100 + seed, shape)
    one = program(template, roles, remembers=shape == LARGE)
    expected = list(wanted(template, roles, frames))
    for precision, last in (("float32", 2.0**-22), ("float64", 2.0**-40)):
        plan = cnnum.Engine(engine, precision=precision).compile(one, shape, channels=CHANNELS)
        schemes = [solver.scheme for solver in plan.solvers.values()]
        assert all(isinstance(scheme, Separate) and scheme.ends for scheme in schemes)
        given = plan(frames[:, 0])
        for layer, (ends, gain) in enumerate(expected):
            error = np.abs(np.asarray(given[f"y{layer}"]) - ends)
            # of a sum of nine products up to 3, which grows with the state
            assert error.max() <= min(gain, 1e12) * last + 1e-7
            if gain * last > 0.1:  # the bound alone would let anything pass
                assert np.mean(error < 1e-3) > 0.9


@pytest.mark.parametrize(("engine", "shape"), [
    ("opencl", SHAPE), ("numba", SHAPE), ("numba", LARGE),
])  # fmt: skip
@pytest.mark.parametrize(("own", "start"), RESTS)
def test_a_cell_at_its_unstable_rest_stays(engine, shape, own, start):
    template, roles, frames = at_rest(own, start)
    rows, cols = (-(-n // m) for n, m in zip(shape, SHAPE, strict=True))
    frames = np.tile(frames, (1, 1, rows, cols, 1))[:, 0, : shape[0], : shape[1]]
    one = program(template, roles, remembers=shape == LARGE)
    expected = np.full(frames.shape[:-1], start)
    expected[1][frames[1, ..., 0] > frames[0, ..., 0]] = 1.0
    expected[2][frames[2, ..., 0] < frames[0, ..., 0]] = -1.0
    for precision in ("float32", "float64"):
        plan = cnnum.Engine(engine, precision=precision).compile(one, shape, channels=CHANNELS)
        np.testing.assert_array_equal(plan(frames)["y0"], expected)


@pytest.mark.parametrize("engine", ["opencl", "numba"])
@pytest.mark.parametrize("name", ["life", "skeleton", "thinning", "center"])
def test_loops_of_such_templates_give_the_pictures_of_the_reference(engine, name):
    rng = np.random.default_rng(9)
    frames = np.where(rng.random((3, 12, 14, 1)) < 0.6, 1.0, -1.0)
    outputs = [
        cnnum.Engine(one).compile(name, (12, 14), channels=("picture",))(frames)
        for one in (engine, "reference")
    ]
    for output, values in outputs[0].items():
        np.testing.assert_array_equal(values, outputs[1][output], output)
