"""The closed forms themselves, against quadrature, brute force and matrices."""

from itertools import groupby, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import integrate, linalg, ndimage

from cnnum.errors import TemplateError
from cnnum.templating.boundary import PERIODIC, ZERO_FLUX, Boundary, halo_sources, parse_boundary
from cnnum.templating.checks.analytic.courses import state_after, switching_time
from cnnum.templating.checks.analytic.linear import modes
from cnnum.templating.checks.digital.propagation import packed_runs
from cnnum.templating.checks.pictures import binary, gray
from cnnum.templating.checks.records import number
from cnnum.templating.checks.registry import form_of
from cnnum.templating.library import get_template

BOUNDARIES = [ZERO_FLUX, PERIODIC, parse_boundary(0.0)]


def five_point(boundary: Boundary, shape: tuple[int, int]) -> np.ndarray:
    """Return the Laplacian as a matrix, cell by cell from the list of who neighbours whom."""
    sources = halo_sources(boundary, shape, 1)
    cells = shape[0] * shape[1]
    matrix = -4.0 * np.eye(cells)
    for row, col in product(*map(range, shape)):
        for down, east in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            source = sources[row + 1 + down, col + 1 + east]
            if source >= 0:
                matrix[row * shape[1] + col, source] += 1.0
    return matrix


@pytest.mark.parametrize("shape", [(8, 8), (5, 9), (1, 6), (4, 1)], ids=str)
@pytest.mark.parametrize("boundary", BOUNDARIES, ids=str)
def test_modes_are_those_of_the_matrix_exponential(
    boundary: Boundary, shape: tuple[int, int]
) -> None:
    start = np.random.default_rng(2).normal(size=shape)
    found = modes(boundary, shape)
    by_matrix = linalg.expm(0.7 * five_point(boundary, shape)) @ start.ravel()
    by_modes = found.apply(start, np.exp(0.7 * found.laplacian))
    # Both are exact; 1e-12 is a thousand roundings of a float64 of order 1.
    np.testing.assert_allclose(by_modes.ravel(), by_matrix, atol=1e-12)


@pytest.mark.parametrize("boundary", BOUNDARIES, ids=str)
def test_symbol_of_corner_weights_is_that_of_the_correlation(boundary: Boundary) -> None:
    start = np.random.default_rng(3).normal(size=(6, 7))
    mode = {"symmetric": "reflect", "wrap": "wrap", "constant": "constant"}[boundary.pad_mode]
    kernel = np.array([[0.1, 0.15, 0.1], [0.15, 0.0, 0.15], [0.1, 0.15, 0.1]])
    found = modes(boundary, (6, 7))
    np.testing.assert_allclose(
        found.apply(start, found.symbol(0.15, 0.1)),
        ndimage.correlate(start, kernel, mode=mode),
        atol=1e-12,
    )


def test_modes_refuse_a_boundary_that_drives_the_array() -> None:
    with pytest.raises(TemplateError, match="boundaries 0, 'zero-flux' and 'periodic', got 1"):
        modes(parse_boundary(1.0), (8, 8))


@pytest.mark.parametrize("feedback", [0.0, 0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("bias", [-2.5, -0.4, 0.0, 0.7, 4.0])
def test_uncoupled_cell_is_the_solution_of_its_equation(feedback: float, bias: float) -> None:
    start = np.array([-1.8, -1.0, -0.6, 0.0, 0.3, 1.0, 1.7])

    def slope(_: float, x: np.ndarray) -> np.ndarray:
        return -x + feedback * np.clip(x, -1.0, 1.0) + bias

    for time in (0.05, 0.4, 1.3, 6.0):
        answer = integrate.solve_ivp(slope, (0.0, time), start, rtol=1e-9, atol=1e-11)
        # The kinks of f cost the integrator some digits of its 1e-9.
        np.testing.assert_allclose(
            state_after(start, feedback, bias, time), answer.y[:, -1], atol=2e-6
        )


@given(
    start=st.floats(-0.99, 0.99),
    feedback=st.floats(1.0, 4.0),
    bias=st.floats(-3.0, 3.0),
)
def test_a_cell_saturates_exactly_at_its_switching_time(
    start: float, feedback: float, bias: float
) -> None:
    cell = np.array([start])
    time = float(switching_time(cell, feedback, bias)[0])
    if not np.isfinite(time) or time > 30.0:
        return
    before, after = (
        state_after(cell, feedback, bias, time),
        state_after(cell, feedback, bias, time * (1 + 1e-6) + 1e-6),
    )
    # e^{30(a-1)} would amplify roundings of the start beyond any use; those times are left out.
    assert abs(float(before[0])) == pytest.approx(1.0, abs=1e-6)
    assert abs(float(after[0])) >= 1.0


def test_a_cell_without_drive_never_switches() -> None:
    assert switching_time(np.array([0.4]), 2.0, -0.4)[0] == np.inf
    assert switching_time(np.array([0.0, 0.5]), 0.0, 0.3).tolist() == [np.inf, np.inf]


def test_the_library_threshold_switches_when_its_formula_says() -> None:
    # a = 2, z = -0.4: x - 0.4 grows as e^t, so 0.45 reaches 1 at ln(0.6 / 0.05).
    assert switching_time(np.array([0.45]), 2.0, -0.4)[0] == pytest.approx(np.log(12.0))


@given(arrays(np.bool_, st.integers(1, 20)))
@settings(max_examples=60)
def test_packed_runs_holds_one_cell_a_run_two_apart_at_the_end(line: np.ndarray) -> None:
    runs = sum(1 for black, _ in groupby(line.tolist()) if black)
    expected = [
        (len(line) - 1 - n) % 2 == 0 and (len(line) - 1 - n) // 2 < runs for n in range(len(line))
    ]
    assert packed_runs(line).tolist() == expected


def test_pictures_are_black_and_white_of_every_density_and_touch_the_frame() -> None:
    pictures = binary(np.random.default_rng(0), (8, 8))
    assert set(np.unique(pictures)) == {-1.0, 1.0}
    shares = (pictures > 0).mean(axis=(1, 2))
    assert shares.min() == 0.0
    assert shares.max() == 1.0
    rims = pictures.copy()
    rims[:, 1:-1, 1:-1] = -1.0
    assert ((rims > 0).any(axis=(1, 2)) & (shares < 1.0)).sum() >= 4


def test_gray_pictures_reach_their_amplitude_and_no_more() -> None:
    pictures = gray(np.random.default_rng(0), (1, 7), 0.5)
    np.testing.assert_allclose(np.abs(pictures).max(axis=(1, 2)), 0.5)


@pytest.mark.parametrize("seed", range(5))
def test_gray_inputs_keep_away_from_the_threshold(seed: int) -> None:
    """A cell on the threshold stays there for ever, and one near it for long."""
    template = get_template("THRESHOLD")
    form, level = form_of(template), number(template, "threshold")
    case = form.cases(template, np.random.default_rng(seed), (24, 24))
    near = np.abs(case.pictures - level).min()
    assert 0.05 - 1e-12 <= near < 0.06
