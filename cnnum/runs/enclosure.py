"""A proven enclosure of an array's trajectory: a polynomial in time, and how far it may be off.

A step takes the Taylor polynomial p of the state, whose defect δ ≥ |τ p' − F(p)| is bounded by its
last terms, by roundings, and where p passes a corner of f within the step. The true state differs
from p by r at most, cell by cell, where

    τ_i r_i' = (s_ii − 1) r_i + Σ_j s_ij r_j + δ_i

and s bounds the slopes of the couplings between p − r and p + r (M. Müller 1927; Walter,
Differential and Integral Inequalities, 1970, §12). Cells that are saturated all over a step have
the slope 0. So r grows where an array decides, and nowhere else. A limited state keeps within its
limits, which brings states nearer to each other.

Steps end where cells come to corners of f, for which polynomials end there, too.
"""

import math
import time as clock
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.runs.cells import EPSILON, Flags, Frame, Places, output_slopes, own_output
from cnnum.templating.functions import Table

ORDER = 12
"""Terms of a polynomial after the first."""

DEFECT = 1e-14
"""Allowed defect of a step, as a fraction of the largest state."""

SAMPLES = 24
"""Places within a step at which cells near corners are looked at."""

SHORTEST = 1e-4
"""Fraction of a step that ends at a kink: cells that reach kinks within this time do so
together."""

TERMS = 16
"""Number of terms in the series for the growth of r over a step."""

LARGE = 1e6
"""Value of r above which the enclosure is useless."""


