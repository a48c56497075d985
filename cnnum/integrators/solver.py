"""How one transient runs: the exact answers, the ways to step, and the choice among them."""

from collections.abc import Mapping
from dataclasses import dataclass

from cnnum.integrators.closed_forms import Circulant, Decay, Propagator, Separate, Spectral
from cnnum.integrators.rosenbrock import ImplicitSteps
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps, FixedSteps

Stepping = FixedSteps | AdaptiveSteps | ChebyshevSteps | ImplicitSteps
Linear = Decay | Propagator | Spectral | Circulant
"""Exact schemes whose end is an affine map of start and drive."""

Exact = Linear | Separate
Scheme = Exact | Stepping


@dataclass(frozen=True, slots=True, eq=False)
class Solver:
    """Method, duration and tolerances of one transient.

    Attributes
    ----------
    method : str
        Name of the method, as results report it.
    reason : str
        Reason for the choice of this method.
    scheme : Scheme
    duration : float
        Final time; the time limit for a run to equilibrium.
    settle : bool
        Whether the transient runs to equilibrium.
    rtol, atol : float
    asked : bool
        Whether the method or the step was requested, not chosen.
    forced : bool
        Whether the step is outside the stability bound, as requested by `force`. Nothing is known
        about the error then.
    """

    method: str
    reason: str
    scheme: Scheme
    duration: float
    settle: bool
    rtol: float
    atol: float
    asked: bool = False
    forced: bool = False


Solvers = Mapping[int, Solver]
"""How each transient runs, by the index of its node."""
