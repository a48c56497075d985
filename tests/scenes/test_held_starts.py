"""Streams that begin with the object held: what is said, marked, and learned again."""

import logging

import numpy as np
import pytest

import cnnum
from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.grips import Arrays, power, pulled
from cnnum.drivers.simulated.settings import Phase
from cnnum.frame import FORCE_AXES
from cnnum.lab.scoring.families import bristles
from cnnum.lab.scoring.families.catalogue import begun, in_hold
from cnnum.programs.library import get_program
from cnnum.scenes.pipeline import load_scene
from cnnum.scenes.push_watch import HeldWatch

SCRIPT = (
    Phase("hold", 0.5),
    Phase("press", 0.3, load=1.0),
    Phase("hold", 1.0),
    Phase("pull", 1.0, speed=1.5e-3, direction=0.5),
    Phase("release", 0.3),
    Phase("hold", 1.2),
    Phase("press", 0.3, load=1.0),
    Phase("hold", 0.4),
    Phase("pull", 1.0, speed=1.5e-3, direction=0.5),
)


@pytest.fixture(scope="module")
def strain():
    with SimulatedOptions(script=SCRIPT, rate=100.0, seed=3).open() as array:
        frames = list(array.frames())
        return array.calibration.to_strain(np.stack([frame.values for frame in frames]))


def played(values, caplog):
    channels = ("shear_x", "shear_y", "normal")
    recording = cnnum.Recording(values, rate=100.0, unit="strain", channels=channels)
    changes = {"needs": ["slip"], "program.name": "slip", "program.parameters": {}}
    engine = cnnum.Engine("numba")
    with (
        caplog.at_level(logging.WARNING, "cnnum"),
        load_scene("contact", recording=recording, changes=changes, engine=engine) as scene,
    ):
        events = list(scene.events())
    return events, [each for each in caplog.messages if "begin with the object held" in each]


def test_a_stream_that_begins_in_the_air_has_no_mark(strain, caplog):
    events, said = played(strain, caplog)
    assert len(events) >= 2
    assert not said
    assert not any(event.rest_held for event in events)


def test_events_of_a_held_start_are_marked_until_the_object_is_let_go(strain, caplog):
    """From 0.6 s into the hold on; the object is free 1.7 s later, and touched again at 2.9 s."""
    events, said = played(strain[120:], caplog)
    assert len(said) == 1
    late = [event for event in events if event.time > 3.2]
    assert late
    assert not any(event.rest_held for event in late)
    assert all(event.rest_held for event in events if event.time < 1.9)
    assert "the rest was held" in str(next(event for event in events if event.rest_held))
    assert next(event for event in events if event.rest_held).record()["rest_held"] is True


def test_a_start_in_a_slide_is_said_and_marks_events(strain, caplog):
    """From the middle of the first slide on; the object is let go 0.6 s later."""
    events, _ = played(strain[245:], caplog)
    assert len([each for each in caplog.messages if "define the rest" in each]) == 1
    assert "'rest_held'" in next(each for each in caplog.messages if "define the rest" in each)
    early = [event for event in events if event.time < 1.0]
    assert all(event.rest_held for event in early)
    late = [event for event in events if event.time > 2.6]
    assert late
    assert not any(event.rest_held for event in late)


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize(
    ("body", "make"),
    [("spheres", pulled(power(1.0))), ("bristles", bristles.scene(bristles.slide))],
)
def test_starts_in_a_hold_are_marked_before_they_slip_and_others_never(body, make, held):
    """Of the sphere, the pull alone raises readings by a third of the shear, and lowers others."""
    make = begun(make, in_hold) if held else make
    trial = make(Arrays(), f"held start: {body}", 5_000_002)
    watch, marks = HeldWatch(get_program("slip"), FORCE_AXES), list[bool]()
    for n, frame in enumerate(trial.frames):
        watch.look(frame, n / trial.rate)
        marks.append(watch.held)
    assert any(marks[: trial.onset]) == any(marks) == held
