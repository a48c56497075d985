"""A stage of a step on the cells of a strip: a few sums, each kept in an array.

Let s be the state of a stage, and d = (h/τ)(w + A ∗ f(s) − s). An explicit Runge–Kutta method's
next state is x + Σ_j a_ij d_j, and the step ends at x + Σ_i b_i d_i. Every such sum is kept from
its first term on, so that no d outlives its stage. Exponential steps are sums of this form too.
"""

from dataclasses import dataclass

from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.tableau import Explicit, Row


@dataclass(frozen=True, slots=True)
class Sum:
    """A sum, as it is after a stage.

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
        """Whether all it does is to add d to its own state."""
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
        return 1 + max(one.place for stage in self.stages for one in stage.sums)


def stages_of(scheme: FixedSteps, layer: int, tau: float) -> Stages | None:
    """Return the stages of a scheme's steps, None where they are not sums of this form."""
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
