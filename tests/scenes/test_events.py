"""Flags become events when they change, with the fields of the rule."""

import math

import numpy as np
import pytest

from cnnum.scenes.events import EVENT_RULES, Event, EventDetector, rules_that_fit

CONTACT, SLIP, TWIST = EVENT_RULES["contact"], EVENT_RULES["slip"], EVENT_RULES["twist"]


def outputs(rules, **values):
    names = {name for rule in rules for name in rule.needs}
    return {name: np.asarray(float(values.get(name, 0.0))) for name in names}


def test_contact_begins_and_ends_once():
    detector = EventDetector(CONTACT)
    events = []
    for frame, touched in enumerate([0, 1, 1, 1, 0, 0, 1]):
        now = outputs(CONTACT, contact=touched, contact_row=2.0, contact_column=3.0)
        events += detector.update(frame * 0.1, frame, now)
    assert [(e.kind, e.frame) for e in events] == [("contact", 1), ("release", 4), ("contact", 6)]
    assert events[0].where == (2.0, 3.0)
    assert events[0].time == 0.1


def test_flag_that_holds_from_the_start_is_an_event():
    (event,) = EventDetector(CONTACT).update(0.0, 0, outputs(CONTACT, contact=1))
    assert event.kind == "contact"


def test_people_read_words_and_programs_names():
    event = Event(0.0, "pressure_end", 3)
    assert event.title == "pressure end"
    assert "pressure end" in str(event)
    assert event.record()["kind"] == "pressure_end"
    assert Event(0.0, "slip", 3, phase="gross").title == "gross slip"


def test_slip_has_phase_and_direction():
    detector = EventDetector(SLIP)
    detector.update(0.0, 0, outputs(SLIP))
    values = {"slip_x": -1.0, "slip_y": 1.0, "slip_strength": 7.0}
    (first,) = detector.update(0.1, 1, outputs(SLIP, incipient_slip=1, **values))
    (second,) = detector.update(0.2, 2, outputs(SLIP, incipient_slip=1, gross_slip=1, **values))
    assert (first.phase, second.phase) == ("incipient", "gross")
    assert math.isclose(first.direction, 0.75 * math.pi)
    assert second.strength == 7.0
    assert not detector.update(0.3, 3, outputs(SLIP))


def test_twist_has_a_sense():
    now = outputs(TWIST, twist=1, twist_sense=-1.0, twist_row=1.0, twist_column=2.0)
    (event,) = EventDetector(TWIST).update(0.0, 0, now)
    assert event.sense == -1
    assert "y to x" in str(event)


def test_record_leaves_out_what_is_not_there():
    assert Event(1.5, "release", 30).record() == {"t": 1.5, "kind": "release", "frame": 30}


@pytest.mark.parametrize("pivots", [False, True])
def test_a_slip_is_a_slide_or_a_pivot_with_its_sense_and_centre(pivots):
    values = {"slip_x": 1.0, "slip_y": 0.0, "slip_strength": 0.7, "slip_row": 2.0}
    values |= {"slip_column": 5.0, "slip_sense": -1.0 * pivots, "gross_slip": 1.0}
    values |= {"slip_pivots": 1.0 * pivots, "slip_centred": 1.0 * pivots}
    outputs = {name: np.float64(value) for name, value in values.items()}
    (rule,) = rules_that_fit(["slip"], outputs)
    (event,) = EventDetector((rule,)).update(0.5, 50, outputs)
    assert event.motion == ("pivot" if pivots else "slide")
    assert event.where == ((2.0, 5.0) if pivots else None)
    assert event.sense == (-1 if pivots else None)
    assert ("that pivots" in str(event)) == pivots
    (plain,) = rules_that_fit(["slip"], ("gross_slip", "slip_x", "slip_y", "slip_strength"))
    (event,) = EventDetector((plain,)).update(0.5, 50, outputs)
    assert (event.motion, event.where, event.sense) == (None, None, None)
