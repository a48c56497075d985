"""Values of function tables exactly at their places, where one step ends and the next begins."""

import numpy as np
import pytest

from cnnum import Template
from cnnum.engine import Engine
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import Table

STEPS = Table("constant", ((-0.5, 1.0), (0.5, 2.0), (1.0, 3.0)))
AT = np.array([[-1.0, -0.5, -0.25, 0.5, 0.75, 1.0]])
VALUES = np.array([[1.0, 1.0, 2.0, 2.0, 3.0, 3.0]])


def test_a_level_holds_up_to_its_place_and_there():
    np.testing.assert_array_equal(STEPS(AT), VALUES)


@pytest.mark.parametrize("name", ["opencl", "numba", "reference"])
def test_kernels_hold_levels_up_to_their_places_and_there(name):
    coupling = NonlinearCoupling(np.ones((1, 1)), STEPS, "u")
    template = Template("levels", [[0]], [[0]], nonlinear=[coupling], output="linear")
    result = Engine(name).run(template, input=AT, duration=30.0)
    # e^{-30} of the way is left, and single precision
    np.testing.assert_allclose(result.state, VALUES, rtol=1e-5)


@pytest.mark.parametrize("name", ["opencl", "numba", "reference"])
def test_kernels_forget_steep_lines_beyond_them(name):
    """Written as a sum of ramps, their roundings stayed in all values that follow."""
    steep = Table("linear", ((-2.0, 0.5), (3.0, 1.0), (3.0001, 1000.0), (3.0002, 1.0), (8.0, 2.0)))
    coupling = NonlinearCoupling(np.ones((1, 1)), steep, "u")
    template = Template("steep", [[0]], [[0]], nonlinear=[coupling], output="linear")
    seen = np.array([[-9.0, -2.0, 0.5, 2.999, 3.001, 8.0, 20.0]])
    result = Engine(name).run(template, input=seen, duration=30.0)
    np.testing.assert_allclose(result.state, steep(seen), rtol=1e-5)
