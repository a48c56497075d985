"""Taxels at an end of their range: a load on them is a lower bound, and its shape is not known.

A broken taxel stands at an end of its range, too, and would hold back every release and every edge.
It is told from a loaded one by its neighbours: a load that takes a taxel to its end reaches them
through the cover. So a group of taxels at their end counts unless it has stood there from the first
frame on, or for a while with no load around it. Whoever presses a single taxel of an array without
a cover for longer than that finds the warning that names it.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape, largest
from cnnum.frame import Frame, Quality
from cnnum.programs.machine import BEGINS, ENOUGH
from cnnum.programs.machine import SATURATED as CHANNEL

__all__ = ["CHANNEL", "Mask", "Saturation", "Seen", "marked"]

ALONE = 1.0
"""s for which a taxel stands at its end without a load around it until it is taken as broken."""

REACHES = 0.02
"""Share of the range by which a neighbour of a loaded taxel moves from its rest, at least: above
the noise and the drift of an array that is of use, below what any cover passes on."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class _Past:
    """What earlier frames leave behind.

    Attributes
    ----------
    frames : int
        Number of frames of the rest.
    began : float, s
        Time of the first of them.
    learned : bool
        Whether the rest is over.
    total : (rows, cols, channels) float or None
        Sum of their values; None before the first frame.
    stuck : (rows, cols) bool
        At their end in all frames so far.
    since : (rows, cols) float, s
        From when on a taxel has been at its end without a load around it; infinite where it is not.
    broken : (rows, cols) bool
        At their end ever since that lasted too long.
    """

    frames: int
    began: float
    learned: bool
    total: Floats | None
    stuck: Mask
    since: Floats
    broken: Mask

    @property
    def idle(self) -> bool:
        """Whether a frame without a taxel at its end changes nothing."""
        watched = self.stuck.any() or self.broken.any() or np.isfinite(self.since).any()
        return self.learned and not watched


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What a frame shows, before it is known to be a good one.

    Attributes
    ----------
    found : (rows, cols) bool or None
        Taxels at their end because of a load, all of them where it is not known which, or None if
        there is none.
    known : bool
        Whether it is known which.
    frame : Frame
    past : object
        For `Saturation.take`.
    """

    found: Mask | None
    known: bool
    frame: Frame
    past: _Past


class Saturation:
    """Says which taxels of a frame stand at an end of their range because of a load.

    Parameters
    ----------
    shape : (rows, cols)
    limit : float
        Magnitude in the driver's unit from which a value stands at its end; infinite where the
        driver's own flags are all that is known.
    dead : sequence of (row, column)
        Taxels that are not looked at.
    withheld : sequence of str
        Events that are not reported while a taxel stands at its end, for the sentence.
    program : str
        Its name, for the sentences.
    marks : bool
        Whether the program is told which taxels they are, and leaves out what they would decide.
    quiet : bool
        Whether nothing is said on the logger "cnnum".

    Attributes
    ----------
    limit : float
    idle : bool
        Whether a frame without a taxel at its end changes nothing.
    """

    def __init__(
        self,
        shape: Shape,
        limit: float = float("inf"),
        dead: Sequence[tuple[int, int]] = (),
        withheld: Sequence[str] = (),
        program: str = "",
        *,
        marks: bool = False,
        quiet: bool = False,
    ) -> None:
        self.limit = self._limit = limit
        self.idle = False
        self._withheld = tuple(dict.fromkeys(withheld))
        self._program, self._marks = program, marks
        self._looked_at = np.ones(shape, dtype=np.bool_)
        for row, col in dead:
            self._looked_at[row, col] = False
        none = np.zeros(shape, dtype=np.bool_)
        self._past = _Past(0, 0.0, False, None, none, np.full(shape, np.inf), none)
        self._quiet, self._named = quiet, none
        self._said = self._said_most = False

    def look(self, frame: Frame, size: float) -> Seen | None:
        """Return what a frame shows, None if that is nothing; `take` keeps it in mind.

        Parameters
        ----------
        frame : Frame
        size : float
            A bound of the magnitudes of its values.
        """
        flagged = bool(frame.quality & Quality.SATURATED)
        if not flagged and self.idle:
            if size < self._limit:
                return None
            if frame.saturated is None and largest(frame.values) < self._limit:
                return None  # of many taxels the bound is a loose one
        at_end, known = self._at_end(frame, flagged)
        before, alone = self._past, self._alone(frame, at_end)
        since = np.where(alone, np.minimum(before.since, frame.time), np.inf)
        broken = at_end & (before.broken | (alone & (frame.time - since >= ALONE)))
        stuck = at_end & before.stuck if before.frames else at_end
        frames, total = before.frames, before.total
        began = before.began if frames else frame.time
        if not before.learned:
            frames, total = frames + 1, frame.values if total is None else total + frame.values
        learned = frames >= ENOUGH and frame.time - began >= BEGINS
        result = at_end & ~stuck & ~(broken & alone)
        past = _Past(frames, began, learned, total, stuck, since, broken)
        return Seen(result if result.any() else None, known, frame, past)

    def take(self, seen: Seen | None) -> None:
        """Keep in mind what a good frame shows, and say it where it is new."""
        if seen is None:
            return
        settled = seen.past.learned and not self._past.learned
        self._past, self.idle = seen.past, seen.past.idle
        if self._quiet:
            return
        if settled:
            self._name(seen.past.stuck, "since the first frame", known=seen.known)
        self._name(seen.past.broken, "with no load around them", known=True)
        if seen.found is None or self._said_most:
            return
        if seen.known and 2 * seen.found.sum() > self._looked_at.sum():
            self._said = self._said_most = True
            logging.getLogger("cnnum").warning("%s", self._sentence_of_most(seen))
        elif not self._said:
            self._said = True
            logging.getLogger("cnnum").warning("%s", self._sentence(seen))

    def _at_end(self, frame: Frame, flagged: bool) -> tuple[Mask, bool]:
        """Return the taxels at their end, all of them where it is not known which; and whether."""
        result = np.zeros(frame.shape, dtype=np.bool_)
        if frame.saturated is not None:
            result = result | frame.saturated
        if self._limit < float("inf"):
            result = result | (np.abs(frame.values) >= self._limit).any(axis=2)
        known = bool(result.any()) or not flagged
        return (result if known else ~result) & self._looked_at, known

    def _alone(self, frame: Frame, at_end: Mask) -> Mask:
        """Return the taxels at their end around which no other one feels a load."""
        past = self._past
        if past.total is None or not at_end.any():
            return np.zeros_like(at_end)
        moved = np.abs(frame.values - past.total / past.frames).max(axis=2)
        reach = self._limit if self._limit < float("inf") else float(moved[at_end].max())
        others = self._looked_at & ~at_end
        felt = _reached(others & (moved > REACHES * reach), at_end)
        # where all are at their end, none says that there is no load
        return at_end & ~felt & _reached(others, at_end)

    def _name(self, cells: Mask, how: str, *, known: bool) -> None:
        """Name taxels that are broken, each once."""
        new = cells & ~self._named
        if not new.any():
            return
        self._named = self._named | new
        which = ", ".join(f"[{row}, {col}]" for row, col in np.argwhere(new).tolist())
        cure = f"declare them dead with 'frames.dead = [{which}]'"
        if not known:
            cure = "the array does not say which: find them with 'cnnum probe'"
        logging.getLogger("cnnum").warning(
            "Taxels have been at an end of their range %s, so a load on them is not seen: %s.",
            how,
            cure,
        )

    def _sentence(self, seen: Seen) -> str:
        """Return the message of the first frame with such taxels."""
        count = 0 if seen.found is None else int(seen.found.sum())
        which = f"{count} of {self._looked_at.size} taxels" if seen.known else "some taxels"
        unknown = "" if seen.known else " (it is not known which)"
        more = self._not_reported()
        if self._marks:
            more += f"; the program '{self._program}' leaves out what depends on them"
        return (
            f"{self._when(seen)} {which} are at the limit of their range{unknown}: the normal load "
            "on them is at least what they read ('load_is_bound'), and shear, directions and "
            f"shapes may be wrong{more}; press less, lower the gain, or take a thicker cover."
        )

    def _sentence_of_most(self, seen: Seen) -> str:
        """Return the message of the first frame with more such taxels than others."""
        count = 0 if seen.found is None else int(seen.found.sum())
        program = f"the program '{self._program}'" if self._program else "a program"
        more = self._not_reported()
        return (
            f"{self._when(seen)} {count} of {self._looked_at.size} taxels are at the limit of "
            f"their range, so the array is saturated and {program} cannot work: only lower bounds "
            f"of normal loads ('load_is_bound') are left of its values{more}; press less, lower "
            "the gain, or take a thicker cover, and if nothing presses, check supply and wiring."
        )

    def _not_reported(self) -> str:
        withheld = " and ".join(self._withheld)
        return f", and no {withheld} is reported from such frames" if withheld else ""

    @staticmethod
    def _when(seen: Seen) -> str:
        return f"In frame {seen.frame.sequence} ({seen.frame.time:.3f} s)"


def marked(values: Floats, at_end: Mask | None) -> Floats:
    """Return values with the taxels at an end of their range as one more channel."""
    marks = np.zeros((*values.shape[:2], 1))
    if at_end is not None:
        marks[..., 0] = at_end
    return np.concatenate([values, marks], axis=2)


def _reached(cells: Mask, group: Mask) -> Mask:
    """Return the part of a group that hangs together with a neighbour of the cells."""
    mask = group & _around(cells)
    while True:
        more = group & _around(mask)
        if (more == mask).all():
            return mask
        mask = more


def _around(cells: Mask) -> Mask:
    """Return the cells and their eight neighbours."""
    rows, cols = cells.shape
    wide = np.pad(cells, 1)
    shifts = [wide[i : i + rows, j : j + cols] for i in range(3) for j in range(3)]
    return np.asarray(np.logical_or.reduce(shifts), dtype=np.bool_)
