"""Explicit Runge–Kutta methods as data: a new method is one record here.

Runge–Kutta–Chebyshev methods of second order: steps as long as a diffusion's stages allow.

Sommeijer, Shampine & Verwer, J. Comput. Appl. Math. 88 (1998) 315-326, "RKC: An explicit solver for
parabolic PDEs". The interval of stability grows with the square of the stages. So s stages reach
s/3 times as far as s steps of Euler's method.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, cached_property
from math import factorial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats

Row = tuple[Fraction, ...]


class Explicit(Protocol):
    """Stages of a step of one length, which is all that engines know about an explicit method.

        k_i = F(x_i), x_i = x + h Σ_j a_ij k_j,   x⁺ = x + carried (x_s − x) + h Σ_i b_i k_i

    x_s is the state of the last stage.
    """

    @property
    def name(self) -> str:
        """Name of the method."""
        ...

    @property
    def a(self) -> tuple[Row, ...]:
        """Rows of the stages' states."""
        ...

    @property
    def b(self) -> Row:
        """Weights of the rates at the end."""
        ...

    @property
    def carried(self) -> float:
        """Part of the last stage's move that the end keeps."""
        ...

    @property
    def stages(self) -> int:
        """Evaluations of dx/dt."""
        ...


class Pair(Protocol):
    """Stages of a step, the last one at its end, with an error estimate.

    The coefficients are those of a `ButcherTableau` or of another method.
    """

    @property
    def name(self) -> str:
        """Name of the method."""
        ...

    @property
    def a(self) -> tuple[Row, ...]:
        """Rows of the stages' states; the last is the step's end."""
        ...

    @property
    def order(self) -> int:
        """Power of a step's length with which its estimated error grows."""
        ...

    @property
    def error(self) -> Row:
        """Weights of the error estimate that controls the step length; zeros accept every step."""
        ...

    @property
    def truncation(self) -> tuple[Row, ...]:
        """Parts of the error that a step adds."""
        ...

    @property
    def least_bent(self) -> float:
        """The least part of a step's error that they show where the rate bends in it."""
        ...

    @property
    def stages(self) -> int:
        """Evaluations of dx/dt; the last is the first of the next step."""
        ...


