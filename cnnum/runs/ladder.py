"""The strategies for a run, as an ordered list: the first that fits is used.

A strategy performs the run itself, or delegates simpler runs to the strategies below it: with other
maps, another duration or other steps. Calls only go down the list. `Result.ways` names the
strategies that took part.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, number_type
from cnnum.engines.backend import EngineRecord
from cnnum.engines.notices import refuse_unfinished
from cnnum.errors import MethodError
from cnnum.integrators.choice import check_spec
from cnnum.integrators.estimate import LOST
from cnnum.integrators.rosenbrock import MOST_STATES, RODAS3, may_be_implicit
from cnnum.integrators.schemes import MAX_STEPS, AdaptiveSteps, ChebyshevSteps
from cnnum.integrators.solver import Solver
from cnnum.plan import Plan
from cnnum.runs.batches import as_batch
from cnnum.runs.chip import on_chip
from cnnum.runs.decided import decides, in_one_pass
from cnnum.runs.growth import followed, follows, halves, in_halves
from cnnum.runs.prepared import as_prepared, is_prepared, keep
from cnnum.runs.request import Ask, Request, as_frame, has_many_cells, maps_by_role
from cnnum.runs.result import ROLES, Result, result_of, with_fallback, with_proof
from cnnum.runs.settling import to_rest
from cnnum.runs.symmetry import breaks, unbroken
from cnnum.runs.times import at_times
from cnnum.runs.wavefront import skips, without_way
from cnnum.templating.batch import TemplateBatch

SOONEST = 0.1
"""Part of a time constant before which no run comes to a rest that it does not start from."""

REASON = f"explicit steps would be more than {MAX_STEPS:,}; implicit ones, on the host in float64"


def may_be_stiff(request: Request) -> bool:
    """Return whether implicit steps are tried if explicit ones do not reach the end of a run.

    They are not if a method or a step was requested, or the array is large. Engines that solve as
    accurately as they can have their own.
    """
    spec, engine = request.spec, request.engine
    if spec.method != "auto" or spec.dt is not None or engine.whole:
        return False
    states = request.template.layers * request.shape[0] * request.shape[1]
    return engine.record.takes_steps and states <= MOST_STATES


def by_implicit_steps(request: Request, down: Callable[[Request], Result]) -> Result:
    """Use implicit steps if explicit ones do not reach the end of a run."""
    try:
        return down(request)
    except MethodError:
        if not may_be_implicit(request.template):
            raise
        result = down(request.by(replace(request.spec, method=RODAS3.name)))
        return replace(result, reason=REASON)


def refuse_hopeless(engine: EngineRecord, solver: Solver, tau: float) -> None:
    """Raise if a run's steps would be too short to reach its end, before it starts.

    Engines that solve finely take them only where they were asked for.

    Parameters
    ----------
    engine : EngineRecord
    solver : Solver
    tau : float
        The shortest time constant.

    Raises
    ------
    MethodError
        If so.
    """
    scheme = solver.scheme
    taken = solver.asked or engine.takes_steps
    if taken and isinstance(scheme, AdaptiveSteps | ChebyshevSteps):
        # up to a rest cells need their own time, whatever the others do
        end = min(SOONEST * tau, solver.duration) if solver.settle else solver.duration
        refuse_unfinished(np.array([end > MAX_STEPS * scheme.control.longest]))


NEVER_SATURATES = "no cell leaves the linear range"


def outputs_of(
    plan: Plan, given: dict[str, NDArray[np.floating]], lead: tuple[int, ...]
) -> dict[str, Floats]:
    """Run a plan on checked maps by role; errors are those of a call of the plan."""
    if has_many_cells(plan.schedule.shape):
        outputs = plan.run_large(list(given.values()), lead)
        if outputs is not None:
            return outputs
    return plan.run_finite(as_frame(given, lead, np.dtype(number_type(plan.precision))))


def plainly(request: Request, down: Callable[[Request], Result]) -> Result:
    """Take a run by its plan, and keep it ready where others may differ in numbers alone."""
    plan, solver, template = request.plan, request.solver, request.ran
    refuse_hopeless(request.engine.record, solver, float(template.tau.min()))
    outputs = outputs_of(plan, request.given, request.lead)
    if solver.forced:  # nothing is known of its end
        outputs |= {
            "settled": np.zeros_like(outputs["settled"]),
            "error": np.full_like(outputs["error"], LOST),
        }
    result = result_of(outputs, template.layers, solver.method, solver.reason)
    result = with_fallback(result, plan)
    if request.form is not None and not halves(request):
        keep(request)
    return result


def linearly(request: Request, down: Callable[[Request], Result]) -> Result:
    """Run the linear array that a saturating one is as long as no cell leaves that range."""
    result = down(request)
    # rounding may lie beyond 1
    output = np.clip(result.output, -1.0, 1.0)
    return replace(result, output=output, reason=f"{NEVER_SATURATES}; {result.reason}")


Down = Callable[[Any], Result]
"""Performs a run by the strategies below."""


@dataclass(frozen=True, slots=True)
class Way:
    """A strategy for a run.

    Attributes
    ----------
    name : str
    reason : str
        Why it is used if it fits.
    fits : callable
        Whether it takes an `Ask`, or a `Request` below "checked".
    run : callable
        Takes that and the ways below it, and returns the result.
    """

    name: str
    reason: str
    fits: Callable[[Any], bool]
    run: Callable[[Any, Down], Result]


def _checked(ask: Ask, down: Down) -> Result:
    """Check the maps, then run them; the result keeps copies of them for its proof."""
    given, shape = maps_by_role(ask.template, dict(zip(ROLES, ask.arrays, strict=True)))
    spec = ask.spec
    check_spec(spec)
    result = down(Request(ask.engine, ask.template, given, shape, spec, ask.form, ask.ready))
    if ask.engine.whole or result.proof is not None:
        return result
    kept = {role: np.array(maps) for role, maps in given.items()}
    return with_proof(result, ask.template, kept, ask.duration, (spec.rtol, spec.atol))


LADDER = (
    Way("chip", "an analogue array stores and reads coarsely what another run computes",
        lambda ask: ask.chip is not None, on_chip),
    Way("batch", "templates of a batch run side by side, or one by one",
        lambda ask: isinstance(ask.template, TemplateBatch), as_batch),
    Way("times", "a run is looked at on its way, or taken to each time",
        lambda ask: ask.at is not None, at_times),
    Way("decided", "the output of a cell that sees no other cell is known without its state",
        decides, in_one_pass),
    Way("prepared", "a run that differs in its numbers alone was taken before",
        is_prepared, as_prepared),
    Way("checked", "arrays are looked at before they run", lambda ask: True, _checked),
    Way("wavefront", "the order of events cannot change where a monotone array ends",
        skips, without_way),
    Way("compared", "a state that grows far needs a finer run to know its error",
        follows, followed),
    Way("settling", "a run to equilibrium goes on until it is shown to rest",
        lambda request: request.settles, to_rest),
    Way("symmetric", "roundings break a symmetry that the start has", breaks, unbroken),
    Way("halved", "steps with a delay are halved until two runs agree", halves, in_halves),
    Way("implicit", "where explicit steps do not reach the end, implicit ones may",
        may_be_stiff, by_implicit_steps),
    Way("linear", "no cell leaves the linear range, so that the array is linear",
        lambda request: request.linear, linearly),
    Way("plain", "a plan runs as it is", lambda request: True, plainly),
)  # fmt: skip
"""In order of preference: the first that fits is used."""


class _Below:
    """The ways from a place on, and the last result that they gave."""

    __slots__ = ("_first", "last")

    def __init__(self, first: int) -> None:
        self._first = first
        self.last: Result | None = None

    def __call__(self, ask: Ask | Request) -> Result:
        self.last = run(ask, self._first)
        return self.last


def run(ask: Ask | Request, first: int = 0) -> Result:
    """Perform a run by the first strategy that fits, from index `first` on.

    Parameters
    ----------
    ask : Ask or Request
    first : int
        Index of the first strategy to try.
    """
    place = first
    while not LADDER[place].fits(ask):
        place += 1
    way, below = LADDER[place], _Below(place + 1)
    result = way.run(ask, below)
    if result is not below.last:
        object.__setattr__(result, "ways", (way.name, *result.ways))
    return result
