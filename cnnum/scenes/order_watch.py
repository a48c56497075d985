"""Notices axes in a wrong order or of a wrong sign: shear that points elsewhere under a press."""

import logging
from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.frame import FORCE_AXES, Frame
from cnnum.recordings.checking import sentence_of
from cnnum.recordings.orders import DENIED, Order, best_order, pad_pressed, score

RESTING, LEAST = 0.1, 8
"""s of rest at the begin, and the fewest frames of it."""

EVERY = 0.02
"""s between looks."""

TOUCH = 20.0
"""Times the noise at rest from which a frame is under a load."""

ENOUGH, AGREE = 8, 2
"""Looks that are taken together, and how often in a row they must show the same order."""

SURE = 0.85
"""Score of another order from which it is said: a pull, a twist and a load that rolls have patterns
of their own, and none of them is an order."""


class OrderWatch:
    """Looks at some frames of a scene under a load, and says once that an order seems wrong.

    Parameters
    ----------
    channels : sequence of str
        Channels of the frames; nothing is done unless they are those of three axes.
    pads : int
        Pads side by side in the columns.
    """

    __slots__ = (
        "_able",
        "_agreed",
        "_away",
        "_last",
        "_order",
        "_pads",
        "_rest",
        "_resting",
        "_scores",
        "_start",
        "said",
    )

    def __init__(self, channels: Sequence[str], pads: int = 1) -> None:
        self._pads = pads
        self._able = tuple(channels) == FORCE_AXES
        self.said = False
        self.begin()

    def begin(self) -> None:
        """Begin anew with the next frame; a message that was said is not said again."""
        self._rest: tuple[Floats, float] | None = None
        self._resting: list[Floats] = []
        self._away: list[Floats] = []
        self._scores: list[float] = []
        self._order: Order | None = None
        self._agreed = 0
        self._start = self._last = -np.inf

    def look(self, frame: Frame) -> None:
        """Take in a good frame."""
        if self.said or not self._able:
            return
        if self._rest is None:
            self._rests(frame)
            return
        if frame.time - self._last < EVERY:
            return
        self._last = frame.time
        rest, noise = self._rest
        away = frame.values - rest
        if not np.abs(away).max() > TOUCH * noise:
            return
        away = pad_pressed(away[np.newaxis], self._pads)[0]
        self._away.append(away)
        self._scores.append(score(away))
        if len(self._away) < ENOUGH:
            return
        order = None
        if float(np.median(self._scores)) < DENIED:
            order, value, present = best_order(np.stack(self._away))
            order = None if order == Order() or value < SURE else order
            self._agreed = self._agreed + 1 if order is not None and order == self._order else 0
            if order is not None and self._agreed >= AGREE - 1:
                from cnnum.drivers.own_data.proposal import toml_text

                self.said = True
                said, _, cure = sentence_of(order, value, present)
                keys = ", ".join(f"{key} = {toml_text(value)}" for key, value in cure.items())
                logging.getLogger("cnnum").warning(
                    "%s In a layout, a descriptor or [frames] of the scene that is %s; 'cnnum "
                    "check' looks at a whole recording.",
                    said,
                    keys,
                )
        self._order = order
        self._away, self._scores = [], []

    def _rests(self, frame: Frame) -> None:
        if not self._resting:
            self._start = frame.time
        self._resting.append(frame.values)
        if len(self._resting) < LEAST or frame.time - self._start < RESTING:
            return
        held = np.stack(self._resting)
        size = float(np.abs(held).max())
        noise = max(float(held.std(axis=0).mean()), 1e-9 * max(size, 1e-300))
        self._rest, self._resting = (held.mean(axis=0), noise), []
