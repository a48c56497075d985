"""Taxels at an end of their range: a load on them is a lower bound, and its shape is not known."""

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape
from cnnum.frame import Frame, Quality
from cnnum.programs.machine import SATURATED as CHANNEL

__all__ = ["CHANNEL", "Mask", "Saturation"]

REST = 16
"""Frames at the start that the programs take as rest: a taxel at its end in all of them is stuck,
and says nothing of any load."""

Mask = NDArray[np.bool_]


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
        Kinds of events that are not reported while a taxel stands at its end, for the sentence.
    quiet : bool
        Whether nothing is said on the logger "cnnum".

    Attributes
    ----------
    frames : int
        With such a taxel, so far.
    """

    def __init__(
        self,
        shape: Shape,
        limit: float = float("inf"),
        dead: Sequence[tuple[int, int]] = (),
        withheld: Sequence[str] = (),
        *,
        quiet: bool = False,
    ) -> None:
        self.frames = 0
        self._limit, self._withheld = limit, tuple(dict.fromkeys(withheld))
        self._looked_at = np.ones(shape, dtype=np.bool_)
        for row, col in dead:
            self._looked_at[row, col] = False
        self._stuck: Mask = np.zeros(shape, dtype=np.bool_)
        self._rest = 0
        self._said = quiet

    def mask(self, frame: Frame, size: float) -> Mask | None:
        """Return the (rows, cols) taxels at their end, None where there is none.

        Parameters
        ----------
        frame : Frame
        size : float
            A bound of the magnitudes of its values.
        """
        flagged = bool(frame.quality & Quality.SATURATED)
        if not flagged and size < self._limit:
            self._end_of_rest(stuck=False)
            return None
        at_end = self._at_end(frame, flagged) & self._looked_at
        if self._rest < REST:
            self._stuck = at_end if self._rest == 0 else self._stuck & at_end
            self._rest += 1
            if self._rest == REST:
                self._end_of_rest(stuck=True)
        found = at_end & ~self._stuck
        if not found.any():
            return None
        self.frames += 1
        if not self._said:
            self._said = True
            logging.getLogger("cnnum").warning("%s", self.sentence(frame, int(found.sum())))
        return found

    def _at_end(self, frame: Frame, flagged: bool) -> Mask:
        """Return the taxels at their end, all of them where only that there are some is known."""
        known = np.zeros(frame.shape, dtype=np.bool_)
        if frame.saturated is not None:
            known = known | frame.saturated
        if self._limit < float("inf"):
            known = known | (np.abs(frame.values) >= self._limit).any(axis=2)
        return known if known.any() or not flagged else ~known

    def _end_of_rest(self, *, stuck: bool) -> None:
        """Take the rest as over; without a taxel at its end in all of it, none is stuck."""
        if not stuck:
            if self._rest < REST:
                self._stuck = np.zeros_like(self._stuck)
            self._rest = REST
        elif self._stuck.any() and not self._said:
            cells = ", ".join(f"[{row}, {col}]" for row, col in np.argwhere(self._stuck).tolist())
            logging.getLogger("cnnum").warning(
                "Taxels have stood at an end of their range since the first frame, and a load on "
                "them is not seen: declare them dead with 'frames.dead = [%s]'.",
                cells,
            )

    def sentence(self, frame: Frame, count: int) -> str:
        """Return the message of the first frame with such taxels."""
        withheld = " and ".join(self._withheld)
        more = f", and no event of {withheld} is reported from such frames" if withheld else ""
        return (
            f"In frame {frame.sequence} ({frame.time:.3f} s) {count} of {self._looked_at.size} "
            f"taxels stand at an end of their range: the load on them is not less than what they "
            f"read ('load_is_bound'){more}; press less, lower the gain, or take a thicker cover."
        )
