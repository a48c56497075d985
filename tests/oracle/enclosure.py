"""Rigorous enclosures of piecewise-linear arrays, by Arb's balls (python-flint).

dx/dt = −x + A clip(x) + c on one layer, τ = 1. Where the same cells are saturated the array is
linear: x(s) is a Taylor polynomial, with a remainder below ‖M‖^K ‖v‖ s^(K+1) e^{‖M‖s} / (K+1)!.
Cells that meet a corner do so within a stretch of 2ε, which is passed by an inclusion: if
X ⊇ x + [0, 2ε] F(X), the solution stays in X (Picard–Lindelöf) and ends in x + 2ε F(X).
Precision pays for the wrapping around the truth: balls of 400 bits lose e^{‖M‖t} of it.
"""

from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat, ctx

from cnnum.templating.boundary import Boundary, halo_sources
from cnnum.templating.template import Template

BITS = 400
ORDER = 110
REACH = 8.0
"""‖M‖h of the longest polynomial: its remainder is 8¹¹⁰ / 110!, about 1e-79."""

THINNEST = 1e-12
"""Pieces of time below which a cell that only touches a corner is given up."""


class UndecidedError(Exception):
    """Two ways of going on cannot be set apart: a cell is balanced, or grazes a corner."""


@dataclass(slots=True)
class Balls:
    """A one-layer array, cell by cell."""

    feedback: arb_mat
    drive: list[arb]
    rate: arb
    """Bound on ‖M‖∞ whatever cells saturate."""


def weights_of(kernel, boundary: Boundary, shape) -> tuple[np.ndarray, np.ndarray]:
    """Weights (cells, cells) of a kernel, and its constant boundary's part of each cell."""
    rows, cols = shape
    radius = kernel.shape[-1] // 2
    around = halo_sources(boundary, shape, radius)
    matrix, constant = np.zeros((rows * cols, rows * cols)), np.zeros(rows * cols)
    for cell in range(rows * cols):
        row, col = divmod(cell, cols)
        for (down, east), weight in np.ndenumerate(kernel):
            source = around[row + down, col + east]
            if source < 0:
                constant[cell] += weight * boundary.constant
            else:
                matrix[cell, source] += weight
    return matrix, constant


def balls_of(template: Template, given) -> Balls:
    """The array of a template under an input; weights are the numbers that the template holds."""
    ctx.prec = BITS
    shape = given.shape
    A, rim = weights_of(template.A[0, 0], template.boundary, shape)
    drive = [arb(float(template.z[0])) + arb(value) for value in rim]
    if template.inputs:
        B, edge = weights_of(template.B[0, 0], template.input_boundary, shape)
        control = arb_mat(B.tolist()) * arb_mat([[arb(u)] for u in given.ravel().tolist()])
        drive = [d + control[i, 0] + arb(edge[i]) for i, d in enumerate(drive)]
    norm = float(np.abs(A).sum(axis=1).max()) + 1.0
    return Balls(arb_mat(A.tolist()), drive, arb(norm * (1.0 + 1e-9)))


def clipped(x: arb) -> arb:
    """f of a ball."""
    return x.min(arb(1)).max(arb(-1))


def side_of(x: arb) -> int | None:
    """Range that a ball is in: −1, 0 or 1; None on a corner."""
    if x > 1:
        return 1
    if x < -1:
        return -1
    return 0 if -1 < x < 1 else None


def hull(low: arb, high: arb) -> arb:
    return low.union(high)


