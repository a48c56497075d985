"""Bad frames of a scene: counted, named, and never a flood of messages."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import HELD, Floats, held, magnitude
from cnnum.errors import CnnumError, FrameError
from cnnum.frame import Frame

UNITS: dict[str, tuple[float, str]] = {
    "strain": (10.0, "no rubber stretches to eleven times its length"),
    "V": (120.0, "the upper limit of extra-low DC voltage, for an array under a hand"),
    "N": (1e4, "the weight of a tonne on one taxel"),
    "Pa": (1e9, "beyond the strength of every polymer that a cover is made of"),
}
"""Largest magnitude that a taxel can give, and the reason, by unit."""

WHOLE = {"float32": 2.0**24, "float64": 2.0**53}
"""By precision, the largest count up to which all whole numbers are exact."""


@dataclass(frozen=True, slots=True)
class FrameRange:
    """The largest magnitude of a frame's values, and the reason for it.

    Attributes
    ----------
    limit : float
        In the frame's unit.
    why : str
        Where the limit comes from.
    precision : "float32" or "float64"
        Values are rounded to it before they are compared.
    """

    limit: float
    why: str = ""
    precision: str = "float64"

    def size(self, frame: Frame) -> float:
        """Return a bound of the magnitudes in a frame.

        Raises
        ------
        FrameError
            If a value is NaN, infinite or out of range; the sentence names the first one.
        """
        values = frame.values
        size = magnitude(values)
        if size <= self.limit:
            return size
        bad = self._outside(values)
        if not bad.any():
            return size
        row, col, channel = (int(n) for n in np.argwhere(bad)[0])
        count = int(bad.sum())
        more = f" ({count - 1} more values are out of range)" if count > 1 else ""
        error = FrameError(
            f"taxel ({row}, {col}) reads {values[row, col, channel]:g} {frame.unit} in the channel "
            f"'{frame.channels[channel]}', expected within ±{self.limit:g} {frame.unit}, "
            f"{self.why}{more}"
        )
        error.cells = tuple((int(r), int(c)) for r, c in np.argwhere(bad.any(axis=2)))
        raise error

    def _outside(self, values: Floats) -> np.ndarray:
        """Return where a value, rounded, is beyond the limit."""
        with np.errstate(over="ignore", invalid="ignore"):
            rounded = values.astype(self.precision).astype(np.float64)
        return np.asarray(~(np.abs(rounded) <= self.limit))


ANY = FrameRange(HELD["float64"])
"""Every finite number."""


def unit_range(unit: str, precision: str) -> FrameRange:
    """Return the range of a unit, for arrays about which nothing better is known.

    Parameters
    ----------
    unit : str
        Unit as given by a driver: "strain", "V", "N", "Pa", "count", or another one.
    precision : "float32" or "float64"
        The engine's.
    """
    if unit in UNITS:
        return FrameRange(*UNITS[unit], precision)
    if unit == "count":
        why = f"beyond which {precision} does not hold every whole number"
        return FrameRange(WHOLE[precision], why, precision)
    return FrameRange(held(precision) ** 0.5, f"whose square {precision} holds", precision)


def range_for(
    unit: str,
    precision: str,
    *,
    given: float | None = None,
    full_scale: float | None = None,
    saturated: float = float("inf"),
) -> FrameRange:
    """Return the range of an array's frames, by the best that is known of it.

    Parameters
    ----------
    unit : str
        Unit of the driver's frames.
    precision : "float32" or "float64"
        The engine's.
    given : float, optional
        Limit in the scene; it stands above all else.
    full_scale : float, optional
        Limit of the driver: no value of its array is larger.
    saturated : float
        Limit of the calibration: the magnitude from which a value counts as saturated. The end of
        the converter's range is taken to be within twice that.
    """
    if given is not None:
        return FrameRange(given, "as 'frames.range' of the scene says", precision)
    if full_scale is not None:
        return FrameRange(full_scale, "the full scale of the array", precision)
    if saturated < float("inf"):
        return FrameRange(2.0 * saturated, "twice the calibration's 'limit'", precision)
    return unit_range(unit, precision)


SAID_EVERY = 10.0
"""s by the host's clock between two messages about bad frames."""

PERSISTENT = 2.0
"""s by the frames' clock after which a taxel that is bad in every frame is named."""


@dataclass(frozen=True, slots=True)
class BadFrame:
    """A bad frame that is named.

    Attributes
    ----------
    frame : int
        Its number, from 0.
    time : float
        s, on the clock of the frames.
    why : str
    count : int
        Bad frames since the one that was named before, this one among them.
    cells : tuple of (row, column)
        Taxels whose values are to blame, where it is known.
    """

    frame: int
    time: float
    why: str
    count: int
    cells: tuple[tuple[int, int], ...] = ()

    def record(self) -> dict[str, object]:
        """Return it as a JSON object."""
        return {
            "t": round(self.time, 6),
            "kind": "bad_frame",
            "frame": self.frame,
            "why": self.why,
            "count": self.count,
            "cells": [list(cell) for cell in self.cells],
        }

    def __str__(self) -> str:
        if self.count == 1:
            return f"Frame {self.frame} is bad and was skipped: {self.why}."
        return (
            f"{self.count} more frames are bad and were skipped, the last of them frame "
            f"{self.frame}: {self.why}."
        )


class BadFrames:
    """Counts bad frames, and says so on the logger "cnnum": at the first, then now and then.

    Parameters
    ----------
    clock : callable
        The host's, s.

    Attributes
    ----------
    count : int
    named : BadFrame or None
        The last one that was named.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.count = 0
        self.named: BadFrame | None = None
        self._clock = clock
        self._unsaid = 0
        self._said_at = -SAID_EVERY
        self._good = -1
        self._since = 0.0
        self._always: frozenset[tuple[int, int]] = frozenset()
        self._persistent: set[tuple[int, int]] = set()

    def add(self, number: int, t: float, error: CnnumError, good: int) -> None:
        """Record a bad frame.

        Parameters
        ----------
        number : int
            Number of the frame.
        time : float
            s, on the clock of the frames.
        error : CnnumError
            The fault of the frame.
        good : int
            Good frames so far.
        """
        self.count += 1
        self._unsaid += 1
        cells = error.cells if isinstance(error, FrameError) else ()
        now = self._clock()
        if now - self._said_at >= SAID_EVERY:
            why = str(error).rstrip(".")
            self.named = BadFrame(number, t, why, self._unsaid, cells)
            self._unsaid, self._said_at = 0, now
            logging.getLogger("cnnum").warning("%s", self.named)
        self._follow(t, frozenset(cells), good)

    def _follow(self, t: float, cells: frozenset[tuple[int, int]], good: int) -> None:
        """Name the taxels that have been bad in every frame for some time, once each."""
        if good != self._good or not self._always & cells:
            self._good, self._since, self._always = good, t, cells
        self._always &= cells
        new = self._always - self._persistent
        if not new or t - self._since < PERSISTENT:
            return
        self._persistent |= new
        listed = ", ".join(f"[{row}, {col}]" for row, col in sorted(new))
        logging.getLogger("cnnum").warning(
            "No frame has been good for %.1f s because these taxels were bad in all of them: "
            "declare them dead with 'frames.dead = [%s]' in the scene (or --set), so that "
            "they take the values of their neighbours, or set 'frames.range' if their values "
            "are right.",
            t - self._since,
            listed,
        )
