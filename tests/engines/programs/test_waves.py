"""Waves on the engines: their speed, their way, and whole batches of pictures against SciPy."""

from typing import Any

import numpy as np
import pytest
from scipy import ndimage
from scipy.stats import poisson

from cnnum.engine import Engine
from cnnum.engines.registry import backend_names
from cnnum.errors import NotSupportedError
from cnnum.templating.checks.analytic.waves import line_after
from cnnum.templating.checks.digital.propagation import next_generation, packed_runs
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

ENGINES = backend_names()
SHAPES = [(4, 4), (8, 8), (7, 13), (16, 16)]
PICTURES = 200


def run(name: str | None, template: Template, **maps: Any) -> Any:
    try:
        return Engine(name).run(template, **maps)
    except NotSupportedError as reason:
        pytest.skip(str(reason))


def pictures(shape: tuple[int, int], seed: int) -> np.ndarray:
    """Return random pictures, speckled and blobby, of all densities; many touch the frame."""
    rng = np.random.default_rng(seed)
    noise = rng.random((PICTURES, *shape))
    noise[1::2] = ndimage.gaussian_filter(noise[1::2], (0.0, 1.0, 1.0), mode="nearest")
    levels = np.quantile(noise, 0.5, axis=(1, 2)) + rng.uniform(-0.3, 0.3, PICTURES) * noise.std(
        axis=(1, 2)
    )
    return noise < levels[:, np.newaxis, np.newaxis]


def black(cells: np.ndarray) -> np.ndarray:
    return np.where(cells, 1.0, -1.0)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_hole_fills_two_hundred_pictures(shape: tuple[int, int]) -> None:
    cells = pictures(shape, 1)
    filled = run(None, get_template("HOLE"), input=black(cells))
    expected = np.stack([ndimage.binary_fill_holes(picture) for picture in cells])
    np.testing.assert_array_equal(filled.output, black(expected))


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("name", ["CCD_HOR", "CCD_VERT"])
def test_components_of_two_hundred_pictures_are_counted(name: str, shape: tuple[int, int]) -> None:
    cells = pictures(shape, 2)
    counted = run(None, get_template(name), state=black(cells))
    lines = cells if name == "CCD_HOR" else cells.swapaxes(1, 2)
    packed = np.stack([[packed_runs(line) for line in picture] for picture in lines])
    expected = packed if name == "CCD_HOR" else packed.swapaxes(1, 2)
    np.testing.assert_array_equal(counted.output, black(expected))


@pytest.mark.parametrize("name", ENGINES)
def test_life_is_the_digital_game_for_a_hundred_generations(name: str) -> None:
    alive = np.random.default_rng(3).random((20, 8, 8)) < 0.4
    white = np.full(alive.shape, -1.0)
    start = np.stack([white, white, black(alive)], axis=1)
    played = run(name, get_template("LIFE"), state=start, duration=200.0)
    for _ in range(100):
        alive = next_generation(alive)
    assert alive.any()
    np.testing.assert_array_equal(played.output[:, 2], black(alive))


@pytest.mark.parametrize("name", ENGINES)
def test_a_maximum_spreads_down_a_slope_as_poissons_law_says(name: str) -> None:
    """x_j' = 3·0.125·(x_{j+1} − x_j): a value comes from k cells on with Poisson's weight."""
    cols = np.arange(9)
    slope = np.broadcast_to(0.1 * cols - 0.4, (5, 9))
    pictures = np.stack([slope, slope[:, ::-1]])
    time = 4.0
    got = run(name, get_template("GLOBMAX"), state=pictures, duration=time).state
    weights = poisson.pmf(np.arange(9), 0.375 * time)
    below = [weights[: 8 - j] @ (slope[0, j:8] - slope[0, 8]) for j in cols]
    expected = slope[0, 8] + np.array(below)
    # ten times the relative tolerance 1e-4, as the errors of the steps add up
    np.testing.assert_allclose(got[0], np.broadcast_to(expected, (5, 9)), atol=1e-3)
    np.testing.assert_allclose(got[1], np.broadcast_to(expected[::-1], (5, 9)), atol=1e-3)


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize(("template", "grows"), [("PROP1", 1.0), ("PROP2", -1.0)])
def test_trigger_wave_has_the_speed_of_the_refined_line(
    name: str, template: str, grows: float
) -> None:
    wave = get_template(template)
    line = np.where(np.arange(24) < 4, grows, -grows)
    picture = np.broadcast_to(line, (3, 24))
    times = (4.0, 8.0)
    # at times of one run: each duration is a kernel of its own to build
    places = run(name, wave, state=picture, at=times).output[:, 1].sum(axis=1) / 2
    expected = [
        float(np.clip(line_after(line[np.newaxis], (3.0, 0.25), wave.z[0], t), -1, 1).sum()) / 2
        for t in times
    ]
    speed, exact = (np.diff(p)[0] / 4.0 for p in (places, expected))
    assert abs(exact) > 0.2
    # each place is off by at most the 0.02 that the check of the template allows, over 4 τ
    assert speed == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("name", ENGINES)
def test_delayed_wave_moves_one_cell_a_delay(name: str) -> None:
    start = np.full((5, 9), -1.0)
    start[2, 0] = 1.0
    wave = get_template("DELAYED_WAVE")
    outputs = run(name, wave, state=start, at=(5.0, 15.0, 25.0, 35.0)).output
    assert (outputs[:, 2] > 0.99).sum(axis=1).tolist() == [2, 3, 4, 5]
