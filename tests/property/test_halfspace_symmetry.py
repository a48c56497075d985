"""Laws that any elastic half-space obeys, for random loads and places."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cnnum.tactile import halfspace

number = st.floats(-3.0, 3.0).map(lambda v: round(v, 6))
depth = st.floats(0.05, 3.0).map(lambda v: round(v, 6))
force = st.tuples(number, number, number)
ratio = st.floats(-0.9, 0.5).map(lambda v: round(v, 6))
size = st.tuples(st.floats(0.1, 3.0), st.floats(0.1, 3.0))
# sums of a few products of order one to a hundred
ROUNDING = 1e-11


def close(got: np.ndarray, expected: np.ndarray) -> bool:
    scale = max(np.abs(expected).max(), np.abs(got).max(), 1e-300)
    return bool(np.abs(got - expected).max() <= ROUNDING * max(scale, 1.0))


@given(number, number, depth, force, force, ratio)
def test_loads_superpose(x, y, z, first, second, nu) -> None:
    def stress(f):
        return halfspace.stress(x, y, z, f, poisson=nu)

    total = np.add(first, 2 * np.array(second))
    assert close(stress(total), stress(first) + 2 * stress(second))


@given(number, number, depth, force, ratio, st.floats(0, 2 * math.pi))
def test_turning_load_and_place_turns_the_answer(x, y, z, f, nu, angle) -> None:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    kind = {"youngs_modulus": 2.0, "poisson": nu}
    place = turn @ (x, y, z)
    moved = halfspace.displacement(*place[:2], z, turn @ f, **kind)
    assert close(moved, turn @ halfspace.displacement(x, y, z, f, **kind))
    bent = halfspace.strain(*place[:2], z, turn @ f, **kind)
    assert close(bent, turn @ halfspace.strain(x, y, z, f, **kind) @ turn.T)


@given(number, number, depth, force, ratio, size)
def test_mirrors(x, y, z, f, nu, sides) -> None:
    for flip in ((-1, 1, 1), (1, -1, 1)):
        mirror = np.diag(flip)
        place, load = mirror @ (x, y, z), mirror @ f
        for field in (
            lambda p, q: halfspace.stress(*p, q, poisson=nu),
            lambda p, q: halfspace.rectangle_stress(*p, q, size=sides, poisson=nu),
        ):
            assert close(field(place, load), mirror @ field((x, y, z), f) @ mirror)


@given(number, number, force, force, ratio)
def test_betti_reciprocity_on_the_surface(x, y, first, second, nu) -> None:
    """Work of the first load on the second's displacement is that of the second on the first's."""
    if math.hypot(x, y) < 0.05:
        x += 1.0
    kind = {"youngs_modulus": 2.0, "poisson": nu}
    there = halfspace.displacement(x, y, 0.0, first, **kind) @ second
    here = halfspace.displacement(-x, -y, 0.0, second, **kind) @ first
    assert close(np.array(there), np.array(here))


@given(number, number, depth, force, ratio, st.floats(1e-6, 1e6), st.floats(1e-3, 1e9))
def test_scaling_with_size_and_modulus(x, y, z, f, nu, scale, modulus) -> None:
    base = halfspace.stress(x, y, z, f, poisson=nu)
    far = halfspace.stress(scale * x, scale * y, scale * z, f, poisson=nu)
    assert close(far * scale**2, base)
    moved = halfspace.displacement(x, y, z, f, youngs_modulus=1.0, poisson=nu)
    soft = halfspace.displacement(
        scale * x, scale * y, scale * z, f, youngs_modulus=modulus, poisson=nu
    )
    assert close(soft * modulus * scale, moved)


@given(number, number, depth, force, ratio)
def test_energy_is_half_stress_times_strain_and_positive(x, y, z, f, nu) -> None:
    kind = {"youngs_modulus": 2.0, "poisson": nu}
    energy = halfspace.strain_energy_density(x, y, z, f, **kind)
    work = (halfspace.stress(x, y, z, f, **kind) * halfspace.strain(x, y, z, f, **kind)).sum() / 2
    assert energy >= 0
    assert math.isclose(float(energy), float(work), rel_tol=1e-9, abs_tol=1e-18 * sum(np.abs(f)))


@given(number, number, depth, force, ratio)
def test_volume_changes_by_the_trace_and_not_at_one_half(x, y, z, f, nu) -> None:
    strain = halfspace.strain(x, y, z, f, youngs_modulus=2.0, poisson=nu)
    stress = halfspace.stress(x, y, z, f, poisson=nu)
    assert close(np.trace(strain), (1 - 2 * nu) / 2.0 * np.trace(stress))
    rubber = halfspace.strain(x, y, z, f, youngs_modulus=2.0)
    assert close(np.trace(rubber), np.zeros(()))


@given(number, number, depth, force, ratio, size, st.floats(0.1, 0.9))
def test_two_parts_of_a_rectangle_make_the_whole(x, y, z, q, nu, sides, cut) -> None:
    a, b = sides

    def part(at: float, width: float):
        return halfspace.rectangle_stress(x - at, y, z, q, size=(width, b), poisson=nu)

    whole = part(0.0, a)
    assert close(part(-a / 2 + cut * a / 2, cut * a) + part(cut * a / 2, (1 - cut) * a), whole)


@settings(deadline=None, max_examples=20)
@given(st.integers(2, 7), st.integers(2, 7), st.integers(0, 2**31), depth, ratio)
def test_maps_superpose_and_turn_over(rows, cols, seed, z, nu) -> None:
    load = np.random.default_rng(seed).normal(size=(2, rows, cols, 3))
    cover = halfspace.SurfaceToDepth((rows, cols), (0.7, 0.4), z, nu)
    assert close(cover(load[0] - 3 * load[1]), cover(load[0]) - 3 * cover(load[1]))
    half_turn = load[0, ::-1, ::-1] * (-1, -1, 1)
    assert close(cover(half_turn), cover(load[0])[::-1, ::-1] * (-1, -1, 1))
