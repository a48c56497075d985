"""Random networks of every documented kind, and where they truly end by other means than cnnum's.

    python tests/helpers/random_networks.py SEED COUNT [ENGINE ...]

A network is drawn as plain numbers. `template_of` makes cnnum's template of them; `Truth` follows
the same numbers with a right-hand side of its own and SciPy's Dormand-Prince 8(5,3). They share no
code. Starts may be as small as 1e-8 and grow, cells saturate or not, gains vary in time, and
outputs may be seen late. The command prints how many stated errors were below the true one. It also
prints how far above they are: seeds give shards that add up.
"""

import json
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import followed
import numpy as np

import cnnum
from cnnum.integrators.stability import METHODS
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import OutputFunction, Table

ROUGH, FINE, FINEST = 1e-7, 1e-11, 1e-13
"""Tolerances of the truth: the rough one is enough where it leaves no doubt, and what seems wrong
is looked at once more, as a step of the truth may miss a corner, too."""

COARSER = 100.0
"""Share of its tolerance in that of a second solution: how far they are apart is what the truth
itself may be off by."""

NUDGE = 1e-15
"""Share of the start by which that of the second solution is off: where all cells are alike, the
roundings of a solver may grow into a picture that the array never has."""

CLEARLY = 2.0
"""Times that the truth may be off by more than it seems: beyond that it is taken anew, and in the
end it is not known."""

OWN = OutputFunction(
    "soft", lambda x: x / np.sqrt(1.0 + x * x), "x / sqrt(ONE + x * x)", smooth=True
)
STEEP = OutputFunction(
    "steep", lambda x: np.clip(2.0 * x, -1.0, 1.0), "clamp(R(2) * x, -ONE, ONE)", slope=(0.0, 2.0)
)

RESPONSES: dict[str, Callable[[Any], Any]] = {
    "standard": lambda x: 0.5 * (np.abs(x + 1.0) - np.abs(x - 1.0)),
    "full-range": lambda x: np.minimum(1.0, np.maximum(-1.0, x)),
    "linear": lambda x: x,
    "tanh": np.tanh,
    "sign": lambda x: np.where(x >= 0.0, 1.0, -1.0),
    "soft": lambda x: x / np.sqrt(1.0 + x * x),
    "steep": lambda x: np.minimum(1.0, np.maximum(-1.0, 2.0 * x)),
}
"""Output functions, written once more."""


@dataclass(frozen=True)
class Late:
    """Couplings that see outputs and inputs a delay ago."""

    delay: float
    A: Any
    B: Any


@dataclass(frozen=True)
class Bend:
    """A nonlinear coupling: a table of straight lines of a neighbour's quantity."""

    weights: Any
    points: tuple[tuple[float, float], ...]
    neighbour: str
    centre: str | None
    times: bool
    reverse: bool
    to: int
    source: int


@dataclass(frozen=True)
class Network:
    """A network as plain numbers, with a batch of frames, and how it is run.

    Attributes
    ----------
    A : (layers, layers, k, k), B : (layers, 1, k, k), z, tau : (layers,)
    boundary, rim : float, "zero-flux" or "periodic"
        Of states, and of inputs.
    gains : tuple of (to, source, kind, points)
    u : (frames, rows, cols), x, bias : (frames, layers, rows, cols), held : (rows, cols) bool
    times : tuple of float
        Where the run is looked at; the last is its end.
    """

    A: Any
    B: Any
    z: Any
    tau: Any
    boundary: float | str
    rim: float | str
    output: str
    gains: tuple[tuple[int, int, str, tuple[tuple[float, float], ...]], ...]
    late: Late | None
    bends: tuple[Bend, ...]
    u: Any
    x: Any
    bias: Any
    held: Any
    times: tuple[float, ...]
    how: dict[str, Any] = field(default_factory=dict)
    kind: str = ""


