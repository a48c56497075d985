"""Cells that no neighbour reaches, by themselves: whether each is right, without any of our code.

A cell dx/dt = −x + a f(x) + w, f cut at ±1, moves one way only. Whether it has come to a level by a
time is a sum of at most three logarithms, one for each piece of f. All is in NumPy, and takes
arrays of cells; the products' own way goes forward in time, cell by cell.
"""

from dataclasses import dataclass

import numpy as np

EVERY = np.array([[1.0 if n >> k & 1 else -1.0 for k in range(9)] for n in range(512)])
"""All neighbourhoods of 3×3 cells, row by row: (512, 9)."""


def rate(a, w, x):
    """Return dx/dt."""
    return -x + a * np.clip(x, -1.0, 1.0) + w


def time_between(a, w, low, high):
    """Return the time that a cell takes across an interval, up or down; inf if it rests inside."""
    total = 0.0
    for left, right in ((-np.inf, -1.0), (-1.0, 1.0), (1.0, np.inf)):
        start, end = np.clip(low, left, right), np.clip(high, left, right)
        first, last = rate(a, w, start), rate(a, w, end)
        with np.errstate(all="ignore"):
            even = np.isclose(first, last, rtol=1e-9, atol=0.0)
            mean = np.where(even, 0.5 * (first + last), (last - first) / np.log(last / first))
            passed = (end - start) / np.abs(mean)
        blocked = (np.sign(first) != np.sign(last)) | (first == 0.0)
        total = total + np.where(end > start, np.where(blocked, np.inf, passed), 0.0)
    return total


def is_right(a, w, start, time, colour, level=0.5):
    """Return whether cells end on the right side of the level: outputs within half a colour.

    Parameters
    ----------
    a, w, start : arrays that broadcast
    time : float
        Time constants.
    colour : array, ±1
    """
    w, start = colour * w, colour * start  # the equation is odd: a white cell is a black one
    rises, falls = start < level, start >= level
    low, high = np.minimum(start, level), np.maximum(start, level)
    passed = time_between(a, w, low, high)
    moves_up = (rate(a, w, low) > 0.0) & (rate(a, w, high - 1e-300) > 0.0)
    there = rises & moves_up & (passed <= time)
    moves_down = (rate(a, w, high) < 0.0) & (rate(a, w, low) < 0.0)
    gone = falls & moves_down & (passed < time)
    return there | (falls & ~gone)


@dataclass
class Cell:
    """An uncoupled template, as numbers: own feedback, B row by row, bias, start and duration."""

    a: float
    b: np.ndarray
    z: float
    start: float | str
    time: float

    def starts(self, before=None):
        """Return the initial state of each neighbourhood."""
        if before is not None:
            return before
        return EVERY[:, 4] if self.start == "input" else np.full(512, float(self.start))

    def right(self, colour, before=None, off_a=0.0, off_b=0.0, off_z=0.0):
        """Return which of the 512 neighbourhoods are right, numbers off by shares of themselves."""
        w = EVERY @ (self.b * (1.0 + off_b)) + self.z * (1.0 + off_z)
        return is_right(self.a * (1.0 + off_a), w, self.starts(before), self.time, colour)

    def narrowest(self, colour, before=None, steps=11):
        """Return the share of all numbers at which a first neighbourhood can be wrong.

        For each neighbourhood the worst B and z are known, each against the colour; the own
        feedback is looked for on a fine grid between its ends, so that nothing is assumed of it.
        """
        w = colour * (EVERY @ self.b + self.z)
        size, start = np.abs(self.b).sum() + abs(self.z), colour * self.starts(before)

        def holds(share):
            own = self.a * (1.0 + share * np.linspace(-1.0, 1.0, steps))[:, None]
            return is_right(own, w - share * size, start, self.time, np.ones(512)).all()

        low, high = 0.0, 1.0
        if not holds(low):
            return None
        for _ in range(34):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if holds(middle) else (low, middle)
        return low


def drawn(rng):
    """Return a random cell: any own feedback, few or many weights, any start and duration."""
    b = rng.choice([0.0, 0.5, 1.0, 2.0], 9) * rng.choice([-1.0, 1.0], 9)
    if rng.random() < 0.5:
        b *= rng.uniform(0.3, 2.0, 9)
    a = rng.choice([0.0, 1.0, 2.0, rng.uniform(-1.0, 3.0)])
    start = rng.choice([0.0, -1.0, 1.0, rng.uniform(-2.0, 2.0)])
    chosen = "input" if rng.random() < 0.3 else float(start)
    z = float(rng.choice([0.0, rng.uniform(-1.0, 1.0) * np.abs(b).sum()]))
    return Cell(float(a), b, z, chosen, float(rng.uniform(0.2, 20.0)))


def as_rule(weights, level):
    """Return the rule 'the weighted sum of ±1 is above a level' in the language of checks."""
    names = ("nw", "n", "ne", "w", "c", "e", "sw", "s", "se")
    black = [f"{2 * w!r} * {n}" for w, n in zip(weights.tolist(), names, strict=True) if w > 0]
    white = [f"{-2 * w!r} * {n}" for w, n in zip(weights.tolist(), names, strict=True) if w < 0]
    rest = float(level + weights.sum())
    (black if rest < 0.0 else white).append(repr(abs(rest)))
    return f"{' + '.join(black) or '0'} > {' + '.join(white) or '0'}"
