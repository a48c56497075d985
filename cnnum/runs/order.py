"""Bounds on the trajectory of an array whose couplings keep the order of its states.

Where no weight between cells is negative and the output never falls, a state that is below another
one in every cell stays below it (Kamke 1932; Walter, Differential and Integral Inequalities, 1970,
§12). So a polygon in time whose slopes are nowhere above the rates at its points stays below the
true state, and one whose slopes are nowhere below them stays above. The slopes of a step are the
rates at its beginning, less by as much as these may fall on the way. That is a share of the rates
themselves, which goes as they do. So the bounds do not part for good where a wave decides one cell
after the other, while an error that may grow in each of them says nothing soon.
"""

import math
import time as clock
from dataclasses import dataclass, field

import numpy as np

from cnnum.arrays import Floats
from cnnum.runs.cells import EPSILON, Frame

PART = 1.0 / 16.0
"""Of the time in which the fastest cell changes by e: the longest step. With twice as much, some
bounds part of cells whose neighbours all turn against them."""

HALVINGS = 10
"""Of a step in which the slopes of some cells are not found."""

SPARE = 1.5
"""Of what the rates were found to fall by: the slopes that are less by it may fall a bit more."""

LEAST = 1e-9
"""Part of the largest rate by which every slope is less at least."""

TRIES = 20


def keeps_order(frame: Frame) -> bool:
    """Return whether a larger state of a frame never leads to a smaller one."""
    cells = frame.cells
    template = cells.template
    if template.output.name != "standard" or cells.pairs or cells.delays or template.gains:
        return False
    weights = cells.matrix.tocoo()
    return bool((weights.data[weights.row != weights.col] >= 0.0).all())


@dataclass(slots=True, eq=False)
class Between:
    """The states below and above the trajectory of a frame from its start, advanced in steps.

    Attributes
    ----------
    frame : Frame
        See `keeps_order`.
    start : (n,) float
    time : float
    budget : float
        Seconds of the processor after which it gives up.
    """

    frame: Frame
    start: Floats
    time: float = 0.0
    budget: float = math.inf
    _low: Floats = field(init=False)
    _high: Floats = field(init=False)
    _own: Floats = field(init=False)
    _step: float = field(init=False)

    def __post_init__(self) -> None:
        cells = self.frame.cells
        self._low = np.array(self.start, dtype=np.float64)
        self._high = self._low.copy()
        # −x + a f(x) has the slopes −1 and a − 1
        self._own = np.maximum(1.0, np.abs(cells.diagonal - 1.0))
        others = np.asarray(cells.beside.sum(axis=1)).ravel()
        fastest = float(((self._own + others) / cells.tau).max(initial=0.0))
        self._step = PART / max(fastest, 1e-300)
        self.budget += clock.thread_time()

    @property
    def x(self) -> Floats:
        """The middle of the bounds, (n,)."""
        return 0.5 * (self._low + self._high)

    @property
    def off(self) -> Floats:
        """How far the true state is from it at most, (n,)."""
        size = np.maximum(np.abs(self._low), np.abs(self._high))
        found = 0.5 * (self._high - self._low) + 2.0 * EPSILON * size
        return np.where(self.frame.moving, found, 0.0)

    def advance(self, until: float) -> bool:
        """Go on to a time; return whether there are bounds."""
        with np.errstate(all="ignore"):
            while self.time < until:
                most = until - self.time
                taken = 0.0
                if clock.thread_time() <= self.budget:
                    taken = self._advanced(min(self._step, most))
                if not taken:
                    return False
                self.time = until if taken == most else self.time + taken
        return True

    def _advanced(self, h: float) -> float:
        """Take a step, which may be shorter; return its length, or 0."""
        low = high = None
        for _ in range(HALVINGS):
            low, high = self._slopes(self._low, -1.0, h), self._slopes(self._high, 1.0, h)
            if low is not None and high is not None:
                break
            h *= 0.5
        if low is None or high is None:
            return 0.0
        moving = self.frame.moving
        for state, slope, side in ((self._low, low, -1.0), (self._high, high, 1.0)):
            ahead = h * slope
            state += ahead
            rounded = 4.0 * EPSILON * (np.abs(state) + np.abs(ahead))
            state += np.where(moving, side * rounded, 0.0)
        finite = np.isfinite(self._low).all() and np.isfinite(self._high).all()
        return h if bool(finite) else 0.0

    def _slopes(self, x: Floats, side: float, h: float) -> Floats | None:
        """Return slopes that no rate over the step is beyond, on that side."""
        frame, cells = self.frame, self.frame.cells
        rate, rounded = frame.rates(x)
        y = np.clip(x, -1.0, 1.0)

        def lost(slope: Floats) -> Floats:
            ahead = h * slope
            away = np.maximum(side * (np.clip(x + ahead, -1.0, 1.0) - y), 0.0)
            spare = 1.0 + 64.0 * cells.roundings
            found = (self._own * np.abs(ahead) + cells.beside @ away) * spare + 2.0 * rounded
            return np.asarray(np.where(frame.moving, found, 0.0))

        # what falls in one cell reaches all others, by less and less
        slack = SPARE * lost(rate / cells.tau)
        slack += np.where(frame.moving, LEAST * float(np.abs(rate).max(initial=0.0)), 0.0)
        for _ in range(TRIES):
            slope = (rate + side * slack) / cells.tau
            found = lost(slope)
            if bool((found <= slack).all()):
                return slope
            slack = SPARE * np.maximum(slack, found)
        return None
