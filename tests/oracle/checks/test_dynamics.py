"""Closed forms of delays, oscillators, waves and nonlinear couplings, against other solutions."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.integrate import solve_ivp

from cnnum.templating.checks import closed_form
from cnnum.templating.checks.analytic.courses import by_steps
from cnnum.templating.checks.analytic.linear import bending
from cnnum.templating.checks.analytic.waves import limit_cycle, line_after
from cnnum.templating.checks.digital.propagation import next_generation
from cnnum.templating.library import get_template


@pytest.mark.parametrize(("rate", "late"), [(-1.0, -0.9), (-1.0, 0.6), (-0.4, 0.3), (0.2, -1.1)])
def test_method_of_steps_is_the_solution_of_its_equation(rate: float, late: float) -> None:
    # Heun steps of T/n with the past read at whole steps; Richardson takes the h² away.
    def heun(n: int) -> float:
        h, x = 2.0 / n, [1.0] * (n + 1)
        for _ in range(round(3.3 * n)):
            k1 = rate * x[-1] + late * x[-1 - n]
            k2 = rate * (x[-1] + h * k1) + late * x[-n]
            x.append(x[-1] + h / 2 * (k1 + k2))
        return x[-1]

    refined = (4.0 * heun(800) - heun(400)) / 3.0
    exact = by_steps(np.array([rate]), np.array([late]), 2.0, 6.6)[0]
    assert exact == pytest.approx(refined, abs=1e-7)  # the rest is of the order of h⁴ = 4e-11


def test_method_of_steps_knows_the_first_stretch_in_full() -> None:
    # x' = -x + b up to t = T, from 1
    exact = by_steps(np.array([-1.0]), np.array([-0.9]), 2.0, 1.5)[0]
    assert exact == pytest.approx(-0.9 + 1.9 * np.exp(-1.5), rel=1e-14)


def test_limit_cycle_is_a_cycle_and_its_period_solves_the_piecewise_linear_system() -> None:
    orbit = limit_cycle(2.0, 2.0)
    phases = np.array([0.0, 1.0])
    ends = orbit.at(phases)
    # a step over one of the corners of f, four a period, is off by 1e-8 or so; the last bits of the
    # processor decide which steps are
    np.testing.assert_allclose(ends[:, 0], ends[:, 1], atol=1e-7)
    # the system turns by a quarter onto itself, so a quarter of the period turns the state
    quarter = orbit.at(np.array([0.1, 0.35]))
    np.testing.assert_allclose(quarter[:, 1], [-quarter[1, 0], quarter[0, 0]], atol=1e-5)


def test_limit_cycle_attracts_from_outside_too() -> None:
    orbit = limit_cycle(2.0, 2.0)

    def slope(_: float, x: np.ndarray) -> np.ndarray:
        y = np.clip(x, -1.0, 1.0)
        return -x + np.array([2.0 * y[0] - 2.0 * y[1], 2.0 * y[0] + 2.0 * y[1]])

    outside = solve_ivp(slope, (0.0, 30.0), [9.0, 4.0], rtol=1e-9, atol=1e-9).y[:, -1]
    path = orbit.at(np.linspace(0.0, 1.0, 4001))
    # neighbouring points of the path are 2e-3 of a period, some 6e-3, apart
    assert np.hypot(*(path - outside[:, np.newaxis])).min() < 6e-3


def test_a_front_moves_on_at_a_constant_speed() -> None:
    line = np.where(np.arange(60) < 8, 1.0, -1.0)[np.newaxis]
    places = [
        float(np.clip(line_after(line, (3.0, 0.25), 3.75, t), -1.0, 1.0).sum()) / 2.0
        for t in (6.0, 10.0, 14.0)
    ]
    first, second = np.diff(places)
    assert first > 1.0
    # a front on a lattice repeats itself cell by cell: between, its place may be half a cell off
    assert second == pytest.approx(first, abs=0.5)


def test_a_glider_moves_one_cell_in_four_generations() -> None:
    alive = np.zeros((1, 12, 12), dtype=bool)
    alive[0, 1:4, 1:4] = [[0, 1, 0], [0, 0, 1], [1, 1, 1]]
    later = alive
    for _ in range(4):
        later = next_generation(later)
    np.testing.assert_array_equal(later, np.roll(alive, (1, 1), (1, 2)))


def test_bending_is_the_bilaplacian_of_the_thirteen_points() -> None:
    stencil = np.array(
        [[0, 0, 1, 0, 0], [0, 2, -8, 2, 0], [1, -8, 20, -8, 1], [0, 2, -8, 2, 0], [0, 0, 1, 0, 0]]
    )
    picture = np.random.default_rng(4).normal(size=(5, 7))
    expected = ndimage.correlate(picture, stencil, mode="constant")
    got = (bending((5, 7)) @ picture.ravel()).reshape(5, 7)
    np.testing.assert_allclose(got, expected, atol=1e-12)


def test_dominoes_are_the_solution_of_their_equation() -> None:
    template, form = get_template("D_ANISO"), closed_form("dominoes")
    case = form.cases(template, np.random.default_rng(6), (4, 6))
    expected = form.expected(template, case)

    def slope(_: float, v: np.ndarray) -> np.ndarray:
        return -2.0 * v * np.clip(1.0 - np.abs(v) / 0.25, 0.0, None)

    start = (case.pictures[:3, :, 1::2] - case.pictures[:3, :, 0::2]).ravel()
    end = (expected[:3, :, 1::2] - expected[:3, :, 0::2]).ravel()
    answer = solve_ivp(slope, (0.0, 2.0), start, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(end, answer.y[:, -1], atol=1e-8)
    assert (np.abs(start) > 0.25).any()
    np.testing.assert_allclose(
        expected.sum(axis=(1, 2)), case.pictures.sum(axis=(1, 2)), atol=1e-12
    )


def test_steps_of_five_and_of_six_neighbours_make_a_contour() -> None:
    template, form = get_template("CONTOUR"), closed_form("contour")
    case = form.cases(template, np.random.default_rng(7), (9, 9))
    padded = np.pad(case.pictures, [(0, 0), (1, 1), (1, 1)], mode="edge")
    black = form.expected(template, case) > 0
    for picture, row, col in np.argwhere(np.ones_like(black)):
        around = padded[picture, row : row + 3, col : col + 3]
        count = int((np.abs(around - around[1, 1]) > 0.18).sum())
        assert black[picture, row, col] == (count > 5 or (count == 5 and around[1, 1] > -0.2))
