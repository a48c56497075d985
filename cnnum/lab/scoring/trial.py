"""A trial: frames of one array, with the truth of each."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Frames of one array, with the truth of each.

    Attributes
    ----------
    family : str
        The group of its score: a family of scenes, or an object.
    name : str
        For people.
    rate : float, Hz
        Frames a second.
    frames : (frames, rows, cols, 3) float32
        Shear x, shear y, normal.
    slips : (frames,) float
        1 where the object slips, 0 where it does not, NaN where that is not known.
    scored : (frames,) bool
        Frames in which a report counts.
    early : (frames,) bool
        Frames before a slip in which a report is no false one.
    slid : (frames,) float, m
        Sliding from the start of the trial on.
    sense : (frames,) int
        Of a twist that slips, +1 or −1; 0 elsewhere.
    direction : float, rad
        Of the slip; NaN without one or where it is not known.
    rows : (frames,) int
        Row of the log that each frame came from.
    setting : mapping
        Facts of the array for a program, as its parameters.
    """

    family: str
    name: str
    rate: float
    frames: NDArray[np.float32]
    slips: Floats
    scored: Flags
    early: Flags
    slid: Floats
    sense: NDArray[np.int64]
    direction: float
    rows: NDArray[np.int64]
    setting: Mapping[str, float | bool] = field(default_factory=dict[str, "float | bool"])

    @property
    def shape(self) -> Shape:
        """Rows and columns."""
        return (int(self.frames.shape[1]), int(self.frames.shape[2]))

    @property
    def seconds(self) -> float:
        """How long reports counted, s."""
        return float(self.scored.sum()) / self.rate

    @property
    def slides(self) -> bool:
        """Whether the object slips at any time that counts."""
        return bool((self.scored & (self.slips > 0)).any())

    @property
    def onset(self) -> int:
        """First frame of the first slip; the number of frames without one."""
        return first(self.scored & (self.slips > 0))


def first(flags: Flags) -> int:
    """Return the place of the first flag that is set; the number of flags without one."""
    return int(np.argmax(flags)) if flags.any() else len(flags)


def runs(flags: Flags) -> list[tuple[int, int]]:
    """Return where flags are set in a row: the first place, and the one after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
