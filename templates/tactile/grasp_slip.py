"""Slip of an object that is already held, from raw counts of one pad or of several on one frame.

Nothing here is calibrated and no frame shows the unloaded skin, so friction, contact and stick
radius cannot be had: `slip` is the program for arrays that saw the touch begin. What is left is
that slip takes two things at once, a pull and a contact that rearranges, both measured against
the noise of the grasp while still:

    score = √(pull · activity) / noise,

pull: how far the mean shear has moved from where it rests; activity: RMS over the taxels of the
change from frame to frame, without the pad's mean change (a pull without slip moves all taxels
alike), averaged over `window`; noise: the activity while still. The pad that shows more counts.
The score knows no direction and no common gain. It is a score of slip by motion: steady sliding
of a smooth body changes no taxel, and it falls.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cnnum.errors import ProgramError
from cnnum.frame import FORCE_AXES
from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, sqrt, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.templates.tactile.shared.loads import square

START = 0.5
"""s. The grasp must be still at the start of a stream: noise and rest are learned from it."""

FORGET = 2.0
"""s. Time constant of noise and rest later, while still."""

STILL = 2.0
"""Noise floors below which activity and drift count as still."""

SMOOTH = 0.05
"""s. Smoothing of the pull before its turns are judged."""

TURN = 0.7
"""A pull that falls to this share of its peak has turned: what sticks again can slip again."""


@dataclass(frozen=True, slots=True)
class Pad:
    """What one pad shows.

    Attributes
    ----------
    shear_x, shear_y : Field
        Mean shear against rest, counts.
    pull, activity, noise : Field
        Counts.
    """

    shear_x: Field
    shear_y: Field
    pull: Field
    activity: Field
    noise: Field


@program
def grasp_slip(
    frame: FrameFields,
    *,
    pads: int = 1,
    rate: float = 60.0,
    window: float = 0.2,
    threshold: float = 6.0,
) -> Mapping[str, Field]:
    """Slip of a held object.

    Parameters
    ----------
    frame : FrameFields
        Raw counts, the pads side by side in the columns.
    pads : int
        How many.
    rate : float, Hz
        Frames a second.
    window : float, s
        Over which activity is averaged: below half a swing of the held object.
    threshold : float
        Score, in noise floors, from which a pull is a slip. On the four recorded trials that it
        was set with, 5.8 to 6.4 give every labelled slip and no other trial.

    Returns
    -------
    mapping
        `gross_slip` (flag, until the pull turns; incipient slip cannot be told without having
        seen the touch), `slip_x`, `slip_y` (unit vector of the shear's change on the pad that is
        pulled most), `slip_strength` (the score).

    Raises
    ------
    ProgramError
        If the columns cannot be divided among the pads.
    """
    refuse_outside(rate=(rate, 1e-3, 1e6), window=(window, 1e-6, 1e6))
    count = _counter(frame)
    seen = [_pad(frame, columns, count, rate, window) for columns in _columns(frame, pads)]
    still = (count <= START * rate) | _all([pad.still for pad in seen])
    known = [pad.learned(frame, count, rate, still) for pad in seen]
    pull, activity = known[0].pull, known[0].activity
    x, y = known[0].shear_x, known[0].shear_y
    for pad in known[1:]:
        more = pad.pull > pull
        x, y = where(more, pad.shear_x, x), where(more, pad.shear_y, y)
        pull, activity = maximum(pull, pad.pull), maximum(activity, pad.activity)
    noise = _mean([pad.noise for pad in known])
    score = where(count > START * rate, sqrt(pull * activity) / noise, 0.0)
    mean_pull = _mean([pad.pull for pad in known])
    return {
        "gross_slip": _reported(frame, mean_pull, score > threshold, rate),
        "slip_x": x / pull,
        "slip_y": y / pull,
        "slip_strength": score,
    }


@dataclass(frozen=True, slots=True)
class _Seen:
    """A pad before it is decided whether the grasp is still."""

    mean_x: Field
    mean_y: Field
    now: Field
    activity: Field
    still: Field
    noise: "_Average"
    rest_x: "_Average"
    rest_y: "_Average"

    def learned(self, frame: FrameFields, count: Field, rate: float, still: Field) -> Pad:
        """Return what the pad shows, rest and noise followed while still."""
        step = where(still, maximum(1.0 / count, 1.0 / (FORGET * rate)), 0.0)
        noise = self.noise.follow(self.now, step)
        x = self.mean_x - self.rest_x.follow(self.mean_x, where(frame.first, 1.0, step))
        y = self.mean_y - self.rest_y.follow(self.mean_y, where(frame.first, 1.0, step))
        return Pad(x, y, sqrt(square(x) + square(y)), self.activity, noise)


class _Average:
    """A number that follows another one."""

    def __init__(self, frame: FrameFields) -> None:
        self._memory = frame.memory(scalar=True)
        self.held = self._memory.value

    def follow(self, value: Field, step: Field) -> Field:
        """Return the average after this frame."""
        now = self.held + step * (value - self.held)
        self._memory.store(now)
        return now


def _pad(frame: FrameFields, columns: Field, count: Field, rate: float, window: float) -> _Seen:
    def mean(value: Field) -> Field:
        return (value * columns).sum()

    changes = [_change(frame, name) for name in FORCE_AXES]
    loose = [change - mean(change) for change in changes]
    now = sqrt(mean(square(loose[0]) + square(loose[1]) + square(loose[2])))
    x, y = mean(frame.shear_x), mean(frame.shear_y)
    # an average of half the window's time constant spans as much as a plain one of the window
    step = maximum(1.0 / count, 2.0 / (window * rate))
    activity = _Average(frame).follow(now, where(frame.first, 0.0, step))
    slow = where(frame.first, 1.0, maximum(1.0 / count, 1.0 / (window * rate)))
    before_x, before_y = _Average(frame), _Average(frame)
    drift = sqrt(square(x - before_x.held) + square(y - before_y.held))
    before_x.follow(x, slow)
    before_y.follow(y, slow)
    noise = _Average(frame)
    quiet = maximum(maximum(activity, now), drift) < STILL * noise.held
    return _Seen(x, y, now, activity, quiet, noise, _Average(frame), _Average(frame))


def _change(frame: FrameFields, name: str) -> Field:
    value = frame.channel(name)
    return value - frame.previous(value)


def _columns(frame: FrameFields, pads: int) -> list[Field]:
    """Return for each pad the map that averages over it."""
    rows, cols = frame.shape
    if pads < 1 or cols % pads:
        raise ProgramError(f"{cols} columns cannot be divided among 'pads' = {pads}.")
    place = np.broadcast_to(np.arange(cols) // (cols // pads), (rows, cols))
    return [frame.constant((place == pad) * (pads / (rows * cols))) for pad in range(pads)]


def _counter(frame: FrameFields) -> Field:
    """Return the number of frames before this one."""
    memory = frame.memory(scalar=True)
    memory.store(memory.value + 1.0)
    return memory.value


def _reported(frame: FrameFields, pull: Field, high: Field, rate: float) -> Field:
    """Return a flag that holds from the first high score of a pull until that pull turns."""
    smooth = _Average(frame).follow(pull, frame.constant(min(1.0, 1.0 / (SMOOTH * rate))))
    falling, turn = frame.memory(scalar=True, logic=True), frame.memory(scalar=True)
    flag = frame.memory(scalar=True, logic=True)
    extreme = where(falling.value, -maximum(-turn.value, -smooth), maximum(turn.value, smooth))
    falls = ~falling.value & (smooth < TURN * extreme)
    rises = falling.value & (TURN * smooth > extreme)
    falling.store(falls | (falling.value & ~rises))
    turn.store(where(falls | rises, smooth, extreme))
    now = ~falls & (rises | ~falling.value) & (flag.value | high)
    flag.store(now)
    return now


def _all(flags: list[Field]) -> Field:
    together = flags[0]
    for flag in flags[1:]:
        together = together & flag
    return together


def _mean(values: list[Field]) -> Field:
    return sum(values[1:], start=values[0]) / float(len(values))
