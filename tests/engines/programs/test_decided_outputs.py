"""Outputs of cells that see only themselves, in programs on the engines: one sum for each cell.

Compared with the equation of a cell, solved by SciPy, over the range of `drawn`.
"""

import numpy as np
import pytest

import cnnum
from tests.embedded.test_decided_exports import CHANNELS, SHAPE, drawn, wanted


def program(template, roles):
    def function(frame):
        maps = {"input": frame.u, "state": frame.x, "flag": frame.x > 0.0, "mask": frame.m > 0.0}
        given = {"state" if role == "flag" else role: maps[role] for role in roles}
        return {"y": cnnum.transient(template, **given).outputs[0]}

    return cnnum.Program(function, "one")


@pytest.mark.parametrize("engine", ["opencl", "numba"])
@pytest.mark.parametrize("seed", range(16))
def test_outputs_are_those_of_the_equation(engine, seed):
    template, roles, frames, own, time = drawn(100 + seed)
    expected = wanted(template, roles, frames, own, time)
    slope = own - 1.0
    gain = time if slope == 0.0 else np.expm1(slope * time) / slope
    for precision, last in (("float32", 2.0**-22), ("float64", 2.0**-40)):
        plan = cnnum.Engine(engine, precision=precision).compile(
            program(template, roles), SHAPE, channels=CHANNELS
        )
        given = np.asarray(plan(frames[:, 0])["y"])
        # of a sum of nine products up to 3, which grows with the state
        assert np.abs(given - expected).max() <= min(gain, 1e12) * last * max(1.0, slope) + 1e-7
        if gain * last > 0.1:  # the bound alone would let anything pass
            assert np.mean(np.abs(given - expected) < 1e-3) > 0.9


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
