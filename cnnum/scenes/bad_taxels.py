"""Gaps, taxel dropouts and silent arrays, none of which is a touch or its end.

A load continues from frame to frame and in its neighbours, changes no faster than the cover can
follow, and has noise. A lost taxel does not: it is not finite or beyond the limits of its range; it
jumps to one number in all its channels, with its whole line, or to 0; its load vanishes between
neighbours that stay loaded; or it jumps alone, or with its line, faster than any load. Such a taxel
is masked: it continues from its last good value as its neighbours do, until it has been steady for
a while.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.errors import FrameError
from cnnum.frame import NORMAL, Frame, Limits, Quality, limits_of
from cnnum.programs.machine import BEGINS, ENOUGH
from cnnum.scenes.events import Event
from cnnum.scenes.saturation import Mask

LONG = 0.1
"""s; a gap at least as long has a record of its own."""

APART = 1.0
"""s between records of shorter gaps, which are counted together."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Scans missing before a frame.

    Attributes
    ----------
    time : float
        s, of the first frame after it.
    frame : int
        Number of that frame.
    seconds : float
        From the frame before to that one; of several gaps the longest.
    missing : int
        Scans.
    gaps : int
        Gaps since the record before, this one among them.
    """

    time: float
    frame: int
    seconds: float
    missing: int
    gaps: int = 1

    def record(self) -> dict[str, object]:
        """Return it as a record of `--json`."""
        return {
            "kind": "gap",
            "t": round(self.time, 6),
            "frame": self.frame,
            "seconds": round(self.seconds, 6),
            "missing": self.missing,
            "gaps": self.gaps,
        }

    def __str__(self) -> str:
        many = f"{self.gaps} gaps, the longest" if self.gaps > 1 else "gap"
        scans = "scan" if self.missing == 1 else "scans"
        return f"{self.time:9.3f} s  {many} {self.seconds:.3f} s, {self.missing} {scans} missing"


class GapWatch:
    """Notices gaps by the flags of the frames."""

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._said = float("-inf")
        self._gaps = self._missing = 0
        self._longest = 0.0

    def seen(self, number: int, frame: Frame) -> Gap | None:
        """Take in a frame, and return the gap that it says, if it is time to say one."""
        last, self._last = self._last, frame
        if last is None or not frame.quality & Quality.DROPPED_BEFORE:
            return None
        seconds = frame.time - last.time
        self._gaps += 1
        self._missing += max(0, frame.sequence - last.sequence - 1)
        self._longest = max(self._longest, seconds)
        if seconds < LONG and 0.0 <= frame.time - self._said < APART:
            return None
        gap = Gap(frame.time, number, self._longest, self._missing, self._gaps)
        self._said, self._gaps, self._missing, self._longest = frame.time, 0, 0, 0.0
        return gap


JUMP = 25.0
"""Step of a reading from frame to frame, over the noise, from which it may be a taxel that is
lost: noise alone never makes it."""

ASIDE = 0.25
"""Part of such a step that no neighbour may have made, where a lost taxel is to be told from a
load, and that may follow in the next frame, where the step was over in one."""

LEFT = 0.1
"""Part of a load at most that is left of it where a taxel is lost."""

LOADED = 0.5
"""Part of that load that two neighbours at least must bear."""

BANDWIDTH = 100.0
"""Hz, the highest frequency of loads on a covered array, unless its scene or layout states it: the
touch of a stiff body on a rubber cover lasts some 10 ms."""

RISE = 0.35
"""Rise time times bandwidth of a system of first order, between 10 and 90 % of a step."""

FINE = 0.002
"""Part of the largest load shown that counts as noise at least: arrays that read 0 below a
threshold have none at rest."""

SPREAD = 6.0
"""Times the noise that readings at rest may be from it."""

LINE = 3
"""Taxels that a row or column must have at least to be judged as one."""

STEADY = 0.1
"""s for which a masked taxel must be whole and make no such step until it counts again, and for
which the same taxels must be no numbers until frames are used without them."""

KEPT = 0.5
"""Part of all taxels that must be left, or the frame is a bad one."""

SILENT = 2.0
"""s for which readings are the same to the bit until a taxel, or the array, is silent."""

LIVELY = 0.5
"""Part of the frames before in which a reading has changed, from which it is known to have noise.
One that is coarser than its noise rests rightly."""

CHANCE = 1e-12
"""Probability below which a repeated reading is no accident of a living taxel: 64 taxels at 1 kHz
seldom reach it in a day. Readings of few levels repeat often, and slow arrays have few frames in
`SILENT`."""

FOLLOWS = 1.0
"""Time, s, over which the noise is averaged."""

SHOWN = 0.05
"""s between looks at the largest loads."""

LISTED = 8
"""Taxels that a sentence names."""

TINY = 1e-30


class Dropouts:
    """Masks the taxels of a scene that are lost.

    Parameters
    ----------
    shape : (rows, cols)
    limits : (low, high), or one pair per channel, optional
        In the driver's unit; a taxel with a value beyond them is lost.
    dead : sequence of (row, column)
        Taxels that are not looked at.
    bandwidth : float, Hz
        Highest frequency of loads: where frames come more than twice in the rise time of such a
        load, one that is there within a single frame is none.
    end : float
        Magnitude from which a value stands at an end of its range: pressed, and not lost.
    quiet : bool
        Whether nothing is said on the logger "cnnum".

    Attributes
    ----------
    masked : (rows, cols) bool or None
        Of the last frame, or None if there is none. It has the taxels whose step is only judged
        with the next frame, too.
    count : int
        Times that a taxel has dropped out.
    """

    def __init__(
        self,
        shape: Shape,
        limits: Limits | None = None,
        dead: Sequence[tuple[int, int]] = (),
        *,
        bandwidth: float = BANDWIDTH,
        end: float = np.inf,
        quiet: bool = False,
    ) -> None:
        self._limits, self._end, self._quiet = limits, end, quiet
        self._rise = RISE / bandwidth
        self._ends: Floats | None = None  # (2, channels): of the limits
        self._looked_at = np.ones(shape, dtype=np.bool_)
        for row, col in dead:
            self._looked_at[row, col] = False
        none = np.zeros(shape, dtype=np.bool_)
        self.masked: Mask | None = None
        self.count = 0
        self._none, self._said, self._odd, self._odd_since = none, none, none, 0.0
        self._lost_before = none  # the masked taxels without those in doubt
        self._begin: list[Floats] = []
        self._began = self._before = 0.0
        self._period = 0.0  # from frame to frame, s
        self._rest: Floats | None = None
        self._power: list[float] | None = None  # of the noise, one a channel
        self._analog: NDArray[np.bool_] | None = None  # whether a channel has noise at rest
        self._alike: NDArray[np.bool_] | None = None  # and a whole line one number now and then
        self._flat_at_rest = False  # whether all channels of a taxel are one number there by chance
        self._span: Floats | None = None  # (2, channels): the loads furthest from rest so far
        self._span_at = 0.0
        self._raw: Floats | None = None  # the last frame as read
        self._earlier: Floats | None = None  # and the one before
        self._shown: Floats | None = None  # and as handed on
        self._lost: Floats | None = None  # what a lost taxel read at first
        self._doubted: Mask | None = None  # taxels whose step is judged with the next frame
        self._doubt: Floats | None = None  # and these steps
        self._doubted_at = 0.0
        self._since = np.zeros(shape)  # when a masked taxel was last out of order, s

    def look(self, frame: Frame) -> Frame:
        """Return a frame with its lost taxels filled in, or the frame itself.

        Raises
        ------
        FrameError
            If too few taxels are left.
        """
        values, time = frame.values, frame.time
        if self.masked is None and self._doubted is None:
            if self._within(values) and self._goes_on(values, time):
                self._odd = self._none
                return frame
            odd = self._odd_ones(values, time)
            if odd is None:
                if not np.isfinite(values).all():
                    return frame  # for now: its values are refused
                if self._goes_on(values, time):
                    return frame
        else:
            odd = self._odd_ones(values, time)
        return self._looked(frame, self._none if odd is None else odd)

    def tare(self) -> None:
        """Relearn rest and noise from the next frames on, for every taxel."""
        self._begin, self._rest, self._power, self._span = [], None, None, None
        self.masked = self._doubted = self._shown = None
        self._lost_before = self._none

    def calm(self) -> dict[str, Any] | None:
        """Return what `Calm` keeps instead of it; None unless all is in order."""
        raw = self._raw
        doubted = self.masked is not None or self._doubted is not None
        if doubted or self._rest is None or self._power is None or raw is None:
            return None
        low, high = self._low_and_high(raw.shape[2])
        return {
            "raw": raw, "earlier": raw if self._earlier is None else self._earlier,
            "rest": self._rest, "power": self._power, "low": low, "high": high,
            "span": 0.0 if self._span is None else self._span, "span_at": self._span_at,
            "before": self._before, "period": self._period,
        }  # fmt: skip

    def went_on(self, kept: Mapping[str, Any]) -> None:
        """Take that back, after frames in which all went on."""
        self._raw, self._earlier, self._span = kept["raw"], kept["earlier"], kept["span"]
        self._power, self._odd = kept["power"].tolist(), self._none
        self._before, self._period = float(kept["before"]), float(kept["period"])
        self._span_at = float(kept["span_at"])

    def _odd_ones(self, values: Floats, time: float) -> Mask | None:
        """Return the taxels that are no numbers, or beyond their limits, or None if none is.

        No number is a fault of the frame, which costs it, until the taxel has had none for a while.
        """
        low, high = self._low_and_high(values.shape[2])
        if bool(((values >= low) & (values <= high) & np.isfinite(values)).all()):
            self._odd = self._none
            return None
        numbers = np.isfinite(values).all(axis=2) | ~self._looked_at
        with np.errstate(invalid="ignore"):
            within = ((values >= low) & (values <= high)).all(axis=2) | ~self._looked_at
        faults = ~numbers & ~self._lost_before
        if not faults.any():
            self._odd = self._none
            return np.asarray(~within | ~numbers)
        if not (self._odd & faults).any():
            self._odd_since = time
        self._odd = faults
        lasts = time - self._odd_since >= STEADY
        return np.asarray(~within | ~numbers) if lasts else None

    def _low_and_high(self, channels: int) -> Floats:
        """Return the limits of each channel."""
        if self._ends is None:
            known = (-np.inf, np.inf) if self._limits is None else self._limits
            self._ends = limits_of(known, channels)
        return self._ends

    def _within(self, values: Floats) -> bool:
        """Return whether all values are within the limits of every channel, or there are none.

        One that is no number is left to the steps, which it makes no number, too.
        """
        if self._limits is None:
            return True
        low, high = self._low_and_high(values.shape[2])
        return bool(low.max() <= values.min() and values.max() <= high.min())

    @property
    def _noise(self) -> Floats | None:
        """The noise of each channel, or None while it is not known."""
        return None if self._power is None else np.sqrt(np.array(self._power))

    def _goes_on(self, values: Floats, time: float) -> bool:
        """Take in a frame in which no reading has jumped, or return False.

        Nearly all frames end here, so it asks first whether all steps together are too small.
        """
        raw, powers = self._raw, self._power
        if raw is None or powers is None:
            if not np.isfinite(values).all():
                return False
            self._learn(values, time)
            return True
        steps = (values - raw).reshape(-1, len(powers))
        squares = np.einsum("ij,ij->j", steps, steps).tolist()
        for channel, (square, power) in enumerate(zip(squares, powers, strict=True)):
            if square <= JUMP**2 * power:
                continue
            if not np.abs(steps[:, channel]).max() <= JUMP * sqrt(power):
                return False
        share = min(1.0, max(time - self._before, 0.0) / FOLLOWS)
        twice = 2.0 * len(steps)
        self._power = [
            max(power + share * (square / twice - power), TINY**2)
            for square, power in zip(squares, powers, strict=True)
        ]
        self._earlier, self._raw = raw, values
        self._take_time(time)
        if time - self._span_at >= SHOWN:
            self._take_span(values, time)
        return True

    def _take_time(self, time: float) -> None:
        """Follow the time from frame to frame; frames of a stream may come in bursts."""
        step = time - self._before
        self._before = time
        if 0.0 < step < 2.0 * self._period:
            self._period += min(1.0, step / FOLLOWS) * (step - self._period)

    def _take_span(self, values: Floats, time: float) -> None:
        """Follow the largest loads, and the noise that they let one expect at least."""
        if self._rest is None or self._power is None:
            return
        away = values - self._rest
        least, most = away.min(axis=(0, 1)), away.max(axis=(0, 1))
        if self._span is None:
            self._span = np.zeros((2, len(least)))
        self._span = np.stack([np.minimum(self._span[0], least), np.maximum(self._span[1], most)])
        least = np.square(FINE * np.abs(self._span).max(axis=0))
        self._power = np.maximum(self._power, least).tolist()
        self._span_at = time

    def _learn(self, values: Floats, time: float) -> None:
        """Take in a frame at rest."""
        self._began = self._began if self._begin else time
        self._begin.append(values)
        self._raw, self._before = values, time
        if len(self._begin) < ENOUGH or time - self._began < BEGINS:
            return
        seen = np.stack(self._begin)
        self._period = (time - self._began) / (len(seen) - 1)
        self._begin, self._rest = [], np.asarray(np.median(seen, axis=0))
        power = np.median(np.square(np.diff(seen, axis=0)).mean(axis=(1, 2)), axis=0)
        least = 1e-6 * float(np.abs(self._rest).max()) + TINY
        noise = np.maximum(np.sqrt(0.5 * power), least)
        self._power = np.square(noise).tolist()
        self._analog = np.asarray(noise > least)
        self._flat_at_rest = bool((seen == seen[..., :1]).all(axis=3).any())
        lines = lines_of(self._looked_at)
        alike = [(seen[:, line] == seen[:, line][:, :1]).all(axis=1).any(axis=0) for line in lines]
        self._alike = np.asarray(np.any([~self._analog, *alike], axis=0))

    def _looked(self, frame: Frame, odd: Mask) -> Frame:
        """Return a frame in which a taxel has jumped, is lost, or was."""
        before = self._lost_before
        raw = np.zeros_like(frame.values) if self._raw is None else self._raw
        values = np.where(np.isfinite(frame.values), frame.values, raw)
        if self._power is None:
            self._learn(values, frame.time)
        noise = self._noise
        new, back, doubted = odd & ~before, self._none, self._none
        lost = values
        steps: Floats = np.zeros_like(values)
        had: Floats = steps
        away: Floats = steps
        if noise is not None and self._rest is not None:
            living = self._looked_at & ~before & ~odd
            steps, had = (values - raw) / noise, (raw - self._rest) / noise
            away = (values - self._rest) / noise
            place = frame.channels.index(NORMAL) if NORMAL in frame.channels else None
            begun = ~self._none
            if self._earlier is not None:  # a load that has moved before may be over now
                moved = _main((raw - self._earlier) / noise, place)
                begun = np.abs(moved) < ASIDE * np.abs(_main(steps, place))
            dropped = _alone(steps, had, away, living, place) & begun
            dropped |= self._flat(values, raw, steps, away)
            dropped |= self._one_number(values, raw, steps, living)
            dropped &= ~at_end(frame, self._end) & living
            over = self._over(steps, place, frame.time) & ~dropped
            if over.any():  # it read so in the frame before, too
                lost = np.where(over[..., np.newaxis], raw, values)
            new = (new | dropped | over) & ~before & self._looked_at
            if 2.0 * max(self._period, frame.time - self._before) <= self._rise:
                doubted = _quick(_main(steps, place), living & ~new) & ~at_end(frame, self._end)
                doubted &= begun
        now = np.asarray(before | new)
        left = int((self._looked_at & ~now).sum())
        if left < KEPT * self._looked_at.sum():
            raise FrameError(
                f"{int(self._looked_at.sum()) - left} of {self._looked_at.sum()} taxels are lost: "
                "not a number, beyond their limits, the same in all channels or taxels, or with "
                "a step that no load causes"
            )
        shown = raw if self._shown is None else self._shown
        known: Mask = ~self._none
        if self._raw is None:
            known = np.asarray(np.isfinite(frame.values).all(axis=2))
        held = now | doubted
        filled = _gone_on(values, shown, held, self._held(), known)
        self._lost = values.copy() if self._lost is None else self._lost
        self._lost[new] = lost[new]
        if noise is not None and self._rest is not None and before.any():
            calm = np.abs(steps).max(axis=2) < JUMP
            flat = (values == values[..., :1]).all(axis=2) & (values.shape[2] > 1)
            whole = before & ~odd & ~flat & calm
            whole &= self._as_before(values, filled, held) | _near_rest(away, held)
            self._since = np.where(whole, self._since, frame.time)
            back = whole & (frame.time - self._since >= STEADY)
        self._since[new] = frame.time
        now &= ~back
        held = now | doubted
        self._shown = np.where(held[..., np.newaxis], filled, values) if held.any() else None
        self._earlier, self._raw = self._raw, values
        self._take_time(frame.time)
        self.count += int(new.sum())
        self._lost_before = now
        self.masked = held if held.any() else None
        self._doubted = doubted if doubted.any() else None
        if self._doubted is not None:
            self._doubt, self._doubted_at = steps, frame.time
        if self.masked is None:
            self._take_span(values, frame.time)
        self._say(new, frame)
        return frame if self._shown is None else replace(frame, values=self._shown)

    def _held(self) -> Mask:
        """Return the taxels of the last frame that were not handed on as they came."""
        return self._none if self.masked is None else self.masked

    def _flat(self, values: Floats, raw: Floats, steps: Floats, away: Floats) -> Mask:
        """Return the taxels that have jumped to one number in all their channels."""
        if values.shape[2] < 2:
            return self._none
        flat, was = ((cells == cells[..., :1]).all(axis=2) for cells in (values, raw))
        jumps = np.abs(steps).max(axis=2) > JUMP
        if self._flat_at_rest:
            jumps &= np.abs(away).max(axis=2) > SPREAD
        return np.asarray(flat & ~was & jumps)

    def _one_number(self, values: Floats, raw: Floats, steps: Floats, living: Mask) -> Mask:
        """Return the taxels of lines, or of the array, that jump to one number, and those to 0.

        Loads may hold a taxel at an end of its range. So neither counts that way from the rest on
        which loads were seen to go.
        """
        assert self._rest is not None
        noise = self._noise
        assert noise is not None
        assert self._analog is not None
        assert self._alike is not None
        away = values - self._rest
        shown: Floats = np.zeros((2, len(noise))) if self._span is None else self._span
        ways = np.where(away > 0.0, np.asarray(shown[1]), -np.asarray(shown[0]))
        jumps, far = np.abs(steps) > JUMP, np.abs(away) > JUMP * noise
        free = np.asarray(ways < LEFT * np.abs(away) + SPREAD * noise)
        zero = jumps & far & free & (values == 0.0) & self._analog
        result: Mask = np.asarray(zero.any(axis=2) & living)
        # where noise keeps neighbours apart at rest, one number is none of the rest either
        told = np.where(np.abs(away) > SPREAD * noise, free, ~self._alike) & self._analog
        for line in lines_of(living):
            there, was = values[line], raw[line]
            alike = (there == there[0]).all(axis=0) & ~(was == was[0]).all(axis=0)
            if (alike & told[line].all(axis=0) & jumps[line].any(axis=0)).any():
                result |= line
        return np.asarray(result & living)

    def _over(self, steps: Floats, place: int | None, time: float) -> Mask:
        """Return the taxels whose step was over within the frame before."""
        if self._doubted is None or self._doubt is None:
            return self._none
        first, after = np.abs(_main(self._doubt, place)), np.abs(_main(steps, place))
        result = self._doubted & (after < ASIDE * first)
        # an array that zeroes itself makes one step in all its taxels, and stays there
        if result.all() and time - self._doubted_at >= STEADY:
            return self._none
        return np.asarray(result)

    def _as_before(self, values: Floats, filled: Floats, held: Mask) -> Mask:
        """Return the taxels that read rather as they were continued, or as the mean load around
        them, than as they were lost.
        """
        assert self._rest is not None
        if self._lost is None:
            return self._none
        away, near = (np.abs(values - other).max(axis=2) for other in (self._lost, filled))
        mask = np.asarray((near < away) | (away == near))
        loads = values - self._rest
        for row, col in np.argwhere(held & ~mask).tolist():
            around = np.s_[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
            some = loads[around][~held[around]]
            if len(some):
                apart = np.abs(loads[row, col] - some.mean(axis=0)).max()
                mask[row, col] = apart < away[row, col]
        return mask

    def _say(self, new: Mask, frame: Frame) -> None:
        named = new & ~self._said
        if self._quiet or not named.any():
            return
        self._said = self._said | named
        cells = np.argwhere(named).tolist()
        which = ", ".join(f"[{row}, {col}]" for row, col in cells[:LISTED])
        more = f" and {len(cells) - LISTED} more" if len(cells) > LISTED else ""
        numbers = ", ".join(f"{value:g}" for value in frame.values[tuple(cells[0])].tolist())
        logging.getLogger("cnnum").warning(
            "At %.3f s the taxels %s%s have dropped out (the first reads %s %s): they are "
            "continued from their neighbours until they are steady again; check the wiring, "
            "or declare them dead with 'frames.dead'.",
            frame.time, which, more, numbers, frame.unit,
        )  # fmt: skip


def _one_number(values: Floats) -> bool:
    return values.size > 1 and bool((values == values[0, 0, 0]).all())


def at_end(frame: Frame, end: float) -> Mask:
    """Return the taxels that stand at an end of their range."""
    result = np.asarray((np.abs(frame.values) >= end).any(axis=2))
    return result if frame.saturated is None else result | frame.saturated


def changed_in(values: Floats, last: Floats) -> Mask:
    """Return the taxels of which a channel, the last axis, has changed."""
    moved = values != last
    changed: Mask = moved[..., 0]
    for channel in range(1, moved.shape[-1]):  # a third of the time of `any` over a short axis
        changed = changed | moved[..., channel]
    return changed


def lines_of(living: Mask) -> list[Mask]:
    """Return the rows, the columns, and all of the taxels that are looked at, as masks."""
    result: list[Mask] = []
    for axis in (1, 0):
        for number in range(living.shape[1 - axis]):
            line = np.zeros_like(living)
            line[(number, slice(None)) if axis else (slice(None), number)] = True
            result.append(line & living)
    return [line for line in (*result, living) if line.sum() >= LINE]


def _main(steps: Floats, place: int | None) -> Floats:
    """Return the steps of the normal channel, or the largest ones where there is none."""
    if place is not None:
        return steps[..., place]
    return np.asarray(np.abs(steps).max(axis=2))


def _alone(steps: Floats, had: Floats, away: Floats, living: Mask, place: int | None) -> Mask:
    """Return the taxels whose load is gone between neighbours that stay loaded.

    Shear alone may go: that is the slip of a taxel.

    Parameters
    ----------
    steps, had, away : (rows, cols, channels) float
        Step, and distance from rest before and after it, over the noise.
    living : (rows, cols) bool
    place : int or None
        Index of the normal channel.
    """
    mask = np.zeros_like(living)
    ways = [tuple(np.abs(part).max(axis=2) for part in (steps, had, away))]
    if place is not None:
        ways.append((steps[..., place], had[..., place], away[..., place]))
    for step, was, rest in ways:
        size = np.abs(was)
        gone = living & (np.abs(step) > JUMP) & (size > JUMP) & (np.abs(rest) < LEFT * size)
        for row, col in np.argwhere(gone & ~mask).tolist():
            near = np.s_[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
            others = (living & ~gone)[near]
            stays = np.abs(steps[near][others]) < ASIDE * abs(step[row, col])
            loaded = np.sign(was[row, col]) * was[near][others]
            loaded = loaded > max(JUMP, LOADED * size[row, col])
            mask[row, col] = loaded.sum() >= 2 and bool(stays.all())
    return mask


def _quick(steps: Floats, living: Mask) -> Mask:
    """Return the taxels that make a step alone, with their whole line, or with all others.

    Parameters
    ----------
    steps : (rows, cols) float
        Over the noise.
    living : (rows, cols) bool
    """
    size = np.where(living, np.abs(steps), 0.0)
    jumps = size > JUMP
    mask = np.zeros_like(living)
    for row, col in np.argwhere(jumps).tolist():
        near = np.s_[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
        others = living[near].copy()
        others[row - near[0].start, col - near[1].start] = False
        mask[row, col] = others.any() and size[near][others].max() < ASIDE * size[row, col]
    for axis in (0, 1):
        whole = (jumps | ~living).all(axis=axis) & (living.sum(axis=axis) >= LINE)
        if whole.any():
            lines = np.expand_dims(whole, axis) & living
            outside = size[~lines]
            if not outside.size or outside.max() < ASIDE * np.median(size[lines]):
                mask |= lines
    return mask


def _near_rest(away: Floats, held: Mask) -> Mask:
    """Return the taxels near rest, where no sound one is far from it."""
    far = np.abs(away).max(axis=2)
    others = far[~held]
    return np.asarray((far < JUMP) & bool((others < JUMP).all()))


def _gone_on(values: Floats, shown: Floats, now: Mask, before: Mask, known: Mask) -> Floats:
    """Return values whose masked taxels go on from what was shown as their neighbours do."""
    filled, living = values.copy(), ~now & ~before
    living = living if living.any() else ~now
    if not living.any():
        return np.where(known[..., np.newaxis], shown, values)
    for row, col in np.argwhere(now).tolist():
        for reach in range(1, max(now.shape) + 1):
            rows, cols = (slice(max(0, n - reach), n + reach + 1) for n in (row, col))
            some = living[rows, cols]
            if some.any():
                there, was = (x[rows, cols][some].mean(axis=0) for x in (values, shown))
                filled[row, col] = there if not known[row, col] else shown[row, col] + there - was
                break
    return filled


class Liveness:
    """Reports when an array or some of its taxels fall silent.

    Parameters
    ----------
    dead : sequence of (row, column)
        Taxels that are not looked at.
    end : float
        Magnitude from which a value stands at an end of its range.
    quiet : bool
        Whether nothing is said on the logger "cnnum".
    """

    def __init__(
        self, dead: Sequence[tuple[int, int]] = (), *, end: float = np.inf, quiet: bool = False
    ) -> None:
        self._dead, self._end, self._quiet, self._said = tuple(dead), end, quiet, False
        self._last: Floats | None = None
        self._since: Floats | None = None  # when each taxel last changed, s
        self._changes: NDArray[np.int64] | None = None
        self._seen: NDArray[np.int64] | None = None  # frames up to its last change
        self._frames = 0
        self._alike: float | None = None
        self._alive = False  # whether a frame was anything else than one number at its end
        self._silent = False

    def look(self, number: int, frame: Frame) -> tuple[Event, ...]:
        """Take in a frame, a repeat or a bad one too, and return what begins or ends with it."""
        values, last, time = frame.values, self._last, frame.time
        self._last = values
        if last is None or self._since is None or self._changes is None or self._seen is None:
            self._since = np.full(frame.shape, time)
            self._changes, self._seen = (np.zeros(frame.shape, dtype=np.int64) for _ in range(2))
            self._alive = not (_one_number(values) and at_end(frame, self._end).all())
            return ()
        changed = changed_in(values, last)
        self._frames += 1
        whole = bool(changed.all())
        which = ... if whole else changed
        self._since[which] = time
        self._changes += changed
        self._seen[which] = self._frames
        if whole:
            self._alike, self._alive = None, True
            return self._told(number, frame) if self._silent else ()
        alike = _one_number(values)
        # an array that has lived, and stands at the end of its range, is pressed too hard
        if alike and self._alive and at_end(frame, self._end).all():
            alike = False
        self._alive = self._alive or not alike
        self._alike = None if not alike else time if self._alike is None else self._alike
        return self._told(number, frame)

    def calm(self) -> dict[str, Any] | None:
        """Return what `Calm` keeps instead of it; None unless all is in order."""
        if self._last is None or self._silent or self._alike is not None:
            return None
        return {
            "raw": self._last, "frames": self._frames, "since": self._since,
            "changes": self._changes, "seen": self._seen,
        }  # fmt: skip

    def went_on(self, kept: Mapping[str, Any]) -> None:
        """Take that back, after frames in which all went on."""
        self._last, self._frames, self._alive = kept["raw"], int(kept["frames"]), True
        self._since, self._changes, self._seen = kept["since"], kept["changes"], kept["seen"]

    def _told(self, number: int, frame: Frame) -> tuple[Event, ...]:
        assert self._since is not None
        assert self._changes is not None
        assert self._seen is not None
        noisy = (self._seen >= ENOUGH) & (self._changes >= LIVELY * self._seen)
        # by the part of the frames before in which the reading stayed, one of each counted more
        stays = (self._seen - self._changes + 1.0) / (self._seen + 2.0)
        unlikely = (self._frames - self._seen) * np.log(stays) < np.log(CHANCE)
        frozen = (frame.time - self._since >= SILENT) & noisy & unlikely
        if frozen.any():  # a load that clips a reading holds it still
            frozen &= ~at_end(frame, self._end)
        for row, col in self._dead:
            frozen[row, col] = False
        alike = self._alike is not None and frame.time - self._alike >= SILENT
        alike = alike and self._frames >= ENOUGH and not (noisy & ~unlikely).any()
        silent = bool(frozen.any()) or alike
        if silent == self._silent:
            return ()
        self._silent = silent
        if not silent:
            return (Event(frame.time, "silent_end", number),)
        cells = np.argwhere(np.ones(frame.shape) if alike else frozen)
        row, col = cells.mean(axis=0).tolist()
        self._say(frame, cells.tolist(), alike=alike)
        size = float(len(cells))
        return (
            Event(frame.time, "silent", number, where=(row, col), strength=size, unit="taxels"),
        )

    def _say(self, frame: Frame, cells: list[list[int]], *, alike: bool) -> None:
        if self._quiet or self._said:
            return
        self._said = True
        whole = len(cells) == frame.shape[0] * frame.shape[1]
        which = ", ".join(f"[{row}, {col}]" for row, col in cells[:LISTED])
        more = f" and {len(cells) - LISTED} more" if len(cells) > LISTED else ""
        logging.getLogger("cnnum").warning(
            "%s read %s for %g s at %.3f s: nothing shows that the array is alive there, and "
            "it can cause no event; check its supply and its wiring.",
            "All taxels have" if whole else f"The taxels {which}{more} have",
            f"{frame.values[0, 0, 0]:g} in every channel" if alike else "the same to the bit",
            SILENT, frame.time,
        )  # fmt: skip
