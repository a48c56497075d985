"""Random programs, and what they give: one description, two interpreters that share nothing.

A description is a list of steps. One interpreter makes the program of it that a user would write;
engines run it, and a C compiler. The other one is plain NumPy in double precision: every number has
a bound `off` by which a precision may round it, which is 0 where the documented formats hold it
exactly. Then an answer must be equal to the bit. Where a comparison of rounded numbers may fall
either way, all that follows from it is unknown (infinite).

    python -m tests.fuzz.random_programs --programs 100 --seed 7

tries a shard, and ends with the numbers of programs tried and wrong.
"""

import argparse
import collections
import math
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import expm

import cnnum
from cnnum.programs.blocks import blocks
from cnnum.programs.reports import report

SHAPE, CHANNELS = (3, 4), ("a", "b")
STREAMS, FRAMES = 2, 13
LATER = 8
"""Frames from this one on decide on stored formats: before, memories are still empty."""

SETTINGS = {"settle": math.inf}
NAMES = ("old", "a b", "a_b", "A_B", "3d", "int", "state", "n5", "x-y", "x.y", "m0", "é", "first")


# the description


@dataclass(frozen=True)
class Step:
    """An operation on fields by their numbers; loops have steps of their own."""

    op: str
    at: tuple = ()
    more: tuple = ()
    body: "tuple[Step, ...]" = ()
    ends: tuple = ()


@dataclass(frozen=True)
class Kind:
    """What a field is."""

    scalar: bool = False
    logic: bool = False


MAP, NUMBER, LOGIC, FLAG = Kind(), Kind(True), Kind(False, True), Kind(True, True)
ANY, ANYLOGIC, ANYMAP = "any", "any logic", "any map"
TWO = ("add", "subtract", "multiply", "minimum", "maximum")
COMPARED = ("greater", "at_least", "less", "at_most", "equal", "differs")
LOCAL = {
    **dict.fromkeys((*TWO, *COMPARED, "divide"), (ANY, ANY)),
    **dict.fromkeys(("negate", "absolute", "square", "root", "bounded", "plus", "times"), (ANY,)),
    **dict.fromkeys(("and", "or", "xor", "table"), (ANYLOGIC, ANYLOGIC)),
    "not": (ANYLOGIC,), "where": (ANYLOGIC, ANY, ANY), "picture": (ANYLOGIC,), "above": (ANY,),
    "cube_root": (ANY,), "power": (ANY,),
}  # fmt: skip
GLOBAL = {
    **dict.fromkeys(("sum", "max", "min", "mean", "argmax"), (MAP,)),
    **dict.fromkeys(("any", "all", "count"), (LOGIC,)),
    "shift": (ANYMAP,), "template": (ANYMAP, MAP, MAP, LOGIC), "linear": (MAP, MAP),
}  # fmt: skip
OUTER = {
    "map": (), "number": (), "first": (), "age": (), "place": (), "previous": (ANY,),
    "store": (ANY,), "latch": (ANYLOGIC, ANYLOGIC), "hold": (ANY, ANYLOGIC), "runs": (ANYLOGIC,),
    "average": (ANY,), "block": (MAP,), "report": (NUMBER,), "swap": (MAP, MAP),
}  # fmt: skip
LOOPS = {"branch": (FLAG,), "loop": (), "until": ()}
EIGHTH = 0.125


