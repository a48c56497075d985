"""Proven results on a run: an enclosure of the true end, and its consequences for every cell.

The proof shares only the template and the maps with the run, and is computed on demand, since it
takes longer than the run. `cnnum.runs.enclosure` encloses the trajectory from its start; if the
couplings are monotone, it is also bounded from below and above. A run to equilibrium is proven if
the enclosure reaches a region of contraction (`cnnum.runs.equilibrium`), in which an equilibrium is
then enclosed.

Bounds on the trajectory of an array with monotone couplings follow from the order of its states.

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
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from threading import RLock

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.runs.cells import EPSILON, Cells, Frame, own_output
from cnnum.runs.enclosure import Enclosure, encloses
from cnnum.runs.equilibrium import NEAR, Stability, newton, region, verdict
from cnnum.runs.result import Decision, Proof

PART = 1.0 / 16.0
"""Longest step, as a fraction of the fastest cell's e-folding time. With twice as much, some bounds
diverge in cells whose neighbours all turn against them."""

HALVINGS = 10
"""Largest number of times that a step is halved if slopes of some cells are not found."""

SPARE = 1.5
"""Safety factor on the decrease of rates found over a step."""

LEAST = 1e-9
"""Fraction of the largest rate by which every slope is reduced at least."""

TRIES = 20


def keeps_order(frame: Frame) -> bool:
    """Return whether the flow of a frame is monotone: a larger state never leads to a smaller
    one.
    """
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
        """Largest distance of the true state from `x`, (n,)."""
        size = np.maximum(np.abs(self._low), np.abs(self._high))
        result = 0.5 * (self._high - self._low) + 2.0 * EPSILON * size
        return np.where(self.frame.moving, result, 0.0)

    def advance(self, until: float) -> bool:
        """Advance to a time; return whether there are still bounds."""
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
        """Return slopes that bound all rates over the step on one side."""
        frame, cells = self.frame, self.frame.cells
        rate, rounded = frame.rates(x)
        y = np.clip(x, -1.0, 1.0)

        def lost(slope: Floats) -> Floats:
            ahead = h * slope
            away = np.maximum(side * (np.clip(x + ahead, -1.0, 1.0) - y), 0.0)
            spare = 1.0 + 64.0 * cells.roundings
            result = (self._own * np.abs(ahead) + cells.beside @ away) * spare + 2.0 * rounded
            return np.asarray(np.where(frame.moving, result, 0.0))

        # what falls in one cell reaches all others, by less and less
        slack = SPARE * lost(rate / cells.tau)
        slack += np.where(frame.moving, LEAST * float(np.abs(rate).max(initial=0.0)), 0.0)
        for _ in range(TRIES):
            slope = (rate + side * slack) / cells.tau
            result = lost(slope)
            if bool((result <= slack).all()):
                return slope
            slack = SPARE * np.maximum(slack, result)
        return None


BUDGET = 60.0
"""CPU seconds that the proof of one frame, or of `CELLS` cells of it, may take."""

CELLS = 10_000

FEW = 1024
"""Cells up to which a trajectory is followed closely, though bounds below and above are quicker."""

FIRST_LOOK, LATER = 0.5, 1.3
"""Time constants after which a region is looked for, and the factor between two looks."""

SLOW = 0.1
"""Largest rate at which an equilibrium is looked for that has no M-matrix around it, 1/τ."""

LATEST = 1000.0
"""Time constants after which a run is considered not to come to rest."""

Flags = NDArray[np.bool_]
Words = NDArray[np.str_]


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """The findings on one frame: bounds, whether outputs rest, and a bound on the error alone."""

    lower: Floats
    upper: Floats
    at_rest: bool
    off: float = np.inf


class Certificate:
    """The proof of a run, computed once, on demand.

    Parameters
    ----------
    proof : Proof
        The run.
    """

    def __init__(self, proof: Proof) -> None:
        self._template, self._given = proof.template, proof.given
        self._duration = None if proof.duration == "settle" else float(proof.duration)
        self._rtol, self._atol = proof.tolerances
        self._state, self._error = proof.state, np.asarray(proof.error)
        self._turn = RLock()

    @cached_property
    def _cells(self) -> Cells:
        return Cells(self._template, (int(self._state.shape[-2]), int(self._state.shape[-1])))

    @property
    def _lead(self) -> tuple[int, ...]:
        return self._error.shape

    def _frame(self, number: int) -> tuple[Frame, Floats]:
        """Return a frame, and its start."""
        lead = self._lead
        at = np.unravel_index(number, lead) if lead else ()
        given = {
            role: np.asarray(np.broadcast_to(maps, (*lead, *maps.shape[-3:]))[at], np.float64)
            for role, maps in self._given.items()
        }
        frame = Frame(self._cells, given)
        return frame, frame.start()

    @cached_property
    def _known(self) -> list[Known]:
        count = math.prod(self._lead)
        states = self._state.reshape(count, -1)
        return [self._of(number, states[number]) for number in range(count)]

    def _of(self, number: int, state: Floats) -> Known:
        template = self._template
        nothing = Known(np.full(len(state), -np.inf), np.full(len(state), np.inf), at_rest=False)
        if template.gains:
            return nothing
        frame, start = self._frame(number)
        if template.output.discrete:
            return self._replayed(frame, start) or nothing
        if self._duration is None:
            return self._to_rest(frame, start, state) or nothing
        if not encloses(frame):
            return nothing
        for way in self._ways(frame, start, close=True):
            if way.advance(self._duration):
                rests = self._outputs_rest(frame, way.x, way.off)
                return Known(way.x - way.off, way.x + way.off, rests)
        return nothing

    def _ways(self, frame: Frame, start: Floats, *, close: bool) -> Iterator[Enclosure | Between]:
        """Yield the enclosures of a trajectory; those come first that are `close`, or quick."""
        budget = BUDGET * max(1.0, frame.cells.count / CELLS)
        ordered, few = keeps_order(frame), frame.cells.count <= FEW
        if ordered and not (close and few):
            yield Between(frame, start, budget=budget)
        if few or not ordered:
            yield Enclosure(frame, start, budget=budget)
        if ordered and close and few:
            yield Between(frame, start, budget=budget)

    def _to_rest(self, frame: Frame, start: Floats, state: Floats) -> Known | None:
        """Return the enclosed equilibrium that the array comes to from its start."""
        if own_output(self._template):
            return None
        anywhere = np.where(frame.moving, np.inf, 0.0)
        # masked cells keep their start all the time
        at = np.where(frame.moving, state, start)
        known_rest = _rest(frame, at, anywhere)
        if known_rest is None and encloses(frame):
            rate, rounded = frame.rates(start)
            if bool((np.abs(rate) <= rounded).all()):
                return None  # it starts on an equilibrium from which nothing contracts
            for way in self._ways(frame, start, close=False):
                known_rest = _followed_to_rest(frame, way)
                if known_rest is not None:
                    break
        if known_rest is None:
            return None
        rest, off = known_rest
        # closer than by way of the bounds: both have their roundings
        near = region(frame, state, np.abs(state - rest) + off, close=False)
        error = np.inf if near is None else float(near.off.max(initial=0.0))
        return Known(rest - off, rest + off, at_rest=True, off=error)

    def _outputs_rest(self, frame: Frame, x: Floats, off: Floats) -> bool:
        """Return whether outputs stay as they are from a state on that is within bounds."""
        if frame.cells.template.output.name == "standard" and not frame.cells.pairs:
            beyond = (np.abs(x) - off >= 1.0) | ~frame.moving
            if bool(beyond.all()):
                rate, rounded = frame.rates(x)
                target = (rate + x) * np.sign(x) - rounded
                return bool(((target >= 1.0) | ~frame.moving).all())
        result = region(frame, x, off)
        tolerance = self._atol + self._rtol * np.abs(x)
        return result is not None and bool((2.0 * result.width <= tolerance).all())

    def _replayed(self, frame: Frame, start: Floats) -> Known | None:
        """Return the end in discrete time, step by step, if no sign is in doubt."""
        cells, template = frame.cells, self._template
        if cells.pairs or template.delayed is not None:
            return None
        x, off = start, np.zeros_like(start)
        last = self._duration if self._duration is not None else LATEST
        before = None
        for _ in range(math.ceil(last - 1e-9)):
            if bool((np.abs(x) <= off)[frame.moving & (off > 0.0)].any()):
                return None
            y = np.where(x >= 0.0, 1.0, -1.0)
            if before is not None and bool((y == before).all()):
                return Known(x - off, x + off, at_rest=True)
            before = y
            size = frame.drive_size + cells.sizes @ np.abs(y)
            x = np.where(frame.moving, frame.drive + cells.matrix @ y, start)
            off = np.where(frame.moving, cells.roundings * size + EPSILON * np.abs(x), 0.0)
        if self._duration is None:
            return None
        y = np.where(x >= 0.0, 1.0, -1.0)
        same = before is not None and bool((y == before).all())
        return Known(x - off, x + off, at_rest=same and bool((np.abs(x) > off).all()))

    @property
    def certified(self) -> Words:
        """How each frame's error is known."""
        with self._turn:
            words = [
                self._word(known, state, float(error))
                for known, state, error in zip(
                    self._known if bool(np.isfinite(self._error).any()) else
                    [None] * self._error.size,
                    self._state.reshape(self._error.size, -1),
                    self._error.ravel(),
                    strict=True,
                )
            ]  # fmt: skip
        return np.array(words, dtype="<U9").reshape(self._lead)

    @staticmethod
    def _word(known: Known | None, state: Floats, error: float) -> str:
        if known is None or not math.isfinite(error):
            return "unknown"
        most = max(float((known.upper - state).max()), float((state - known.lower).max()))
        return "proven" if min(most, known.off) <= error else "estimated"

    @cached_property
    def stability(self) -> Words:
        """The stability of the equilibrium at each frame's state."""
        words: list[Stability] = []
        with self._turn:
            for number, x in enumerate(self._state.reshape(self._error.size, -1)):
                if self._template.output.discrete or self._template.gains:
                    words.append("unknown")
                    continue
                frame, _ = self._frame(number)
                x = np.asarray(x, dtype=np.float64)
                tolerance = self._atol + self._rtol * np.abs(x)
                judgement = verdict(frame, x, 0.0, tolerance)
                rest = newton(frame, x)
                at = judgement.state if rest is None else rest
                near = bool((np.abs(at - x) <= np.maximum(tolerance, NEAR * np.abs(x))).all())
                near &= rest is not None or judgement.stability == "stable"
                words.append(judgement.stability if near else "unknown")
        return np.array(words, dtype="<U8").reshape(self._lead)

    @cached_property
    def decision(self) -> Decision:
        """What is proven about every cell."""
        with self._turn:
            known = self._known
        lower = np.stack([box.lower for box in known]).reshape(self._state.shape)
        upper = np.stack([box.upper for box in known]).reshape(self._state.shape)
        return Decision(lower, upper, np.array([k.at_rest for k in known]).reshape(self._lead))


def _followed_to_rest(frame: Frame, way: Enclosure | Between) -> tuple[Floats, Floats] | None:
    """Return the equilibrium to which an enclosure leads, and how far off it may be."""
    look, slowest = FIRST_LOOK, float(frame.cells.tau.max())
    while look < LATEST * slowest and way.advance(look * slowest):
        result = _rest(frame, way.x, way.off)
        if result is not None:
            return result
        look *= LATER
    return None


def _rest(frame: Frame, x: Floats, off: Floats) -> tuple[Floats, Floats] | None:
    """Return the equilibrium that all states within bounds come to, and how far off it may be."""
    around = region(frame, x, off, close=False)
    rate, _ = frame.rates(x)
    if around is None and float(np.abs(rate).max(initial=0.0)) > SLOW:
        return None
    root = newton(frame, x)
    at = x if root is None else root
    if frame.cells.template.output.limited:
        at = np.clip(at, -1.0, 1.0)
    around = region(frame, at, off + np.abs(at - x))
    if around is None and root is not None:
        at, around = x, region(frame, x, off)
    return None if around is None else (at, around.off)
