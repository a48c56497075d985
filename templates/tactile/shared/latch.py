"""Flags that do not chatter: set by what happens, kept until what caused it is over."""

from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields


def latched(frame: FrameFields, holds: Field, event: Field) -> Field:
    """Return a flag that an event sets, and that stays while `holds`."""
    latch = frame.memory(scalar=True, logic=True)
    now = holds & (latch.value | event)
    latch.store(now)
    return now
