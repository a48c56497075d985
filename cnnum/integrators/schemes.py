"""Ways to step, by the numbers that engines need of them.

A scheme of fixed steps is a tableau for each layer: an explicit method that can be written so runs
on every engine. Adaptive schemes have a `Control`, too.

Stages as sums: let s be the state of a stage, and d = (h/τ)(w + A ∗ f(s) − s). An explicit method's
next state is x + Σ_j a_ij d_j, and the step ends at x + Σ_i b_i d_i. Every such sum is kept from
its first term on, so that no d outlives its stage. Exponential steps are sums of this form too.
"""

from dataclasses import dataclass

from cnnum.integrators.estimate import SAFETY
from cnnum.integrators.exponential import ETD_RK2, EXPONENTIAL_EULER
from cnnum.integrators.tableau import MAX_STAGES, Explicit, LayerMethod, Pair, Row, chebyshev_method

MAX_STEPS = 100_000
"""Number of steps after which an adaptive run gives up and reports so."""

NEARLY = 1.000001
"""Part of a step that may reach a point of a gain in time at which it is to end."""

CHEBYSHEV = "runge-kutta-chebyshev"
"""The method whose stages are as many as a step's length needs."""

WAVEFRONT = "wavefront"
"""The method that computes only the final state of an array, for single runs."""

DECISION = "decision"
"""The method that computes outputs in one pass over the input, for single runs."""


LAYER_METHODS: dict[str, LayerMethod] = {m.name: m for m in (EXPONENTIAL_EULER, ETD_RK2)}
"""Integrators with coefficients for each layer; add a record here for another one."""


@dataclass(frozen=True, slots=True)
class Control:
    """Control of the step length by the estimated error.

    Attributes
    ----------
    order : int
        Power of the step length with which the estimated error grows.
    caution : float
        Share of the length permitted by the estimate that is taken.
    least : float
        Smallest length of a step relative to the previous one.
    longest : float
        Longest step.
    """

    order: int
    caution: float
    least: float
    longest: float


@dataclass(frozen=True, slots=True)
class Piece:
    """Consecutive steps of one length.

    Attributes
    ----------
    first : int
        Number of its first step.
    start : float
        Time at which the first step begins.
    step : float
    """

    first: int
    start: float
    step: float


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
    pieces: tuple["Piece", ...] = ()
    """Pieces with different step lengths, if gains have jumps or kinks in time; otherwise empty."""

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
        """Number of evaluations of dx/dt per step."""
        return self.tableau.stages

    def of(self, layer: int) -> Explicit:
        """Return the tableau of a layer."""
        return self.tableaux[layer % len(self.tableaux)]

    def move(self, layer: int, tau: float) -> float:
        """Return h b₀/τ, the factor on a cell's drive in a step with one stage."""
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
    bends: bool = False
    """Whether the truncation error is kept within the tolerances, too: where rates bend, the
    embedded method's estimate may vanish."""
    stops: tuple[float, ...] = ()
    """Times at which a step ends, whatever its error: there a gain in time jumps or bends."""

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
        """Control of the step length by the estimated error."""
        return Control(self.tableau.order, 0.9, 0.2, self.longest)

    @property
    def safety(self) -> float:
        """Safety factor of the stated error relative to the sum of the errors of all steps.

        For rates with kinks, it accounts for the worst position of a kink among the stages.
        """
        least = min(tableau.least_bent for tableau in self.tableaux) if self.bends else 1.0
        return max(SAFETY, 1.0 / least)

    @property
    def later(self) -> float:
        """Power of a step's growth with which its own error grows."""
        return 1.0 / (self.tableau.order + 2.0)

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
        """Control of the step length by the estimated error."""
        stable = chebyshev_method(MAX_STAGES).real_stability
        return Control(3, 0.8, 0.1, stable / self.fastest)

    @property
    def safety(self) -> float:
        """Factor of the sum of the steps' errors in the error that is stated."""
        return SAFETY

    @property
    def later(self) -> float:
        """Power of a step's growth with which its own error grows."""
        return 0.25


