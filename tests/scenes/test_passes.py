"""Passes over a scene: each begins at the first frame, whatever became of the one before."""

from itertools import islice

import numpy as np
import pytest

import cnnum
from cnnum.errors import SceneError


def numbers(record):
    """Everything that a pass gives, to be compared to the bit."""
    fields = {name: record[name].tobytes() for name in record.names}
    return record.times.tolist(), [event.record() for event in record.events], fields


@pytest.fixture(scope="module", params=["simulated", "npz", "mcap", "csv"])
def scene(request, tmp_path_factory):
    """The same scene, of the simulated array and of recordings of it in three formats."""
    changes = {"needs": ["contact", "load_normal"], "array.rate": 50}
    played = cnnum.load_scene("contact", changes=changes)
    if request.param == "simulated":
        return played
    read = played.conversion.reader(played.conversion.channels)
    path = tmp_path_factory.mktemp("recording") / f"played.{request.param}"
    cnnum.Recording(
        [read(frame) for frame in played.driver.frames()],
        rate=played.driver.rate,
        channels=("x", "y", "z"),
        unit="strain",
    ).save(path)
    driver = "file" if request.param == "csv" else request.param
    array = {"driver": driver, "path": str(path)}
    return cnnum.load_scene("contact", changes={**changes, "array": array})


def test_a_second_pass_gives_what_the_first_gave(scene):
    first = scene.collect()
    assert len(first) > 50
    assert first.events
    assert numbers(scene.collect()) == numbers(first)
    assert [e.record() for e in scene.events()] == [e.record() for e in first.events]
    assert scene.summary().frames == len(first)


def test_a_pass_that_was_left_changes_nothing(scene):
    whole = numbers(scene.collect())
    assert len(scene.collect(frames=50)) == 50
    for _ in scene.events():
        break
    assert numbers(scene.collect()) == whole


def test_a_pass_that_another_has_overtaken_ends_with_a_sentence(scene):
    whole = numbers(scene.collect())
    first = scene.results()
    next(first)
    second = scene.results()
    number = [next(second).number for _ in range(3)]
    assert number == [0, 1, 2]
    with pytest.raises(SceneError, match="one pass at a time"):
        next(first)
    assert [moment.number for moment in second] == list(range(3, len(whole[0])))
    assert numbers(scene.collect()) == whole


def test_the_counts_are_those_of_the_pass():
    scene = cnnum.load_scene("contact", changes={"array.rate": 100})
    list(islice(scene.results(), 7))
    assert scene.summary().frames == 7
    list(islice(scene.results(), 5))
    assert scene.summary().frames == 5
    assert scene.summary().handed_on == 5


def test_a_scene_and_a_stream_are_context_managers():
    with cnnum.load_scene("contact") as scene:
        assert len(scene.collect(frames=3)) == 3
    with scene.plan.stream() as stream:
        stream.push(np.zeros((8, 8, len(scene.plan.schedule.channels))))
        assert stream.frames == 1
    assert stream.frames == 0
