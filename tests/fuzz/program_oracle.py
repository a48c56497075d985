"""What a random program gives, by NumPy in double precision, and how far rounding may take it.

Every number has a bound `off` by which a precision may round it, which is 0 where the documented
formats hold it exactly. Where a comparison of rounded numbers may fall either way, all that follows
from it is unknown (infinite).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from tests.fuzz.program_writer import COMPARED, LATER, SETTINGS, SHAPE, STREAMS, TWO

# the same in NumPy, with bounds


@dataclass
class V:
    """Numbers, (streams, rows, cols) or (streams, 1, 1), and by how much they may be off."""

    v: np.ndarray
    off: np.ndarray
    logic: bool = False


@dataclass(frozen=True)
class Rounding:
    """What a precision holds: a mantissa of floats, or words as docs/microcontrollers.md has them.

    Stored maps have `word` bits, and a quarter of room above the largest number seen (four times
    where words are longer than 16 bits), or a fixed fraction; values on the way have 31 bits and 16
    times the room; constant factors have as many bits as a word. Floats below `least` are 0 or lose
    digits, and those beyond `most` are refused. Limited states take Euler's `steps`, of half their
    stability bound, in words and in exported floats.
    """

    name: str
    mantissa: int = 0
    word: int = 0
    fraction: int | None = None
    steps: bool = False

    def step(self, most):
        """Return the distance of stored numbers, and the largest that surely fits."""
        if self.fraction is not None:
            stored = 2.0**-self.fraction
            return max(stored, self.register(most)), 2.0 ** (self.word - 1) * stored - stored
        room = 1.25 if self.word <= 16 else 4.0
        whole = math.ceil(math.log2(room * most * (1.0 + 2.0 ** (1 - self.word))))
        stored = 2.0 ** (whole + 1 - self.word)
        return max(stored, self.register(most)), room * most

    @property
    def least(self):
        """Return the smallest normal float: devices take smaller ones for 0."""
        return 2.0**-126 if self.mantissa == 23 else 2.0**-1022

    @property
    def most(self):
        """Return a float beyond which numbers may not be finite."""
        return 2.0**127 if self.mantissa == 23 else 2.0**1023

    @staticmethod
    def register(most):
        return 2.0 ** (math.ceil(math.log2(16.0 * most * 1.001)) - 30)

    def constant(self, number):
        """Return by how much a constant is off."""
        if self.mantissa:
            # as a Python float it would be rounded to float32, too, before the two are compared
            held = float(np.float32(number)) == number
            return 0.0 if held else abs(number) * 2.0**-self.mantissa
        scaled = abs(number)
        while scaled and scaled != int(scaled) and scaled < 2.0**40:
            scaled *= 2.0
        while scaled and scaled % 2.0 == 0.0:
            scaled /= 2.0
        return 0.0 if scaled < 2.0 ** (self.word - 1) else abs(number) * 2.0 ** (2 - self.word)


FLOAT64, FLOAT32 = Rounding("float64", mantissa=52), Rounding("float32", mantissa=23)
EXPORTED = Rounding("float32", mantissa=23, steps=True)
WHOLE = (
    Rounding("q15", word=16), Rounding("q7", word=8), Rounding("q5.6", word=12, fraction=6),
    Rounding("q12", word=13),
)  # fmt: skip


class Oracle:
    """Evaluates a description frame by frame."""

    def __init__(self, steps, outputs, rounding=None, seen=None) -> None:
        self.steps, self.outputs, self.rounding = steps, outputs, rounding
        self.later, self.early = seen or ({}, {})
        self.measuring = rounding is None
        self.memories: dict = {}

    def run(self, frames):
        """Return the outputs of frames (frames, streams, rows, cols, 2) by name, a V a frame."""
        found = []
        for number, frame in enumerate(frames):
            self.number, self.last = number, number == len(frames) - 1
            self.key, self.count = (), 0
            self.new = {}
            fields = [self.kept(frame[..., n], 0.0 * frame[..., n]) for n in range(2)]
            with np.errstate(all="ignore"):
                self.evaluate(self.steps, fields)
            self.memories |= self.new
            found.append({name: fields[place] for name, place in self.outputs.items()})
        return found

    # rounding

    def kept(self, v, off, logic=False):
        """Return numbers as the precision holds them."""
        v = np.asarray(v, dtype=np.float64)
        off = np.broadcast_to(np.asarray(off, dtype=np.float64), v.shape).copy()
        off[np.isnan(off)] = np.inf
        if logic:
            return V(v, off, True)
        self.count += 1
        key = (*self.key, self.count)
        if self.measuring:
            size = float(np.abs(v).max())
            counts = self.later if self.number >= LATER or self.last else self.early
            counts[key] = max(size, counts.get(key, 0.0))
            return V(v, off)
        rounding = self.rounding
        if rounding.mantissa:
            held = (v == np.round(v * 4096.0) / 4096.0) & (np.abs(v) < 2048.0) & (off == 0.0)
            step = np.abs(v) * 2.0 ** (3 - rounding.mantissa) + rounding.least
            off = off + np.where(held, 0.0, step)
            return V(v, np.where(np.abs(v) + off > rounding.most, np.inf, off))
        most = self.later.get(key) or self.early.get(key) or 1.0
        step, fits = rounding.step(most)
        held = (v == np.round(v / step) * step) & (off == 0.0)
        off = off + np.where(held, 0.0, 1.5 * step)
        return V(v, np.where(np.abs(v) + off > fits, np.inf, off))

    def number_of(self, value):
        off = 0.0 if self.measuring else self.rounding.constant(value)
        one = np.full((STREAMS, 1, 1), float(value))
        return V(one, 0.0 * one + off)

    # operations

    def two(self, op, a, b):
        if op == "add":
            return self.kept(a.v + b.v, a.off + b.off)
        if op == "subtract":
            return self.kept(a.v - b.v, a.off + b.off)
        if op == "multiply":
            off = times(np.abs(a.v), b.off) + times(np.abs(b.v), a.off) + times(a.off, b.off)
            return self.kept(a.v * b.v, off)
        if op == "divide":
            return self.divided(a, b)
        if op in ("minimum", "maximum"):
            chosen = np.minimum if op == "minimum" else np.maximum
            low, high = chosen(a.v - a.off, b.v - b.off), chosen(a.v + a.off, b.v + b.off)
            v = chosen(a.v, b.v)
            return self.kept(v, np.fmax(high - v, v - low))
        apart, bound = a.v - b.v, a.off + b.off
        holds = {
            "greater": apart > 0, "at_least": apart >= 0, "less": apart < 0, "at_most": apart <= 0,
            "equal": apart == 0, "differs": apart != 0,
        }[op]  # fmt: skip
        known = (np.abs(apart) > bound) | (bound == 0.0)
        return V(1.0 * holds, np.where(known, 0.0, np.inf), True)

    def divided(self, a, b):
        zero = b.v == 0.0
        safe = np.where(zero, 1.0, b.v)
        v = np.where(zero, 0.0, a.v / safe)
        room = np.abs(safe) - b.off
        off = (a.off + times(np.abs(v), b.off)) / np.where(room > 0.0, room, np.nan)
        off = np.where(zero, np.where(b.off == 0.0, 0.0, np.inf), off)
        if b.v.shape[-1] == 1:
            # a map over a number is times its inverse, of 31 bits, or in C a rounded one
            inverse = self.kept(np.where(zero, 0.0, 1.0 / safe), 0.0)
            if not self.measuring and self.rounding.steps:
                off = off + times(np.abs(a.v), inverse.off)
            if not self.measuring and self.rounding.word:
                step = 4.0 * Rounding.register(self.most())
                off = off + np.where(np.isfinite(inverse.off), np.abs(a.v) * step, np.inf)
        return self.kept(v, off)

    def most(self):
        """Return the largest number seen of the operation before."""
        key = (*self.key, self.count)
        return self.later.get(key) or self.early.get(key) or 1.0

    def monotone(self, function, a, slack=0.0):
        v, low, high = function(a.v), function(a.v - a.off), function(a.v + a.off)
        return self.kept(v, np.fmax(np.abs(high - v), np.abs(v - low)) + slack)

    def rooted(self, a, order):
        def root(x):
            return np.where(x > 0.0, np.abs(x) ** (1.0 / order), 0.0)

        # rounded down from a radicand that is itself rounded
        step = 0.0
        if not self.measuring and self.rounding.mantissa and order == 3:
            # by a power of 1/3, which is rounded itself
            step = np.abs(root(a.v)) * 2.0 ** (3 - self.rounding.mantissa)
        if not self.measuring and not self.rounding.mantissa:
            key = (*self.key, self.count + 1)
            step = 4.0 * Rounding.register(self.later.get(key) or self.early.get(key) or 1.0)
            step = step + np.where(a.v > 0.0, step, step ** (1.0 / order))
        found = self.monotone(root, a, step)
        exact = (a.off == 0.0) & (a.v <= 0.0)
        return V(found.v, np.where(exact, 0.0, found.off))

    def where(self, c, a, b):
        chosen = c.v != 0.0
        v = np.where(chosen, a.v, b.v)
        off = np.where(chosen, a.off, b.off)
        unsure = c.off > 0.0
        same = (a.v == b.v) & (a.off == 0.0) & (b.off == 0.0)
        either = np.where(same, 0.0, np.abs(a.v - b.v) + np.fmax(a.off, b.off))
        off = np.where(unsure, either, off)
        if a.logic and b.logic:
            return V(v, np.where(off > 0.0, np.inf, 0.0), True)
        return self.kept(v, off)

    def joined(self, op, a, b):
        x, y = a.v != 0.0, b.v != 0.0
        unsure = (a.off > 0.0) | (b.off > 0.0)
        v = {"and": x & y, "or": x | y, "xor": x ^ y}[op]
        if op == "and":
            unsure = unsure & ~((~x & (a.off == 0.0)) | (~y & (b.off == 0.0)))
        elif op == "or":
            unsure = unsure & ~((x & (a.off == 0.0)) | (y & (b.off == 0.0)))
        return V(1.0 * v, np.where(unsure, np.inf, 0.0), True)

    def bounded(self, x):
        large = self.two("greater", self.kept(np.abs(x.v), x.off), self.number_of(4.0))
        above = self.two("greater", x, self.number_of(0.0))
        sign = self.where(above, self.number_of(1.0), self.number_of(-1.0))
        return self.where(large, sign, self.two("multiply", x, self.number_of(1.0)))

    def total(self, a, cells=1.0):
        v = (a.v * cells).sum(axis=(1, 2), keepdims=True)
        off = times(a.off, np.abs(cells)).sum(axis=(1, 2), keepdims=True)
        if not self.measuring and self.rounding.mantissa:
            sizes = np.abs(a.v * cells).sum(axis=(1, 2), keepdims=True)
            grid = a.v * 4096.0 == np.round(a.v * 4096.0)
            exact = (off == 0.0) & (sizes < 2048.0) & grid.all(axis=(1, 2), keepdims=True)
            off = off + np.where(exact, 0.0, sizes * 2.0 ** (4 - self.rounding.mantissa))
        return self.kept(v, off)

    def mean(self, a):
        return self.two("multiply", self.total(a), self.number_of(1.0 / (SHAPE[0] * SHAPE[1])))

    def extreme(self, a, function):
        v = function(a.v, axis=(1, 2), keepdims=True)
        low, high = (function(a.v + s * a.off, axis=(1, 2), keepdims=True) for s in (-1, 1))
        return self.kept(v, np.fmax(high - v, v - low))

    def over(self, a, op):
        holds, sure = a.v != 0.0, a.off == 0.0
        if op == "any":
            v, known = holds.any(axis=(1, 2), keepdims=True), (holds & sure)
        else:
            v, known = holds.all(axis=(1, 2), keepdims=True), (~holds & sure)
        certain = known.any(axis=(1, 2), keepdims=True) | sure.all(axis=(1, 2), keepdims=True)
        return V(1.0 * v, np.where(certain, 0.0, np.inf), True)

    def argmax(self, a):
        flat = a.v.reshape(STREAMS, -1)
        first = flat.argmax(axis=1)
        top = flat.max(axis=1, keepdims=True)
        off = a.off.reshape(STREAMS, -1)
        mine = off[np.arange(STREAMS), first][:, None]
        others = np.arange(flat.shape[1])[None] != first[:, None]
        gap = (top - flat > off + mine) | ((off == 0.0) & (mine == 0.0)) | ~others
        unsure = np.where(gap.all(axis=1), 0.0, np.inf)[:, None, None]
        places = [part.astype(float)[:, None, None] for part in divmod(first, SHAPE[1])]
        return [self.kept(one, unsure) for one in places]

    # templates

    def weighed(self, kernel, u, boundary, share=1.0):
        """Return Σ B u of every cell with its bound; a weight may be off by its bits."""
        kernel = np.asarray(kernel) * share
        weights = self.weight_step(kernel)
        v = off = spread = 0.0
        for (row, col), weight in np.ndenumerate(kernel):
            if not weight:
                continue
            sure = boundary if isinstance(boundary, str) else 0.0
            x = self.neighbour(u.v, row - 1, col - 1, boundary)
            e = self.neighbour(u.off, row - 1, col - 1, sure)
            v = v + weight * x
            off = off + times(abs(weight), e)
            unit = 0.0 if weights and (weight / weights) % 1.0 == 0.0 else weights
            spread = spread + np.abs(x) * unit
        return v, off + spread

    def weight_step(self, kernel):
        """Return the unit of the weights of a template."""
        if self.measuring or not np.any(kernel):
            return 0.0
        if self.rounding.mantissa:
            return float(np.abs(kernel).max()) * 2.0 ** (2 - self.rounding.mantissa)
        largest = float(np.abs(kernel).max())
        return 2.0 ** (math.ceil(math.log2(max(largest, 1.0))) + 2 - self.rounding.word)

    @staticmethod
    def neighbour(x, row, col, boundary):
        """Return for each cell the value of the cell that many rows down and columns right."""
        found = np.empty_like(x)
        rows, cols = SHAPE
        for r in range(rows):
            for c in range(cols):
                i, j = r + row, c + col
                if boundary == "periodic":
                    found[:, r, c] = x[:, i % rows, j % cols]
                elif boundary == "zero-flux":
                    # reflected at the rim itself: the cell next to it comes twice
                    i = -1 - i if i < 0 else 2 * rows - 1 - i if i >= rows else i
                    j = -1 - j if j < 0 else 2 * cols - 1 - j if j >= cols else j
                    found[:, r, c] = x[:, i, j]
                elif 0 <= i < rows and 0 <= j < cols:
                    found[:, r, c] = x[:, i, j]
                else:
                    found[:, r, c] = boundary
        return found

    def template(self, given, more):
        u, state, bias, mask = (self.map_of(one) for one in given)
        kernel, z, boundary, duration, output, start, biased, masked = more
        time = SETTINGS.get(duration, duration)
        left = math.exp(-time)
        zero = np.zeros((STREAMS, *SHAPE))
        begun = {"input": u, "state": state}.get(start, V(zero + 0.5, zero))
        if output == "full-range":
            begun = self.clipped(begun)
        drive, off = self.weighed(kernel, u, boundary)
        drive = drive + z
        off = off + self.term(z)
        if biased:
            drive, off = drive + bias.v, off + bias.off
        if not self.measuring and self.rounding.mantissa:
            # terms are added in any order: sums on the way may be larger than the drive, and are
            # exact only where all terms are
            rim = boundary if isinstance(boundary, str) else abs(boundary)
            sizes, _ = self.weighed(np.abs(kernel), V(np.abs(u.v), u.off), rim)
            sizes = sizes + abs(z) + (np.abs(bias.v) if biased else 0.0)
            terms = 2 + np.count_nonzero(kernel)
            off = off + np.where(off > 0.0, terms * sizes * 2.0**-self.rounding.mantissa, 0.0)
        x = drive + left * (begun.v - drive)
        bound = off * (1.0 - left) + left * begun.off if left else off
        # a run of no time is its start
        rounded = not self.measuring and 0.0 < left < 1.0
        if rounded:
            size = np.abs(drive) + np.abs(begun.v) + 1.0
            taps = 2 + np.count_nonzero(kernel)
            bound = bound + taps * size * self.weight_step(np.array([[2.0]]))
            # terms may cancel in the drive
            bound = bound + taps * self.weight_step(np.array([[2.0]])) * np.abs(u.v).max()
        if output == "full-range":
            x = np.clip(x, -1.0, 1.0)
            if time and time != math.inf and not self.measuring:
                # integrated in steps of the tolerances, or of half the stability bound, which is 1
                apart = np.abs(begun.v - drive)
                bound = bound + (0.5 * apart + 0.01 if self.stepped else 1e-2)
            elif time and not self.measuring:
                bound = bound + (4.0 * self.full_step() if self.rounding.word else 1e-2)
        if masked:
            held = mask.v != 0.0
            x = np.where(held, begun.v, x)
            bound = np.where(held, begun.off, bound)
            bound = np.where(mask.off > 0.0, np.inf, bound)
        found = self.kept(x, bound)
        seen = found if output == "linear" else self.clipped(found)
        rate = np.where(masked & (mask.v != 0.0), 0.0, left * (begun.v - drive))
        rests = self.rest(rate, found, bound if left else 0.0 * bound)
        if output == "full-range":
            # the state may rest at its limit, and steps end near it
            rests = V(rests.v, rests.off + np.inf, True)
        return [seen, found, rests]

    @property
    def stepped(self):
        return bool(self.rounding.word) or self.rounding.steps

    def full_step(self):
        return self.rounding.step(4.0)[0]

    def rest(self, rate, state, off):
        """Return whether |dx/dt| is within the tolerances, where that is clear."""
        if self.measuring:
            off = 0.0
        else:
            step = 1e-6 if self.rounding.mantissa else 4.0 * self.rounding.step(4.0)[0]
            off = np.where(np.isfinite(off), off, 1e30) + np.where(rate == 0.0, 0.0, step)
        most = 1e-5 + 1e-4 * np.abs(state.v)
        moving = np.abs(rate) - off > 3.0 * most
        still = np.abs(rate) + off < most / 3.0
        known = moving.any(axis=(1, 2)) | still.all(axis=(1, 2))
        v = ~moving.any(axis=(1, 2))
        return V(1.0 * v[:, None, None], np.where(known, 0.0, np.inf)[:, None, None], True)

    def term(self, z):
        return 0.0 if self.measuring or not z else self.rounding.constant(z)

    def clipped(self, x):
        v = np.clip(x.v, -1.0, 1.0)
        low, high = np.clip(x.v - x.off, -1.0, 1.0), np.clip(x.v + x.off, -1.0, 1.0)
        return self.kept(v, np.fmax(high - v, v - low))

    def map_of(self, x):
        full = (STREAMS, *SHAPE)
        return V(np.broadcast_to(x.v, full), np.broadcast_to(x.off, full), x.logic)

    def linear(self, given, more):
        kernel, boundary, duration, started = more
        u, state = (self.map_of(one) for one in given)
        n = SHAPE[0] * SHAPE[1]
        matrix, rim = np.zeros((n, n)), np.zeros(n)
        for unit in range(n):
            one = np.zeros((1, n))
            one[0, unit] = 1.0
            matrix[:, unit] = self.coupled(one.reshape(1, *SHAPE), kernel, boundary, edge=False)
        rim[:] = self.coupled(np.zeros((1, *SHAPE)), kernel, boundary, edge=True)
        rates = matrix - np.eye(n)
        w = (0.5 * u.v + 0.25).reshape(STREAMS, n) + rim
        x0 = (state.v if started else 0.0 * state.v).reshape(STREAMS, n)
        e0 = (state.off if started else 0.0 * state.off).max(initial=0.0)
        rest = -np.linalg.solve(rates, w.T).T
        grown = expm(rates * duration) if duration != "settle" else np.zeros((n, n))
        x = (rest + (x0 - rest) @ grown.T).reshape(STREAMS, *SHAPE)
        rate = ((x0 - rest) @ (rates @ grown).T).reshape(STREAMS, *SHAPE)
        bound = 0.0
        if not self.measuring:
            size = 1.0 + np.abs(w).max() + np.abs(x0).max()
            spread = np.abs(np.linalg.inv(rates)).sum(axis=1).max() + 1.0
            if self.rounding.mantissa:
                bound = 1e-5 * size * spread + 4.0 * spread * (u.off.max() + e0)
            else:
                # n products with weights, and modes there and back, of as many bits as a word
                bound = 6.0 * n * size * spread * 2.0 ** (1 - self.rounding.word)
                bound = bound + 8.0 * self.rounding.step(4.0 * size)[0] * spread * n**0.5
                bound = bound + 4.0 * spread * (u.off.max() + e0)
        found = self.kept(x, np.full(x.shape, bound))
        return [found, self.rest(rate, found, 0.0 * x + (bound if duration == 1.0 else 0.0))]

    def coupled(self, x, kernel, boundary, *, edge):
        value = boundary if isinstance(boundary, str) else boundary * edge
        found = 0.0
        for (row, col), weight in np.ndenumerate(np.asarray(kernel)):
            found = found + weight * self.neighbour(x, row - 1, col - 1, value)
        return found.reshape(-1)

    # memories and loops

    def old(self, name, scalar, logic):
        shape = (STREAMS, 1, 1) if scalar else (STREAMS, *SHAPE)
        empty = V(np.zeros(shape), np.zeros(shape), logic)
        found = self.memories.get(name, empty)
        # what reads it rounds by the numbers of its own frames, which are one behind
        return found if logic else self.kept(found.v, found.off)

    def flag(self, holds):
        one = np.full((STREAMS, 1, 1), 1.0 * holds)
        return V(one, 0.0 * one, True)

    def evaluate(self, steps, fields):
        outer = self.key, self.count
        for number, step in enumerate(steps):
            self.key, self.count = (*outer[0], outer[1], number), 0
            given = [fields[n] for n in step.at]
            fields += self.results(step, given, fields)
        self.key, self.count = outer

    def results(self, step, given, fields):
        op, more = step.op, step.more
        if op in TWO or op in COMPARED or op == "divide":
            return [self.two(op, *given)]
        if op in ("and", "or", "xor"):
            return [self.joined(op, *given)]
        simple = {
            "negate": lambda: self.kept(-given[0].v, given[0].off),
            "absolute": lambda: self.kept(np.abs(given[0].v), given[0].off),
            "square": lambda: self.two("multiply", given[0], given[0]),
            "root": lambda: self.rooted(given[0], 2),
            "cube_root": lambda: self.rooted(given[0], 3),
            "not": lambda: V(1.0 - given[0].v, given[0].off, True),
            "where": lambda: self.where(*given),
            "picture": lambda: self.where(given[0], self.number_of(1.0), self.number_of(-1.0)),
            "bounded": lambda: self.bounded(given[0]),
            "plus": lambda: self.two("add", given[0], self.number_of(more[0])),
            "times": lambda: self.two("multiply", given[0], self.number_of(more[0])),
            "above": lambda: self.two("greater", given[0], self.number_of(more[0])),
            "sum": lambda: self.total(given[0]),
            "count": lambda: self.total(given[0]),
            "mean": lambda: self.mean(given[0]),
            "max": lambda: self.extreme(given[0], np.max),
            "min": lambda: self.extreme(given[0], np.min),
            "any": lambda: self.over(given[0], "any"),
            "all": lambda: self.over(given[0], "all"),
            "first": lambda: self.flag(self.number == 0),
            "age": lambda: self.kept(np.full((STREAMS, 1, 1), float(self.number)), 0.0),
            "number": lambda: self.number_of(more[0]),
        }
        if op in simple:
            return [simple[op]()]
        return getattr(self, f"do_{op}")(step, given, fields)

    def do_power(self, step, given, fields):
        found = given[0]
        for _ in range(step.more[0] - 1):
            found = self.two("multiply", found, given[0])
        return [self.two("multiply", found, self.number_of(1.0)) if step.more[0] == 1 else found]

    def do_table(self, step, given, fields):
        a, b = given
        index = (2 * (a.v != 0.0) + (b.v != 0.0)).astype(int)
        table = np.array([float(sign) for sign in step.more[0]])
        off = np.where((a.off > 0.0) | (b.off > 0.0), np.inf, 0.0)
        return [V(table[index], np.broadcast_to(off, index.shape), True)]

    def do_argmax(self, step, given, fields):
        return self.argmax(given[0])

    def do_shift(self, step, given, fields):
        rows, cols, boundary = step.more
        x = given[0]
        v = self.neighbour(x.v, -rows, -cols, boundary)
        off = self.neighbour(x.off, -rows, -cols, boundary if isinstance(boundary, str) else 0.0)
        if x.logic:
            return [V(1.0 * (v > 0.5), off, True)]
        return [self.kept(v, off)]

    def do_template(self, step, given, fields):
        return self.template(given, step.more)

    def do_linear(self, step, given, fields):
        return self.linear(given, step.more)

    def do_map(self, step, given, fields):
        v = np.broadcast_to(np.array(step.more[0]), (STREAMS, *SHAPE))
        return [self.kept(v, 0.0)]

    def do_place(self, step, given, fields):
        v = np.indices(SHAPE)[0 if step.more[0] == "row" else 1].astype(float)
        return [self.kept(np.broadcast_to(v, (STREAMS, *SHAPE)), 0.0)]

    def do_previous(self, step, given, fields):
        (x,) = given
        self.new[self.key] = x
        found = x if self.number == 0 else self.memories[self.key]
        return [found if x.logic else self.kept(found.v, found.off)]

    def do_store(self, step, given, fields):
        (x,) = given
        self.new[self.key] = x
        return [self.old(self.key, x.v.shape[-1] == 1, x.logic)]

    def do_latch(self, step, given, fields):
        sets, stays = given
        old = self.old(self.key, all(one.v.shape[-1] == 1 for one in given), True)
        new = self.joined("or", sets, self.joined("and", old, stays))
        self.new[self.key] = new
        return [old, new]

    def do_hold(self, step, given, fields):
        value, when = given
        old = self.old(self.key, all(one.v.shape[-1] == 1 for one in given), False)
        new = self.where(when, V(value.v, value.off), old)
        self.new[self.key] = new
        return [old, new]

    def do_runs(self, step, given, fields):
        (when,) = given
        old = self.old(self.key, when.v.shape[-1] == 1, False)
        more = self.two("add", old, self.number_of(1.0))
        new = self.where(when, more, self.number_of(0.0))
        self.new[self.key] = new
        return [old, new]

    def do_average(self, step, given, fields):
        (x,) = given
        old = self.old(self.key, x.v.shape[-1] == 1, False)
        part = self.two("multiply", self.two("subtract", x, old), self.number_of(step.more[0]))
        new = self.two("add", old, part)
        self.new[self.key] = new
        return [old, new]

    def do_swap(self, step, given, fields):
        first, second = (*self.key, "one"), (*self.key, "two")
        one, two = self.old(first, False, False), self.old(second, False, False)
        self.new[first] = self.two("add", two, given[0])
        half = self.two("multiply", one, self.number_of(0.5))
        self.new[second] = self.two("add", half, given[1])
        return [one, two]

    def do_block(self, step, given, fields):
        rows, cols, which = step.more
        number = np.zeros(SHAPE, dtype=int)
        for r in range(SHAPE[0]):
            for c in range(SHAPE[1]):
                number[r, c] = (r * rows // SHAPE[0]) * cols + c * cols // SHAPE[1]
        share = 1.0 * (number == rows * cols - 1)
        if which == "inner":
            for r, c in np.argwhere(share):
                for i, j in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
                    inside = 0 <= i < SHAPE[0] and 0 <= j < SHAPE[1]
                    if inside and number[i, j] != number[r, c]:
                        share[r, c] = 0.0
        return [self.total(given[0], share)]

    def do_report(self, step, given, fields):
        (x,), (level, frames) = given, step.more
        on, low = (*self.key, "on"), (*self.key, "low")
        was, below = self.old(on, True, True), self.old(low, True, False)
        above = self.two("greater", x, self.number_of(level))
        high = self.two("greater", x, self.number_of(0.5 * level))
        more = self.two("add", below, self.number_of(1.0))
        self.new[low] = self.where(high, self.number_of(0.0), more)
        patient = self.two("less", below, self.number_of(frames - 0.5))
        stays = self.joined("and", was, self.joined("or", high, patient))
        self.new[on] = self.joined("or", above, stays)
        return [self.new[on]]

    def do_branch(self, step, given, fields):
        flag, *values = given
        return self.rounds(step, values, fields, flag)[: len(values)]

    def do_loop(self, step, given, fields):
        *values, taken, ended = self.rounds(step, given, fields, self.flag(True))
        found = []
        for one in values:
            if one.logic:
                other = V(1.0 - one.v, one.off, True)
            else:
                other = self.two("subtract", self.number_of(0.0), one)
            found.append(self.where(ended, one, other))
        count = self.where(ended, taken, self.two("subtract", self.number_of(0.0), taken))
        return [*found, count, ended]

    do_until = do_loop

    def rounds(self, step, values, fields, flag):
        limit, count = step.more
        running, unsure = flag.v != 0.0, flag.off > 0.0
        taken = np.zeros((STREAMS, 1, 1))
        carried = [V(one.v.copy(), one.off.copy(), one.logic) for one in values]
        base = self.key, self.count
        for _ in range(limit):
            if not (running | unsure).any():
                break
            self.key, self.count = base
            inner = [*carried, *fields]
            self.evaluate(step.body, inner)
            results = [inner[n] for n in step.ends[:count]]
            goes = running | unsure
            changed, doubt = np.zeros_like(running), np.zeros_like(unsure)
            news = []
            for old, new in zip(carried, results, strict=True):
                differ, off = np.abs(old.v - new.v), old.off + new.off
                apart = (differ > off) & np.isfinite(off)
                same = (differ == 0.0) & (off == 0.0)
                changed |= apart.any(axis=(1, 2), keepdims=True)
                doubt |= ~(apart | same).all(axis=(1, 2), keepdims=True)
                v, off = np.where(goes, new.v, old.v), np.where(goes, new.off, old.off)
                off = np.where(unsure, np.inf, off)
                news.append(V(v, off, new.logic) if new.logic else self.kept(v, off))
            carried = news
            taken = taken + goes
            if step.op == "branch":
                break
            if step.op == "until":
                stop = inner[step.ends[-1]]
                again, doubt = stop.v == 0.0, stop.off > 0.0
            else:
                again, doubt = changed, doubt & ~changed
            unsure = unsure | (goes & doubt)
            running = goes & again
        self.key, self.count = base
        if unsure.any():
            carried = [V(o.v, np.where(unsure, np.inf, o.off), o.logic) for o in carried]
        self.count += 1000
        carried = [one if one.logic else self.kept(one.v, one.off) for one in carried]
        lost = np.where(unsure, np.inf, 0.0)
        return [*carried, V(taken, lost), V(1.0 * ~running, lost, True)]


def times(a, b):
    """Return a product in which 0 times infinity is 0."""
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    return np.where((a == 0.0) | (b == 0.0), 0.0, a * b)