def draw(rng: np.random.Generator) -> Network:
    """Return a random network."""
    output = str(rng.choice([*RESPONSES], p=[0.3, 0.15, 0.1, 0.2, 0.05, 0.1, 0.1]))
    layers = 1 if output == "sign" else int(rng.choice([1, 1, 1, 2, 3]))
    k = int(rng.choice([1, 3, 3, 5]))
    rows, cols = int(rng.integers(1, 7)), int(rng.integers(1, 7))
    tau = np.ones(layers)
    if output != "sign":
        tau = 10.0 ** rng.uniform(-0.7, 0.7, layers)
        if rng.random() < 0.3:
            tau = tau * 10.0 ** rng.uniform(-7.0, 3.0)
    unit = float(tau.max())
    length = float(unit * 10.0 ** rng.uniform(-1.0, 1.3))
    if output == "sign":
        length = float(rng.integers(0, 12))
    A = _feedback(rng, layers, k)
    kind = str(rng.choice(["any", "small", "decides", "contracts"], p=[0.4, 0.3, 0.15, 0.15]))
    if kind in ("small", "decides"):
        centre = rng.uniform(1.0, 4.0)
        for layer in range(layers):
            A[layer, layer, k // 2, k // 2] = centre
    strength = np.abs(A).sum(axis=(1, 2, 3)).max()
    if kind == "contracts" and strength > 0:
        A *= rng.uniform(0.05, 0.99) / strength
    if output == "linear":
        fastest = ((np.abs(A).sum(axis=(1, 2, 3)) - 1.0) / tau).max()
        length = float(min(length, 20.0 / fastest)) if fastest > 0.0 else length
    B = rng.normal(size=(layers, 1, k, k)) * (rng.random((k, k)) < 0.5) * rng.choice([0.0, 1.0])
    frames = int(rng.choice([1, 1, 3]))
    size = 10.0 ** rng.uniform(-8.0, -0.5) if kind == "small" else rng.choice([0.1, 0.9, 3.0])
    driven = rng.choice([0.0, 1.0]) * (size if kind == "small" else 1.0)
    x = rng.uniform(-1.0, 1.0, (frames, layers, rows, cols)) * size
    if rng.random() < 0.15:  # all cells alike, at a saddle's rim or on it
        x[:] = size * rng.choice([-1.0, 1.0, 0.3])
    late = (
        _late(rng, layers, unit, length) if output not in ("sign",) and rng.random() < 0.1 else None
    )
    gains = _gains(rng, layers, length) if output != "sign" and rng.random() < 0.2 else ()
    bends = ()
    if output not in ("sign",) and rng.random() < 0.12:
        bends = (_bend(rng, layers, k),)
    u = rng.uniform(-1.0, 1.0, (frames, rows, cols)) * rng.uniform(0.0, 2.0) * driven
    bias = rng.normal(size=(frames, layers, rows, cols)) * driven if rng.random() < 0.3 else None
    held = rng.random((rows, cols)) < 0.3 if rng.random() < 0.2 else None
    count = int(rng.choice([0, 0, 0, 1, 3, 8]))
    times = {*(float(t) for t in rng.uniform(0.0, length, count)), length}
    if output == "sign":
        times = {*(float(t) for t in rng.integers(0, int(length) + 1, count)), length}
    return Network(
        A=A, B=B, z=rng.normal(size=layers) * driven, tau=tau,
        boundary=_edge(rng), rim=_edge(rng), output=output, gains=gains, late=late, bends=bends,
        u=u, x=x, bias=bias, held=held, times=tuple(sorted(times)),
        how=_how(rng, output, late), kind=kind,
    )  # fmt: skip


def _feedback(rng: np.random.Generator, layers: int, k: int) -> Any:
    A = rng.normal(size=(layers, layers, k, k)) * (rng.random((k, k)) < rng.uniform(0.2, 1.0))
    if rng.random() < 0.3:  # symmetric between the layers, too
        A = A + A[..., ::-1, ::-1].swapaxes(0, 1)
    total = max(1e-9, float(np.abs(A).sum(axis=(1, 2, 3)).max()))
    return A * (10.0 ** rng.uniform(-1.0, 1.3) / total)


def _edge(rng: np.random.Generator) -> float | str:
    return (0.0, float(rng.uniform(-1.5, 1.5)), "zero-flux", "periodic")[int(rng.integers(4))]


def _late(rng: np.random.Generator, layers: int, unit: float, length: float) -> Late:
    A = rng.normal(size=(layers, layers, 3, 3)) * (rng.random((3, 3)) < 0.4)
    A *= rng.uniform(0.1, 2.0) / max(1e-9, np.abs(A).sum(axis=(1, 2, 3)).max())
    B = rng.normal(size=(layers, 1, 3, 3)) * rng.choice([0.0, 0.3])
    return Late(float(max(unit * 10.0 ** rng.uniform(-1.0, 0.5), length / 20.0)), A, B)


def _gains(rng: np.random.Generator, layers: int, length: float) -> Any:
    found = []
    for _ in range(int(rng.integers(1, 3))):
        count = int(rng.integers(1, 6))
        places = np.unique(np.sort(rng.uniform(-0.1, 1.2, count)) * length)
        if rng.random() < 0.3 and len(places) > 1:  # a pulse that steps jump over
            places[1] = places[0] + length * 10.0 ** rng.uniform(-4.0, -1.5)
            places = np.unique(places)
        levels = rng.uniform(-1.0, 2.0, len(places))
        points = tuple(zip(places.tolist(), levels.tolist(), strict=True))
        to, source = (int(n) for n in rng.integers(layers, size=2))
        found.append((to, source, str(rng.choice(["constant", "linear"])), points))
    return tuple({gain[:2]: gain for gain in found}.values())


def _bend(rng: np.random.Generator, layers: int, k: int) -> Bend:
    places = np.unique(rng.uniform(-2.0, 2.0, int(rng.integers(2, 6))))
    points = tuple(zip(places.tolist(), rng.uniform(-1.0, 1.0, len(places)).tolist(), strict=True))
    neighbour = str(rng.choice(["x", "y", "u"]))
    centre = [None, "x", "y", "u"][int(rng.integers(4))]
    to, source = (int(n) for n in rng.integers(layers, size=2))
    weights = rng.normal(size=(k, k)) * (rng.random((k, k)) < 0.4) * 0.5
    source = 0 if neighbour == "u" else source
    return Bend(weights, points, neighbour, centre, bool(rng.random() < 0.2),
                bool(rng.random() < 0.3), to, source)  # fmt: skip


def _how(rng: np.random.Generator, output: str, late: Late | None) -> dict[str, Any]:
    rtol = float(10.0 ** rng.uniform(-6.0, -2.0))
    how = (
        {} if rng.random() < 0.6 else {"rtol": rtol, "atol": rtol * 10.0 ** rng.uniform(-2.0, 0.0)}
    )
    if output != "sign" and late is None and rng.random() < 0.2:
        how["method"] = str(rng.choice(["bogacki-shampine", "dormand-prince"]))
    return how


# cnnum's template and run

OUTPUTS = {"soft": OWN, "steep": STEEP}


def template_of(net: Network) -> cnnum.Template:
    """Return cnnum's template of a network."""
    gains = [Gain(to, source, Table(kind, points)) for to, source, kind, points in net.gains]
    late = net.late and DelayedCoupling(net.late.delay, net.late.A, net.late.B)
    bends = [
        NonlinearCoupling(
            b.weights,
            Table("linear", b.points),
            b.neighbour,
            b.centre,
            b.times,
            b.reverse,
            b.to,
            b.source,
        )
        for b in net.bends
    ]
    return cnnum.Template(
        "drawn", net.A, net.B, net.z.tolist(), tau=net.tau.tolist(), boundary=net.boundary,
        input_boundary=net.rim, output=OUTPUTS.get(net.output, net.output), gains=gains,
        delayed=late, nonlinear=bends, duration=net.times[-1],
    )  # fmt: skip


def run(engine: cnnum.Engine, net: Network, **options: Any) -> Any:
    """Return cnnum's result of a network, (times, frames, layers, rows, cols)."""
    maps = {"input": net.u, "state": net.x if len(net.tau) > 1 else net.x[:, 0]}
    if net.bias is not None:
        maps["bias"] = net.bias if len(net.tau) > 1 else net.bias[:, 0]
    if net.held is not None:
        maps["mask"] = net.held
    at = {"at": net.times} if len(net.times) > 1 else {}
    return engine.run(template_of(net), **maps, **at, **{**net.how, **options})


# the truth, of a right-hand side and a solver of its own


class Truth:
    """Where all frames of a network are at its times: one system, of (frames, states)."""

    def __init__(self, net: Network, *, alike: bool = True) -> None:
        self.net = net
        cells = np.arange(net.x[0, 0].size)
        self.first, self.sign = _alike(net) if alike else (cells, np.ones(len(cells)))
        self.frames, *shape = net.x.shape
        self.shape = tuple(shape)
        self.n = self.shape[1] * self.shape[2]
        self.f = RESPONSES[net.output]
        self.limited = net.output == "full-range"
        self.feedback, self.still = self._matrix(net.A)
        self.late = None if net.late is None else self._matrix(net.late.A)
        pace = np.broadcast_to(1.0 / net.tau[:, None, None], self.shape).copy()
        if net.held is not None:
            pace[:, net.held] = 0.0
        self.pace = pace.ravel()
        total = net.z[:, None, None] + self._driven(net.B)
        if net.bias is not None:
            total = total + net.bias
        self.drive = total.reshape(self.frames, -1)
        self.after = self.drive
        if net.late is not None:
            self.after = self.drive + self._driven(net.late.B).reshape(self.frames, -1)
        self.moves = [self._moves(b) for b in net.bends]

    def _cell(self, r: int, c: int, edge: float | str) -> int | None:
        """Return the number of the cell that stands there; None beyond a fixed rim."""
        rows, cols = self.shape[1:]
        if edge == "periodic":
            return (r % rows) * cols + c % cols
        if 0 <= r < rows and 0 <= c < cols:
            return r * cols + c
        if edge != "zero-flux":
            return None
        mirrored = []
        for at, n in ((r, rows), (c, cols)):
            at %= 2 * n  # the picture and its mirror image, one after the other
            mirrored.append(at if at < n else 2 * n - 1 - at)
        return mirrored[0] * cols + mirrored[1]

    def _near(self, di: int, dj: int, edge: float | str) -> Any:
        """Return the cell that every cell sees there; the one after the last beyond a fixed rim."""
        rows, cols = self.shape[1:]
        cells = [self._cell(i + di, j + dj, edge) for i in range(rows) for j in range(cols)]
        return np.array([self.n if at is None else at for at in cells])

    def _matrix(self, kernels: Any) -> tuple[Any, Any]:
        """Return the matrix of all couplings, and what fixed virtual cells add to them."""
        edge, n, layers = self.net.boundary, self.n, kernels.shape[0]
        beyond = 0.0 if isinstance(edge, str) else float(self.f(np.float64(edge)))
        matrix, still = np.zeros((layers * n, layers * n)), np.zeros((layers, layers, n))
        for (to, source, di, dj), weight in np.ndenumerate(kernels):
            if weight:
                r = kernels.shape[-1] // 2
                for cell, at in enumerate(self._near(di - r, dj - r, edge)):
                    if at == n:
                        still[to, source, cell] += weight * beyond
                    else:
                        seen = source * n + self.first[at]
                        matrix[to * n + cell, seen] += weight * self.sign[at]
        return matrix, still

    def _driven(self, kernels: Any) -> Any:
        """Return the sum over inputs, (frames, layers, rows, cols)."""
        edge, u = self.net.rim, self.net.u.reshape(self.frames, -1)
        beyond = np.full((self.frames, 1), 0.0 if isinstance(edge, str) else edge)
        seen = np.concatenate([u, beyond], axis=1)
        total = np.zeros((self.frames, kernels.shape[0], self.n))
        for (to, _, di, dj), weight in np.ndenumerate(kernels):
            if weight:
                r = kernels.shape[-1] // 2
                total[:, to] += weight * seen[:, self._near(di - r, dj - r, edge)]
        return total.reshape(self.frames, *self.shape)

    def _moves(self, b: Bend) -> Any:
        edge, r = self.net.rim if b.neighbour == "u" else self.net.boundary, b.weights.shape[0] // 2
        beyond = 0.0 if isinstance(edge, str) else float(edge)
        if b.neighbour == "y":
            beyond = float(self.f(np.float64(beyond)))
        first = np.append(self.first, self.n)  # no cells of opposite sign, with bends
        near = [
            (weight, first[self._near(di - r, dj - r, edge)])
            for (di, dj), weight in np.ndenumerate(b.weights)
            if weight
        ]
        return beyond, near

    def ends(self, tolerance: float, nudge: float = 0.0) -> Any:
        """Return the states at the network's times, (times, frames, layers, rows, cols).

        They start off by random parts of themselves as small as `nudge`.
        """
        net, x = self.net, self.net.x.reshape(self.frames, -1).copy()
        if net.output == "sign":
            return self._whole_steps(x)
        x *= 1.0 + nudge * np.random.default_rng(0).uniform(-1.0, 1.0, x.shape)
        if self.limited:
            x = np.minimum(1.0, np.maximum(-1.0, x))
        end = net.times[-1]
        stops = {0.0, end, *net.times}
        for _, _, _, points in net.gains:
            stops |= {p for p, _ in points if 0.0 < p < end}
        if net.late is not None:
            count = int(end / net.late.delay) + 1
            stops |= {n * net.late.delay for n in range(1, count) if n * net.late.delay < end}
        marks = sorted(stops)
        smooth = net.output in ("linear", "tanh", "soft") and not net.bends
        found, reached = followed.follow(
            self._numbers(), self._gains(), net.late.delay if net.late else 0.0, x.ravel(),
            np.array(marks), tolerance, smooth, 0.3 * float(net.tau.min()),
        )  # fmt: skip
        if not reached:
            raise ArithmeticError("too many steps")
        places = [marks.index(t) for t in net.times]
        return found[places].reshape(-1, self.frames, *self.shape)

    def _numbers(self) -> Any:
        """Return the network as `followed` takes it: the drive is that after the start."""
        net, n, states = self.net, self.n, len(self.feedback)
        late = (np.zeros((states, states)), np.zeros(states))
        if self.late is not None:
            late = self.late[0], self.late[1].sum(axis=1).ravel()
        matrices, still = [self.feedback, late[0]], [self.still.sum(axis=1).ravel(), late[1]]
        for to, source, _, _ in net.gains:
            part, rest = np.zeros((states, states)), np.zeros(states)
            rows, cols = slice(to * n, to * n + n), slice(source * n, source * n + n)
            part[rows, cols], rest[rows] = self.feedback[rows, cols], self.still[to, source]
            matrices.append(part)
            still.append(rest)
        kinds = {"x": 0.0, "y": 1.0, "u": 2.0, None: -1.0}
        bends, taps, points = [], [], [np.zeros((0, 2))]
        for number, (b, (beyond, near)) in enumerate(zip(net.bends, self.moves, strict=True)):
            first = sum(len(each) for each in points)
            points.append(np.array(b.points))
            sign = -1.0 if b.reverse else 1.0
            about = (b.to, b.source, kinds[b.neighbour], kinds[b.centre], float(b.times), beyond)
            bends.append([*about, sign, first, first + len(b.points)])
            taps += [[number, weight, *at] for weight, at in near]
        gain_points = [np.zeros((0, 2)), *(np.array(one[3]) for one in net.gains)]
        return (
            followed.CODES[net.output], self.limited, self.pace, followed.packed(matrices),
            np.array(still), np.ascontiguousarray(np.concatenate(gain_points).T), self.after,
            self.net.u.reshape(self.frames, -1), np.array(bends).reshape(-1, 9),
            np.array(taps, dtype=np.float64).reshape(-1, 2 + n),
            np.ascontiguousarray(np.concatenate(points).T),
        )  # fmt: skip

    def _gains(self) -> Any:
        firsts = np.cumsum([0, *(len(points) for *_, points in self.net.gains)])
        kinds = [kind == "linear" for _, _, kind, _ in self.net.gains]
        return np.array(list(zip(kinds, firsts, firsts[1:], strict=False)), float).reshape(-1, 3)

    def _whole_steps(self, x: Any) -> Any:
        found, steps = [], 0
        for time in self.net.times:
            while steps < round(time):
                rate = self.drive - x + self.f(x) @ self.feedback.T + self.still.sum(1).ravel()
                x, steps = x + rate * self.pace, steps + 1
            found.append(x)
        return np.array(found).reshape(-1, self.frames, *self.shape)


MIRRORS: tuple[Callable[[Any], Any], ...] = (
    lambda maps: maps[..., ::-1],
    lambda maps: maps[..., ::-1, :],
    lambda maps: maps[..., ::-1, ::-1],
    lambda maps: np.swapaxes(maps, -1, -2),
    lambda maps: np.swapaxes(maps, -1, -2)[..., ::-1, ::-1],
    lambda maps: np.rot90(maps, axes=(-2, -1)),
)
"""The symmetries of a square but for the turn that is the last one backwards."""


def symmetries(net: Network) -> Iterator[tuple[Callable[[Any], Any], float]]:
    """Yield the mirrors, turns and shifts of an array that change nothing in a network.

    With each comes the sign of all states and maps that it leaves as they are.
    """
    rows, cols = net.x.shape[2:]
    kernels = [net.A, net.B, *([net.late.A, net.late.B] if net.late else [])]
    kernels += [bend.weights for bend in net.bends]
    maps = [net.x, *([] if net.bias is None else [net.bias])]
    held = [] if net.held is None else [net.held]
    reads = (
        net.B.any()
        or net.late is not None
        or any(b.neighbour == "u" or b.centre == "u" for b in net.bends)
    )
    maps += [net.u] if reads else []
    edges = (net.boundary, net.rim) if reads else (net.boundary,)
    odd = not (net.z.any() or net.bends or net.output == "sign" or {*edges} - {0.0, *WITHOUT_EDGE})
    for sign in (1.0, -1.0) if odd else (1.0,):

        def alike(moved: Callable[[Any], Any], sign: float = sign) -> bool:
            same = all(np.array_equal(moved(one), sign * one) for one in maps)
            return same and all(np.array_equal(moved(one), one) for one in held)

        for mirror in MIRRORS[: 6 if rows == cols else 3]:
            if all(np.array_equal(mirror(one), one) for one in kernels) and alike(mirror):
                yield mirror, sign
        for by in np.ndindex(rows, cols) if {*edges} == {"periodic"} else ():

            def shifted(maps: Any, by: tuple[int, ...] = by) -> Any:
                return np.roll(maps, by, (-2, -1))

            if any(by) and alike(shifted):
                yield shifted, sign
    uniform = all((one == one[..., :1, :1]).all() for one in (*maps, *held))
    if uniform and not any(isinstance(edge, float) for edge in edges):
        yield lambda maps: np.broadcast_to(maps[..., :1, :1], maps.shape), 1.0


WITHOUT_EDGE = ("zero-flux", "periodic")


def _alike(net: Network) -> tuple[Any, Any]:
    """Return for each cell the first one that always has the same state, by symmetry.

    Then the sign that it has there: −1 for the opposite state, and 0 where both always are 0.
    Roundings of any solver may tell such cells apart, and then grow.
    """
    cells = np.arange(net.x[0, 0].size).reshape(net.x.shape[2:])
    moves = [(moved(cells).ravel().tolist(), sign) for moved, sign in symmetries(net)]
    near: list[list[tuple[int, float]]] = [[] for _ in range(cells.size)]
    for others, sign in moves:
        for at, other in enumerate(others):
            near[at].append((other, sign))
            near[other].append((at, sign))
    first, signs = np.full(cells.size, -1), np.ones(cells.size)
    for cell in range(cells.size):
        waiting = [cell] if first[cell] < 0 else []
        none = False
        for at in waiting:  # which grows
            first[at] = cell
            for other, sign in near[at]:
                if other not in waiting:
                    waiting.append(other)
                    signs[other] = sign * signs[at]
                none = none or signs[other] != sign * signs[at]
        signs[waiting] *= not none
    return first, signs


def symmetric(net: Network, rng: np.random.Generator, *, opposite: bool = False) -> Network:
    """Return a network with a symmetry, half of whose starts decay while others would grow far.

    Mirrored cells may have opposite states.
    """
    square = net.x.shape[2] == net.x.shape[3] and rng.random() < 0.5
    kinds = [[0], [1], [2], [0, 1]] + ([[3], [4], [2, 5], [0, 1, 3]] if square else [])
    kind = kinds[int(rng.integers(len(kinds)))]
    taken = [MIRRORS[at] for at in kind]
    signs = [1.0 if not opposite or (at, kind) == (2, [2, 5]) else -1.0 for at in kind]

    def even(maps: Any) -> Any:
        for mirror in taken:
            maps = 0.5 * (maps + mirror(maps))
        return maps

    def signed(maps: Any) -> Any:
        for mirror, sign in zip(taken, signs, strict=True):
            maps = 0.5 * (maps + sign * mirror(maps))
        return maps

    if opposite:
        edges = {name: 0.0 for name in ("boundary", "rim") if isinstance(getattr(net, name), float)}
        net = replace(net, z=0.0 * net.z, bends=(), **edges)
    late = net.late and Late(net.late.delay, even(net.late.A), even(net.late.B))
    bends = tuple(replace(bend, weights=even(bend.weights)) for bend in net.bends)
    held = net.held
    for mirror in taken if held is not None else []:
        held = held & mirror(held)
    bias = None if net.bias is None else signed(net.bias)
    A = even(net.A)
    net = replace(net, A=A, B=even(net.B), late=late, bends=bends, u=signed(net.u), x=signed(net.x),
                  bias=bias, held=held)  # fmt: skip
    if net.output == "sign" or rng.random() < 0.5:
        return net
    matrix = Truth(replace(net, late=None, bends=()), alike=False).feedback
    folded = Truth(replace(net, late=None, bends=())).feedback
    pace = np.repeat(1.0 / net.tau, net.x[0, 0].size)
    every, kept = (
        float(np.linalg.eigvals(pace[:, None] * one).real.max()) for one in (matrix, folded)
    )
    if every - kept > 1e-6 * abs(every):  # all that is symmetric decays, and something else grows
        length = net.times[-1]
        scale = float(rng.uniform(20.0, 60.0)) / ((every - kept) * length)
        A = A * scale
        decay = float(rng.uniform(-0.5, 1.0))
        for layer in range(len(net.tau)):
            A[layer, layer, A.shape[-1] // 2, A.shape[-1] // 2] += decay - kept * scale * float(
                net.tau[layer]
            )
    return replace(net, A=A)


# the judgement


@dataclass(frozen=True)
class Verdict:
    """A stated error, the true one, and how much of that is unknown; of a frame and a time."""

    network: int
    frame: int
    time: float
    stated: float
    true: float
    unknown: float
    method: str
    covered: bool


def truth_of(net: Network, tolerance: float = FINE) -> tuple[Any, Any]:
    """Return the true states (times, frames, layers, rows, cols), and how well they are known."""
    truth = Truth(net)
    # a state that is limited stops at once: every stop takes many steps
    loose = 10.0 if net.output in ("full-range", "steep") else 1.0
    tolerance *= loose
    fine, coarse = truth.ends(tolerance), truth.ends(COARSER * tolerance, NUDGE)
    # two solutions may agree by chance to more than their tolerance
    least = 10.0 * tolerance * np.abs(fine).max(axis=(2, 3, 4))
    unknown = np.maximum(np.abs(fine - coarse).max(axis=(2, 3, 4)), least)
    return fine, unknown


SYMMETRIC, OPPOSITE = 500_000_000, 700_000_000
"""Seeds from here on give networks with a symmetry; those of the second, with opposite states."""


def network_of(seed: int, number: int) -> Network:
    """Return one of the networks of a seed."""
    rng = np.random.default_rng([seed, number])
    net = draw(rng)
    return net if seed < SYMMETRIC else symmetric(net, rng, opposite=seed >= OPPOSITE)


def judged(engine: cnnum.Engine, net: Network, number: int, known: Any = None) -> Iterator[Verdict]:
    """Yield the verdicts on all frames and times of a network."""
    truth, unknown = truth_of(net) if known is None else known
    result = run(engine, net)
    state = np.asarray(result.state, dtype=np.float64).reshape(truth.shape)
    error = np.asarray(result.error, dtype=np.float64).reshape(truth.shape[:2])
    off = np.abs(state - truth).max(axis=(2, 3, 4))
    for at, time in enumerate(net.times):
        for frame in range(len(net.u)):
            stated, true, rest = (
                float(error[at, frame]),
                float(off[at, frame]),
                float(unknown[at, frame]),
            )
            yield Verdict(number, frame, time, stated, true, rest, result.method,
                          bool(true <= stated + CLEARLY * rest + 1e-300))  # fmt: skip


STEADY = ("euler", "heun", "rk4", "exponential-euler", "etd-rk2")
"""Methods whose steps have one length: their error is estimated on request."""


def otherwise(number: int) -> dict[str, Any]:
    """Return how one of three networks runs other than it was drawn: by each method in turn."""
    if number % 3:
        return {}
    method = METHODS[number // 3 % len(METHODS)]
    return {"method": method, "estimate": method in STEADY}


@dataclass
class Account:
    """What came of a number of networks."""

    networks: int = 0
    refused: int = 0
    unknown: int = 0
    errors: int = 0
    infinite: int = 0
    wrong: list[str] = field(default_factory=list)
    loose: list[float] = field(default_factory=list)

    def take(self, engine: cnnum.Engine, seed: int, number: int, **how: Any) -> None:
        """Judge one network of a seed, run as it draws or as `how` says."""
        net = network_of(seed, number)
        net = replace(net, how={**net.how, **how})
        verdicts: list[Verdict] = []
        for tolerance in (ROUGH, FINE, FINEST):
            try:
                known = truth_of(net, tolerance)
            except ArithmeticError:  # the other solver does not get through
                if verdicts and tolerance == FINEST:
                    break
                self.unknown += 1
                return
            try:
                verdicts = list(judged(engine, net, number, known))
            except cnnum.CnnumError:
                self.refused += 1
                return
            sure = all(one.true + CLEARLY * one.unknown <= one.stated for one in verdicts)
            if sure or (tolerance == FINE and all(one.covered for one in verdicts)):
                break
        self.networks += 1
        for one in verdicts:
            self.errors += 1
            self.infinite += not np.isfinite(one.stated)
            if not one.covered:
                at = f"{seed}:{number} frame {one.frame} at {one.time:.4g}, {net.output}"
                said = f"{engine.name} {engine.precision}: {one.stated:.3g} for {one.true:.3g}"
                self.wrong.append(f"{at}, {one.method}, {said}")
            steps = "propagator" not in one.method and np.isfinite(one.stated)
            if steps and one.true > 1e-8 and one.unknown < 0.1 * one.true:
                self.loose.append(one.stated / one.true)

    def take_any(self, engine: cnnum.Engine, seed: int, number: int) -> None:
        """Judge one network by the method of its number, or as drawn where it has no such steps."""
        refused, how = self.refused, otherwise(number)
        self.take(engine, seed, number, **how)
        if how and self.refused > refused:
            self.refused = refused
            self.take(engine, seed, number)

    def __str__(self) -> str:
        loose = np.array(self.loose or [np.nan])
        return json.dumps(
            {
                "networks": self.networks,
                "refused": self.refused,
                "not followed": self.unknown,
                "errors": self.errors,
                "infinite": self.infinite,
                "wrong": len(self.wrong),
                "median": round(float(np.median(loose)), 2),
                "nine tenths": round(float(np.quantile(loose, 0.9)), 1),
            }
        )


def main(seed: int, count: int, names: list[str]) -> None:
    """Judge a number of networks of a seed, and say what was wrong."""
    warnings.simplefilter("ignore")
    cases = [(name, "float64") for name in names or ["numba"]]
    cases += [(name, "float32") for name in names or ["numba"] if name != "reference"]
    engines = [cnnum.Engine(name, precision=precision) for name, precision in cases]
    account = Account()
    for number in range(count):
        before = len(account.wrong)
        account.take_any(engines[number // 3 % len(engines)], seed, number)
        for line in account.wrong[before:]:
            print(line, flush=True)
        if number % 100 == 99:
            print(account, flush=True)
    print(account, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