@dataclass(slots=True, eq=False)
class Enclosure:
    """The trajectory of a frame from its start, advanced in steps.

    Attributes
    ----------
    frame : Frame
        See `encloses`.
    x : (n,) float
        The state of the polynomial now.
    off : (n,) float
        Largest distance of the true state from `x`.
    time : float
    budget : float
        Seconds of the processor after which it gives up.
    """

    frame: Frame
    x: Floats
    off: Floats = field(init=False)
    time: float = 0.0
    budget: float = math.inf
    _stuck: Flags = field(init=False)

    def __post_init__(self) -> None:
        self.x = np.array(self.x, dtype=np.float64)
        self.off = np.zeros_like(self.x)
        self.budget += clock.thread_time()
        self._stuck = np.zeros(len(self.x), dtype=bool)

    def advance(self, until: float) -> bool:
        """Advance to a time; return whether the true state is still enclosed."""
        with np.errstate(all="ignore"):
            while self.time < until:
                if clock.thread_time() > self.budget or not self._step(until - self.time):
                    return False
        return True

    def _step(self, most: float) -> bool:
        frame, cells = self.frame, self.frame.cells
        limited = cells.template.output.limited
        if limited:
            self._stuck = self._at_limits()
        series = _Series(frame, self.x, self._stuck)
        h = min(most, series.length())
        for _ in range(40):
            step, meets = series.to_corner(h)
            step = min(step, most)
            defect = series.defect(step)
            grown = self._grown(series, step, defect)
            large = float((defect / cells.tau).max()) * step > 1e-9 * (1.0 + _size(self.x))
            if grown is not None and not (large and not meets and step > 4.0 * SHORTEST):
                break
            h = 0.5 * step
            if h < 1e-12 * max(self.time, 1e-3):
                return False
        else:
            return False
        end = series.at(step)
        rounded = 2.0 * ORDER * EPSILON * (np.abs(self.x) + np.abs(end))
        off = grown + np.where(frame.moving & ~self._stuck, rounded, 0.0)
        if limited:
            inside = np.clip(end, -1.0, 1.0)
            off, end = off + np.abs(end - inside), inside
        last = most - step <= 1e-13 * (self.time + most)
        self.x, self.off = end, off
        self.time = self.time + most if last else self.time + step
        return bool(np.isfinite(off).all()) and _size(off) < LARGE

    def _at_limits(self) -> Flags:
        rate, _ = self.frame.rates(self.x)
        return np.asarray((np.abs(self.x) >= 1.0) & (rate * self.x > 0.0))

    def _grown(self, series: "_Series", h: float, defect: Floats) -> Floats | None:
        """Return r at the end of a step, or None if it grows too much to be bounded."""
        frame, cells = self.frame, self.frame.cells
        limited = cells.template.output.limited
        low, high = series.range(h)
        added = defect / cells.tau
        reach = 1.5 * self.off + 2.0 * h * added
        for _ in range(6):
            least, most = output_slopes(cells.template, *_limits(frame, low - reach, high + reach))
            if cells.pairs:
                slopes = frame.slopes(low - reach, high + reach)
                own, others = slopes.own, slopes.others
                steep: Floats | None = None
            else:
                own = np.maximum(cells.diagonal * least, cells.diagonal * most)
                others, steep = cells.beside, np.maximum(np.abs(least), np.abs(most))
            if not bool(np.isfinite(own).all()):
                return None
            moving = frame.moving & ~self._stuck
            rate = (own - 1.0) / cells.tau
            base = float(np.maximum(-rate, 0.0).max(initial=0.0))
            diagonal = np.where(moving, rate + base, 0.0)
            scale = np.where(moving, 1.0 / cells.tau, 0.0)
            # what is stuck has a rate of its own, and its r is no more than at an end
            held = np.where(frame.moving & self._stuck, reach, 0.0)
            free = np.where(moving, self.off, 0.0)
            through = partial(_through, diagonal, scale, others, steep)
            extra = np.where(moving, added, 0.0) + through(held)
            norm = h * float(through(np.ones_like(free)).max(initial=0.0))
            if norm > 4.0:
                return None
            grown, pushed = free.copy(), h * extra
            total, sum_pushed = free.copy(), pushed.copy()
            for k in range(1, TERMS):
                grown = through(grown) * (h / k)
                pushed = through(pushed) * (h / (k + 1))
                total += grown
                sum_pushed += pushed
            tail = norm**TERMS / math.factorial(TERMS) / (1.0 - norm / (TERMS + 1))
            rest = tail * (_size(free) + h * _size(extra))
            spare = 1.0 + 64.0 * TERMS * EPSILON
            over = (total + sum_pushed + np.where(moving, rest, 0.0)) * spare
            if limited:
                stuck = np.maximum(self.off, self._nearer(series, h, reach))
                over = np.where(frame.moving & self._stuck, stuck, over)
            if bool((over <= reach).all()):
                end = (math.exp(-base * h) * total + sum_pushed) * spare
                end = end + np.where(moving, rest, 0.0)
                return np.where(frame.moving & self._stuck, self._nearer(series, h, reach), end)
            reach = 1.3 * over
        return None

    def _nearer(self, series: "_Series", h: float, reach: Floats) -> Floats:
        """Return r of cells at a limit, to which their rates push them all over the box."""
        frame = self.frame
        low, high = series.range(h)
        slopes = frame.slopes(low - reach, high + reach)
        _, rounded = frame.rates(self.x)
        around = slopes.others @ reach + np.maximum(slopes.own, 1.0) * reach + 2.0 * rounded
        push = series.push(h) - around
        # where they do not, a limited state comes no further away than by what pulls it
        pull = np.maximum(-push, 0.0) / frame.cells.tau
        nearer = np.maximum(self.off - h * np.maximum(push, 0.0) / frame.cells.tau, 0.0)
        return np.asarray(np.where(push > 0.0, nearer, self.off + h * pull), dtype=np.float64)


def _through(
    diagonal: Floats, scale: Floats, others: Any, steep: Floats | None, v: Floats
) -> Floats:
    """Return the rate of a bound v, but for its common decay."""
    seen = others @ (v if steep is None else steep * v)
    return np.asarray(diagonal * v + scale * seen, dtype=np.float64)


def encloses(frame: Frame) -> bool:
    """Return whether trajectories of an array can be enclosed: its slopes are known everywhere."""
    template = frame.cells.template
    known = not (own_output(template) or template.output.discrete or template.gains)
    tables = all(
        isinstance(p.coupling.function, Table)
        and p.coupling.function.interpolation == "linear"
        and not p.coupling.times_argument
        for p in frame.cells.pairs
    )
    # rates at a limit are followed by their series, which these leave the pieces of
    limited = template.output.limited and bool(frame.cells.pairs)
    return known and tables and not limited and template.delayed is None


def _size(values: Floats) -> float:
    return float(np.abs(values).max(initial=0.0))


