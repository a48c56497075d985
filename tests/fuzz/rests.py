"""Random networks that may settle, and where they truly do: nothing here is of the package's own.

The right-hand side is written from the state equation, cell by cell; SciPy's DOP853 follows it.
Limited states and delays are followed by Heun's steps, whose fixed points are those of the network.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.integrate import solve_ivp

import cnnum
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import OutputFunction, Table

SOFT = OutputFunction(
    "soft sign", lambda x: x / (1.0 + np.abs(x)), "x / (ONE + fabs(x))", slope=(0.0, 1.0)
)
OUTPUTS = ("standard", "tanh", "full-range", "linear", "sign", SOFT)
UNITS = (1.0, 1.0, 1e-6, 1.0, 1e5)
"""Units of time in turn: rests are where they are in any."""

LONGEST = 400.0
STILL = 1e-9


@dataclass
class Case:
    """A network, its maps, and its right-hand side by hand."""

    kind: str
    template: cnnum.Template
    maps: dict[str, np.ndarray]
    limits: bool = False
    delay: float = 0.0
    matrix: np.ndarray = field(default_factory=lambda: np.zeros(0))
    late: np.ndarray = field(default_factory=lambda: np.zeros(0))
    drive: np.ndarray = field(default_factory=lambda: np.zeros(0))
    late_drive: np.ndarray = field(default_factory=lambda: np.zeros(0))
    tau: np.ndarray = field(default_factory=lambda: np.zeros(0))
    held: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    start: np.ndarray = field(default_factory=lambda: np.zeros(0))
    pairs: list = field(default_factory=list)
    gain: tuple = ()
    """Matrix and rim of the couplings that it multiplies, its times and values, and whether it
    steps."""

    def output(self, x):
        name = getattr(self.template.output, "name", "")
        if name == "tanh":
            return np.tanh(x)
        if name == "linear":
            return x
        if name == "sign":
            return np.where(x >= 0.0, 1.0, -1.0)
        if name == "soft sign":
            return x / (1.0 + np.abs(x))
        return np.minimum(np.maximum(x, -1.0), 1.0)

    def rate(self, x, past=None):
        y = self.output(x)
        rate = self.matrix @ y + self.drive - x
        if self.delay:
            rate = rate + self.late @ (y if past is None else past) + self.late_drive
        for to, near, weight, centre, table, edge, quantity in self.pairs:
            values = np.append(x if quantity == "x" else y, edge)
            argument = values[near] - (values[centre] if centre is not None else 0.0)
            points = np.array(table)
            found = np.interp(argument, points[:, 0], points[:, 1])
            np.add.at(rate, to, weight * found)
        return np.where(self.held, 0.0, rate) / self.tau

    def truth(self):
        """Return the state at rest, or None where it does not come to one in time."""
        if getattr(self.template.output, "discrete", False):
            x, seen = self.start, None
            for _ in range(1000):
                y = self.output(x)
                if seen is not None and (y == seen).all():
                    return x
                seen = y
                x = np.where(self.held, self.start, self.matrix @ y + self.drive)
            return None
        if self.limits or self.delay:
            return self.by_steps(0.1)
        x, stretch, time, slowest = self.through_gains(), 50.0, 0.0, float(self.tau.max())
        while time < LONGEST:
            way = solve_ivp(
                lambda _, v: self.rate(v), (0.0, stretch * slowest), x, method="DOP853",
                rtol=1e-10, atol=1e-13)  # fmt: skip
            moved = np.abs(way.y[:, -1] - x).max()
            x, time, stretch = way.y[:, -1], time + stretch, 2.0 * stretch
            if not np.isfinite(x).all() or np.abs(x).max() > 1e9:
                return None
            # a slow mode has a small rate long before it is at rest
            if np.abs(self.rate(x)).max() * slowest < STILL and moved < 10.0 * STILL:
                return x
        return None

    def through_gains(self):
        """Return the state once the gain keeps its last value, which the matrix then has."""
        if not self.gain:
            return self.start
        matrix, rim, times, values, steps = self.gain
        plain, drive, x, begin = self.matrix, self.drive, self.start, 0.0

        def take(value):
            self.matrix, self.drive = plain + (value - 1.0) * matrix, drive + (value - 1.0) * rim

        for n, end in enumerate(times[:-1] if steps else times):
            low, high = values[n if steps else max(0, n - 1)], values[n]

            def moving(t, v, begin=begin, end=end, low=low, high=high):
                take(low + (high - low) * (t - begin) / (end - begin))
                return self.rate(v)

            x = solve_ivp(moving, (begin, end), x, method="DOP853", rtol=1e-11, atol=1e-14).y[:, -1]
            begin = end
        take(values[-1])
        self.gain = ()  # the rest has no gain
        return x

    def by_steps(self, share):
        fastest, slowest = float(self.tau.min()), float(self.tau.max())
        h = share * fastest
        lag = max(1, math.ceil(self.delay / h)) if self.delay else 0
        h = self.delay / lag if lag else h
        x = self.start
        past = [self.output(x)] * (lag + 1)
        still = 0
        for _ in range(round(150.0 * slowest / h)):
            before = past[-lag - 1] if lag else None
            next_past = past[-lag] if lag else None
            one = self.rate(x, before)
            if self.limits:
                one = np.where((np.abs(x) >= 1.0) & (one * x > 0.0), 0.0, one)
            ahead = x + h * one
            ahead = np.clip(ahead, -1.0, 1.0) if self.limits else ahead
            two = self.rate(ahead, next_past)
            moved = x + 0.5 * h * (one + two)
            moved = np.clip(moved, -1.0, 1.0) if self.limits else moved
            still = still + 1 if np.abs(moved - x).max() < 1e-12 else 0
            x = moved
            if not np.isfinite(x).all() or np.abs(x).max() > 1e9:
                return None
            if lag:
                past.append(self.output(x))
                del past[: -lag - 2]
            if still > lag + 5:
                return x
        return None


def place(row, col, rows, cols, boundary):
    """Return the number of the cell that a place in or beyond an array is; −1 for a virtual one."""
    if boundary == "periodic":
        return (row % rows) * cols + col % cols
    if boundary == "zero-flux":
        row, col = (
            (i % (2 * n)) if (i % (2 * n)) < n else 2 * n - 1 - i % (2 * n)
            for i, n in ((row, rows), (col, cols))
        )
        return row * cols + col
    return row * cols + col if 0 <= row < rows and 0 <= col < cols else -1


def spread(kernels, boundary, shape, edge):
    """Return kernels (to, from, k, k) cell by cell, and the sum of virtual cells."""
    rows, cols = shape
    layers, sources, k = kernels.shape[:3]
    n, r = rows * cols, k // 2
    matrix, rim = np.zeros((layers * n, sources * n)), np.zeros(layers * n)
    for to, source, a, b in zip(*np.nonzero(kernels), strict=True):
        for row in range(rows):
            for col in range(cols):
                weight = kernels[to, source, a, b]
                seen = place(row + a - r, col + b - r, rows, cols, boundary)
                if seen < 0:
                    rim[to * n + row * cols + col] += weight * edge
                else:
                    matrix[to * n + row * cols + col, source * n + seen] += weight
    return matrix, rim


def case_of(seed, number):
    """Return a random network of one of the documented kinds, by seed and number."""
    rng = np.random.default_rng([seed, number])
    kind = ("plain", "plain", "growth", "fold", "nonlinear", "layers", "delayed", "masked")[
        int(rng.integers(8))
    ]
    shape = tuple(int(n) for n in rng.integers(1, 5, 2))
    if kind == "growth" and rng.random() < 0.06:
        shape = (18, 19)
    layers = int(rng.integers(2, 4)) if kind == "layers" else 1
    output = OUTPUTS[int(rng.choice(6, p=[0.3, 0.28, 0.16, 0.1, 0.06, 0.1]))]
    if kind in ("delayed", "nonlinear") and output == "sign":
        output = "tanh"
    if kind == "fold":
        return fold_of(rng)
    k = int(rng.choice([1, 3, 3, 5])) if shape[0] < 10 else 3
    A = rng.normal(size=(layers, layers, k, k))
    A *= rng.random(A.shape) < rng.uniform(0.2, 1.0)
    style = rng.integers(3)
    if style == 0 and layers == 1:  # symmetric, so that it settles
        A = 0.5 * (A + A[:, :, ::-1, ::-1])
    elif style == 1:
        A = np.abs(A)
    total = max(1e-9, float(np.abs(A).sum(axis=(1, 2, 3)).max()))
    A *= rng.uniform(0.1, float(rng.choice([0.9, 2.0, 4.0]))) / total
    if rng.random() < 0.6 or kind == "growth":
        for layer in range(layers):
            A[layer, layer, k // 2, k // 2] += rng.uniform(0.0, 2.0)
    if output == "linear":
        A *= 0.9 / max(0.9, float(np.abs(A).sum(axis=(1, 2, 3)).max()) * rng.uniform(0.8, 1.2))
    boundary = (0.0, 0.4, -1.5, "zero-flux", "periodic")[int(rng.integers(5))]
    if output == "sign" or (output == "full-range" and boundary == -1.5):
        boundary = "zero-flux"
    inputs = int(rng.integers(1, 3)) if kind == "layers" else int(rng.integers(2))
    B = rng.normal(size=(layers, inputs, 3, 3)) * 0.5
    z = rng.normal(size=layers) * (0.0 if kind == "growth" else rng.choice([0.0, 0.3, 2.0]))
    tau = rng.choice([0.2, 1.0, 1.0, 4.0], size=layers) if output != "sign" else np.ones(layers)
    if output != "sign" and kind != "delayed":
        tau *= UNITS[number % len(UNITS)]
    scale = 10.0 ** -rng.uniform(0.0, 8.0) if kind == "growth" else rng.choice([1e-3, 0.9, 2.0])
    state = rng.uniform(-1.0, 1.0, (layers, *shape)) * scale
    if output == "full-range":
        state = np.clip(state, -1.0, 1.0)
    maps = {"state": state}
    if inputs:
        size = 0.0 if kind == "growth" else rng.uniform(0.0, 1.0)
        maps["input"] = rng.uniform(-1.0, 1.0, (inputs, *shape)) * size
    if rng.random() < 0.3 and kind != "growth":
        maps["bias"] = rng.normal(size=(layers, *shape)) * 0.3
    if kind == "masked" or rng.random() < 0.1:
        maps["mask"] = (rng.random(shape) < 0.3).astype(float)
    nonlinear, delayed = (), None
    if kind == "nonlinear":
        places = np.sort(rng.uniform(-1.5, 1.5, int(rng.integers(2, 5))))
        places += np.arange(len(places)) * 0.05
        points = tuple(
            (float(v), float(f)) for v, f in zip(places, rng.normal(size=len(places)), strict=True)
        )
        weights = rng.normal(size=(3, 3)) * (rng.random((3, 3)) < 0.5) * 0.5
        quantity = str(rng.choice(["x", "y"]))
        centre = quantity if rng.random() < 0.5 else None
        nonlinear = (
            NonlinearCoupling(
                weights, Table("linear", points), quantity, centre, reversed_sign=centre is not None
            ),
        )
    if kind == "delayed":
        late = rng.normal(size=(layers, layers, 1, 1)) * 0.5
        seen = rng.normal(size=(layers, inputs, 1, 1)) * 0.3
        delayed = DelayedCoupling(float(rng.choice([0.3, 1.0])), late, seen)
    template = cnnum.Template(
        "random", A, B if inputs else None, z.tolist(), tau=tau.tolist(), boundary=boundary,
        output=output, nonlinear=nonlinear, delayed=delayed)  # fmt: skip
    case = by_hand(kind, template, maps, A, B, z, tau, boundary, shape, nonlinear, delayed)
    if number % 6 == 4 and delayed is None and output not in ("sign", "full-range"):
        with_gain(case, np.random.default_rng([seed, number, 1]), A, boundary, shape)
    return case


def with_gain(case, rng, A, boundary, shape):
    """Let a weight of a case change in time, before the rest that it had or after it."""
    to, source = (int(n) for n in rng.integers(len(A), size=2))
    times = np.cumsum(rng.uniform(0.1, 1.0, int(rng.integers(2, 5)))) * float(case.tau.max())
    times, values = times * rng.choice([0.5, 3.0, 12.0]), rng.uniform(-0.5, 1.5, len(times))
    steps = bool(rng.random() < 0.5)
    points = tuple((float(t), float(v)) for t, v in zip(times, values, strict=True))
    part = np.zeros_like(A)
    part[to, source] = A[to, source]
    fixed = boundary if not isinstance(boundary, str) else 0.0
    case.gain = (*spread(part, boundary, shape, float(case.output(np.array(fixed)))), times, values,
                 steps)  # fmt: skip
    gain = Gain(to, source, Table("constant" if steps else "linear", points))
    case.template = replace(case.template, gains=(gain,))
    case.kind = f"{case.kind}, gain"


def fold_of(rng):
    """Return cells beside a fold of x = a f(x) + z, a little on either side of it."""
    a = float(rng.uniform(1.3, 3.0))
    name = str(rng.choice(["tanh", "standard", "full-range"]))
    if name == "tanh":
        x = -math.acosh(math.sqrt(a))
        z = x - a * math.tanh(x)
    else:
        z = a - 1.0
    z += float(rng.choice([-1.0, 1.0])) * 10.0 ** -rng.uniform(1.0, 7.0)
    shape = (1, int(rng.integers(1, 4)))
    start = -1.5 if name == "tanh" else -1.0
    state = np.full((1, *shape), start) + 0.1 * rng.random((1, *shape))
    if name == "full-range":
        state = np.clip(state, -1.0, 1.0)
    A, B, zero = np.full((1, 1, 1, 1), a), np.zeros((1, 0, 1, 1)), np.array([z])
    template = cnnum.Template("fold", A, None, z, output=name)
    one = np.ones(1)
    return by_hand("fold", template, {"state": state}, A, B, zero, one, 0.0, shape, (), None)


def by_hand(kind, template, maps, A, B, z, tau, boundary, shape, nonlinear, delayed):
    """Return the case of a template with its equation written out."""
    n = shape[0] * shape[1]
    case = Case(kind, template, maps, limits=template.output.limited)
    fixed = boundary if not isinstance(boundary, str) else 0.0
    edge = float(case.output(np.array(fixed)))
    case.matrix, rim = spread(A, boundary, shape, edge)
    case.drive = np.repeat(z, n) + rim
    inputs = maps["input"].ravel() if "input" in maps else np.zeros(0)
    if "input" in maps:
        matrix, rim = spread(B, boundary, shape, fixed)
        case.drive = case.drive + matrix @ inputs + rim
    if "bias" in maps:
        case.drive = case.drive + maps["bias"].ravel()
    case.tau, case.start = np.repeat(tau, n), maps["state"].ravel()
    case.held = np.zeros(len(case.tau), bool)
    if "mask" in maps:
        case.held = np.tile(maps["mask"].ravel() > 0.5, len(tau))
    for one in nonlinear:
        rows, cols = shape
        to, near, weight, centre = [], [], [], []
        for a, b in zip(*np.nonzero(one.weights), strict=True):
            for cell in range(n):
                to.append(cell)
                near.append(place(cell // cols + a - 1, cell % cols + b - 1, rows, cols, boundary))
                weight.append(one.weights[a, b])
                centre.append(cell)
        if to:
            virtual = fixed if one.neighbour == "x" else edge
            near = [n if seen < 0 else seen for seen in near]
            own = np.array(centre) if one.centre else None
            case.pairs.append(
                (np.array(to), np.array(near), np.array(weight), own, one.function.points, virtual,
                 one.neighbour))  # fmt: skip
    if delayed is not None:
        case.delay = delayed.delay
        case.late, rim = spread(delayed.A, boundary, shape, edge)
        case.late_drive = rim
        if "input" in maps:
            matrix, more = spread(delayed.B, boundary, shape, fixed)
            case.late_drive = case.late_drive + matrix @ inputs + more
    return case


def run(engine, case):
    """Return the result of a case on an engine, or None where it refuses in a sentence."""
    plain = {"mask"} | ({"input"} if len(case.maps.get("input", [0, 0])) == 1 else set())
    plain |= {"state", "bias"} if len(case.maps["state"]) == 1 else set()
    maps = {
        role: (one > 0.5 if role == "mask" else one[0] if role in plain else one)
        for role, one in case.maps.items()
    }
    try:
        return engine.run(case.template, **maps, duration="settle")
    except cnnum.CnnumError:
        return None


def judge(case, result, *, proof):
    """Return a sentence of what is wrong with a result; empty if nothing is.

    Right is an error that covers the true one beyond what the truth itself is off, and bounds that
    hold it.
    """
    finite = bool(np.isfinite(result.error))
    certified = str(result.certified) if proof or not finite else ""
    if not finite and certified != "unknown":
        return f"an infinite error is {certified}"
    decision = result.decision if proof else None
    known = decision is not None and bool(np.isfinite(decision.lower).all())
    if not finite and not known:
        return ""
    if finite and not bool(result.settled):
        return "a finite error of what does not settle"
    truth = case.truth()
    if truth is None:
        return ""
    spare = 2e-8 * (1.0 + np.abs(truth))
    off = np.abs(np.ravel(result.state) - truth)
    if finite and bool((off > float(result.error) + spare).any()) and case.limits:
        truth = case.by_steps(0.01)  # the corner may have been missed by the longer steps
        if truth is None:
            return ""
        off = np.abs(np.ravel(result.state) - truth)
    if finite and bool((off > float(result.error) + spare).any()):
        return f"error {float(result.error):.3g} for {off.max():.3g} ({certified})"
    if decision is not None and known:
        low, high = np.ravel(decision.lower) - spare, np.ravel(decision.upper) + spare
        if bool(((truth < low) | (truth > high)).any()):
            return "bounds that do not hold the true state"
    return ""
