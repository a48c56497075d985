"""Exponential steps: the decay −x/τ is followed exactly, only the couplings are approximated.

x' = −x/τ + N(x), N = (A ∗ f(x) + w)/τ. With z = −h/τ and φ₁(z) = (e^z − 1)/z,
φ₂(z) = (φ₁(z) − 1)/z (Cox & Matthews, J. Comput. Phys. 176 (2002) 430-455):

    exponential Euler:   x⁺ = e^z x + h φ₁ N(x)
    ETD-RK2:             a = e^z x + h φ₁ N(x),   x⁺ = a + h φ₂ (N(a) − N(x))
"""

from dataclasses import dataclass
from fractions import Fraction
from math import factorial

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.integrators.tableau import LayerMethod, Row


def phi(order: int, z: Floats) -> Floats:
    """Return φ₁, φ₂ or φ₃ without the cancellation of its quotient at small z.

    φ_k(z) = Σ_n zⁿ/(n + k)!
    """
    small = np.abs(z) < 0.5
    safe = np.where(small, 1.0, z)
    direct = np.expm1(safe) / safe
    for k in range(1, order):
        direct = (direct - 1.0 / factorial(k)) / safe
    term = np.full_like(z, 1.0 / factorial(order))
    series = term.copy()
    # 0.5ⁿ/n! is below the rounding of float64 after 14 terms
    for n in range(1, 15):
        term = term * np.where(small, z, 0.0) / (n + order)
        series = series + term
    return np.where(small, series, direct)


