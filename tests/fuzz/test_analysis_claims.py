"""What `cnnum.analyse` claims, of random templates, against an integrator and matrices of its own.

Nothing here shares code with the package but the records of templates and of output functions. In
a long run `CNNUM_SEED` shifts the seeds, so that several runs add up.
"""

import math
import os
import time
from collections import Counter

import numpy as np
import pytest

import cnnum
from cnnum.templating.functions import OutputFunction

SECONDS = float(os.environ.get("CNNUM_FUZZ", "0")) / 8.0
FIRST = int(os.environ.get("CNNUM_SEED", "0"))
CASES = 40


def wave(x):
    return x * np.exp(-x * x)


SMOOTH = {"smooth": True}
OWN = [  # with slopes that are declared rightly, and the same with others
    OutputFunction("steep", lambda x: np.tanh(3.0 * x), "tanh(R(3) * x)", slope=(0, 3), **SMOOTH),
    OutputFunction("wave", wave, "x * exp(-x * x)", slope=(-0.447, 1.0), **SMOOTH),
    OutputFunction("ratio", lambda x: x / (1.0 + abs(x)), "x / (ONE + fabs(x))", **SMOOTH),
    OutputFunction("ramp", lambda x: np.maximum(x, 0.0), "fmax(x, ZERO)"),
    OutputFunction("twice", lambda x: 2.0 * x, "R(2) * x", slope=(2.0, 2.0), **SMOOTH),
    OutputFunction("half", lambda x: 0.5 * x, "R(0.5) * x", slope=(0.5, 0.5), **SMOOTH),
    OutputFunction("falling", lambda x: -np.tanh(x), "-tanh(x)", slope=(-1.0, 0.0), **SMOOTH),
    OutputFunction("raised", lambda x: 3.0 + np.tanh(x), "R(3) + tanh(x)", **SMOOTH),
    OutputFunction("hump", lambda x: np.exp(-x * x), "exp(-x * x)", slope=(-0.86, 0.86), **SMOOTH),
]
FALSE = [
    OutputFunction("steep2", lambda x: np.tanh(3.0 * x), "tanh(R(3) * x)", **SMOOTH),
    OutputFunction("wave2", wave, "x * exp(-x * x)", **SMOOTH),
    OutputFunction("twice2", lambda x: 2.0 * x, "R(2) * x"),
    OutputFunction("cube", lambda x: x * x * x, "x * x * x", **SMOOTH),
    OutputFunction("step", lambda x: np.where(x > 0.3, 1.0, -1.0), "PICK(x > 0.3f, ONE, -ONE)"),
]
NAMED = ["standard", "linear", "tanh", "full-range"]
FUNCTIONS = {
    "standard": lambda x: np.clip(x, -1.0, 1.0),
    "linear": lambda x: x,
    "tanh": np.tanh,
    "full-range": lambda x: np.clip(x, -1.0, 1.0),
}
KINDS = [
    "centre",
    "one side",
    "half-plane",
    "symmetric",
    "even",
    "even along one",
    "positive",
    "sparse",
    "any",
]


def kernels(rng, layers, size):
    """Feedback of one of the kinds for which there are theorems, or nearly so."""
    kind = KINDS[rng.integers(len(KINDS))]
    A = np.round(rng.normal(size=(layers, layers, size, size)), 2)
    middle = size // 2
    if kind == "centre":
        A *= (np.arange(size) == middle)[:, None] & (np.arange(size) == middle)
        A *= np.eye(layers)[:, :, None, None]
    elif kind == "one side":
        A *= (np.arange(size) == middle)[:, None] & (np.arange(size) <= middle)
    elif kind == "half-plane":
        A *= (np.arange(size) < middle)[:, None] | (np.arange(size) == middle)
    elif kind == "symmetric":
        A = 0.5 * (A + A.transpose(1, 0, 2, 3)[:, :, ::-1, ::-1])
    elif kind == "even":
        A = 0.25 * sum(A[:, :, ::a, ::b] for a in (1, -1) for b in (1, -1))
        A = 0.5 * (A + A.transpose(1, 0, 2, 3))
    elif kind == "even along one":  # and its own mirror image, over the layers
        axis = int(rng.integers(2, 4))
        A = 0.25 * (A + np.flip(A, axis))
        A = A + A.transpose(1, 0, 2, 3)[:, :, ::-1, ::-1]
    elif kind == "positive":
        A = np.abs(A)
    elif kind == "sparse":
        A *= rng.random(A.shape) < 0.3
    own = np.array([0.0, 0.5, 1.0, 2.0, -2.0, 1.3])[rng.integers(6)]
    A[range(layers), range(layers), middle, middle] = own
    return A * rng.choice([0.1, 0.3, 1.0, 1.0, 2.0])