class Course:
    """A state and its way on.

    Attributes
    ----------
    x : list of arb
    time : arb
    """

    def __init__(self, array: Balls, start) -> None:
        self.array, self.x, self.time = array, [arb(v) for v in np.ravel(start).tolist()], arb(0)
        self.crossings = 0

    def rates(self, x: list[arb]) -> list[arb]:
        y = self.array.feedback * arb_mat([[clipped(v)] for v in x])
        return [y[i, 0] + d - x[i] for i, d in enumerate(self.array.drive)]

    def to(self, end: float) -> None:
        """Go on until a time."""
        while self.time < end:
            sides = [side_of(v) for v in self.x]
            if None in sides:
                self.cross(arb(2) ** (-BITS // 3))  # the start may lie on a corner
                sides = [side_of(v) for v in self.x]
                if None in sides:
                    raise UndecidedError(f"a cell is balanced at a corner at {self.time}")
            left = arb(end) - self.time
            self.stretch(sides, min(float(left.mid()), REACH / float(self.array.rate.mid())), left)

    def cross(self, step: arb) -> None:
        """Pass corners in a step so short that its first order is exact to step²."""
        span, first = hull(arb(0), step), self.rates(self.x)
        speed = max((abs(v).upper() for v in first), key=float)
        # the radius of a ball has 30 bits: a thousandth of the way is room enough
        room = step * (speed + 1) / 1024
        margin = hull(-room, room)
        inside = [x + span * v + margin for x, v in zip(self.x, first, strict=True)]
        rates = self.rates(inside)
        image = [x + span * v for x, v in zip(self.x, rates, strict=True)]
        if not all(i in o for i, o in zip(image, inside, strict=True)):
            raise UndecidedError("no inclusion over a corner")
        self.x = [x + step * v for x, v in zip(self.x, rates, strict=True)]
        self.time = self.time + step

    def stretch(self, sides: list[int], longest: float, left: arb) -> None:
        """Go on in one polynomial, at most to the first corner."""
        path = Path(self.array, sides, self.x)
        at, width = 0.0, longest / 8.0
        ends = left if longest >= float(left.mid()) else arb(longest)
        while at < longest:
            to = min(at + width, longest)
            met = path.meets(at, to, sides)
            if met == []:
                at, width = to, 1.5 * width
            elif met is None:
                width /= 2.0
                if width < THINNEST:
                    raise UndecidedError(f"a cell grazes a corner at {self.time + at}")
            else:
                first = min(
                    (path.root(i, arb(at), arb(to), sides[i]) for i in met),
                    key=lambda s: float(s.mid()),
                )
                near = arb(2) ** (-BITS // 3)
                self.x, self.time = path.at(first - near), self.time + first - near
                self.cross(2 * near)
                self.crossings += 1
                return
        self.x, self.time = path.at(ends), self.time + ends


class Path:
    """The polynomial of a state while the same cells are saturated."""

    def __init__(self, array: Balls, sides: list[int], x: list[arb]) -> None:
        n = len(x)
        linear = [side == 0 for side in sides]
        M = arb_mat(
            [[array.feedback[i, j] if linear[j] else arb(0) for j in range(n)] for i in range(n)]
        )
        M = M - arb_mat([[arb(int(i == j)) for j in range(n)] for i in range(n)])
        held = array.feedback * arb_mat([[arb(side)] for side in sides])
        offset = [held[i, 0] + d for i, d in enumerate(array.drive)]
        column = M * arb_mat([[v] for v in x]) + arb_mat([[v] for v in offset])
        self.speed = max((abs(column[i, 0]).upper() for i in range(n)), key=float)
        self.rate, columns = array.rate, [arb_mat([[v] for v in x]), column]
        for k in range(2, ORDER + 1):
            columns.append(M * columns[-1] / arb(k))
        self.terms = arb_mat([[columns[k][i, 0] for k in range(ORDER + 1)] for i in range(n)])
        self.slopes = arb_mat(
            [[columns[k][i, 0] * k for k in range(1, ORDER + 1)] for i in range(n)]
        )
        self.n = n

    def _sum(self, terms: arb_mat, s: arb, order: int) -> list[arb]:
        powers, count = [arb(1)], terms.ncols()
        for _ in range(count - 1):
            powers.append(powers[-1] * s)
        values = terms * arb_mat([[p] for p in powers])
        late = abs(s).upper()
        rest = self.speed * self.rate**ORDER * late**order * (self.rate * late).exp()
        rest = rest / arb(ORDER + 1).gamma() if order == ORDER else rest / arb(ORDER + 2).gamma()
        ball = hull(-rest, rest)
        return [values[i, 0] + ball for i in range(self.n)]

    def at(self, s: arb) -> list[arb]:
        return self._sum(self.terms, s, ORDER + 1)

    def rates(self, s: arb) -> list[arb]:
        return self._sum(self.slopes, s, ORDER)

    def meets(self, start: float, end: float, sides: list[int]) -> list[int] | None:
        """Cells that leave their range between two times, moving one way; None where unclear."""
        low, high = self.at(arb(start)), self.at(arb(end))
        span = hull(arb(start), arb(end))
        rates, middle = self.rates(span), self.at(arb((start + end) / 2))
        met = []
        for i, side in enumerate(sides):
            # the mean value theorem, and where the rate keeps its sign the ends alone
            whole = middle[i] + rates[i] * (span - arb((start + end) / 2))
            if side_of(whole) == side:
                continue
            if not (rates[i] > 0 or rates[i] < 0):
                return None
            if side_of(low[i]) != side and start > 0.0:
                return None
            after = side_of(high[i])
            if after is None:
                return None
            if after != side:
                met.append(i)
        return met

    def root(self, cell: int, low: arb, high: arb, side: int) -> arb:
        """Time at which a cell is at a corner, near enough for the inclusion around it."""
        level = arb(side) if side else arb(1 if self.at(high)[cell] > 0 else -1)
        row = arb_mat([[self.terms[cell, k] for k in range(ORDER + 1)]])
        slope = arb_mat([[self.slopes[cell, k] for k in range(ORDER)]])
        s = arb(((low + high) / 2).mid())
        for _ in range(14):  # Newton, kept between the two; digits double
            powers = [arb(1)]
            for _ in range(ORDER):
                powers.append(powers[-1] * s)
            value = (row * arb_mat([[p] for p in powers]))[0, 0] - level
            rate = (slope * arb_mat([[p] for p in powers[:-1]]))[0, 0]
            s = arb((s - value / rate).mid())
            s = low if s < low else high if s > high else s
        return s


def rests(array: Balls, x: list[arb]) -> bool:
    """Whether all cells are saturated and stay so: each goes to its own end without a turn."""
    sides = [side_of(v) for v in x]
    if not all(sides):
        return False
    held = array.feedback * arb_mat([[arb(side)] for side in sides])
    return all(side_of(held[i, 0] + d) == sides[i] for i, d in enumerate(array.drive))