@dataclass(frozen=True, slots=True)
class ExponentialMethod:
    """A method whose stages are combinations of x, N(x) and N of the stage before.

    Attributes
    ----------
    name : str
    order : int
        1 or 2: with 2 the second stage corrects the first by φ₂.
    """

    name: str
    order: int

    def __post_init__(self) -> None:
        # x' = −x + c has the solution e^{−h} x + (1 − e^{−h}) c, which the first stage must give
        kept, first, second = self.weights(0.7, np.array([1.0]))
        if abs(kept[0] + first[0] - 1.0) > 1e-14 or self.order not in (1, 2):
            raise ValueError(f"'{self.name}' does not integrate a constant exactly.")
        # and N = t, from 0: x(h) = h − 1 + e^{−h}, which the second must give
        if self.order == 2 and abs(second[0] * 0.7 - (0.7 - 1.0 + np.exp(-0.7))) > 1e-14:
            raise ValueError(f"'{self.name}' does not integrate a linear function exactly.")

    @property
    def stages(self) -> int:
        """Number of evaluations of the couplings per step."""
        return self.order

    def weights(self, step: float | Floats, tau: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the share of x that is kept, and the weights of A ∗ y + w and of its change.

        Parameters
        ----------
        step : float, or (steps, 1) float
        tau : (layers,) float
        """
        z = -step / tau
        return np.exp(z), -z * phi(1, z), -z * phi(2, z)

    def fixed(self, steps: Floats, tau: float) -> tuple[Floats, Floats, Floats]:
        """Return steps of a layer as sums of rates: a, b and the carried part, for each step.

        The coupling is N = x + τk, and the share of x that is kept is 1 − first, so that

            a = x + first·τk₀,   x⁺ = x + (1 + second)(a − x) + second·τ(k₁ − k₀)

        and a cell whose rate is 0 keeps its state exactly.

        Parameters
        ----------
        steps : (steps,) float
        tau : float

        Returns
        -------
        (steps, stages, stages), (steps, stages) and (steps,) float
        """
        _, first, second = self.weights(steps, np.array(tau))
        slope, later, count = first * tau / steps, second * tau / steps, len(steps)
        if self.order == 1:
            return np.zeros((count, 1, 1)), slope[:, np.newaxis], np.zeros(count)
        a = np.zeros((count, 2, 2))
        a[:, 1, 0] = slope
        return a, np.stack([-later, later], axis=1), 1.0 + second

    def followed(self, steps: Floats, tau: float) -> tuple[Floats, Floats]:
        """Return steps of a layer with stages that estimate their error, and those estimates.

        The error of the first method is the correction by the second. The error of the second is
        what a third-order method would add; for small h/τ, its stage in the middle of the step is
        that of Shu & Osher (1988).

        Parameters
        ----------
        steps : (steps,) float
        tau : float

        Returns
        -------
        (steps, stages, stages) and (steps, stages) float
        """
        decay = (steps / tau)[:, np.newaxis]
        phi_1, phi_2, phi_3 = (phi(k, -decay) for k in (1, 2, 3))
        n = 2 * self.order
        start = np.eye(n)[0]

        def change(stage: int, move: Floats) -> Floats:
            """Return N − N₀ of a stage, as parts of the rates: k − k₀ + its move over τ."""
            return np.asarray(np.eye(n)[stage] - start + decay * move, dtype=np.float64)

        first = phi_1 * start
        if self.order == 1:
            return np.stack([0.0 * first, first], axis=1), phi_2 * change(1, first)
        beyond = change(1, first)
        amid = 0.5 * (phi(1, -0.5 * decay) * start + phi(2, -0.5 * decay) * beyond)
        bend = beyond - 2.0 * change(2, amid)
        rows = [0.0 * first, first, amid, first + phi_2 * beyond]
        return np.stack(rows, axis=1), (4.0 * phi_3 - 2.0 * phi_2) * bend

    def growth(self, steps: Floats, values: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return growth factors of modes per step, (steps, modes), for 1/τ = 1 and eigenvalues."""
        kept, first, second = self.weights(steps[:, np.newaxis], np.ones(1))
        coupling = values + 1.0
        once = kept + first * coupling
        return once if self.order == 1 else once + second * coupling * (once - 1.0)


@dataclass(frozen=True, slots=True)
class ExponentialStep:
    """An exponential step of one length, in the form of `Explicit`.

    Attributes
    ----------
    name : str
    a : tuple of rows
    b : row
    carried : float
    """

    name: str
    a: tuple[Row, ...]
    b: Row
    carried: float = 0.0

    @property
    def stages(self) -> int:
        """Evaluations of the rates."""
        return len(self.a)


@dataclass(frozen=True, slots=True)
class FollowedStep:
    """An exponential step of one length, as sums of rates whose last stage is at the step's end.

    Attributes
    ----------
    name : str
    order : int
    a : tuple of rows
    least_bent : float
        Not known for these steps, whose length is not adapted to kinks.
    truncation : tuple of rows
        The part of the error that the step estimates.
    """

    name: str
    order: int
    a: tuple[Row, ...]
    truncation: tuple[Row, ...]
    least_bent: float = 1.0

    @property
    def stages(self) -> int:
        """Evaluations of the rates; the last is the first of the next step."""
        return len(self.a)

    @property
    def error(self) -> Row:
        """It has one length."""
        return (Fraction(0),) * self.stages


def _row(values: Floats) -> Row:
    return tuple(Fraction(value) for value in values.tolist())


def _rows(a: Floats) -> tuple[Row, ...]:
    return tuple(_row(row[:stage]) for stage, row in enumerate(a))


def fixed_step(method: LayerMethod, step: float, tau: float) -> ExponentialStep:
    """Return a step of a layer as sums of rates."""
    a, b, carried = method.fixed(np.array([step]), tau)
    return ExponentialStep(method.name, _rows(a[0]), _row(b[0]), float(carried[0]))


def followed_step(method: LayerMethod, step: float, tau: float) -> FollowedStep:
    """Return the same with stages that estimate its error."""
    a, part = method.followed(np.array([step]), tau)
    return FollowedStep(method.name, method.order, _rows(a[0]), (_row(part[0]),))


EXPONENTIAL_EULER = ExponentialMethod("exponential-euler", 1)
ETD_RK2 = ExponentialMethod("etd-rk2", 2)
EXPONENTIAL_METHODS = {m.name: m for m in (EXPONENTIAL_EULER, ETD_RK2)}