def drawn(seed):
    """A template, an array, and whether its output declares slopes that hold."""
    rng = np.random.default_rng(seed)
    layers, inputs = int(rng.choice([1, 1, 1, 2])), int(rng.integers(0, 3))
    output = rng.integers(3)
    own = [NAMED, OWN, FALSE][0 if output == 0 else rng.choice([0, 1, 2], p=[0.4, 0.45, 0.15])]
    output = own[rng.integers(len(own))]
    limited = output == "full-range"
    size = int(rng.choice([1, 3, 3, 3, 5]))
    edges = [0.0, 0.7, -3.0, "zero-flux", "periodic"]
    parts = {
        "tau": rng.choice([0.5, 1.0, 4.0], size=layers).tolist() if rng.random() < 0.4 else 1.0,
        "boundary": edges[rng.integers(5)],
        "input_boundary": [*edges, 2.5, None][rng.integers(7)],
        "initial": 0.0 if limited else [0.0, 0.4, -5.0][rng.integers(3)],
        "output": output,
    }
    B = np.round(rng.normal(size=(layers, inputs, 3, 3)), 2) if inputs else None
    z = np.round(rng.normal(size=layers) * rng.choice([0.0, 0.3, 2.0]), 2).tolist()
    template = cnnum.Template("drawn", kernels(rng, layers, size), B, z, **parts)
    return template, (int(rng.integers(1, 9)), int(rng.integers(1, 9))), own is not FALSE


def at(index, n, boundary):
    """The cell of an axis that a virtual one copies; None where it is fixed."""
    if 0 <= index < n:
        return index
    if boundary.pad_mode == "wrap":
        return index % n
    if boundary.pad_mode == "symmetric":
        index %= 2 * n
        return index if index < n else 2 * n - 1 - index
    return None


def dense(weights, shape, boundary):
    """The matrix of couplings, and for each cell the sum of weights of fixed virtual cells."""
    (to, source, *_), (rows, cols) = weights.shape, shape
    cells, middle = rows * cols, weights.shape[-1] // 2
    matrix, rim = np.zeros((to * cells, source * cells)), np.zeros(to * cells)
    for t, s, i, j in np.argwhere(weights):
        for r in range(rows):
            for c in range(cols):
                y, x = at(r + i - middle, rows, boundary), at(c + j - middle, cols, boundary)
                here = t * cells + r * cols + c
                if y is None or x is None:
                    rim[here] += weights[t, s, i, j]
                else:
                    matrix[here, s * cells + y * cols + x] += weights[t, s, i, j]
    return matrix, rim


class Array:
    """The state equation as one matrix, and RK4 on it, many starts at once."""

    def __init__(self, template, shape):
        self.f = FUNCTIONS.get(template.output.name, template.output.numpy)
        self.limited, cells = template.output.name == "full-range", shape[0] * shape[1]
        self.A, rim = dense(template.A, shape, template.boundary)
        self.B, seen = dense(template.B, shape, template.input_boundary)
        edge = 0.0
        if template.boundary.constant is not None:
            edge = float(self.f(np.float64(template.boundary.constant)))
        self.still = rim * edge + seen * (template.input_boundary.constant or 0.0)
        self.still = (self.still + np.repeat(template.z, cells))[:, None]
        self.tau = np.repeat(template.tau, cells)[:, None]

    def rates(self, x, drive):
        if self.limited:
            x = np.clip(x, -1.0, 1.0)
        found = (drive - x + self.A @ self.f(x)) / self.tau
        if self.limited:
            found = np.where((x >= 1.0) & (found > 0) | (x <= -1.0) & (found < 0), 0.0, found)
        return found

    @np.errstate(over="ignore", invalid="ignore")  # a cube may run away within one step
    def run(self, x, drive, time, steepest):
        """Return the end, its largest rate, the largest |x| on the way."""
        fastest = (1.0 + np.abs(self.A).sum(axis=1).max(initial=0.0) * steepest) / self.tau.min()
        h, most, end = 0.4 / fastest, np.abs(x).max(), time * self.tau.max()
        for step in range(math.ceil(end / h)):
            k1 = self.rates(x, drive)
            k2 = self.rates(x + 0.5 * h * k1, drive)
            k3 = self.rates(x + 0.5 * h * k2, drive)
            k4 = self.rates(x + h * k3, drive)
            x = x + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
            x = np.clip(x, -1.0, 1.0) if self.limited else x
            most = max(most, np.nan_to_num(np.abs(x), nan=np.inf).max())
            if most > 1e12 or (step % 16 == 0 and np.abs(k1).max() < 1e-9):
                break
        return x, float(np.abs(self.rates(x, drive)).max()), most


