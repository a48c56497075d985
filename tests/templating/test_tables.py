"""Function tables as the template library means them."""

import numpy as np
import pytest

from cnnum.templating.functions import Table


@pytest.mark.parametrize(
    ("v", "f"), [(-5.0, 1.0), (0.0, 1.0), (0.001, 2.0), (1.0, 2.0), (1.5, 3.0), (9.0, 3.0)]
)
def test_constant_holds_up_to_and_with_its_point(v, f):
    table = Table("constant", ((0.0, 1.0), (1.0, 2.0), (2.0, 3.0)))
    assert table(np.array(v)) == f


@pytest.mark.parametrize(("v", "f"), [(-5.0, 1.0), (0.0, 1.0), (0.5, 1.5), (1.0, 2.0), (9.0, 2.0)])
def test_linear_is_clamped_at_its_ends(v, f):
    assert Table("linear", ((0.0, 1.0), (1.0, 2.0)))(np.array(v)) == f


def test_steepest_slope():
    assert Table("linear", ((0.0, 0.0), (1.0, 2.0), (3.0, 1.0))).steepest == 2.0
