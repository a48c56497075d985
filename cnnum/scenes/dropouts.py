"""Taxels that drop out, and arrays that fall silent: neither is a touch, or its end.

A load goes on from frame to frame, in its neighbours too, and has noise. A taxel that is lost does
not: it is not finite, or beyond the limits of its range; it jumps to one number in all its
channels; or its load is gone between neighbours that stay loaded. Such a taxel is masked: it takes
its last good value, and goes on as its neighbours do, until it has been steady for a while.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.errors import FrameError
from cnnum.frame import Frame, Limits, limits_of
from cnnum.programs.machine import BEGINS, ENOUGH
from cnnum.scenes.events import Event
from cnnum.scenes.saturation import Mask

JUMP = 25.0
"""Step of a reading from frame to frame, over the noise, from which it may be a taxel that is
lost: noise alone never makes it."""

ASIDE = 0.25
"""Part of such a step that no neighbour may have made, where the lost load of a single taxel is to
be told from a release."""

LEFT = 0.1
"""Part of a load at most that is left of it where a taxel is lost."""

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

FOLLOWS = 1.0
"""s over which the noise is followed."""

LISTED = 8
"""Taxels that a sentence names."""

TINY = 1e-30


class Dropouts:
    """Masks the taxels of a scene that are lost.

    Parameters
    ----------
    shape : (rows, cols)
    limits : (low, high), or a pair a channel, optional
        In the driver's unit; a taxel with a value beyond them is lost.
    dead : sequence of (row, column)
        Taxels that are not looked at.
    end : float
        Magnitude from which a value stands at an end of its range: pressed, and not lost.
    quiet : bool
        Whether nothing is said on the logger "cnnum".

    Attributes
    ----------
    masked : (rows, cols) bool or None
        Of the last frame; None where there is none.
    count : int
        Times that a taxel has dropped out.
    """

    def __init__(
        self,
        shape: Shape,
        limits: Limits | None = None,
        dead: Sequence[tuple[int, int]] = (),
        *,
        end: float = np.inf,
        quiet: bool = False,
    ) -> None:
        self._limits, self._end, self._quiet = limits, end, quiet
        self._ends: Floats | None = None  # (2, channels): of the limits
        self._looked_at = np.ones(shape, dtype=np.bool_)
        for row, col in dead:
            self._looked_at[row, col] = False
        none = np.zeros(shape, dtype=np.bool_)
        self.masked: Mask | None = None
        self.count = 0
        self._none, self._said, self._odd, self._odd_since = none, none, none, 0.0
        self._begin: list[Floats] = []
        self._began = self._before = 0.0
        self._rest: Floats | None = None
        self._noise: Floats | None = None  # one a channel
        self._raw: Floats | None = None  # the last frame as read
        self._shown: Floats | None = None  # and as handed on
        self._lost: Floats | None = None  # what a lost taxel read at first
        self._held: Floats | None = None  # and before
        self._since = np.zeros(shape)  # when a masked taxel was last out of order, s

    def look(self, frame: Frame) -> Frame:
        """Return a frame with its lost taxels filled in, or the frame itself.

        Raises
        ------
        FrameError
            If too few taxels are left.
        """
        values = frame.values
        odd = self._odd_ones(values, frame.time)
        if odd is None and self.masked is None:
            if not np.isfinite(values).all():
                return frame  # for now: its values are refused
            if not self._jumps(values, frame.time):
                return frame
        return self._looked(frame, self._none if odd is None else odd)

    def tare(self) -> None:
        """Learn rest and noise from the next frames on."""
        self._begin, self._rest, self._noise = [], None, None

    def _odd_ones(self, values: Floats, time: float) -> Mask | None:
        """Return the taxels that are no numbers, or beyond their limits; None where none is.

        No number is a fault of the frame, which costs it, until the taxel has had none for a while.
        """
        least, most = float(values.min()), float(values.max())
        low, high = self._low_and_high(values.shape[2])
        if np.isfinite(most - least) and (
            (low.max() <= least and most <= high.min())
            or bool(((values >= low) & (values <= high)).all())
        ):
            self._odd = self._none
            return None
        numbers = np.isfinite(values).all(axis=2) | ~self._looked_at
        with np.errstate(invalid="ignore"):
            within = ((values >= low) & (values <= high)).all(axis=2) | ~self._looked_at
        known = self._none if self.masked is None else self.masked
        faults = ~numbers & ~known
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

    def _jumps(self, values: Floats, time: float) -> bool:
        """Return whether a reading has jumped, and take in one that has not."""
        raw, before = self._raw, self._before
        if raw is None or self._noise is None:
            self._learn(values, time)
            return False
        steps = np.abs(values - raw).reshape(-1, values.shape[2])
        if (steps.max(axis=0) > JUMP * self._noise).any():
            return True
        share = min(1.0, max(time - before, 0.0) / FOLLOWS)
        power = 0.5 * np.square(steps).mean(axis=0)
        self._noise = np.maximum(np.sqrt(self._noise**2 + share * (power - self._noise**2)), TINY)
        self._raw, self._before = values, time
        return False

    def _learn(self, values: Floats, time: float) -> None:
        """Take in a frame at rest."""
        self._began = self._began if self._begin else time
        self._begin.append(values)
        self._raw, self._before = values, time
        if len(self._begin) < ENOUGH or time - self._began < BEGINS:
            return
        seen = np.stack(self._begin)
        self._begin, self._rest = [], np.asarray(np.median(seen, axis=0))
        power = np.median(np.square(np.diff(seen, axis=0)).mean(axis=(1, 2)), axis=0)
        least = 1e-6 * float(np.abs(self._rest).max()) + TINY
        self._noise = np.maximum(np.sqrt(0.5 * power), least)

    def _looked(self, frame: Frame, odd: Mask) -> Frame:
        """Return a frame in which a taxel has jumped, is lost, or was."""
        before = self._none if self.masked is None else self.masked
        raw = np.zeros_like(frame.values) if self._raw is None else self._raw
        values = np.where(np.isfinite(frame.values), frame.values, raw)
        if self._noise is None:
            self._learn(values, frame.time)
        new, back = odd & ~before, self._none
        if self._noise is not None and self._rest is not None:
            steps = (np.abs(values - raw) / self._noise).max(axis=2)
            far, had = (np.abs(x - self._rest) / self._noise for x in (values, raw))
            flat = (values == values[..., :1]).all(axis=2) & (values.shape[2] > 1)
            lost = flat & (steps > JUMP) & ~(raw == raw[..., :1]).all(axis=2)
            lost |= _alone(steps, had.max(axis=2), far.max(axis=2), self._looked_at & ~before)
            lost &= ~at_end(frame, self._end)
            new = (new | lost) & ~before & self._looked_at
            whole = before & ~odd & ~flat & (steps < JUMP)
            whole &= self._as_before(values) | _all_near(far.max(axis=2), before | new)
            self._since = np.where(whole, self._since, frame.time)
            back = whole & (frame.time - self._since >= STEADY)
        now = np.asarray((before & ~back) | new)
        left = int((self._looked_at & ~now).sum())
        if left < KEPT * self._looked_at.sum():
            raise FrameError(
                f"{int(self._looked_at.sum()) - left} of {self._looked_at.sum()} taxels are lost: "
                "no number, beyond their limits, or one number in all channels"
            )
        self._keep(values, raw, new)
        shown = raw if self._shown is None else np.where(before[..., np.newaxis], self._shown, raw)
        known: Mask = ~self._none
        if self._raw is None:
            known = np.asarray(np.isfinite(frame.values).all(axis=2))
        self._shown = _gone_on(values, shown, now, before, known)
        self._raw, self._before = values, frame.time
        self.count += int(new.sum())
        self.masked = now if now.any() else None
        self._say(new, frame)
        return frame if self.masked is None else replace(frame, values=self._shown)

    def _keep(self, values: Floats, raw: Floats, new: Mask) -> None:
        """Keep what taxels read that are lost now, and what they read before."""
        if self._lost is None or self._held is None:
            self._lost, self._held = values.copy(), values.copy()
        self._lost[new], self._held[new] = values[new], raw[new]

    def _as_before(self, values: Floats) -> Mask:
        """Return the taxels that read rather as before they were lost than as they did then."""
        if self._lost is None or self._held is None:
            return self._none
        gone = np.abs(self._held - self._lost).max(axis=2)
        away = np.abs(values - self._lost).max(axis=2)
        return np.asarray((away > 0.5 * gone) | (gone == 0.0))

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


def at_end(frame: Frame, end: float) -> Mask:
    """Return the taxels that stand at an end of their range."""
    found = np.asarray((np.abs(frame.values) >= end).any(axis=2))
    return found if frame.saturated is None else found | frame.saturated


def _alone(steps: Floats, had: Floats, has: Floats, living: Mask) -> Mask:
    """Return the taxels whose load is gone between neighbours that stay loaded.

    Parameters
    ----------
    steps, had, has : (rows, cols) float
        Step, and distance from rest before and after it, over the noise.
    living : (rows, cols) bool
    """
    gone = living & (steps > JUMP) & (had > JUMP) & (has < LEFT * had)
    found = np.zeros_like(gone)
    for row, col in np.argwhere(gone).tolist():
        near = np.s_[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
        others = (living & ~gone)[near]
        stays = steps[near][others] < ASIDE * steps[row, col]
        found[row, col] = (had[near][others] > JUMP).sum() >= 2 and bool(stays.all())
    return found


def _all_near(far: Floats, masked: Mask) -> Mask:
    """Return the taxels near rest, where no sound one is far from it."""
    others = far[~masked]
    return np.asarray((far < JUMP) & bool((others < JUMP).all()))


def _gone_on(values: Floats, shown: Floats, now: Mask, before: Mask, known: Mask) -> Floats:
    """Return values whose masked taxels go on from what was shown as their neighbours do."""
    filled, living = values.copy(), ~now & ~before
    living = living if living.any() else ~now
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
    """Says when an array, or taxels of it, give no sign of life.

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
        self._silent = False

    def look(self, number: int, frame: Frame) -> tuple[Event, ...]:
        """Take in a frame, a repeat or a bad one too, and return what begins or ends with it."""
        values, last, time = frame.values, self._last, frame.time
        self._last = values
        if last is None or self._since is None or self._changes is None or self._seen is None:
            self._since = np.full(frame.shape, time)
            self._changes, self._seen = (np.zeros(frame.shape, dtype=np.int64) for _ in range(2))
            return ()
        changed = (values != last).any(axis=2)
        self._frames += 1
        self._since[changed] = time
        self._changes += changed
        self._seen[changed] = self._frames
        if changed.all():
            self._alike = None
            return self._told(number, frame) if self._silent else ()
        alike = values.size > 1 and bool((values == values[0, 0, 0]).all())
        self._alike = None if not alike else time if self._alike is None else self._alike
        return self._told(number, frame)

    def _told(self, number: int, frame: Frame) -> tuple[Event, ...]:
        assert self._since is not None
        assert self._changes is not None
        assert self._seen is not None
        noisy = (self._seen >= ENOUGH) & (self._changes >= LIVELY * self._seen)
        frozen = (frame.time - self._since >= SILENT) & noisy
        if frozen.any():  # a load that clips a reading holds it still
            frozen &= ~at_end(frame, self._end)
        for row, col in self._dead:
            frozen[row, col] = False
        alike = self._alike is not None and frame.time - self._alike >= SILENT
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
