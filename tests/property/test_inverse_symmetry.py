"""Turning, shifting or scaling the strain does just that to the answer."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cnnum.arrays import Floats
from cnnum.tactile.inverse import locate, locate_load, locate_stress

E, Z = 0.87e6, 200e-6
TAXELS = np.array([[0.0, 0.0], [1.2, 0.1], [-0.2, 1.1], [0.9, 1.3]]) * Z

numbers = st.floats(-1.0, 1.0, allow_nan=False)
angles = st.floats(0.0, 6.3)
rows = st.tuples(numbers, numbers, numbers).map(lambda r: 1e-3 * np.array(r))


def turn(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@settings(max_examples=200, deadline=None)
@given(strain=rows, angle=angles, factor=st.floats(1e-3, 1e3))
def test_one_taxel_turns_and_scales(strain: Floats, angle: float, factor: float) -> None:
    load = locate(strain, depth=Z, youngs_modulus=E, noise=1e-6)
    other = locate(factor * turn(angle) @ strain, depth=Z, youngs_modulus=E, noise=factor * 1e-6)
    assert not np.isnan([load.x, load.y, load.force, load.position_error]).any()
    if np.hypot(*strain[:2]) < max(1e-9 * abs(strain[2]), 1e-290):
        return  # rounding turns a place straight below, or infinitely far, by more than itself
    place = turn(angle)[:2, :2] @ [load.x, load.y]
    radius = max(float(np.hypot(*place)), 1e-9 * Z)
    # n and s carry 1e-16 of each other; far out ρ divides by s.
    slack = 1e-12 * (1.0 + (radius / Z) ** 2)
    np.testing.assert_allclose([other.x, other.y], place, atol=slack * radius)
    np.testing.assert_allclose(other.force, factor * load.force, rtol=10.0 * slack)


@settings(max_examples=100, deadline=None)
@given(stress=rows, shift=st.tuples(numbers, numbers))
def test_the_answer_moves_with_the_taxel(stress: Floats, shift: tuple[float, float]) -> None:
    for find in (
        lambda at: locate(stress, depth=Z, youngs_modulus=E, taxel=at),
        lambda at: locate_stress(stress, depth=Z, taxel=at),
    ):
        here, there = find((0.0, 0.0)), find(shift)
        if not here.seen:
            continue
        # One addition, rounded to the larger of the two.
        size = max(abs(float(here.x)), abs(float(here.y)), 1.0)
        moved = [there.x - here.x, there.y - here.y]
        np.testing.assert_allclose(moved, shift, atol=4e-16 * size)
        assert there.force == here.force


@settings(max_examples=40, deadline=None)
@given(
    place=st.tuples(numbers, numbers),
    force=st.tuples(numbers, numbers, st.floats(0.2, 1.0)),
    angle=angles,
)
def test_an_array_turns(
    place: tuple[float, float], force: tuple[float, float, float], angle: float
) -> None:
    from cnnum.tactile import halfspace

    spin = turn(angle)[:2, :2]
    answers = []
    for matrix in (np.eye(2), spin):
        offset = (TAXELS - Z * np.array(place)) @ matrix.T
        load = np.array([*(matrix @ force[:2]), force[2]])
        tensor = halfspace.strain(offset[:, 0], offset[:, 1], Z, load, youngs_modulus=E)
        answers.append(
            locate_load(tensor[:, 2, :], TAXELS @ matrix.T, depth=Z, youngs_modulus=E, noise=1e-5)
        )
    plain, turned = answers
    # Exact data: both are the truth to 1e-9 of the depth and of the force.
    np.testing.assert_allclose([turned.x, turned.y], spin @ [plain.x, plain.y], atol=2e-9 * Z)
    np.testing.assert_allclose(turned.force[:2], spin @ plain.force[:2], atol=2e-9)
    np.testing.assert_allclose(turned.position_error, plain.position_error, rtol=1e-6)
