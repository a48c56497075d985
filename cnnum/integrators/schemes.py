"""Ways to step, by the numbers that engines need of them.

A scheme of fixed steps is a tableau for each layer: an explicit method that can be written so runs
on every engine. Adaptive schemes have a `Control`, too.
"""

from dataclasses import dataclass

from cnnum.integrators.chebyshev import MAX_STAGES, chebyshev_method
from cnnum.integrators.exponential import ETD_RK2, EXPONENTIAL_EULER
from cnnum.integrators.tableau import Explicit, LayerMethod, Pair

MAX_STEPS = 100_000
"""Steps after which an adaptive run gives up and says so."""

CHEBYSHEV = "runge-kutta-chebyshev"
"""The method whose stages are as many as a step's length needs."""


LAYER_METHODS: dict[str, LayerMethod] = {m.name: m for m in (EXPONENTIAL_EULER, ETD_RK2)}
"""Integrators with numbers of their own in every layer: another one is a record here."""


@dataclass(frozen=True, slots=True)
class Control:
    """How the length of steps follows their error.

    Attributes
    ----------
    order : int
        Power of a step's length with which its estimated error grows.
    caution : float
        Share of the length that the estimate allows.
    least : float
        A step is no shorter than this share of the one before.
    longest : float
        No step is longer.
    """

    order: int
    caution: float
    least: float
    longest: float


@dataclass(frozen=True, slots=True)
class FixedSteps:
    """`count` steps of `step` with an explicit method.

    With `settle` the count is a limit, and the run stops where nothing changes any more.
    """

    tableaux: tuple[Explicit, ...]
    """One for all layers, or one a layer."""
    step: float
    count: int
    settle: bool
    last: float
    """Length of the last step, so that the run ends on time."""

    @property
    def tableau(self) -> Explicit:
        """That of the first layer, which has the name and the stages of all."""
        return self.tableaux[0]

    @property
    def name(self) -> str:
        """Name of the method."""
        return self.tableau.name

    @property
    def stages(self) -> int:
        """Evaluations of dx/dt a step."""
        return self.tableau.stages

    def of(self, layer: int) -> Explicit:
        """Return the tableau of a layer."""
        return self.tableaux[layer % len(self.tableaux)]

    def move(self, layer: int, tau: float) -> float:
        """Return the factor of a cell's drive in a step of one stage: h b₀/τ."""
        return self.step * float(self.of(layer).b[0]) / tau


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

    @property
    def name(self) -> str:
        """Name of the method."""
        return self.tableau.name

    @property
    def control(self) -> Control:
        """How the length of steps follows their error."""
        return Control(self.tableau.order, 0.9, 0.2, self.longest)

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

    @property
    def name(self) -> str:
        """Name of the method."""
        return CHEBYSHEV

    @property
    def control(self) -> Control:
        """How the length of steps follows their error."""
        stable = chebyshev_method(MAX_STAGES).real_stability
        return Control(3, 0.8, 0.1, stable / self.fastest)
