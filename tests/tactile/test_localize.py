"""Bumps: their own loads by a linear solve, and contacts next to each other told apart."""

import numpy as np
import pytest

from cnnum.errors import ProgramError
from cnnum.templates.tactile.localize import localize


def mixing(shape, c):
    """What taxels read of bumps, as a matrix."""
    rows, cols = shape
    matrix = np.eye(rows * cols)
    for row in range(rows):
        for col in range(cols):
            for r, k in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
                if 0 <= r < rows and 0 <= k < cols:
                    matrix[row * cols + col, r * cols + k] = c
    return matrix


@pytest.mark.parametrize("shape", [(4, 4), (8, 8), (16, 16)])
@pytest.mark.parametrize("crosstalk", [0.05, 0.2])
def test_own_loads_come_back(engine, run, shape, crosstalk):
    rng = np.random.default_rng(2)
    noise = 1e-4
    own = np.zeros((*shape, 3))
    own[0, 0] = 0.3, -0.2, 1.0
    own[1, 3] = -0.1, 0.4, 0.6  # one free bump on the way
    own[3, 2] = 0.0, 0.0, 0.9
    read = np.einsum("ij,jk->ik", mixing(shape, crosstalk), own.reshape(-1, 3)).reshape(own.shape)
    frames = noise * rng.normal(size=(24, *shape, 3))
    frames[20:] -= read
    got = run(engine, localize.bind(crosstalk=crosstalk), frames)
    np.testing.assert_array_equal(got["bump_contact"][-1] > 0, own[..., 2] > 0)
    assert got["bump_count"][-1] == 3
    for k, name in enumerate(("bump_load_x", "bump_load_y", "bump_load_normal")):
        # noise of the frame and of the rest, amplified by at most 1/(1 − 4c)
        assert np.abs(got[name][-1] - own[..., k]).max() <= 10 * noise / (1 - 4 * crosstalk)
    assert not got["bump_contact"][:20].any()


def test_without_unmixing_a_neighbour_would_count(opencl, run):
    """At 20 % crosstalk a bump's neighbours are above the 10 % share unless it is taken off."""
    frames = 1e-4 * np.random.default_rng(3).normal(size=(24, 8, 8, 3))
    frames[20:, 4, 4, 2] -= 1.0
    for r, c in ((3, 4), (5, 4), (4, 3), (4, 5)):
        frames[20:, r, c, 2] -= 0.2
    assert run(opencl, localize.bind(crosstalk=0.2), frames)["bump_count"][-1] == 1
    assert run(opencl, localize.bind(crosstalk=0.0), frames)["bump_count"][-1] == 5


def test_crosstalk_that_can_not_be_undone_is_refused():
    with pytest.raises(ProgramError, match="crosstalk"):
        localize.bind(crosstalk=0.25).trace((8, 8))
