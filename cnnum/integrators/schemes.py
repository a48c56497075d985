"""Ways to step: by a tableau, by Chebyshev's stages, or exponentially."""

from dataclasses import dataclass

from cnnum.integrators.exponential import ExponentialMethod
from cnnum.integrators.tableau import ButcherTableau, Pair

MAX_STEPS = 100_000
"""Steps after which an adaptive run gives up and says so."""


@dataclass(frozen=True, slots=True)
class FixedSteps:
    """`count` steps of `step` with an explicit method.

    With `settle` the count is a limit, and the run stops where nothing changes any more.
    """

    tableau: ButcherTableau
    step: float
    count: int
    settle: bool
    last: float
    """Length of the last step, so that the run ends on time."""


@dataclass(frozen=True, slots=True)
class AdaptiveSteps:
    """Steps that keep the method's own error estimate within the tolerances.

    Where the estimate is 0, all are as long as the first, and only their error is followed.
    """

    tableaux: tuple[Pair, ...]
    """One for all layers, or one a layer."""
    first_step: float
    settle: bool
    longest: float
    """No step is longer: at the stability bound a decay bounces instead of settling, by less than
    the error estimate sees."""

    @property
    def tableau(self) -> Pair:
        """That of the first layer, which has the name, order and stages of all."""
        return self.tableaux[0]

    def of(self, layer: int) -> Pair:
        """Return the tableau of a layer."""
        return self.tableaux[layer % len(self.tableaux)]


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
