"""Scenes in whole numbers: their ranges are those of their own frames, or of a recording."""

from dataclasses import replace

import numpy as np
import pytest

from cnnum.errors import SceneError
from cnnum.scenes import like_frames
from cnnum.scenes.pipeline import Scene
from cnnum.scenes.scene_file import SceneSpec, read_scene

FRAMES = 95
SPEC = SceneSpec(
    "press",
    ("twist_row", "twist_column"),
    "simulated",
    {"shape": [4, 4]},
    program="twist",
    engine="reference",
    precision="q15",
)


def test_a_scene_gives_its_fields_in_whole_numbers(monkeypatch):
    monkeypatch.setattr(like_frames, "MOST", FRAMES)
    found = Scene.of(SPEC).collect(FRAMES)
    wanted = Scene.of(replace(SPEC, precision="float64")).collect(FRAMES)
    for name in SPEC.needs:
        exact = wanted[name]
        assert np.abs(exact).max() > 0.0
        off = np.abs(found[name] - exact)
        # an input has 2^15 steps; the first touch is some hundreds of them, a press all
        assert off.max() < 1e-2
        assert off[-1] < 1e-3


def test_ranges_may_be_those_of_another_recording(monkeypatch):
    monkeypatch.setattr(like_frames, "MOST", 30)
    scene = Scene.of(replace(SPEC, ranges={"driver": "simulated", "shape": [4, 4], "seed": 5}))
    assert scene.collect(3)["twist_row"].shape == (3,)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"driver": "serial", "driver_options": {"port": "loop://"}}, r"table \[engine.ranges\]"),
        ({"ranges": {"driver": "simulated"}}, "frames of 8×8 taxels .* expected the array's 4×4"),
        ({"precision": "float64", "ranges": {"driver": "npz"}}, "is for whole numbers"),
    ],
)
def test_what_has_no_ranges_is_refused_in_one_sentence(changes, words):
    spec = replace(SPEC, **changes)
    if changes.get("driver") == "serial":
        with pytest.raises(SceneError, match=words):
            like_frames.like_frames(spec, "q15", None, None, None)
        return
    with pytest.raises(SceneError, match=words):
        Scene.of(spec)


def test_the_key_is_read(tmp_path):
    path = tmp_path / "scene.toml"
    head = 'needs = ["contact"]\n[array]\ndriver = "simulated"\n[engine]\nprecision = "q15"\n'
    path.write_text(head + '[engine.ranges]\ndriver = "npz"\npath = "press.npz"\n')
    assert read_scene(path).ranges == {"driver": "npz", "path": "press.npz"}
    path.write_text(head + "[engine.ranges]\npath = 3\n")
    with pytest.raises(SceneError, match="'driver' must be a string"):
        read_scene(path)
