"""Random programs: a description of steps, and the program of it that a user would write."""

import math
from dataclasses import dataclass

import numpy as np

import cnnum
from cnnum.programs.machine import blocks
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


def program_of(described, name):
    """Return one program of some descriptions, each (steps, outputs, beginning of its outputs)."""

    def function(frame):
        found = {}
        for steps, outputs, beginning in described:
            fields = [frame.a, frame.b]
            built(frame, steps, fields)
            found |= {f"{beginning}{key}": fields[place] for key, place in outputs.items()}
        return found

    return cnnum.Program(function, name)
