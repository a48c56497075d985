"""Half-space by diffusion waves against closed forms on 8×8 taxels of 1, 2, 4 and 8 cells."""

from functools import cache

import numpy as np
import pytest

from cnnum.tactile import halfspace
from cnnum.templates.tactile.halfspace_strain import halfspace_strain
from cnnum.templates.tactile.halfspace_stress import halfspace_stress

PITCH, THICKNESS, E = 1.5e-3, 3.0e-3, 0.87e6
"""A cover two taxels thick: at one cell a taxel h²/z² is 1/4, in reach of second order."""
TAXELS, CELLS = 8, (1, 2, 4, 8)
SIDE = TAXELS * PITCH
COMPONENTS = {"xz": 0, "yz": 1, "zz": 2}


def mirrored(function, x, y, at, periods=3):
    """Sum a closed form over the images of a load, which goes on mirrored beyond the rim."""
    total = 0.0
    for m in range(-periods, periods + 1):
        for n in range(-periods, periods + 1):
            for a in (at[0], -at[0]):
                for b in (at[1], -at[1]):
                    total = total + function(x - a - 2 * m * SIDE, y - b - 2 * n * SIDE)
    return total


def cells_at(cells):
    """Where the cells lie, as columns and rows."""
    place = (np.arange(TAXELS * cells) + 0.5) * (PITCH / cells)
    return place[None, :], place[:, None]


@cache
def exact_fields(closed, load_at, cells):
    """Return (rows, cols, load, component) under each of the loads along the three axes.

    All three at once, as they have their functions of the place in common.
    """
    x, y = cells_at(cells)
    _, centre = load_at(x, y, PITCH / cells, cells)

    def field(a, b):
        return closed(a[..., None], b[..., None], THICKNESS, np.eye(3))[..., 2, :]

    return mirrored(field, x, y, centre)


def errors(numba, program, prefix, closed, axis, load_at):
    """Return the error of each number of cells, against the largest value of that field."""
    found = []
    for cells in CELLS if prefix == "stress" else CELLS[:-1]:
        h = PITCH / cells
        load, _ = load_at(*cells_at(cells), h, cells)
        frame = np.zeros((*load.shape, 3))
        frame[..., axis] = load
        names = [f"{prefix}_{name}" for name in COMPONENTS]
        bound = program.bind(thickness=THICKNESS, pitch=PITCH, cells=cells)
        got = numba.compile(bound, load.shape, names)(frame)
        exact = exact_fields(closed, load_at, cells)[..., axis, :]
        exact = exact - exact.mean((0, 1))
        kept = [got[name] - got[name].mean() for name in names]
        worst = max(np.abs(k - exact[..., n]).max() for n, k in enumerate(kept))
        found.append(worst / np.abs(exact).max())
    return np.array(found)


def patch(x, y, h, cells):
    """Uniform load of 1 Pa on 2×2 taxels in the middle: its edges are edges of cells."""
    inside = (np.abs(x - SIDE / 2) < PITCH) & (np.abs(y - SIDE / 2) < PITCH)
    return inside.astype(float), (SIDE / 2, SIDE / 2)


def point(x, y, h, cells):
    """1 N on the cell next to the middle."""
    load = np.zeros((y.size, x.size))
    load[y.size // 2, x.size // 2] = 1.0 / h**2
    return load, (x[0, x.size // 2], y[y.size // 2, 0])


def falls_as_the_square(found):
    ratios = found[:-1] / found[1:]
    # second order is 4; at one cell a taxel, half the depth, a point load's next term counts still
    return (ratios[1:] >= 3.0).all() and (ratios[1:] <= 6.5).all() and ratios[0] >= 1.8


def love(x, y, z, load):
    return halfspace.rectangle_stress(x, y, z, load, size=(2 * PITCH, 2 * PITCH))


def strain(x, y, z, force):
    return halfspace.strain(x, y, z, force, youngs_modulus=E)


@pytest.mark.parametrize("axis", [0, 1, 2], ids=["q_x", "q_y", "p"])
def test_stress_nears_love_patches_as_the_square_of_the_cell(numba, axis):
    found = errors(numba, halfspace_stress, "stress", love, axis, patch)
    assert falls_as_the_square(found), found
    # (h/z)² is 1/256 at 8 cells a taxel, and its factor near 1
    assert found[-1] <= 1.5 / 256, found


@pytest.mark.parametrize("axis", [0, 1, 2], ids=["Q", "R", "F"])
@pytest.mark.parametrize("kind", ["stress", "strain"])
def test_point_loads_near_4_11_and_4_12(numba, axis, kind):
    program, closed = {
        "stress": (halfspace_stress, halfspace.stress),
        "strain": (halfspace_strain.bind(youngs_modulus=E), strain),
    }[kind]
    found = errors(numba, program, kind, closed, axis, point)
    assert falls_as_the_square(found), found
    assert found[-1] <= 2 * (PITCH / CELLS[len(found) - 1] / THICKNESS) ** 2, found