RESTS = {
    "linear and stable",
    "contracting",
    "monostable cells",
    "bistable cells",
    "symmetric A",
    "feed-forward",
    "positive cell-linking",
}


def claims_hold(seed, tally):
    template, shape, honest = drawn(seed)
    found, array = cnnum.analyse(template, shape), Array(template, shape)
    kind, output = found.kind.name, template.output
    tally[kind] += 1
    tally["exact"] += found.exact
    assert honest or output.name == "cube" or kind == "unknown", kind
    rng, states = np.random.default_rng(seed), len(array.tau)
    starts, signs = rng.uniform(-1, 1, (states, 4)), rng.choice([-1.0, 1.0], (states, 4))
    x = np.concatenate([starts, signs, np.full((states, 1), template.initial)], axis=1)
    # inputs at random, and those that push one cell as far as any can
    u = rng.uniform(-1.0, 1.0, (array.B.shape[1], x.shape[1]))
    u[:, 4:] = np.sign(array.B[rng.integers(states)])[:, None] if u.size else u[:, 4:]
    drive = array.still + array.B @ u
    steep = 3.0 if not honest else output.steepest
    rests, bounded = kind in RESTS, math.isfinite(found.largest)
    time = 60.0 if rests else 10.0
    end, rate, most = array.run(x, drive, time, steep)
    assert most <= found.largest * (1.0 + 1e-9), (most, found.largest)
    if output.name in ("standard", "tanh", "full-range"):
        assert bounded
    for _ in range(6):  # each four times as long: slow passages are no rest yet
        if not rests or rate < 1e-4:
            break
        time *= 3.0
        end, rate, _ = array.run(end, drive, time, steep)
    assert not rests or rate < 1e-4, (kind, rate)
    if kind in ("linear and stable", "contracting"):
        ends, _, _ = array.run(
            x[:, :1] * 7.0 if not array.limited else -x[:, :1], drive[:, :1], 200.0, steep
        )
        assert np.abs(ends - array.run(end[:, :1], drive[:, :1], 200.0, steep)[0]).max() < 1e-3
    if kind == "bistable cells" and output.name != "tanh":
        assert ((np.abs(end) >= 1.0 - 1e-6) | (end == x)).all()  # or it starts in balance
    figures_hold(template, found, array, tally)


def figures_hold(template, found, array, tally):
    """Rates, and the condition, of the dense matrices."""
    if template.output.name not in FUNCTIONS:
        assert math.isnan(found.condition)
        assert math.isnan(found.growth)
        return
    inside = array.A - np.eye(len(array.A))
    sizes = np.linalg.svd(inside, compute_uv=False)
    if sizes.min() > 1e-12 * sizes.max():
        assert found.condition == pytest.approx(sizes.max() / sizes.min(), rel=1e-3)
    else:
        assert found.condition > 1e11
    values = np.linalg.eigvals(inside / array.tau)
    other = np.linalg.eigvals((inside / array.tau).T)
    if np.abs(np.sort(values.real) - np.sort(other.real)).max() > 1e-7:
        tally["ill-conditioned"] += 1
        return
    fastest = np.abs(values).max()
    assert found.fastest >= fastest * (1.0 - 1e-7)
    if found.exact:
        assert found.fastest == pytest.approx(fastest, rel=1e-6)
    assert found.growth == pytest.approx(max(0.0, values.real.max()), abs=1e-6)
    assert found.turning == pytest.approx(np.abs(values.imag).max(), abs=1e-4 * fastest)
    decays = -values.real[values.real < -1e-6]
    if len(decays):
        assert found.slowest <= decays.min() * (1.0 + 1e-5)
        if not (np.abs(values.real) < 1e-6).any():
            assert found.slowest == pytest.approx(decays.min(), rel=1e-5)
            assert found.stiffness == pytest.approx(decays.max() / decays.min(), rel=1e-4)


def test_claims_of_random_templates():
    tally, end, seed = Counter(), time.monotonic() + SECONDS, FIRST
    while seed < FIRST + CASES or time.monotonic() < end:
        try:
            claims_hold(seed, tally)
        except AssertionError as error:
            raise AssertionError(f"seed {seed}: {error}") from error
        seed += 1
    print(f"{seed - FIRST} templates: {dict(tally)}")
    # a class for everything, or for nothing, is no answer
    assert len(set(tally) & RESTS) >= 6
    assert 0.1 < tally["unknown"] / (seed - FIRST) < 0.9
