"""A frame's picture: which way arrows go, the meaning of a colour, where circles lie."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cnnum.report import SceneRecord
from cnnum.report.pictures import CELL, MapScale, frame_picture
from cnnum.sharing import DARK, LIGHT, STEPS, scale, step

ROW, COL = 1, 2


@pytest.fixture
def pulled(record: SceneRecord) -> SceneRecord:
    """One taxel is pushed and pulled towards −y in every frame; the others read nothing."""
    values = np.zeros_like(record.values)
    values[:, ROW, COL] = (0.0, 0.02, -0.04)
    return replace(record, values=values)


def drawn(record: SceneRecord, frame: int = 30) -> str:
    return frame_picture(record, frame, MapScale.of(record), "label")


def test_scales_hold_all_frames_and_are_round(pulled: SceneRecord) -> None:
    assert MapScale.of(pulled) == MapScale(normal=0.04, shear=0.02)


@pytest.mark.parametrize(("push", "way", "colour"), [(-1, -1.0, STEPS), (1, 1.0, 0)])
def test_an_arrow_goes_with_the_pull_and_a_push_is_at_the_high_end(
    pulled: SceneRecord, push: int, way: float, colour: int
) -> None:
    text = drawn(replace(pulled, push=push))
    arrows = re.search(r'class="arrow" d="M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)', text)
    assert arrows is not None
    x, y, tip_x, tip_y = map(float, arrows.groups())
    assert (x, y) == (CELL * (COL + 0.5), CELL * (ROW + 0.5))
    # two digits in the text
    assert (tip_x - x, tip_y - y) == pytest.approx((0.0, way * CELL), abs=0.01)
    assert f'class="k{colour}" d="M{10 * COL} {10 * ROW}h10' in text


def test_circles_are_to_scale(record: SceneRecord) -> None:
    unit = CELL / 1.5  # the pitch is 1.5 mm
    rows, cols = record.shape
    found = re.findall(r'class="(\S*outline)" cx="(\S+)" cy="(\S+)" r="(\S+)"', drawn(record))
    assert [name for name, *_ in found] == ["outline", "stick-outline"]
    for (_, x, y, radius), size in zip(found, (2.0, 1.0), strict=True):
        expected = (CELL * cols / 2 + 0.3 * unit, CELL * rows / 2 - 0.2 * unit, size * unit)
        assert (float(x), float(y), float(radius)) == pytest.approx(expected, abs=0.01)


def test_without_contact_or_pitch_there_is_no_circle(record: SceneRecord) -> None:
    assert "<circle" not in drawn(record, 10)
    assert "<circle" not in drawn(replace(record, pitch=None))


def test_the_outline_of_a_seen_contact_runs_around_its_cells(record: SceneRecord) -> None:
    seen = np.zeros_like(record.outputs["contact_map"])
    seen[:, 1, 1:3] = 1.0
    text = drawn(replace(record, outputs={"contact_map": seen}))
    (way,) = re.findall(r'class="detected in-contact" d="([^"]*)"', text)
    assert set(re.findall(r"M\S+ \S+?[hv]10", way)) == {
        "M10 10h10",
        "M20 10h10",
        "M10 20h10",
        "M20 20h10",
        "M10 10v10",
        "M30 10v10",
    }


def test_nothing_is_drawn_for_a_frame_that_did_not_run(record: SceneRecord) -> None:
    text = drawn(record, 5)
    assert 'class="k' not in text
    assert 'class="arrow"' not in text


@pytest.mark.parametrize("anchors", [LIGHT, DARK])
def test_lightness_of_a_scale_only_rises_or_falls_from_its_middle(
    anchors: tuple[tuple[float, float, float], ...],
) -> None:
    def luminance(colour: str) -> float:
        red, green, blue = (int(colour[n : n + 2], 16) for n in (1, 3, 5))
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    values = np.array([luminance(colour) for colour in scale(anchors)])
    half = STEPS // 2
    steps = np.diff(values) * np.sign(values[half] - values[0])
    # a step of the rounded channels may be lost
    assert (steps[:half] > -1).all()
    assert (steps[half:] < 1).all()


def test_a_step_of_the_scale_is_that_of_the_value() -> None:
    assert [step(value, 2.0) for value in (-9.0, -2.0, 0.0, 2.0, 9.0)] == [0, 0, 32, 64, 64]
    assert step(1.0, 0.0) == STEPS // 2
