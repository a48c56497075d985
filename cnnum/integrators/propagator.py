"""No time stepping at all: where an array is linear, its state at time t is one product.

x(t) = e^{Mt} x₀ + t φ₁(Mt) S (w + g),     φ₁(z) = (e^z − 1)/z
"""

import math
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.templating.network import Network
from cnnum.templating.template import Template

DENSE_LIMIT = 1024
"""Cells of all layers above which the dense product is not offered: its matrices take n² numbers,
and time stepping with few taps is cheaper."""

EXPONENTIAL = 64.0 * float(np.finfo(np.float64).eps)
"""The error bound of an exponential of a matrix, as a part of ‖M‖t: squaring adds to one rounding;
47 were seen, over 10 to 10,000 turns."""


@dataclass(frozen=True, slots=True, eq=False)
class Decay:
    """Cells that do not see each other (A = 0): x(t) = w + (x₀ − w) e^{−t/τ}.

    Attributes
    ----------
    kept : (layers,) float
        e^{−t/τ} of every layer; 0 at equilibrium.
    """

    kept: Floats


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
        if float(np.linalg.eigvals(system.matrix).real.max()) >= -1e-9:
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