def _limits(frame: Frame, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    if frame.cells.template.output.limited:
        return np.clip(low, -1.0, 1.0), np.clip(high, -1.0, 1.0)
    return low, high


class _Series:
    """The Taylor series of a state, in the pieces of f where it begins."""

    def __init__(self, frame: Frame, x: Floats, stuck: Flags) -> None:
        self.frame, self.stuck = frame, stuck
        cells = frame.cells
        self.name = cells.template.output.name
        self.moving = frame.moving & ~stuck
        self.x: list[Floats] = [x]
        rate, _ = frame.rates(x)
        self._choose_pieces(x, np.where(self.moving, rate / cells.tau, 0.0))
        self.y: list[Floats] = []
        self.s: list[Floats] = []
        self._pulls: list[Floats] = []
        for k in range(ORDER):
            self._next_output(k)
            pull = cells.matrix @ self.y[k] - self.x[k]
            for number in range(len(cells.pairs)):
                pull = pull + self._pair_sum(number, k)
            if k == 0:
                pull = pull + frame.drive
            self._pulls.append(pull)
            self.x.append(np.where(self.moving, pull / cells.tau / (k + 1), 0.0))
        self._next_output(ORDER)

    def _choose_pieces(self, x: Floats, ahead: Floats) -> None:
        soon = x + 1e-9 * ahead
        self.inside = np.ones(len(x), dtype=bool)
        self.level = np.zeros(len(x))
        if self.name == "standard":
            self.inside = np.abs(soon) < 1.0
            self.level = np.where(self.inside, 0.0, np.sign(soon))
        self.pieces: list[tuple[Floats, Places, Floats, Floats]] = []
        self._tables: list[tuple[Floats, Floats, Floats]] = []
        y = self.frame.maps(x)["y"]
        maps = {"x": x, "y": y, "u": self.frame.inputs}
        slope_y = self.inside if self.name == "standard" else (
            1.0 - y**2 if self.name == "tanh" else np.ones(len(x)))  # fmt: skip
        changes = {"x": ahead, "y": slope_y * ahead, "u": np.zeros_like(self.frame.inputs)}
        for pairs in self.frame.cells.pairs:
            table = pairs.coupling.function
            assert isinstance(table, Table)
            places, values = np.array(table.points).T
            slopes = np.concatenate([[0.0], np.diff(values) / np.diff(places), [0.0]])
            argument = pairs.argument(maps)
            soon = argument + 1e-9 * pairs.argument(changes, moving=True)
            piece = np.searchsorted(places, soon, side="left")
            corner = np.minimum(np.maximum(piece - 1, 0), len(places) - 1).astype(np.intp)
            ends = np.concatenate([[-np.inf], places, [np.inf]])
            # slope, a point of the line, and where the piece ends
            self.pieces.append((slopes[piece], corner, ends[piece], ends[piece + 1]))
            self._tables.append((places, values, slopes))

    def _term(self, k: int) -> dict[str, Floats]:
        inputs = self.frame.inputs if k == 0 else np.zeros_like(self.frame.inputs)
        return {"x": self.x[k], "y": self.y[k], "u": inputs}

    def _pair_sum(self, number: int, k: int) -> Floats:
        pairs = self.frame.cells.pairs[number]
        slope, corner, _, _ = self.pieces[number]
        argument = pairs.argument(self._term(k), moving=k > 0)
        places, values, _ = self._tables[number]
        first = values[corner] - slope * places[corner] if k == 0 else 0.0
        value = first + slope * argument
        return np.bincount(pairs.to, pairs.weights * value, self.frame.cells.count).astype(float)

    def _next_output(self, k: int) -> None:
        x = self.x
        if self.name == "tanh":
            if k == 0:
                self.y.append(np.tanh(x[0]))
            else:
                total = sum(
                    (j * x[j] * self.s[k - j] for j in range(1, k + 1)), np.zeros_like(x[0])
                )
                self.y.append(total / k)
            square = sum((self.y[j] * self.y[k - j] for j in range(k + 1)), np.zeros_like(x[0]))
            self.s.append(1.0 - square if k == 0 else -square)
        elif self.name == "standard":
            whole = np.where(self.inside, x[k], self.level if k == 0 else 0.0)
            self.y.append(whole)
        else:
            self.y.append(x[k])

    def length(self) -> float:
        """Return a step after which the last terms are no more than the defect."""
        scale = DEFECT * max(_size(self.x[0]), 1e-290)
        cells = self.frame.cells
        lengths = [1.0 * float(cells.tau.max())]
        for k in (ORDER - 1, ORDER):
            last = _size(np.abs(self.x[k]) + cells.sizes @ np.abs(self.y[k]))
            if last > 0.0:
                lengths.append((scale / last) ** (1.0 / k))
        return 0.9 * min(lengths)

    def at(self, t: float, cells: Places | None = None) -> Floats:
        """Return the state of all cells, or some, at a time within the step."""
        terms = self.x if cells is None else [values[cells] for values in self.x]
        total = terms[ORDER]
        for term in terms[-2::-1]:
            total = total * t + term
        return np.asarray(total)

    def to_corner(self, h: float) -> tuple[float, bool]:
        """Return the time to the first corner that is met within a step, and whether there is.

        A cell at a limit meets one where its rate turns inwards.
        """
        if self.name not in ("standard", "full-range"):
            return h, False
        low, high = self._rough(h)
        passes = self.moving & (((low < 1.0) & (high > 1.0)) | ((low < -1.0) & (high > -1.0)))
        at = np.flatnonzero(passes)
        stuck = np.flatnonzero(self.stuck)
        if not len(at) and not len(stuck):
            return h, False
        times = np.linspace(0.0, h, SAMPLES + 1)
        left = np.array([self._leaves(t, at, stuck) for t in times[1:]])
        if not left.any():
            return h, False
        first = int(np.argmax(left))
        low_t, high_t = times[first], times[first + 1]
        for _ in range(60):
            middle = 0.5 * (low_t + high_t)
            if self._leaves(middle, at, stuck):
                high_t = middle
            else:
                low_t = middle
            if high_t - low_t <= 1e-14 * h:
                break
        return max(float(high_t) * (1.0 + 1e-14), min(SHORTEST, h)), True

    def _leaves(self, t: float, at: Places, stuck: Places) -> bool:
        """Return whether a cell is in another piece at a time within the step."""
        if len(at) and bool((self._side(self.at(t, at)) != self._own_side(at)).any()):
            return True
        return bool(len(stuck)) and bool((self._pushes(t)[stuck] <= 0.0).any())

    def _pushes(self, t: float) -> Floats:
        """Return the rate outwards of cells at a limit at a time within the step."""
        total = np.zeros_like(self.x[0])
        for pull in self._pulls[::-1]:
            total = total * t + pull
        return np.asarray(total * np.sign(self.x[0]))

    def push(self, h: float) -> Floats:
        """Return the least rate outwards of cells at a limit over a step."""
        count = SAMPLES // 3
        least = np.min([self._pushes(t) for t in np.linspace(0.0, h, count + 1)], axis=0)
        zero = np.zeros_like(self.x[0])
        bend = sum(
            (k * (k - 1) * np.abs(self._pulls[k]) * h ** (k - 2) for k in range(2, ORDER)), zero
        )
        cells = self.frame.cells
        last = np.abs(self.x[ORDER]) + cells.sizes @ np.abs(self.y[ORDER])
        return np.asarray(least - bend * (h / count) ** 2 / 8.0 - last * h**ORDER)

    def _side(self, x: Floats) -> Floats:
        return np.sign(x) * (np.abs(x) >= 1.0)

    def _own_side(self, at: Places) -> Floats:
        if self.name == "full-range":
            return np.zeros(len(at))
        return np.asarray(self.level[at])

    def _rough(self, h: float) -> tuple[Floats, Floats]:
        spread = sum(
            (np.abs(self.x[k]) * h**k for k in range(1, ORDER + 1)), np.zeros_like(self.x[0])
        )
        return self.x[0] - spread, self.x[0] + spread

    def range(self, h: float) -> tuple[Floats, Floats]:
        """Return bounds on the polynomial over a step."""
        low, high = self._rough(h)
        slow = sum(
            (k * np.abs(self.x[k]) * h ** (k - 1) for k in range(2, ORDER + 1)),
            np.zeros_like(self.x[0]),
        )
        steady = np.abs(self.x[1]) > slow
        end = self.at(h)
        spare = 4.0 * ORDER * EPSILON * (np.abs(self.x[0]) + np.abs(end))
        low = np.where(steady, np.minimum(self.x[0], end) - spare, low)
        high = np.where(steady, np.maximum(self.x[0], end) + spare, high)
        if self.name not in ("standard", "full-range"):
            return low, high
        crosses = ((low < 1.0) & (high > 1.0)) | ((low < -1.0) & (high > -1.0))
        at = np.flatnonzero(~steady & crosses)
        if len(at):
            bend = sum(
                (k * (k - 1) * np.abs(self.x[k][at]) * h ** (k - 2) for k in range(2, ORDER + 1)),
                np.zeros(len(at)),
            )
            seen = np.stack([self.at(t, at) for t in np.linspace(0.0, h, SAMPLES + 1)])
            over = bend * (h / SAMPLES) ** 2 / 8.0 + spare[at]
            low[at] = np.maximum(low[at], seen.min(axis=0) - over)
            high[at] = np.minimum(high[at], seen.max(axis=0) + over)
        return low, high

    def defect(self, h: float) -> Floats:
        """Return a bound on |τ p' − F(p)| over a step."""
        frame, cells = self.frame, self.frame.cells
        low, high = self.range(h)
        sizes = [np.abs(self.x[k]) * h**k for k in range(ORDER + 1)]
        outputs = [np.abs(self.y[k]) * h**k for k in range(ORDER)]
        all_x, all_y = sum(sizes[1:], sizes[0]), sum(outputs[1:], outputs[0])
        rest = self._output_rest(h, low, high)
        result = sizes[ORDER] + cells.sizes @ rest
        rounded = frame.drive_size + all_x + cells.sizes @ all_y
        for number, pairs in enumerate(cells.pairs):
            _, _, first, last = self.pieces[number]
            _, values, slopes = self._tables[number]
            steep = float(np.abs(slopes).max())
            tops = {"x": sizes[ORDER], "y": rest, "u": np.zeros_like(frame.inputs)}
            magnitudes = {"x": all_x, "y": all_y, "u": np.abs(frame.inputs)}

            y_low, y_high = frame.maps(low)["y"], frame.maps(high)["y"]
            least, most = pairs.argument_bounds(
                {"x": low, "y": y_low, "u": frame.inputs},
                {"x": high, "y": y_high, "u": frame.inputs},
            )
            beyond = np.maximum(np.maximum(first - least, most - last), 0.0)
            beyond = np.where(np.isfinite(beyond), beyond, 0.0)
            bend = float(np.abs(slopes[:, np.newaxis] - slopes).max())
            part = steep * pairs.argument_sizes(tops, 0.0) + bend * beyond
            result = result + np.bincount(pairs.to, np.abs(pairs.weights) * part, cells.count)
            size = np.abs(pairs.weights) * (
                float(np.abs(values).max())
                + steep * pairs.argument_sizes(magnitudes, abs(pairs.edge))
            )
            rounded = rounded + np.bincount(pairs.to, size, cells.count)
        result = result + (cells.roundings + ORDER * EPSILON) * rounded
        return np.where(self.moving, result, 0.0)

    def _output_rest(self, h: float, low: Floats, high: Floats) -> Floats:
        """Return a bound on |f(p) − the series of the output, without its last term|."""
        if self.name == "tanh":
            return self._tanh_rest(h)
        rest = np.abs(self.y[ORDER]) * h**ORDER
        if self.name == "standard":
            beyond = np.where(self.inside, np.maximum(high - 1.0, -1.0 - low), 0.0)
            below = np.where(self.inside, 0.0, 1.0 - np.where(self.level > 0.0, low, -high))
            return np.asarray(rest + np.maximum(np.maximum(beyond, below), 0.0))
        return np.asarray(rest)

    def _tanh_rest(self, h: float) -> Floats:
        """Return that bound from magnitudes of the series over the step, by the same recursion."""
        x = [
            sum(
                (math.comb(m, j) * np.abs(self.x[m]) * h ** (m - j) for m in range(j, ORDER + 1)),
                np.zeros_like(self.x[0]),
            )
            for j in range(ORDER + 1)
        ]
        y, s = [np.minimum(x[0], 1.0)], [np.ones_like(x[0])]
        for k in range(1, ORDER + 1):
            y.append(sum((j * x[j] * s[k - j] for j in range(1, k + 1)), np.zeros_like(x[0])) / k)
            s.append(sum((y[j] * y[k - j] for j in range(k + 1)), np.zeros_like(x[0])))
        return np.asarray(y[ORDER] * h**ORDER)
