"""Friction and roughness against the standard library's statistics, as a block and as a stream."""

import statistics

import numpy as np
import pytest

from cnnum.arrays import Floats
from cnnum.errors import ArrayError, PhysicsError
from cnnum.tactile.texture import WINDOW, start, stream, texture


def rubbing(rng: np.random.Generator, frames: int, friction: float, rough: float) -> Floats:
    """Return signals of a rough surface drawn in changing directions under a changing load."""
    angle = np.linspace(0.0, 7.0, frames)
    normal = 1.0 + 0.5 * np.sin(np.linspace(0.0, 20.0, frames))
    ratio = friction * (1.0 + rough * rng.normal(size=frames))
    return (
        np.stack([ratio * np.cos(angle), ratio * np.sin(angle), np.ones(frames)], -1)
        * (normal[:, np.newaxis])
    )


def test_a_window_is_t_plus_1_points_mean_and_unbiased_deviation() -> None:
    signals = rubbing(np.random.default_rng(1), 300, 0.4, 0.1)
    found = texture(signals)
    points = [float(np.hypot(x, y) / abs(n)) for x, y, n in signals]
    for t in (1, 17, WINDOW, 200, 299):
        part = points[max(0, t - WINDOW) : t + 1]
        mean = statistics.fmean(part)
        assert found.count[t] == len(part) == min(t, WINDOW) + 1
        # Sums of 129 numbers, rounded.
        assert found.friction[t] == pytest.approx(mean, rel=1e-12)
        assert found.roughness[t] == pytest.approx(100.0 * statistics.stdev(part) / mean, rel=1e-10)
    assert not found.valid[0]
    assert found.valid[1:].all()


def test_stream_gives_the_numbers_of_the_block() -> None:
    rng = np.random.default_rng(2)
    signals = rng.normal(size=(150, 3, 2, 3)) + np.array([0.5, 0.0, 1.0])
    block = texture(signals, window=32, threshold=0.4)
    state = start(window=32, threshold=0.4)
    for t, frame in enumerate(signals):
        state, now = stream(state, frame)
        for name in ("friction", "roughness"):
            # The same sums in the same order, but over another memory layout.
            np.testing.assert_allclose(getattr(now, name), getattr(block, name)[t], rtol=1e-12)
        np.testing.assert_array_equal(now.count, block.count[t])
        np.testing.assert_array_equal(now.valid, block.valid[t])


def test_friction_and_roughness_are_those_of_the_surface() -> None:
    signals = rubbing(np.random.default_rng(3), 4000, 0.6, 0.08)
    found = texture(signals, window=3999)
    # 4000 points know the mean to 0.13 % and the deviation to 1.1 %: three of those.
    assert found.friction[-1] == pytest.approx(0.6, rel=0.004)
    assert found.roughness[-1] == pytest.approx(8.0, rel=0.035)


def test_direction_and_load_do_not_matter() -> None:
    signals = rubbing(np.random.default_rng(4), 200, 0.5, 0.2)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, -1.0]])
    plain, turned = texture(signals), texture(7.0 * signals @ turn.T)
    np.testing.assert_allclose(turned.friction, plain.friction, rtol=1e-12)
    np.testing.assert_allclose(turned.roughness, plain.roughness, rtol=1e-9)


def test_frames_without_contact_do_not_count() -> None:
    signals = rubbing(np.random.default_rng(5), 100, 0.5, 0.1)
    gaps = signals.copy()
    gaps[::2] = [9.0, 9.0, 1e-6]
    found = texture(gaps, window=40, threshold=1e-3)
    only = texture(signals[1::2], window=20)
    assert found.count[99] == 21
    assert found.friction[99] == pytest.approx(only.friction[-1], rel=1e-12)
    silent = texture(np.zeros((5, 2, 3)))
    assert not silent.valid.any()
    assert (silent.friction == 0.0).all()
    assert (silent.roughness == 0.0).all()


def test_many_frames_are_worked_in_blocks_without_seams() -> None:
    rng = np.random.default_rng(6)
    signals = rng.normal(size=(400, 64, 3)) + np.array([0.0, 1.0, 3.0])
    whole = texture(signals)  # 400 · 64 · 129 points: more than one block
    alone = texture(signals[:, 5])
    np.testing.assert_allclose(whole.roughness[:, 5], alone.roughness, rtol=1e-12)


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(ArrayError):
        texture([0.0, 0.0, 1.0])
    with pytest.raises(PhysicsError):
        texture(np.full((4, 3), np.nan))
    with pytest.raises(PhysicsError):
        start(window=0)
    state, _ = stream(start(), np.zeros((2, 3)))
    with pytest.raises(ArrayError, match="use a new stream"):
        stream(state, np.zeros((3, 3)))
