"""Flags that do not chatter: set by what lasts, kept until what caused it is over."""

from cnnum.programs.fields import Field, maximum, where
from cnnum.programs.machine import FrameFields

RELEASED = 0.7
"""Share of its largest value below which a pull is over."""


def lasting(frame: FrameFields, size: Field, there: Field) -> Field:
    """Return whether a load that is there is still near its largest value."""
    peak = frame.memory(scalar=True)
    largest = where(there, maximum(peak.value, size), 0.0)
    peak.store(largest)
    return there & (size > RELEASED * largest)


def latched(frame: FrameFields, holds: Field, event: Field) -> Field:
    """Return a flag that an event sets, and that stays while `holds`."""
    latch = frame.memory(scalar=True, logic=True)
    now = holds & (latch.value | event)
    latch.store(now)
    return now


def twice(frame: FrameFields, event: Field) -> Field:
    """Return whether an event holds in this frame and in the one before."""
    return event & frame.previous(event)
