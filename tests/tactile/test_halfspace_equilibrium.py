"""(4.8) relaxed on layers: against a direct solve assembled otherwise, and against (4.9)."""

import numpy as np
import pytest

from cnnum.checks.lattice_cover import block_displacement, on_plane
from cnnum.engine import Engine
from cnnum.errors import ProgramError
from cnnum.tactile import halfspace
from cnnum.templates.tactile.halfspace_equilibrium import halfspace_equilibrium

PLANE = 2
"""The taxels lie so many slabs deep."""


def relaxed(engine, load, *, slabs, thickness, cells=1, poisson, tolerance):
    program = halfspace_equilibrium.bind(
        thickness=thickness, pitch=1.0, cells=cells, slabs=slabs, layers=PLANE * cells,
        poisson=poisson, youngs_modulus=2 * (1 + poisson), tolerance=tolerance,
    )  # fmt: skip
    names = [f"displacement_{axis}" for axis in "xyz"]
    got = engine.compile(program, load.shape[:2], names)(load)
    return np.stack([got[name] for name in names], axis=-1)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.45, 0.49])
def test_relaxation_ends_at_the_direct_solution(poisson):
    load = np.random.default_rng(1).normal(size=(6, 5, 3))
    wanted = on_plane(block_displacement(load, 6, 0.75, poisson), PLANE)
    engine = Engine(precision="float64")
    got = relaxed(engine, load, slabs=6, thickness=1.5, poisson=poisson, tolerance=1e-9)
    # 1e-9 a time constant, times the 1e4 of the slowest mode at ν = 0.49, with room
    assert np.abs(got - wanted).max() <= 1e-4 * np.abs(wanted).max()


def infinite(place, side, depth, axis, poisson):
    """Sum (4.9) over two loads on a unit square and their images, up and down by turns.

    The window ends so gently that nothing of its edge is left: half as wide makes no difference.
    """
    found, reach = np.zeros((place.size, place.size, 3)), 3.0 * side
    for m in range(-6, 7):
        for n in range(-6, 7):
            for sign, at in ((1.0, 1.5), (-1.0, 5.5)):
                x, y = at + m * side, at + n * side
                window = np.exp(-((np.hypot(x - side / 2, y - side / 2) / reach) ** 4))
                found += sign * window * halfspace.rectangle_displacement(
                    place[None, :] - x, place[:, None] - y, depth, np.eye(3)[axis],
                    size=(1.0, 1.0), youngs_modulus=2 * (1 + poisson), poisson=poisson,
                )  # fmt: skip
    return found


@pytest.mark.parametrize("poisson", [0.3, 0.49])
@pytest.mark.parametrize("axis", [0, 2], ids=["Q", "F"])
def test_what_relaxes_nears_4_9_as_the_square_of_the_cell(poisson, axis):
    """Two opposite loads on a torus: far images and the base do not matter."""
    side, depth, errors = 8, 2.0, []
    engine = Engine(precision="float64")
    for cells in (1, 2):
        n = side * cells
        load, place = np.zeros((n, n, 3)), (np.arange(n) + 0.5) / cells
        load[cells : 2 * cells, cells : 2 * cells, axis] = 1.0
        load[5 * cells : 6 * cells, 5 * cells : 6 * cells, axis] = -1.0
        exact = infinite(place, side, depth, axis, poisson)
        got = relaxed(
            engine, load, slabs=6 * cells, thickness=depth, cells=cells, poisson=poisson,
            tolerance=1e-8,
        )  # fmt: skip
        errors.append(np.abs(got - exact).max() / np.abs(exact).max())
    # second order is 4; at one cell a load of that size the terms beyond still help
    assert 3.5 <= errors[0] / errors[1] <= 8.0, errors
    assert errors[1] <= 0.17


@pytest.mark.parametrize("options", [{"poisson": 0.5}, {"slabs": 1}])
def test_what_can_not_be_is_refused(options):
    with pytest.raises(ProgramError, match="Poisson ratio"):
        halfspace_equilibrium.bind(**options).trace((8, 8))
