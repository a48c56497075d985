"""Simulated materials and their classification, against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from cnnum.errors import ArrayError, MissingExtraError, PhysicsError
from cnnum.tactile import texture_materials
from cnnum.tactile.texture_materials import (
    FOUR,
    Bump,
    Material,
    Stroke,
    classify,
    draw_samples,
    envelope,
    features,
    profile,
    rub,
)

STEP = 4e-6
FLAT = Material("glass", "grain", 0.4, 1e-12, 0.3e-3, spread=0.0)
QUIET = Bump(noise=0.0)


def test_two_gaussians_are_distinguished_as_well_as_can_be() -> None:
    # Two classes a distance d apart in one feature: the best share is Φ(d/2).
    rng = np.random.default_rng(0)
    count, distance = 8000, 2.0
    labels = np.repeat([0, 1], count)
    logs = rng.normal(size=(2 * count, 2)) + distance * np.stack([labels, 0 * labels], axis=-1)
    found = classify(np.exp(logs), labels, np.arange(2 * count), names=("a", "b"))
    # 16 000 draws know a share of 0.84 to 0.3 %; three of those
    assert found.accuracy == pytest.approx(norm.cdf(distance / 2), abs=0.009)
    assert found.confusion.sum() == 2 * count
    assert found.recall == pytest.approx(2 * [norm.cdf(distance / 2)], abs=0.015)


def test_groups_do_not_leak() -> None:
    # Tight clusters with labels drawn at random: only a torn group could be classified right.
    rng = np.random.default_rng(1)
    centres, labels = rng.normal(size=(60, 2)), rng.permutation(np.repeat([0, 1], 30))
    logs = np.repeat(centres, 40, axis=0) + 1e-3 * rng.normal(size=(2400, 2))
    truth, groups = np.repeat(labels, 40), np.repeat(np.arange(60), 40)
    found = classify(np.exp(logs), truth, groups, names=("a", "b"))
    assert found.accuracy < 0.7  # half, and three deviations of 60 clusters


def test_four_materials_are_distinguished() -> None:
    drawn = draw_samples(strokes=8, per_stroke=20)
    found = classify(drawn.features, drawn.material, drawn.stroke, names=drawn.names)
    assert len(drawn.features) == 4 * 8 * 20
    assert found.confusion.sum(axis=1) == pytest.approx(160)
    assert found.recall.min() > 0.5
    shuffled = np.random.default_rng(2).permutation(drawn.material)
    assert classify(drawn.features, shuffled, drawn.stroke, names=drawn.names).accuracy < 0.4


def test_flat_surface_shows_its_friction_and_no_roughness() -> None:
    signals = rub(FLAT, Stroke(), np.random.default_rng(3), QUIET)
    friction, roughness = features(signals).T
    assert friction == pytest.approx(0.4 * QUIET.shear_gain / QUIET.normal_gain, rel=1e-5)
    assert roughness == pytest.approx(0.0, abs=1e-4)


def test_force_is_hertz() -> None:
    deep = [Stroke(indentation=d) for d in (50e-6, 100e-6)]
    normal = [rub(FLAT, s, np.random.default_rng(3), QUIET)[:, 2] for s in deep]
    assert normal[1] / normal[0] == pytest.approx(2.0**1.5, rel=1e-4)
    # (4/3) E* √R δ^1.5 with E* = E/0.75, within the hand's tenth
    mean = 100.0 * 4.0 / 3.0 * 0.87e6 / 0.75 * math.sqrt(200e-6) * 50e-6**1.5
    assert np.abs(normal[0] / mean - 1.0).max() <= 0.1 + 1e-6


def test_turning_the_motion_turns_the_shear() -> None:
    strokes = [Stroke(direction=turn) for turn in (0.3, 0.3 + math.pi / 2)]
    first, second = (rub(FOUR[3], s, np.random.default_rng(4), QUIET) for s in strokes)
    assert second[:, 0] == pytest.approx(-first[:, 1])
    assert second[:, 1] == pytest.approx(first[:, 0])
    assert second[:, 2] == pytest.approx(first[:, 2])


def test_round_tip_rides_over_a_needle_as_a_circle() -> None:
    trace = np.full(401, -1.0)
    trace[200] = 0.0
    x = STEP * (np.arange(401) - 200)
    seen = envelope(trace, 200e-6)
    near = np.abs(x) <= 150e-6
    assert seen[near] == pytest.approx(np.sqrt(200e-6**2 - x[near] ** 2) - 200e-6)
    assert (seen >= trace).all()


def test_round_tip_follows_what_is_flatter_than_itself() -> None:
    x = STEP * np.arange(2000)
    height, wave = 2e-6, 0.5e-3  # curvature 2e-6 (2π/0.5 mm)² = 316/m, the tip's is 5000/m
    trace = height * np.cos(2.0 * math.pi * x / wave)
    crests = np.flatnonzero(np.abs(trace - height) < 1e-12)
    assert len(crests) >= 10
    assert envelope(trace, 200e-6)[crests] == pytest.approx(height)
    valley = envelope(trace, 200e-6)[100:-100].min()
    assert valley == pytest.approx(-height, abs=1e-9)


@pytest.mark.parametrize("material", FOUR, ids=lambda material: material.name)
def test_profiles_have_their_height_and_length(material: Material) -> None:
    trace = profile(material, 0.2, np.random.default_rng(5))
    size = {
        "thread": np.ptp(trace) / 2.0,
        "grain": trace.std(),
        "weave": trace.std() * math.sqrt(2.0 / 1.25),  # (1 + ¼) is the mean of (1 + n/2)²
        "teeth": np.sort(trace)[-len(trace) // 200 :].mean() / 1.4,
    }[material.kind]
    # 0.2 m holds some hundred correlation lengths of a random profile
    assert size == pytest.approx(material.height, rel=0.15)


def test_a_stretched_material_is_as_rough_as_its_slopes() -> None:
    smooth = replace(FOUR[0], height=10e-6, spread=0.0)
    gentle = replace(smooth, length=2.0 * smooth.length, height=20e-6)
    means = [
        features(rub(m, Stroke(indentation=90e-6), np.random.default_rng(6), QUIET))[:, 1].mean()
        for m in (smooth, gentle)
    ]
    # the longer wave is averaged less by the contact (0.27 mm wide) at equal slopes
    assert means[1] > means[0]


def test_wrong_input_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    ones = np.ones((4, 2))
    with pytest.raises(ArrayError, match="same samples"):
        classify(ones, [0, 1], [0, 1], names=("a", "b"))
    with pytest.raises(ArrayError, match="positive"):
        classify(0.0 * ones, [0, 1, 0, 1], [0, 1, 2, 3], names=("a", "b"))
    with pytest.raises(PhysicsError, match="must be positive"):
        replace(FLAT, friction=0.0)
    with pytest.raises(PhysicsError, match="'kind'"):
        replace(FLAT, kind="silk")

    def absent(name: str) -> object:
        raise ImportError(name)

    monkeypatch.setattr(texture_materials, "import_module", absent)
    with pytest.raises(MissingExtraError, match="'\\.\\[texture\\]'"):
        classify(ones, [0, 1, 0, 1], [0, 1, 2, 3], names=("a", "b"))
