"""How loads change, over windows that double: two means of m frames, one after the other.

A mean of 2m frames is that of two of m frames, so every window costs one addition more (Haar's
wavelet in time). Short windows are quick, long ones see slow changes through the noise.
"""

from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields

WINDOWS = (2, 4, 8, 16)
"""Frames a mean; a change is seen over twice as many."""


def changes(frame: FrameFields, value: Field) -> tuple[Field, ...]:
    """Return the difference of the last two means of a map, for each of `WINDOWS`.

    White noise of variance v in one frame becomes 2v/m. On the first frames, what lies before
    the stream counts as equal to its first frame.
    """
    total, found = value + frame.previous(value), list[Field]()
    for window in WINDOWS:
        before = delayed(frame, total, window)
        found.append((total - before) / float(window))
        total = total + before
    return tuple(found)


def delayed(frame: FrameFields, value: Field, frames: int) -> Field:
    """Return what a value was a number of frames ago."""
    for _ in range(frames):
        value = frame.previous(value)
    return value