@dataclass(frozen=True, slots=True)
class Sum:
    """A sum that a stage updates.

    Attributes
    ----------
    place : int
        The array that keeps it.
    terms : tuple of (int, float)
        Arrays, as the stage's sums before this one left them, and their factors.
    factor : float
        Of the stage's own d.
    """

    place: int
    terms: tuple[tuple[int, float], ...]
    factor: float


@dataclass(frozen=True, slots=True)
class Stage:
    """One evaluation of the couplings, and its target.

    Attributes
    ----------
    state : int
        The array of the states at which the couplings are evaluated.
    sums : tuple of Sum
        In this order. The first is the state of the stage that follows.
    """

    state: int
    sums: tuple[Sum, ...]

    @property
    def whole(self) -> bool:
        """Whether the stage only adds d to its own state."""
        return self.sums == (Sum(self.state, ((self.state, 1.0),), 1.0),)


@dataclass(frozen=True, slots=True)
class Stages:
    """The stages of a step.

    Attributes
    ----------
    scale : float
        The factor of w + A ∗ y − s in d.
    stages : tuple of Stage
        The step begins and ends in array 0.
    """

    scale: float
    stages: tuple[Stage, ...]

    @property
    def arrays(self) -> int:
        """Arrays that keep states and sums."""
        return 1 + max(term.place for stage in self.stages for term in stage.sums)


def stages_of(scheme: FixedSteps, layer: int, tau: float) -> Stages | None:
    """Return the stages of a scheme's steps, or None if they are not sums of this form."""
    tableau = scheme.of(layer)
    if tableau.stages == 1:
        return Stages(scheme.move(layer, tau), (ALONE,))
    if tableau.carried:
        # d comes with the first stage's weight, so that its sum is the state of the next
        first = scheme.step * float(tableau.a[1][0]) / tau
        return Stages(first, _carried(tableau)) if tableau.stages == 2 else None
    stages = _runge_kutta(tableau)
    return Stages(scheme.step / tau, stages) if stages else None


ALONE = Stage(0, (Sum(0, ((0, 1.0),), 1.0),))
"""The stage that is the whole step."""


def _carried(tableau: Explicit) -> tuple[Stage, Stage]:
    """Return a = x + d, and x⁺ = a + (carried − 1)(a − x) + Σ b_i k_i.

    The increment of a is kept by itself: at a limit it is then exactly 0, and a state stays there.
    """
    first, more = float(tableau.a[1][0]), tableau.carried - 1.0
    before, after = (float(weight) / first for weight in tableau.b)
    begun = Sum(0, ((1, more), (0, -more)), before)
    return (
        Stage(0, (Sum(1, ((0, 1.0),), 1.0), begun)),
        Stage(1, (Sum(0, ((1, 1.0), (0, 1.0)), after),)),
    )


def _runge_kutta(tableau: Explicit) -> tuple[Stage, ...]:
    """Return the stages that the step's end needs; none where one does not see that before it."""
    count = 1 + max(i for i, b in enumerate(tableau.b) if b)
    rows = [*tableau.a[:count], tableau.b[:count]]  # row i is complete after stage i − 1
    if not all(row[-1] for row in rows[1:]):
        return ()
    starts = [0, *(_first(row) for row in rows[1:])]
    places, stages = {0: 0}, list[Stage]()
    for stage in range(count):
        state, sums = places[stage], list[Sum]()
        for row in range(stage + 1, count + 1):
            if not rows[row][stage]:
                continue
            begins = starts[row] == stage
            source = 0 if begins else places[row]
            if row == count and stage >= max(starts):
                places[row] = 0  # no other sum has still to begin from the state before
            elif begins:
                taken = {place for at, place in places.items() if at > stage}
                places[row] = next(n for n in range(1, count + 1) if n not in taken)
            sums.append(Sum(places[row], ((source, 1.0),), float(rows[row][stage])))
        stages.append(Stage(state, tuple(sums)))
    return tuple(stages)


def _first(row: Row) -> int:
    return next(i for i, weight in enumerate(row) if weight)
