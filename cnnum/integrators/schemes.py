"""Ways to step that need more than a tableau: Chebyshev's stages and exponential steps."""

from dataclasses import dataclass

from cnnum.integrators.exponential import ExponentialMethod


@dataclass(frozen=True, slots=True)
class ChebyshevSteps:
    """Steps that follow the error estimate, each of as many stages as its length needs.

    Attributes
    ----------
    fastest : float
        Bound on the rates, 1/time: a step h takes the stages that are stable at h·fastest.
    first_step : float
    settle : bool
    """

    fastest: float
    first_step: float
    settle: bool


@dataclass(frozen=True, slots=True)
class ExponentialSteps:
    """`count` exponential steps of `step`; with `settle` the count is a limit."""

    method: ExponentialMethod
    step: float
    count: int
    settle: bool
