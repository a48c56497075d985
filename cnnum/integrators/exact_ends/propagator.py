"""No time stepping at all: where an array is linear, its state at time t is one product.

x(t) = e^{Mt} x₀ + t φ₁(Mt) S (w + g),     φ₁(z) = (e^z − 1)/z
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.network import Network
from cnnum.templating.template import Template

DENSE_LIMIT = 1024
"""Cells of all layers above which the dense product is not offered: its matrices take n² numbers,
and time stepping with few taps is cheaper."""

DECAYS = 1e-9
"""1/time: a mode or wave that decays more slowly counts as one that does not."""

EXPONENTIAL = 64.0 * float(np.finfo(np.float64).eps)
"""The error bound of an exponential of a matrix, as a part of ‖M‖t: squaring adds to one rounding;
47 were seen, over 10 to 10,000 turns."""


@dataclass(frozen=True, slots=True, eq=False)
class Decay:
    """Cells that do not see each other (A = 0): x(t) = w + (x₀ − w) e^{−t/τ}.

    Attributes
    ----------
    kept : (layers,) float
        e^{−t/τ} of every layer; 0 at equilibrium, and 1 where no time passes: then a cell is at
        its start, which a sum with its drive would round.
    """

    kept: Floats

    rounding: ClassVar[float] = 0.0

    def reach(self, start: Floats, drive: Floats) -> Floats:
        """Return x(t) of (..., layers, rows, cols) initial states and drives."""
        kept = self.kept[:, np.newaxis, np.newaxis]
        ends = drive + kept * (start - drive)
        return np.where(kept == 0.0, drive, np.where(kept == 1.0, start, ends))

    def flops(self, states: int, shape: Shape) -> int:
        """Return the arithmetic from the drive and the start of that many states to their end."""
        del shape
        return 3 * states

    def still(self) -> "Decay":
        """Return the same without the part of a fixed boundary."""
        return self


@dataclass(frozen=True, slots=True, eq=False)
class Propagator:
    """x(t) = state · x₀ + drive · w + constant, layers stacked, cells row-major.

    Attributes
    ----------
    state, drive : (n, n) float
    constant : (n,) float
        The sum of a fixed boundary.
    rounding : float
        By how much the matrices themselves may be off, as a part of the largest number in a state.
    """

    state: Floats
    drive: Floats
    constant: Floats
    rounding: float = 0.0

    def reach(self, start: Floats, drive: Floats) -> Floats:
        """Return x(t) of (batch, layers, rows, cols) initial states and drives."""
        flat = start.reshape(len(start), -1) @ self.state.T
        flat += drive.reshape(len(drive), -1) @ self.drive.T + self.constant
        return flat.reshape(drive.shape)

    def flops(self, states: int, shape: Shape) -> int:
        """Return the arithmetic from the drive and the start of that many states to their end."""
        del shape
        return 2 * states * states * (int(self.state.any()) + int(self.drive.any()))

    def still(self) -> "Propagator":
        """Return the same without the part of a fixed boundary."""
        return replace(self, constant=0.0 * self.constant)


def rounded_gain(matrices: Sequence[Floats], passes: Sequence[Floats]) -> float:
    """Return by how many roundings of its largest number a sum of products is off at most.

    Of a sum over columns each term is rounded by every addition from its own on. See Higham,
    Accuracy and Stability of Numerical Algorithms, 2002, section 3.1. The bound is the largest over
    rows of Σ |b_ij| · passes_j. Its unit is half the distance from 1 to the next number.

    Parameters
    ----------
    matrices : sequence of (rows, n) float
    passes : sequence of (n,) float
        Of each matrix how often its terms are rounded.
    """
    rows = sum(
        (np.abs(matrix) @ times for matrix, times in zip(matrices, passes, strict=True)),
        np.zeros(1),
    )
    return float(np.max(rows))


def passes_in_fours(columns: int) -> Floats:
    """Return how often a column is rounded by the additions from its own on.

    The sums of four columns at a time are added, then those that are left one by one.
    """
    alone = columns % 4
    fours = np.repeat(np.arange(columns // 4, 0, -1) + alone, 4)
    return np.concatenate([fours, np.arange(alone, 0, -1)]).astype(np.float64)


def decay(template: Template, duration: float) -> Decay:
    """Return the exact answer of uncoupled cells after `duration` (infinite: equilibrium)."""
    with np.errstate(under="ignore"):
        return Decay(np.exp(-duration / template.tau))


def propagator(network: Network, duration: float) -> Propagator | None:
    """Return the exact answer of a linear array after `duration`, None where there is none.

    An infinite duration asks for the equilibrium, which exists where every mode decays.
    """
    from scipy.linalg import expm, solve  # imported late: it takes longer than all of the engine

    system = network.linear_system()
    n = network.states
    if math.isinf(duration):
        if float(np.linalg.eigvals(system.matrix).real.max()) >= -DECAYS:
            return None
        drive = solve(system.matrix, -np.diag(system.rates))
        return Propagator(np.zeros((n, n)), drive, drive @ system.rim)
    # e^{[[M, S], [0, 0]] t} holds e^{Mt} and t φ₁(Mt) S in its upper blocks (Van Loan 1978)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n] = system.matrix
    block[:n, n:] = np.diag(system.rates)
    exponential = np.asarray(expm(block * duration))
    drive = exponential[:n, n:]
    turned = float(np.abs(system.matrix).sum(axis=1).max()) * duration
    return Propagator(exponential[:n, :n], drive, drive @ system.rim, EXPONENTIAL * turned)
