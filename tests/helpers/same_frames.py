"""Frames of a file against those that were written."""

import numpy as np

from cnnum.frame import Frame


def same(one: Frame, other: Frame) -> bool:
    """Whether two frames are the same to the bit."""
    facts = ("sequence", "time", "quality", "truth", "channels", "unit")
    marks = [np.zeros(f.shape, bool) if f.saturated is None else f.saturated for f in (one, other)]
    return (
        all(getattr(one, name) == getattr(other, name) for name in facts)
        and np.array_equal(one.values, other.values)
        and np.array_equal(*marks)
    )
