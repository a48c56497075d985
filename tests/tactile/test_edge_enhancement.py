"""Edge enhancement: where outlines pass, against straight edges, punches and the band-pass."""

from functools import partial

import numpy as np
import pytest
from scipy.fft import dctn, idctn

from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import Transient
from cnnum.graph.schedule import schedule
from cnnum.lab.bench.programs.edge_errors import (
    Skin,
    by_enhancement,
    by_sobel,
    by_steepest,
    by_template,
    found_places,
    tally,
)
from cnnum.lab.bench.programs.edge_scenes import SHARP
from cnnum.programs.library import get_program
from cnnum.tactile.indenters import Disc, Rectangle, frame_under
from cnnum.templates.tactile import edge_enhancement as program
from cnnum.templates.tactile.edge_enhancement import edge_enhancement


def pressed(loads, noise=0.0, seed=0):
    """Frames of rest and then of a load, with the sign of strain and stress."""
    frames = np.random.default_rng(seed).normal(0.0, 1e-9 + noise, (20, *loads.shape, 3))
    frames[18:, ..., 2] -= loads / loads.max()
    return frames


def band_pass(frame):
    """4 s²K/(1 + s²K)² of a frame with a mirror at its rim, s² = 0.5, by its cosine modes."""
    halves = [2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in frame.shape]
    half = 0.5 * (halves[0][:, None] + halves[1])
    return idctn(dctn(frame, norm="ortho") * 4.0 * half / (1.0 + half) ** 2, norm="ortho")


@pytest.mark.parametrize("reads", ["strain", "stress"])
@pytest.mark.parametrize("depth", [0.1, 0.3, 0.667, 1.0])
def test_a_straight_edge_lies_where_it_is_through_any_cover(numba, run, depth, reads):
    """A half-plane that is pressed evenly: by symmetry of the cover and of the template.

    The load ends midway between two taxels, and at a taxel. Love's solution for a rectangle that is
    far wider than the array; its other edges are 40 pitches away, and the rim of the array mirrors.
    """
    for at in (0.5, 0.0):  # cells from the middle of an array of 16 or 17 columns
        columns = 16 if at == 0.5 else 17
        edge = Rectangle(40.0, 80.0, 0.0, (-20.0, 0.0))
        got = run(numba, edge_enhancement, pressed(frame_under(edge, (9, columns), depth, reads)))
        places = found_places(got["edge_to_right"][-1], got["edge_to_below"][-1])
        middle = places[np.abs(places[:, 0] - 4) < 2]
        assert len(middle) == 3
        np.testing.assert_allclose(middle[:, 1], (columns - 1) / 2, atol=0.03)


@pytest.mark.parametrize("engine", ["fast", "reference"], indirect=True)
def test_the_enhanced_frame_is_the_band_pass_of_the_load(engine, run):
    load = frame_under(Disc(2.1, (0.3, -0.2), "punch"), (8, 8), 0.5, "strain")
    got = run(engine, edge_enhancement, pressed(load))
    wanted = band_pass(load / load.max())
    np.testing.assert_allclose(got["edge_enhanced"][-1], wanted, atol=2e-6)
    # lateral inhibition: an even pressure fades, and the surround is below 0
    assert abs(got["edge_enhanced"][-1].sum()) < 1e-4
    assert wanted.min() < -0.05


@pytest.mark.parametrize("name", ["ring", "bar", "triangle", "two punches"])
def test_outlines_are_nearer_than_by_the_usual_gradient(numba, name):
    """Through covers that the program does not know; twice as near as Sobel's cells and EDGE's."""
    bodies = SHARP[name](np.random.default_rng(201), 8, 8)
    skins = [Skin(depth=0.1, reads="stress"), Skin(depth=0.3), Skin(depth=0.667)]
    ours = tally(partial(by_enhancement, numba), bodies, skins)
    assert ours.edged == ours.of
    assert ours.met > 0.9
    assert np.median(ours.off) < 0.25
    assert np.quantile(ours.off, 0.95) < 0.65
    for other in (by_sobel, partial(by_template, numba)):
        assert np.median(tally(other, bodies, skins).off) > 1.4 * np.median(ours.off)
    assert np.median(tally(by_steepest, bodies, skins).off) > np.median(ours.off)


def test_the_noise_of_a_fall_is_that_of_the_band_pass():
    waves = (np.arange(256) + 0.5) / 256 * 2.0 * np.pi
    across, down = np.meshgrid(waves, waves)
    half = 2.0 - np.cos(across) - np.cos(down)
    fall = 4.0 * half / (1.0 + half) ** 2 * np.abs(1.0 - np.exp(1j * across))
    assert np.sqrt(np.mean(fall**2)) == pytest.approx(program.NOISE_GAIN, abs=1e-3)


def test_noise_alone_has_no_outline(numba):
    frames = np.random.default_rng(4).normal(0.0, 1e-3, (2000, 8, 8, 3))
    stream = numba.compile(get_program("edge_enhancement"), (8, 8), ["edge_count"]).stream(
        rate=200.0
    )
    assert not any(stream.push(frame)["edge_count"] for frame in frames)


@pytest.mark.parametrize("shape", [(1, 12), (2, 9), (5, 5)])
def test_small_arrays_run(numba, run, shape):
    load = np.zeros(shape)
    load[:, 2:5] = 1.0
    got = run(numba, edge_enhancement, pressed(load))
    row = got["edge_to_right"][-1][0]
    found = np.flatnonzero(row >= 0.0) + row[row >= 0.0]
    wanted = [1.5] if shape[1] == 5 else [1.5, 4.5]
    np.testing.assert_allclose(found, wanted, atol=0.3)


def test_the_program_is_made_of_templates():
    """The wave with feedback is `tactile_edge`; the rest are edge templates and shifts."""
    plan = schedule(edge_enhancement.trace((8, 8)), FORCE_AXES, None)
    runs = (node.operation for node in plan.nodes)
    names = [run.template.name for run in runs if isinstance(run, Transient)]
    assert names.count("tactile_edge") == 1
    assert sum(name.startswith("edge_step") for name in names) == 2
    assert {"gradient_x", "gradient_y"} <= set(names)
