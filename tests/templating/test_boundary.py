"""Which cell a virtual one copies, by hand: closed forms and engines share the rule."""

import numpy as np
import pytest

from cnnum.templating.boundary import PERIODIC, ZERO_FLUX, halo_sources, parse_boundary, rim_copies

# of the cells 0 1 2 / 3 4 5
MIRRORED = [[0, 0, 1, 2, 2], [0, 0, 1, 2, 2], [3, 3, 4, 5, 5], [3, 3, 4, 5, 5]]
WRAPPED = [[5, 3, 4, 5, 3], [2, 0, 1, 2, 0], [5, 3, 4, 5, 3], [2, 0, 1, 2, 0]]
FIXED = [[-1, -1, -1, -1, -1], [-1, 0, 1, 2, -1], [-1, 3, 4, 5, -1], [-1, -1, -1, -1, -1]]


@pytest.mark.parametrize(
    ("boundary", "cells"), [(ZERO_FLUX, MIRRORED), (PERIODIC, WRAPPED), (0.5, FIXED)], ids=str
)
def test_virtual_cells_copy_these(boundary, cells):
    assert halo_sources(parse_boundary(boundary), (2, 3), 1).tolist() == cells


@pytest.mark.parametrize("shape", [(2, 3), (1, 1), (1, 4), (5, 4)], ids=str)
@pytest.mark.parametrize("radius", [0, 1, 3])
@pytest.mark.parametrize("boundary", [ZERO_FLUX, PERIODIC, parse_boundary(0.5)], ids=str)
def test_a_rim_copies_what_numpy_pads(boundary, radius, shape):
    numbers = np.arange(1.0, 1.0 + shape[0] * shape[1]).reshape(shape)
    fixed = {"constant_values": 0.5} if boundary.constant is not None else {}
    padded = np.pad(numbers, radius, mode=boundary.pad_mode, **fixed)
    empty = np.pad(numbers, radius, constant_values=0.5).ravel()
    places, sources = rim_copies(boundary, shape, radius)
    assert np.all(empty[places] == 0.5)  # virtual cells, all of them
    assert len(places) == padded.size - numbers.size
    empty[places] = empty[sources]
    assert empty.tolist() == padded.ravel().tolist()


def test_a_constant_is_what_virtual_cells_hold(fast):
    """One cell that adds up its neighbours: four virtual ones of 0.5."""
    from cnnum import Template

    cross = [[0, 1, 0], [1, 0, 1], [0, 1, 0]]
    template = Template("cross", [[0]], cross, boundary=0.5, initial=0.0, output="linear")
    assert parse_boundary(0.5).constant == 0.5
    assert fast.run(template, input=np.zeros((1, 1))).output.item() == pytest.approx(2.0)