class Writer:
    """Draws descriptions."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)

    def pick(self, some):
        return some[int(self.random.integers(len(some)))]

    def program(self):
        """Return steps, the kinds of all fields, and outputs by name."""
        kinds = [MAP, MAP]
        ops = [*LOCAL, *LOCAL, *GLOBAL, *GLOBAL, *OUTER, *OUTER, *LOOPS, *LOOPS, *LOOPS]
        steps = self.steps(int(self.random.integers(3, 16)), kinds, ops, depth=0)
        count = int(self.random.integers(1, 6))
        places = self.random.permutation(np.arange(2, len(kinds)))[:count].tolist()
        if self.random.random() < 0.1:
            places.append(int(self.random.integers(2)))
        names = self.random.permutation(NAMES)[: len(places)]
        return steps, kinds, dict(zip(names.tolist(), places, strict=True))

    def steps(self, count, kinds, ops, depth):
        found = []
        while len(found) < count:
            step = self.step(self.pick(ops), kinds, depth)
            if step is not None:
                found.append(step)
        return tuple(found)

    def argument(self, wanted, kinds):
        fits = {
            ANY: lambda kind: True,
            ANYLOGIC: lambda kind: kind.logic,
            ANYMAP: lambda kind: not kind.scalar,
        }.get(wanted, lambda kind: kind == wanted)
        places = [n for n, kind in enumerate(kinds) if fits(kind)]
        if not places:
            return None
        # late fields more often: long chains
        late = places[-4:] if self.random.random() < 0.6 else places
        return self.pick(late)

    def eighths(self, most, shape=None):
        return self.random.integers(-8 * most, 8 * most + 1, shape) * EIGHTH

    def step(self, op, kinds, depth):
        wanted = {**LOCAL, **GLOBAL, **OUTER, **LOOPS}[op]
        at = tuple(self.argument(one, kinds) for one in wanted)
        if any(one is None for one in at):
            return None
        given = [kinds[one] for one in at]
        scalar = all(kind.scalar for kind in given)
        random = self.random
        if op in LOOPS:
            return self.loop(op, at, kinds, depth)
        more, made = (), [Kind(scalar)]
        if op in COMPARED or op in ("and", "or", "xor", "not", "above"):
            made = [Kind(scalar, True)]
        if op == "table":
            more, made = ("".join(random.choice(["0", "1"], 4)),), [Kind(scalar, True)]
        elif op == "where":
            made = [Kind(scalar, given[1].logic and given[2].logic)]
        elif op in ("plus", "times", "above"):
            number = float(self.pick([0.5, -1.0, 2.0, 0.25, 1.0, 0.3, -1.7, 0.0, 3.0]))
            more = (number,)
        elif op == "power":
            more = (int(self.pick([1, 2, 3])),)
        elif op in ("sum", "max", "min", "mean", "count"):
            made = [NUMBER]
        elif op in ("any", "all"):
            made = [FLAG]
        elif op == "argmax":
            made = [NUMBER, NUMBER]
        elif op == "shift":
            more = (
                int(random.integers(-2, 3)), int(random.integers(-2, 3)),
                self.pick([0.0, -1.0, 2.0, "zero-flux", "periodic"]),
            )  # fmt: skip
            made = [given[0]]
        elif op == "template":
            more = self.template()
            made = [MAP, MAP, FLAG]
        elif op == "linear":
            more = self.linear()
            made = [MAP, FLAG]
        elif op == "map":
            more, made = (self.eighths(2, SHAPE).tolist(),), [MAP]
        elif op == "number":
            more, made = (float(self.eighths(2)),), [NUMBER]
        elif op == "first":
            made = [FLAG]
        elif op == "age":
            made = [NUMBER]
        elif op == "place":
            more, made = (self.pick(["row", "column"]),), [MAP]
        elif op in ("previous", "store"):
            made = [given[0]]
        elif op == "latch":
            made = [Kind(scalar, True), Kind(scalar, True)]
        elif op == "hold":
            made = [Kind(given[0].scalar and given[1].scalar)] * 2
        elif op == "runs":
            made = [Kind(scalar)] * 2
        elif op == "average":
            more, made = (float(self.pick([0.5, 0.25, 0.1])),), [Kind(scalar)] * 2
        elif op == "block":
            more = (*self.pick([(1, 2), (3, 1), (1, 4), (3, 2)]), self.pick(["total", "inner"]))
            made = [NUMBER]
        elif op == "report":
            more, made = (float(self.pick([0.5, 1.0, 2.0])), int(random.integers(1, 4))), [FLAG]
        elif op == "swap":
            made = [MAP, MAP]
        kinds += made
        return Step(op, at, more)

    def kernel(self, chance):
        weights = self.random.choice([1.0, -1.0, 0.5, 2.0, 0.25, 0.3], (3, 3))
        kernel = np.where(self.random.random((3, 3)) < chance, weights, 0.0)
        return kernel.tolist()

    def template(self):
        random = self.random
        return (
            self.kernel(random.choice([0.15, 0.6])),
            float(self.pick([0.0, 0.0, 0.5, -0.3])),
            self.pick([0.0, -1.0, 3.0, "zero-flux", "periodic"]),
            self.pick(["settle", "settle", 1.0, 0.0, 30.0]),
            self.pick(["standard", "linear", "full-range"]),
            self.pick(["input", "state", "number"]),
            bool(random.random() < 0.3),
            bool(random.random() < 0.4),
        )

    def linear(self):
        kernel = np.zeros((3, 3))
        if self.random.random() < 0.5:
            kernel[[0, 1, 1, 2], [1, 0, 2, 1]], kernel[1, 1] = 0.125, 0.25
        else:
            kernel = self.random.choice([0.0, 0.125, -0.0625], (3, 3))
        return (
            kernel.tolist(),
            self.pick([0.0, 0.5, "zero-flux", "periodic"]),
            self.pick(["settle", 1.0, 30.0]),
            bool(self.random.random() < 0.5),
        )

    def loop(self, op, at, kinds, depth):
        if depth > 1:
            return None
        values = [n for n, kind in enumerate(kinds) if kind != FLAG]
        values = [self.pick(values[-5:]) for _ in range(int(self.random.integers(1, 3)))]
        carried = [kinds[n] for n in values]
        if all(kind.scalar for kind in carried) and self.random.random() < 0.5:
            return None
        inner = [*carried, *kinds]
        ops = [*LOCAL, *LOCAL, *GLOBAL] + ([*LOOPS] if depth == 0 else [])
        body = self.steps(int(self.random.integers(1, 5)), inner, ops, depth + 1)
        new = list(range(len(carried) + len(kinds), len(inner)))
        ends = []
        for n, kind in enumerate(carried):
            fits = [k for k in new if inner[k] == kind]
            ends.append(self.pick(fits) if fits else n)
        flags = [k for k in new if inner[k] == FLAG]
        if op == "until":
            if not flags:
                return None
            ends.append(self.pick(flags))
        limit = 1 if op == "branch" else int(self.pick([1, 2, 3, 5]))
        kinds += carried if op == "branch" else [*carried, NUMBER, FLAG]
        return Step(op, (*at, *values), (limit, len(values)), body, tuple(ends))


# the program of cnnum

ARITHMETIC = {
    "add": lambda a, b: a + b, "subtract": lambda a, b: a - b, "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b, "minimum": cnnum.minimum, "maximum": cnnum.maximum,
    "greater": lambda a, b: a > b, "at_least": lambda a, b: a >= b, "less": lambda a, b: a < b,
    "at_most": lambda a, b: a <= b, "equal": lambda a, b: a == b, "differs": lambda a, b: a != b,
    "negate": lambda a: -a, "absolute": abs, "square": lambda a: a * a, "root": cnnum.sqrt,
    "and": lambda a, b: a & b, "or": lambda a, b: a | b, "xor": lambda a, b: a ^ b,
    "not": lambda a: ~a, "where": cnnum.where, "picture": lambda a: a.picture(),
    "cube_root": lambda a: a ** (1.0 / 3.0),
    "sum": lambda a: a.sum(), "max": lambda a: a.max(), "min": lambda a: a.min(),
    "mean": lambda a: a.mean(), "any": lambda a: a.any(), "all": lambda a: a.all(),
    "count": lambda a: a.count(),
}  # fmt: skip


def built(frame, steps, fields):
    """Write the steps as a user would; `fields` grows by their results."""
    for step in steps:
        given, more, op = [fields[n] for n in step.at], step.more, step.op
        if op in ARITHMETIC:
            fields.append(ARITHMETIC[op](*given))
        elif op == "bounded":
            (x,) = given
            fields.append(cnnum.where(abs(x) > 4.0, cnnum.where(x > 0.0, 1.0, -1.0), x * 1.0))
        elif op == "plus":
            fields.append(given[0] + more[0])
        elif op == "times":
            fields.append(more[0] * given[0])
        elif op == "above":
            fields.append(given[0] > more[0])
        elif op == "power":
            fields.append(given[0] ** more[0])
        elif op == "table":
            fields.append(cnnum.logic(more[0], *given))
        elif op == "argmax":
            fields += given[0].argmax()
        elif op == "shift":
            fields.append(cnnum.shift(given[0], more[0], more[1], boundary=more[2]))
        elif op == "template":
            fields += template_run(given, more)
        elif op == "linear":
            kernel, boundary, duration, started = more
            template = cnnum.Template(
                "linear", kernel, [[0.5]], 0.25, boundary=boundary, output="linear"
            )
            run = cnnum.transient(
                template, input=given[0], state=given[1] if started else None,
                spec=cnnum.RunSpec(duration=duration),
            )  # fmt: skip
            fields += [run.outputs[0], run.settled]
        elif op in ("map", "number"):
            fields.append(frame.constant(more[0]))
        elif op in ("first", "age"):
            fields.append(getattr(frame, op))
        elif op == "place":
            fields.append(getattr(frame, more[0]))
        elif op == "previous":
            fields.append(frame.previous(given[0]))
        elif op == "swap":
            one, two = frame.memory("one"), frame.memory("two")
            one.store(two.value + given[0])
            two.store(one.value * 0.5 + given[1])
            fields += [one.value, two.value]
        elif op in ("store", "latch", "hold", "runs", "average"):
            fields += remembered(frame, op, given, more)
        elif op == "block":
            rows, cols, which = more
            found = blocks(frame, rows, cols)
            fields.append(getattr(found[-1], which)(given[0]))
        elif op == "report":
            fields.append(report(frame, given[0], *more))
        else:
            fields += looped(frame, step, given, fields)


def template_run(given, more):
    kernel, z, boundary, duration, output, start, biased, masked = more
    initial = {"input": "input", "number": 0.5}.get(start, 0.0)
    template = cnnum.Template(
        "own", [[0.0]], kernel, z, boundary=boundary, output=output, initial=initial
    )
    run = cnnum.transient(
        template, input=given[0], state=given[1] if start == "state" else None,
        bias=given[2] if biased else None, mask=given[3] if masked else None,
        spec=cnnum.RunSpec(duration=duration),
    )  # fmt: skip
    return [run.outputs[0], run.states[0], run.settled]


def remembered(frame, op, given, more):
    scalar = all(one.scalar for one in given)
    logic = op == "latch" or (op == "store" and given[0].logic)
    memory = frame.memory("", scalar=scalar, logic=logic)
    if op == "store":
        memory.store(given[0])
        return [memory.value]
    if op == "latch":
        new = memory.latch(*given)
    elif op == "hold":
        new = memory.hold(*given)
    elif op == "runs":
        new = memory.count(given[0])
    else:
        new = memory.mean(given[0], more[0])
    return [memory.value, new]


def looped(frame, step, given, fields):
    limit, count = step.more
    values = given[-count:]

    def body(*carried):
        inner = [*carried, *fields]
        built(frame, step.body, inner)
        until.append(inner)
        found = [inner[n] for n in step.ends[:count]]
        return found[0] if count == 1 else found

    until = []
    if step.op == "branch":
        return list(cnnum.branch(given[0], body, *values))
    ends = (lambda *_: until[-1][step.ends[-1]]) if step.op == "until" else None
    run = cnnum.loop(body, *values, limit=limit, until=ends)
    # a plan refuses loops at their limits unless it is asked whether they ended
    ended = [cnnum.where(run.finished, one, ~one if one.logic else 0.0 - one) for one in run.values]
    count = cnnum.where(run.finished, run.iterations, 0.0 - run.iterations)
    return [*ended, count, run.finished]


def program_of(steps, outputs, name):
    def function(frame):
        fields = [frame.a, frame.b]
        built(frame, steps, fields)
        return {key: fields[place] for key, place in outputs.items()}

    return cnnum.Program(function, name)


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
    where words are longer than 16 bits); values on the way have 31 bits and 16 times the room;
    constant factors have as many bits as a word. Limited states take Euler's `steps`, of half their
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
            return 2.0**-self.fraction, 2.0 ** (self.word - 1 - self.fraction) - 2.0**-self.fraction
        room = 1.25 if self.word <= 16 else 4.0
        whole = math.ceil(math.log2(room * most * (1.0 + 2.0 ** (1 - self.word))))
        stored = 2.0 ** (whole + 1 - self.word)
        return max(stored, self.register(most)), room * most

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
            return V(v, off + np.where(held, 0.0, np.abs(v) * 2.0 ** (3 - rounding.mantissa)))
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
            # a map over a number is times its inverse, of 31 bits
            inverse = self.kept(np.where(zero, 0.0, 1.0 / safe), 0.0)
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
        x = drive + left * (begun.v - drive)
        bound = off * (1.0 - left) + left * begun.off if left else off
        # a run of no time is a weighted sum of start and drive, too
        rounded = not self.measuring and left > 0.0
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


# the comparison


class Shard:
    """Tries programs on all engines, in all precisions, and as compiled C."""

    def __init__(self, *, compiler=None, engines=None) -> None:
        self.compiler = compiler
        self.engines = engines or ("reference", "opencl", "numba")
        self.tried, self.refused, self.wrong = 0, collections.Counter(), []
        self.compared = self.known = self.exact = 0
        self.pending = []
        self.made = {}

    def engine(self, name, precision):
        key = name, precision
        if key not in self.made:
            self.made[key] = cnnum.Engine(name, precision=precision)
        return self.made[key]

    def one(self, seed):
        """Try the program of a seed."""
        writer = Writer(seed)
        steps, _, outputs = writer.program()
        most = writer.pick([1, 2])
        frames = writer.eighths(most, (FRAMES, STREAMS, *SHAPE, 2))
        measured = Oracle(steps, outputs)
        measured.run(frames)
        seen = measured.later, measured.early
        program = program_of(steps, outputs, f"p{seed}")
        self.tried += 1
        wanted = {
            one: Oracle(steps, outputs, one, seen).run(frames)
            for one in (FLOAT64, FLOAT32, EXPORTED, *WHOLE)
        }
        for one, answers in wanted.items():
            for engine in self.engines if one is not EXPORTED else ():
                self.on_engine(seed, program, frames, engine, one, answers)
        if self.compiler:
            for one in (EXPORTED, *WHOLE):
                self.to_c(seed, program, frames, one, wanted[one])

    def on_engine(self, seed, program, frames, engine, rounding, answers):
        precision = rounding.name
        alone = {"numba": bool(rounding.word), "reference": precision == "float32"}
        if alone.get(engine):
            return
        options = {"like": frames} if rounding.word else {}
        try:
            plan = self.engine(engine, precision).compile(
                program, SHAPE, channels=CHANNELS, **options
            )
            stream = plan.stream((STREAMS,))
            found = [stream.push(frame) for frame in frames]
        except cnnum.CnnumError as error:
            self.refuse(seed, f"{engine} {precision}", error)
            return
        self.compare(seed, f"{engine} {precision}", found, answers)

    def refuse(self, seed, where, error):
        # what the documentation refuses: more than 64 bits on the way
        expected = "64 bits" in str(error)
        self.refused[str(error)[:60]] += 1
        if not expected:
            self.wrong.append((seed, where, f"{type(error).__name__}: {error}"))

    def compare(self, seed, where, found, answers):
        for number, (got, wanted) in enumerate(zip(found, answers, strict=True)):
            for name, one in wanted.items():
                value = np.asarray(got[name], dtype=np.float64)
                v = np.broadcast_to(
                    one.v, (*value.shape, 1, 1)[:3] if value.ndim == 1 else value.shape
                )
                value = value.reshape(v.shape)
                off = np.broadcast_to(one.off, v.shape)
                known = np.isfinite(off)
                self.compared += v.size
                self.known += int(known.sum())
                self.exact += int((off == 0.0).sum())
                far = known & ~(np.abs(value - v) <= off * (1.0 + 1e-9))
                if far.any():
                    at = tuple(np.argwhere(far)[0])
                    self.wrong.append(
                        (seed, where, f"frame {number}, '{name}' {at}: {value[at]} for {v[at]} "
                         f"± {off[at]:.3g}")
                    )  # fmt: skip
                    return

    # compiled C

    def to_c(self, seed, program, frames, rounding, answers):
        from cnnum.embedded.formats import precision_named
        from cnnum.embedded.making import make
        from cnnum.graph.passes import schedule

        name = f"{program.name}_{rounding.name.replace('.', '_')}"
        planned = schedule(program.trace(SHAPE, CHANNELS), CHANNELS, None)
        try:
            made = make(name, planned, precision_named(rounding.name), frames)
            # all of them would take most of the time
            vector = frames if seed % 7 == 0 else frames[:2, :1]
            files = made.export(vector).files
        except cnnum.CnnumError as error:
            self.refuse(seed, f"C {rounding.name}", error)
            return
        self.pending.append((seed, name, made, files, frames, rounding, answers))

    def compile(self):
        """Compile the programs that wait, all in one image, and compare what they give."""
        from cnnum.embedded.c.layout import packed, record_type

        if not self.pending:
            return
        with tempfile.TemporaryDirectory() as folder:
            place, given = Path(folder), b""
            for _, name, made, files, frames, _, _ in self.pending:
                for file in (f"{name}.c", f"{name}.h"):
                    (place / file).write_text(files[file])
                text = files["vector.c"].replace("int main(void)", f"int vector_{name}(void)")
                text = text.replace(
                    f"int vector_{name}", f"int vector_{name}(void);\nint vector_{name}"
                )
                (place / f"vector_{name}.c").write_text(text)
                inputs = made.program.of_kind("input")
                for lane in range(STREAMS):
                    for frame in frames:
                        one = made.inputs(frame[lane : lane + 1])
                        given += packed(inputs, one, 1).tobytes()
            (place / "all.c").write_text(drivers([one[1] for one in self.pending]))
            sources = sorted(path.name for path in place.glob("*.c"))
            command = [
                self.compiler, "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-O0",
                "-ffp-contract=off", "-fsanitize=undefined,address", "-fno-sanitize-recover=all",
                "-o", "all", *sources, "-lm",
            ]  # fmt: skip
            done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
            if done.returncode:
                lines = [line for line in done.stderr.splitlines() if "error" in line]
                for seed, name, *_ in self.pending:
                    mine = [line for line in lines if name in line]
                    if mine or not lines:
                        self.wrong.append((seed, f"gcc {name}", (mine or [done.stderr])[0][:300]))
                self.pending = []
                return
            done = subprocess.run([place / "all"], input=given, capture_output=True, check=False)
            if done.returncode:
                seeds = [one[0] for one in self.pending]
                self.wrong.append((seeds[0], "C", done.stderr.decode(errors="replace")[:600]))
                self.pending = []
                return
            self.read(done.stdout, record_type)
        self.pending = []

    def read(self, text, record_type):
        from cnnum.embedded.c.layout import unpacked

        at = 0
        for seed, name, made, _, frames, rounding, answers in self.pending:
            outputs = made.program.of_kind("output")
            layout = record_type(outputs)
            size = layout.itemsize * FRAMES * STREAMS
            records = np.frombuffer(text[at : at + size], layout).reshape(STREAMS, FRAMES)
            at += size
            passed = text[at : at + 1]
            at += 1
            if passed != b"1":
                self.wrong.append((seed, f"C {rounding.name}", "its own vector fails"))
            found = [made.outputs(unpacked(outputs, records[:, n])) for n in range(FRAMES)]
            self.compare(seed, f"C {rounding.name}", found, answers)
            if rounding.word:
                emulated = made.run(frames)
                for key, values in emulated.items():
                    got = np.stack([one[key] for one in found])
                    if not np.array_equal(got, values):
                        self.wrong.append((seed, f"C {name}", f"'{key}' is not the emulator's"))
                        break
        assert at == len(text)


def drivers(names):
    """Return a main program that runs all, each in STREAMS streams, and its vector."""
    lines = [*(f'#include "{name}.h"' for name in names), "#include <stdio.h>", ""]
    body = []
    for name in names:
        lines += [
            f"int vector_{name}(void);",
            f"static int run_{name}(void)",
            "{",
            f"    static {name}_memory memory; static {name}_input input;",
            f"    static {name}_output output;",
            f"    for (int s = 0; s < {STREAMS}; ++s) {{",
            f"        {name}_reset(&memory);",
            f"        for (int n = 0; n < {FRAMES}; ++n) {{",
            "            if (fread(&input, sizeof input, 1, stdin) != 1) { return 1; }",
            f"            {name}_step(&memory, &input, &output);",
            "            if (fwrite(&output, sizeof output, 1, stdout) != 1) { return 1; }",
            "        }",
            "    }",
            f"    return putchar(vector_{name}() == 0 ? '1' : '0') == EOF;",
            "}",
        ]
        body.append(f"    if (run_{name}()) {{ return 2; }}")
    return "\n".join([*lines, "int main(void)", "{", *body, "    return 0;", "}", ""])


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--programs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=math.inf)
    parser.add_argument("--engines", default="reference,opencl,numba")
    parser.add_argument("--no-c", action="store_true")
    asked = parser.parse_args()
    compiler = None if asked.no_c else "cc"
    shard, began = Shard(compiler=compiler, engines=asked.engines.split(",")), time.monotonic()
    for seed in range(asked.seed, asked.seed + asked.programs):
        shard.one(seed)
        if len(shard.pending) >= 40:
            shard.compile()
        if time.monotonic() - began > asked.seconds:
            break
    shard.compile()
    for row in shard.wrong[:40]:
        print(*row)
    for words, count in shard.refused.most_common(8):
        print(f"refused {count}: {words}")
    wrong = len({row[0] for row in shard.wrong})
    bounded, seconds = shard.known - shard.exact, time.monotonic() - began
    print(
        f"tried {shard.tried}, wrong {wrong}, seeds {asked.seed} to {seed}; numbers compared "
        f"{shard.compared}, of them exact {shard.exact}, within a bound {bounded}; {seconds:.0f} s"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
