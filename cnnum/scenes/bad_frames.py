"""Bad frames of a scene: counted, named, and never a flood of sentences."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

from cnnum.errors import CnnumError, FrameError

SAID_EVERY = 10.0
"""s by the host's clock between two sentences on bad frames."""

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
        """Take in a bad frame.

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
