"""Implicit steps for stiff arrays as data: Rosenbrock methods, which solve linear systems alone.

    (1/(hγ) − J) K_i = F(x + Σ_j a_ij K_j) + Σ_j c_ij K_j / h,   x⁺ = x + Σ_i m_i K_i,
    error ≈ Σ_i e_i K_i

J is the array's Jacobian at x (Hairer & Wanner, Solving ODEs II, section IV.7). No Newton
iteration is needed: between corners of f an array is linear, and J is exact.
"""

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape
from cnnum.errors import MethodError
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.schemes import Control
from cnnum.integrators.tableau import Row
from cnnum.templating.network import Network
from cnnum.templating.template import Template

MOST_STATES = 20_000
"""States of an array beyond which one factorisation per step takes seconds."""

MOST_STEPS = 20_000
"""Largest number of steps in a run: each needs a factorisation, and these take half a minute."""


@dataclass(frozen=True, slots=True)
class RosenbrockMethod:
    """A Rosenbrock method, in the form that avoids products with the Jacobian J.

    Attributes
    ----------
    name : str
    gamma : Fraction
    a, c : tuple of rows
        Row i has i numbers; the first stage has none.
    m : row
        Weights of the stages at the end.
    order : int
        Up to 3.
    error : row
        Weights of the stages in the error estimate, which is one order lower.

    Raises
    ------
    ValueError
        If the coefficients violate the order conditions, or fast decaying modes are not damped.
    """

    name: str
    gamma: Fraction
    a: tuple[Row, ...]
    c: tuple[Row, ...]
    m: Row
    order: int
    error: Row

    def __post_init__(self) -> None:
        stages = range(self.stages)
        if any(len(rows[i]) != i for rows in (self.a, self.c) for i in stages):
            raise ValueError(f"Stages of '{self.name}' depend on later stages.")
        embedded = tuple(m - e for m, e in zip(self.m, self.error, strict=True))
        wrong = [*self._missed(self.m, self.order), *self._missed(embedded, self.order - 1)]
        if wrong:
            raise ValueError(f"'{self.name}' does not satisfy the conditions of order {wrong}.")
        if abs(self.growth(np.array([-1e12 + 0j]))[0]) > 1e-9:
            raise ValueError(f"'{self.name}' does not damp fast decaying modes.")

    @property
    def stages(self) -> int:
        """Number of linear systems per step, all with the same matrix."""
        return len(self.m)

    def _missed(self, m: Row, order: int) -> list[int]:
        """Return the orders whose conditions fail (Hairer & Wanner II, table IV.7.1).

        With Γ = (1/γ − C)⁻¹ the method's own numbers are α = a Γ, b = m Γ, β = α + Γ.
        """
        n = self.stages
        full = [
            [Fraction(0) if j > i else -self.c[i][j] if j < i else 1 / self.gamma for j in range(n)]
            for i in range(n)
        ]
        turned = _inverse(full)
        alpha, b = [_times(row, turned) for row in self.a], _times(m, turned)
        beta = [[alpha[i][j] + turned[i][j] for j in range(n)] for i in range(n)]
        c, d = [sum(row) for row in alpha], [sum(row) for row in beta]
        conditions = [
            (1, sum(b), 1),
            (2, sum(b[i] * d[i] for i in range(n)), Fraction(1, 2)),
            (3, sum(b[i] * c[i] ** 2 for i in range(n)), Fraction(1, 3)),
            (3, sum(b[i] * beta[i][j] * d[j] for i in range(n) for j in range(n)), Fraction(1, 6)),
        ]
        return [at for at, got, wanted in conditions if at <= order and got != wanted]

    def growth(self, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return R(z), the growth factor of a mode per step, with z = h·λ."""
        known: list[NDArray[np.complex128]] = []
        for a, c in zip(self.a, self.c, strict=True):
            inner = 1.0 + sum((float(x) * k for x, k in zip(a, known, strict=True)), 0.0 * z)
            right = z * inner + sum((float(x) * k for x, k in zip(c, known, strict=True)), 0.0 * z)
            known.append(right / (1.0 / float(self.gamma) - z))
        return 1.0 + sum((float(x) * k for x, k in zip(self.m, known, strict=True)), 0.0 * z)


def _times(row: Row, matrix: list[list[Fraction]]) -> list[Fraction]:
    """Return a row, which may be short, times a square matrix."""
    parts = [[x * y for y in line] for x, line in zip(row, matrix, strict=False)]
    return [sum(column, Fraction(0)) for column in zip(*parts, [0] * len(matrix), strict=True)]


def _inverse(lower: list[list[Fraction]]) -> list[list[Fraction]]:
    """Return the inverse of a lower triangular matrix."""
    n = len(lower)
    result = [[Fraction(0)] * n for _ in range(n)]
    for j in range(n):
        for i in range(j, n):
            known = sum((lower[i][k] * result[k][j] for k in range(j, i)), Fraction(0))
            result[i][j] = (Fraction(int(i == j)) - known) / lower[i][i]
    return result


def _row(text: str) -> Row:
    return tuple(Fraction(number) for number in text.split())


# Sandu, Verwer, Blom, Spee, Carmichael & Potra, Atmos. Environ. 31 (1997) 3459-3472, 3(2):
# L-stable, and its last stage alone is the error
RODAS3 = RosenbrockMethod(
    "rodas3",
    Fraction(1, 2),
    (_row(""), _row("0"), _row("2 0"), _row("2 0 1")),
    (_row(""), _row("4"), _row("1 -1"), _row("1 -1 -8/3")),
    _row("2 0 1 1"),
    3,
    _row("0 0 0 1"),
)

IMPLICIT_METHODS = {method.name: method for method in (RODAS3,)}
"""Methods for stiff arrays; add a record here for another one."""


@dataclass(frozen=True, slots=True)
class ImplicitSteps:
    """Adaptive steps of a Rosenbrock method, on the host.

    Decaying modes do not limit the length of a step.
    """

    rosenbrock: RosenbrockMethod
    first_step: float
    settle: bool

    @property
    def name(self) -> str:
        """Name of the method."""
        return self.rosenbrock.name

    @property
    def control(self) -> Control:
        """How the length of steps follows their error."""
        return Control(self.rosenbrock.order, 0.9, 0.2, math.inf)


def may_be_implicit(template: Template) -> bool:
    """Return whether implicit steps know the Jacobian of a template."""
    return template.plain and not (template.output.limited or template.output.discrete)


def implicit_steps(
    template: Template, shape: Shape, spec: RunSpec, duration: float, *, settle: bool
) -> ImplicitSteps:
    """Return the steps of an implicit method that was asked for.

    Raises
    ------
    MethodError
        If the method is not made for such a template, or its array is too large. Or if a length of
        steps was given.
    """
    network = Network(template, shape)
    if not may_be_implicit(template):
        raise MethodError(
            f"'{spec.method}' supports only plain couplings without a limited state: run template "
            f"'{template.name}' with method='auto'."
        )
    if network.states > MOST_STATES:
        raise MethodError(
            f"'{spec.method}' factorises the array at each step and supports up to "
            f"{MOST_STATES:,} states, got {network.states:,}: use method='auto'."
        )
    if spec.dt is not None:
        raise MethodError(f"'{spec.method}' chooses its own steps: leave dt out.")
    fastest = network.fastest_rate()
    first = min(0.1 / fastest if fastest else math.inf, duration or 1.0)
    return ImplicitSteps(IMPLICIT_METHODS[spec.method], first, settle)