class LayerMethod(Protocol):
    """An integrator that gives the coefficients of a step for its length and a time constant.

    Engines use only these coefficients, so they can run integrators that they do not know.
    """

    @property
    def name(self) -> str:
        """The name that `method` takes."""
        ...

    @property
    def order(self) -> int:
        """Order of convergence."""
        ...

    def fixed(self, steps: Floats, tau: float) -> tuple[Floats, Floats, Floats]:
        """Return a, b and the carried part of steps of a layer, whose lengths are the first axis.

        Of as many stages (steps, stages, stages), (steps, stages) and (steps,).
        """
        ...

    def followed(self, steps: Floats, tau: float) -> tuple[Floats, Floats]:
        """Return a of the same steps with stages that estimate their error, and that estimate."""
        ...

    def growth(self, steps: Floats, values: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return growth factors of modes per step, (steps, modes), for 1/τ = 1 and eigenvalues."""
        ...


def _row(text: str) -> Row:
    return tuple(Fraction(number) for number in text.split())


@dataclass(frozen=True)
class ButcherTableau:
    """An explicit Runge–Kutta method.

        k_i = F(x + h Σ_j a_ij k_j),   x⁺ = x + h Σ_i b_i k_i,   error ≈ h Σ_i e_i k_i

    Attributes
    ----------
    name : str
    a : tuple of rows
        Row i has i numbers; the first stage has none.
    b : row
    order : int
    error : row, optional
        b − b̂ of the embedded method, whose last stage is the first of the next step. Without it,
        steps are fixed; zeros accept every step.

    Raises
    ------
    ValueError
        If the coefficients do not satisfy the conditions of their order.
    """

    name: str
    a: tuple[Row, ...]
    b: Row
    order: int
    error: Row = ()

    def __post_init__(self) -> None:
        if any(len(row) != i for i, row in enumerate(self.a)) or len(self.b) != len(self.a):
            raise ValueError(f"The tableau of '{self.name}' is not explicit.")
        b, a, c = self.b, self.a, [sum(row) for row in self.a]
        stages = range(len(b))
        conditions = [  # Hairer, Nørsett & Wanner, Solving ODEs I, table II.2.1
            (1, sum(b), 1),
            (2, sum(b[i] * c[i] for i in stages), Fraction(1, 2)),
            (3, sum(b[i] * c[i] ** 2 for i in stages), Fraction(1, 3)),
            (3, sum(b[i] * a[i][j] * c[j] for i in stages for j in range(i)), Fraction(1, 6)),
            (4, sum(b[i] * c[i] ** 3 for i in stages), Fraction(1, 4)),
        ]
        wrong = [at for at, got, wanted in conditions if at <= self.order and got != wanted]
        if wrong or (self.error and sum(self.error) != 0):
            raise ValueError(
                f"'{self.name}' does not satisfy the conditions of order {wrong or 'error'}."
            )
        if self.error and (a[-1] != b[:-1] or b[-1] != 0):
            raise ValueError(
                f"The last stage of '{self.name}', which has an error estimate, is not at the end "
                "of the step."
            )

    @property
    def carried(self) -> float:
        """Share of the last stage's change that the result keeps: 0, as the rates suffice."""
        return 0.0

    @property
    def stages(self) -> int:
        """Number of evaluations of dx/dt per step."""
        return len(self.b)

    @property
    def adaptive(self) -> bool:
        """Whether the method estimates its own error."""
        return bool(self.error)

    @property
    def truncation(self) -> tuple[Row, ...]:
        """Rows d, each with a part h Σ_i d_i k_i of the step's own truncation error, in order.

        On x' = λx, z = hλ, the stages are k_i = λ K_i(z) x with K_i of degree i. The step is off by
        e^z − R(z). Its leading parts up to z^s are combinations of the stages: a row each. Between
        corners of f an array is linear, so that they show its error. At a corner, their sum of
        absolute values is seldom below the error. Bogacki–Shampine's is never below 0.37 of it,
        Dormand–Prince's never below 0.19. That of the embedded method may vanish there. A stage
        that reaches no higher power than the one before shows no part of its own.
        """
        return self._truncation

    @cached_property
    def _truncation(self) -> tuple[Row, ...]:
        growth = self._stage_polynomials
        gaps = [
            Fraction(1, factorial(q + 1)) - sum(b * growth[i][q] for i, b in enumerate(self.b))
            for q in range(self.stages)
        ]
        shows = [growth[q][q] != 0 for q in range(self.stages)]
        return tuple(self._row_of(q, gap, growth) for q, gap in enumerate(gaps) if gap and shows[q])

    @cached_property
    def _stage_polynomials(self) -> list[list[Fraction]]:
        """Return the coefficients of K_i(z) = 1 + z Σ_j a_ij K_j(z), lowest power first."""
        growth: list[list[Fraction]] = []
        for row in self.a:
            powers = [
                sum((a * k[q] for a, k in zip(row, growth, strict=True)), Fraction(0))
                for q in range(self.stages - 1)
            ]
            growth.append([Fraction(1), *powers])
        return growth

    def _row_of(self, power: int, value: Fraction, growth: list[list[Fraction]]) -> Row:
        """Return d with Σ_i d_i K_i(z) = value · z^power, from the highest power down."""
        row = [Fraction(0)] * self.stages
        for q in reversed(range(self.stages)):
            wanted = value if q == power else Fraction(0)
            above = sum((row[i] * growth[i][q] for i in range(q + 1, self.stages)), Fraction(0))
            row[q] = (wanted - above) / growth[q][q] if growth[q][q] else Fraction(0)
        return tuple(row)

    @cached_property
    def estimate_smooth(self) -> float:
        """Error estimate of a small step of x' = λx, over |hλ|^order · |x|."""
        growth, power = self._stage_polynomials, self.order - 1
        return abs(float(sum(e * k[power] for e, k in zip(self.error, growth, strict=True))))

    @cached_property
    def estimate_bent(self) -> float:
        """Mean error estimate, over h², of a step in which the slope of the rate changes by 1."""
        return self._mean_estimate((self.error,), _bent)

    @cached_property
    def estimate_jumped(self) -> float:
        """Mean error estimate, over h, of a step in which the rate jumps by 1."""
        return self._mean_estimate((self.error,), _jumped)

    @property
    def least_bent(self) -> float:
        """The least part of a step's error that `truncation` shows where the rate bends in it."""
        return self._least_bent

    @cached_property
    def _least_bent(self) -> float:
        times = np.array([float(sum(row)) for row in self.a])
        places = np.linspace(0.0, 1.0, 1002)[1:-1, np.newaxis]
        rates = np.maximum(times - places, 0.0)
        ends = np.array([float(weight) for weight in self.b])
        error = np.abs(rates @ ends - 0.5 * (1.0 - places[:, 0]) ** 2)
        rows = np.array([[float(e) for e in row] for row in self.truncation])
        shown = np.abs(rates @ rows.T).sum(axis=1)
        return float((shown / np.maximum(error, 1e-12)).min())

    @cached_property
    def truncation_bent(self) -> float:
        """Truncation error, over h², of a step in which the slope of the rate changes by 1."""
        return self._mean_estimate(self.truncation, _bent)

    @cached_property
    def truncation_jumped(self) -> float:
        """Truncation error, over h, of a step in which the rate jumps by 1."""
        return self._mean_estimate(self.truncation, _jumped)

    def _mean_estimate(self, rows: tuple[Row, ...], rate: Callable[[Floats], Floats]) -> float:
        """Average over the places in a step where the rate may change."""
        times = np.array([float(sum(row)) for row in self.a])
        since = times - np.linspace(0.0, 1.0, 1001)[:, np.newaxis]
        weights = np.array([[float(e) for e in row] for row in rows])
        return float(np.abs(rate(since) @ weights.T).sum(axis=1).mean())

    @cached_property
    def real_stability(self) -> float:
        """Length of the interval of the negative real axis where |R(z)| ≤ 1."""
        polynomial = self._stability_polynomial
        z = np.linspace(0.0, -8.0, 80_001)
        outside = np.abs(np.polyval(polynomial, z)) > 1.0 + 1e-12
        return float(-z[np.argmax(outside) - 1])

    def growth(self, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return R(z), the growth factor of a mode per step, with z = h·λ."""
        first, *others = self._stability_polynomial
        value = np.full(z.shape, first, np.complex128)
        for factor in others:
            value *= z
            value += factor
        return value

    @cached_property
    def _stability_polynomial(self) -> list[float]:
        # R(z) = 1 + Σ_s z^s bᵀ A^{s−1} 1, highest power first
        n = self.stages
        a = np.array([[float(x) for x in row] + [0.0] * (n - len(row)) for row in self.a])
        b = np.array([float(x) for x in self.b])
        powers = [1.0]
        vector = np.ones(n)
        for _ in range(n):
            powers.append(float(b @ vector))
            vector = a @ vector
        return powers[::-1]


def _bent(since: Floats) -> Floats:
    return np.maximum(since, 0.0)


def _jumped(since: Floats) -> Floats:
    return np.where(since > 0.0, 1.0, 0.0)


EULER = ButcherTableau("euler", (_row(""),), _row("1"), 1)
HEUN = ButcherTableau("heun", (_row(""), _row("1")), _row("1/2 1/2"), 2)
RK4 = ButcherTableau(
    "rk4",
    (_row(""), _row("1/2"), _row("0 1/2"), _row("0 0 1")),
    _row("1/6 1/3 1/3 1/6"),
    4,
)
# Bogacki & Shampine 1989, 3(2)
BOGACKI_SHAMPINE = ButcherTableau(
    "bogacki-shampine",
    (_row(""), _row("1/2"), _row("0 3/4"), _row("2/9 1/3 4/9")),
    _row("2/9 1/3 4/9 0"),
    3,
    error=_row("-5/72 1/12 1/9 -1/8"),
)
# Dormand & Prince 1980, 5(4)
DORMAND_PRINCE = ButcherTableau(
    "dormand-prince",
    (
        _row(""),
        _row("1/5"),
        _row("3/40 9/40"),
        _row("44/45 -56/15 32/9"),
        _row("19372/6561 -25360/2187 64448/6561 -212/729"),
        _row("9017/3168 -355/33 46732/5247 49/176 -5103/18656"),
        _row("35/384 0 500/1113 125/192 -2187/6784 11/84"),
    ),
    _row("35/384 0 500/1113 125/192 -2187/6784 11/84 0"),
    5,
    error=_row("71/57600 0 -71/16695 71/1920 -17253/339200 22/525 -1/40"),
)

TABLEAUX = {t.name: t for t in (EULER, HEUN, RK4, BOGACKI_SHAMPINE, DORMAND_PRINCE)}

# Heun's own stages do not see a rate that bends between them: one more lies amid the step (Shu &
# Osher 1988)
_FOLLOWED_HEUN = ButcherTableau(
    "heun",
    (_row(""), _row("1"), _row("1/4 1/4"), _row("1/2 1/2 0")),
    _row("1/2 1/2 0 0"),
    2,
    error=_row("0 0 0 0"),
)


def followed(method: ButcherTableau) -> ButcherTableau:
    """Return the same steps with stages that show their error, the last one at the end.

    The error estimate is 0, so that every step is accepted.
    """
    if method == HEUN:
        return _FOLLOWED_HEUN
    if not method.adaptive:
        method = replace(method, a=(*method.a, method.b), b=(*method.b, Fraction(0)))
    return replace(method, error=(Fraction(0),) * method.stages)


DAMPING = 2.0 / 13.0
"""ε of the paper: |P| stays below 1 by about ε/3 within the interval of stability."""

STABILITY = 2.0 / 3.0 * (1.0 - 2.0 / 15.0 * DAMPING)
"""Length of a method's interval of stability over s² − 1."""

MAX_STAGES = 40
"""Beyond it rounding in single precision grows with s², more than longer steps gain."""


@dataclass(frozen=True, slots=True)
class Chebyshev:
    """A Runge–Kutta–Chebyshev method with s stages.

        Y₀ = x,  Y₁ = Y₀ + first·h F₀,
        Y_j = (1 − back₁_j − back₂_j) Y₀ + back₁_j Y_{j−1} + back₂_j Y_{j−2}
              + rate_j h F_{j−1} + start_j h F₀,   x⁺ = Y_s

    Attributes
    ----------
    stages : int
    first : float
    rows : tuple of (back1, back2, rate, start)
        For j = 2 … s.

    Raises
    ------
    ValueError
        If the stability polynomial is not 1 + z + z²/2 + O(z³), or leaves [−1, 1] within the
        interval of stability.
    """

    stages: int
    first: float
    rows: tuple[tuple[float, float, float, float], ...]

    def __post_init__(self) -> None:
        if self.stages < 2 or len(self.rows) != self.stages - 1:
            raise ValueError(f"A Chebyshev method needs at least 2 stages, got {self.stages}.")
        z = np.linspace(-self.real_stability, 0.0, 40 * self.stages)
        if np.abs(self.growth(z)).max() > 1.0 + 1e-9:
            raise ValueError(f"The Chebyshev method of {self.stages} stages is not stable.")
        # a difference of third order on 1 + z + z²/2: the rest is O(z³)
        left = self.growth(np.array([-1e-3])) - (1.0 - 1e-3 + 0.5e-6)
        if abs(float(left[0])) > 1e-9:
            raise ValueError(f"The Chebyshev method of {self.stages} stages is not of order 2.")

    @property
    def real_stability(self) -> float:
        """Length of the interval of the negative real axis where |P| ≤ 1."""
        return (self.stages**2 - 1) * STABILITY

    def growth(self, z: Floats) -> Floats:
        """Return the stability polynomial P(z), by the method's own recursion."""
        before, now = np.ones_like(z), 1.0 + self.first * z
        for back1, back2, rate, start in self.rows:
            new = (1.0 - back1 - back2) + back1 * now + back2 * before + rate * z * now + start * z
            before, now = now, new
        return now


@cache
def chebyshev_method(stages: int) -> Chebyshev:
    """Return the method of that many stages (at least 2)."""
    w0 = 1.0 + DAMPING / stages**2
    value, slope, bend = _polynomials(w0, stages)
    w1 = slope[stages] / bend[stages]
    b = np.empty(stages + 1)
    b[2:] = bend[2:] / slope[2:] ** 2
    b[:2] = b[2]
    a = 1.0 - b * value
    rows = [
        (
            float(2.0 * b[j] * w0 / b[j - 1]),
            float(-b[j] / b[j - 2]),
            float(2.0 * b[j] * w1 / b[j - 1]),
            float(-a[j - 1] * 2.0 * b[j] * w1 / b[j - 1]),
        )
        for j in range(2, stages + 1)
    ]
    return Chebyshev(stages, float(b[1] * w1), tuple(rows))


def _polynomials(at: float, highest: int) -> tuple[Floats, Floats, Floats]:
    """Return T₀ … T_highest at a place, and their first and second derivatives.

    By T_{j+1} = 2x T_j − T_{j−1} and its derivatives, which grow from x ≥ 1 on and lose nothing.
    """
    value, slope, bend = np.ones(highest + 1), np.zeros(highest + 1), np.zeros(highest + 1)
    value[1], slope[1] = at, 1.0
    for j in range(1, highest):
        value[j + 1] = 2.0 * at * value[j] - value[j - 1]
        slope[j + 1] = 2.0 * value[j] + 2.0 * at * slope[j] - slope[j - 1]
        bend[j + 1] = 4.0 * slope[j] + 2.0 * at * bend[j] - bend[j - 1]
    return value, slope, bend


def stages_about(reach: Floats) -> Floats:
    """Return the mean number of stages for steps with h·|λ| = reach, each of which may round up."""
    return np.maximum(2.0, np.sqrt(1.0 + reach / STABILITY) + 0.5)


def stages_for(reach: float) -> int:
    """Return the fewest stages that are stable at h·|λ| = reach.

    The answer may be above `MAX_STAGES`: then the step has to be shorter.
    """
    return max(2, math.ceil(math.sqrt(1.0 + max(reach, 0.0) / STABILITY)))


def coefficients() -> Floats:
    """Return (most + 1, most, 4) numbers: method s, stage j; the first stage's weight at j = 0."""
    table = np.zeros((MAX_STAGES + 1, MAX_STAGES, 4))
    for stages in range(2, MAX_STAGES + 1):
        method = chebyshev_method(stages)
        table[stages, 0, 2] = method.first
        table[stages, 1:stages] = method.rows
    return table
