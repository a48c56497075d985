"""Dead taxels take their values from their nearest living neighbours."""

from dataclasses import replace

import numpy as np
import pytest

from cnnum.errors import SceneError
from cnnum.frame import Frame
from cnnum.scenes.conversion import DeadCells
from cnnum.scenes.pipeline import load_scene

SCRIPT = [
    {"kind": "hold", "duration": 0.2},
    {"kind": "press", "load": 1.0, "duration": 0.2},
    {"kind": "hold", "duration": 0.1},
]


def test_the_ring_around_it_is_its_mean():
    values = np.arange(60.0).reshape(4, 5, 3)
    got = DeadCells([(1, 2)], (4, 5)).filled(values)
    ring = [values[r, c] for r in (0, 1, 2) for c in (1, 2, 3) if (r, c) != (1, 2)]
    np.testing.assert_allclose(got[1, 2], np.mean(ring, axis=0), rtol=1e-15)
    got[1, 2] = values[1, 2]
    np.testing.assert_array_equal(got, values)


def test_a_corner_whose_neighbours_are_dead_looks_further():
    cells = [(0, 0), (0, 1), (1, 0), (1, 1)]
    values = np.zeros((3, 3, 1))
    values[2, 2] = 5.0
    got = DeadCells(cells, (3, 3)).filled(values)
    assert got[0, 0, 0] == pytest.approx(5.0 / 5, rel=1e-15)  # five taxels at a distance of 2
    assert got[1, 1, 0] == pytest.approx(5.0 / 5, rel=1e-15)  # five living ones at 1


def test_what_a_dead_taxel_reads_is_not_looked_at():
    values = np.ones((2, 2, 1))
    values[0, 1] = np.nan
    frame = DeadCells([(0, 1)], (2, 2)).without(Frame(values, ("normal",), "V", 0, 0.0))
    assert frame.values.ravel().tolist() == [1.0, 0.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("cells", "words"), [([(0, 4)], r"\[0, 4\], expected"), ([(0, 0), (0, 1)], "every taxel")]
)
def test_wrong_taxels_get_one_sentence(cells, words):
    with pytest.raises(SceneError, match=words):
        DeadCells(cells, (1, 2))


def test_a_scene_runs_on_with_a_taxel_that_is_bad_in_every_frame():
    changes = {"array.script": SCRIPT, "frames.dead": [[3, 4]]}
    scene = load_scene("contact", changes=changes)
    way = scene.path()
    kinds = []
    for number, frame in enumerate(scene.driver.frames()):
        values = frame.values.copy()
        values[3, 4] = (np.nan, np.inf, 1e22, -1e30)
        moment = way.step(number, replace(frame, values=values))
        assert moment.error is None
        kinds += [event.kind for event in moment.events]
        rows, cols = np.array([(r, c) for r in (2, 3, 4) for c in (3, 4, 5)]).T
        near = np.delete(moment.values[rows, cols], 4, axis=0).mean(axis=0)
        np.testing.assert_allclose(moment.values[3, 4], near, rtol=1e-12)
    assert kinds == ["contact"]


@pytest.mark.parametrize("dead", ["[3, 4]", [3, 4], [[3]], [[3.5, 4]], [[True, 1]], [[8, 0]]])
def test_scenes_that_name_no_taxel_are_refused(dead):
    with pytest.raises(SceneError, match=r"'frames\.dead'"):
        load_scene("contact", changes={"array.script": SCRIPT, "frames.dead": dead})


@pytest.mark.parametrize("value", [0, -1.0, "5 V", True, float("inf"), float("nan")])
def test_ranges_that_are_none_are_refused(value):
    with pytest.raises(SceneError, match=r"'frames\.range' must be a positive number"):
        load_scene("contact", changes={"array.script": SCRIPT, "frames.range": value})
