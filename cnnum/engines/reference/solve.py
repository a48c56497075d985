"""One transient in float64: SciPy's Dormand–Prince 8(5,3) far below the tolerance asked for.

The stated error is the difference from a coarser solution with other steps. A delay is solved by
the method of steps: each interval of one delay reads the dense output of the previous interval. If
rates jump, fixed steps are taken. A method or step that was requested is used unchanged.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import DOP853, DenseOutput, OdeSolution, Radau

from cnnum.arrays import Floats
from cnnum.engines.reference.adaptive import march_adaptive
from cnnum.engines.reference.equation import Given, StateEquation
from cnnum.engines.reference.implicit import march_implicit
from cnnum.engines.reference.march import march
from cnnum.errors import MethodError
from cnnum.integrators.closed_forms import Decay, Separate, evaluate, roundings
from cnnum.integrators.rosenbrock import ImplicitSteps
from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.solver import Exact, Solver, Stepping
from cnnum.templating.network import Network, jumps, turning_points
from cnnum.templating.template import Template

PRECISION = 1e-10
"""Relative tolerance of the solver. A kink of f costs steps. Where all stages of a step miss it, it
costs accuracy, up to 1e-3 of it."""

COARSER = 1e-8
"""Tolerance of a second solution with other steps; the difference is the error estimate."""

FINEST = 1e-13
"""Smallest tolerance that is tried where the two do not agree."""

LOOKED_AT = 0.1
"""Share of the tolerances in those of solutions that are looked at on their way."""

SAFETY = 2.0
"""Safety factor on the difference of two solutions: near a kink the finer one may be as far off."""

AGREED = 1e-6
"""Of the largest state or 1: solutions that differ by more have missed a kink."""

MOST_EXPLICIT = 1e5
"""Fastest rate times a stretch above which an array is stiff: explicit steps take minutes."""

MOST_IMPLICIT = 1000
"""States up to which a Jacobian is a matrix."""

MOST_STEPS = 10_000
"""Implicit steps of a stretch: weights beyond all measure take steps so short that it never ends.
The cases of `cnnum stability` take up to 3,206."""

MOST_WORK = 3e8
"""Evaluations of the rate of a cell in a transient, or what takes as long: about half a minute. The
cases of `cnnum stability` take up to half as many."""

CALL = 500
"""Cells whose rates take as long as the call itself."""

FACTORED = 20.0
"""n³ over this many rates of a cell take as long as a factorisation of n states."""

LATEST = 1e6
"""Time constants of the slowest layer to which an array is followed whose equilibrium other engines
know exactly."""

SMALL = 1e-8
"""Least size of a state to which tolerances are relative."""

FINER = 4
"""Where rates jump and no step was asked for, steps of other engines are this much longer."""

Past = Callable[[float], Floats]


@dataclass(frozen=True, slots=True, eq=False)
class Budgeted(StateEquation):
    """An equation whose rates are given as long as the budget lasts: some runs have no end."""

    spent: Floats = field(default_factory=lambda: np.zeros(1), init=False)

    def rate(
        self,
        drive: Floats,
        x: Floats,
        past: Floats | None,
        time: float,
        middle: float | None = None,
        within: float = 0.0,
        *,
        outwards: bool = False,
    ) -> Floats:
        """Return dx/dt.

        Raises
        ------
        MethodError
            If that is asked for too often.
        """
        self.spend(max(x.size, CALL))
        return StateEquation.rate(self, drive, x, past, time, middle, within, outwards=outwards)

    def factoring(self, factor: Callable[[Floats], Any]) -> Callable[[Floats], Any]:
        """Return a function that factors a matrix at the expense of the budget."""

        def counted(matrix: Floats) -> Any:
            self.spend(len(matrix) ** 3 / FACTORED)
            return factor(matrix)

        return counted

    def spend(self, work: float) -> None:
        """Subtract work from the remaining budget.

        Raises
        ------
        MethodError
            If nothing is.
        """
        self.spent[0] += work
        if self.spent[0] > MOST_WORK:
            raise MethodError(
                f"The reference solver gives up after {MOST_WORK:.0e} evaluations of the rate of "
                "a cell: the fastest rate is too large for such a long run; scale the weights, "
                "or use another engine."
            )


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """The end of a transient, or its state on the way, and the estimate of its error."""

    state: Floats
    time: float
    steps: int
    error: float
    passed: tuple["Answer", ...] = ()
    """Those at the moments that were asked for."""


def solve(
    template: Template,
    shape: tuple[int, int],
    solver: Solver,
    given: Given,
    moments: Sequence[float] = (),
) -> Answer:
    """Return the end of a transient of one frame, and what it passes at moments on its way.

    Parameters
    ----------
    template : Template
    shape : (rows, cols)
    solver : Solver
    given : Given
    moments : sequence of float
        Rising, none after the end. A solution is looked at within its steps. It is ten times as
        fine, because the polynomials between the ends of steps are less exact than these.

    Raises
    ------
    MethodError
        If SciPy's solver gives up, or adaptive steps that were asked for do not reach the end.
    """
    equation = StateEquation(template, shape, given)
    scheme = solver.scheme
    if isinstance(scheme, Decay):
        passed = tuple(_decayed(equation, moment) for moment in moments)
        end = _decayed(equation, math.inf if solver.settle else solver.duration)
        return replace(end, time=solver.duration, passed=passed)
    if _stepped(template, solver):
        return _marched(equation, solver, moments)
    if jumps(template) and isinstance(scheme, FixedSteps):
        finer = replace(
            scheme, step=scheme.step / FINER, count=scheme.count * FINER, last=scheme.last / FINER
        )
        return _in_steps(equation, solver, finer, moments)
    equation = Budgeted(template, shape, given)
    if template.delayed is not None:
        delay = template.delayed.delay
        return _agreed(partial(_by_stretches, equation, solver, delay), moments)
    answer = _agreed(partial(_to_the_end, equation, solver), moments)
    if not isinstance(scheme, Separate) or given.feedback is not None:
        return answer
    on_way = (_with_roundings(equation, scheme, end, end.time) for end in answer.passed)
    end = _with_roundings(equation, scheme, answer, math.inf if solver.settle else answer.time)
    return replace(end, passed=tuple(on_way))


def _with_roundings(
    equation: StateEquation, scheme: Separate, answer: Answer, time: float
) -> Answer:
    """Add what rounding errors of a rate grow to, which solutions to any tolerance have alike."""
    template, held = equation.template, equation.given.held
    rounding = float(np.finfo(np.float64).eps) * roundings(template)
    until = replace(scheme, time=time / template.tau)
    _, sizes = evaluate(until, equation.start(), equation.drive(), rounding)
    largest = sizes.max() if held is None else sizes.max(where=~held, initial=0.0)
    return replace(answer, error=answer.error + rounding * float(largest))


def instead(template: Template, solver: Solver) -> str:
    """Return in words the method in place of the solver's scheme; empty if it runs."""
    if isinstance(solver.scheme, Decay) or _stepped(template, solver):
        return ""
    if jumps(template) and isinstance(solver.scheme, FixedSteps):
        return f"in steps 1/{FINER} as long"
    return f"solved to {PRECISION:g} by adaptive steps of Dormand-Prince 8(5,3), or Radau IIA"


def _stepped(template: Template, solver: Solver) -> bool:
    """Return whether the solver's own steps are taken: they were asked for, or time is discrete."""
    return isinstance(solver.scheme, Stepping) and (solver.asked or template.output.discrete)


def _marched(equation: StateEquation, solver: Solver, moments: Sequence[float]) -> Answer:
    """Take the solver's own steps."""
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps):
        return _in_steps(equation, solver, scheme, moments)
    if isinstance(scheme, ImplicitSteps):
        time, states = march_implicit(equation, solver, scheme, moments)
        times = (*moments, time)
        *passed, end = [
            Answer(p.state, t, p.steps, p.error) for p, t in zip(states, times, strict=True)
        ]
        return replace(end, passed=tuple(passed))
    assert not isinstance(scheme, Exact)
    return Answer(*march_adaptive(equation, solver, scheme))


def _in_steps(
    equation: StateEquation, solver: Solver, scheme: FixedSteps, moments: Sequence[float]
) -> Answer:
    """Take steps of one length, of whose error nothing is known."""
    x, time, count, seen = march(equation, solver, scheme, moments)
    passed = [
        Answer(state, moment, steps, math.inf)
        for (state, steps), moment in zip(seen, moments, strict=True)
    ]
    return Answer(x, time, count, math.inf, tuple(passed))


def _decayed(equation: StateEquation, span: float) -> Answer:
    """Return x = w + (x₀ − w) e^{−t/τ}: uncoupled cells are solved exactly."""
    start, drive = equation.start(), equation.drive()
    with np.errstate(under="ignore"):
        x = Decay(np.exp(-span / equation.template.tau)).reach(start, drive)
    held = equation.given.held
    return Answer(x if held is None else np.where(held, start, x), span, 0, PRECISION)


@dataclass(slots=True, eq=False)
class Track:
    """The moments at which a solution is looked at, and what it passed there so far."""

    moments: Sequence[float]
    passed: list[Answer] = field(default_factory=list[Answer])
    steps: int = 0

    def begin(self, state: Floats) -> None:
        """Note the start, if it is looked at."""
        if len(self.moments) and self.moments[0] <= 0.0:
            self.passed.append(Answer(state, 0.0, 0, math.inf))

    def follow(self, equation: Budgeted, solver: Any, shape: tuple[int, ...]) -> None:
        """Note the states within the step that a solver of SciPy has just taken."""
        self.steps += 1
        last = bisect_right(self.moments, float(solver.t))
        own = self.moments[len(self.passed) : last]
        if not own:
            return
        spent = equation.spent.copy()
        if isinstance(solver, Radau):
            states = [_part(solver, moment) for moment in own]
        else:
            states = [*solver.dense_output()(np.array(own)).T]
        equation.spent[:] = spent  # to look is no work of the run
        self.passed += [
            Answer(state.reshape(shape), moment, self.steps, math.inf)
            for state, moment in zip(states, own, strict=True)
        ]


def _part(solver: Any, moment: float) -> Floats:
    """Return the state of Radau's method at a moment within its last step, by a shorter one.

    The polynomial of the step itself is of order 3 alone.
    """
    begin = solver.t_old
    options = {"rtol": solver.rtol, "atol": solver.atol, "jac": solver.J}
    part = Radau(solver.fun, begin, solver.y_old, moment, first_step=moment - begin, **options)
    part.lu = solver.lu
    while part.status == "running":
        message = part.step()
        if message is not None:
            raise MethodError(f"The reference solver stopped: {message}")
    return np.asarray(part.y, dtype=np.float64)


def change(equation: StateEquation, answer: Answer, solver: Solver) -> float:
    """Return the largest rate at the end, in units of the tolerance."""
    x = answer.state
    drive = equation.drive() + equation.delayed_drive(before=False)
    rate = equation.rate(drive, x, equation.outputs(x), answer.time)
    scale = solver.atol + solver.rtol * np.abs(x)
    return float((np.abs(float(equation.template.tau.max()) * rate) / scale).max())


def _method(equation: StateEquation, length: float) -> Any:
    """Return implicit steps where explicit ones would be too many, else explicit ones."""
    network = Network(equation.template, equation.shape)
    many = network.fastest_rate() * length > MOST_EXPLICIT
    return Radau if many and network.states <= MOST_IMPLICIT else DOP853


def _stretch(
    equation: Budgeted,
    drive: Floats,
    x: Floats,
    time: float,
    length: float,
    past: Past | None,
    precision: float,
    track: Track,
) -> tuple[Floats, int, OdeSolution | None]:
    """Return the state after a stretch of time, the steps, and the dense output for delays."""
    marks = (time, *(t for t in turning_points(equation.template, time + length) if t > time))
    parts: list[OdeSolution] = []
    taken = 0
    for start, end in pairwise((*marks, time + length)):
        given = (equation, drive, x, start, end - start, past, precision, track)
        x, steps, part = _smooth_stretch(*given)
        taken += steps
        parts += [] if part is None else [part]
    return x, taken, _joined(parts) if parts else None


def _joined(parts: list[OdeSolution]) -> OdeSolution:
    """Return the dense output of stretches that follow each other."""
    times = [parts[0].ts, *(part.ts[1:] for part in parts[1:])]
    pieces = [piece for part in parts for piece in part.interpolants]
    return OdeSolution(np.concatenate(times), pieces)


def _smooth_stretch(
    equation: Budgeted,
    drive: Floats,
    x: Floats,
    time: float,
    length: float,
    past: Past | None,
    precision: float,
    track: Track,
) -> tuple[Floats, int, OdeSolution | None]:
    """Return the same for an interval within which no gain has a jump or a kink."""
    middle = time + 0.5 * length

    def right(t: float, flat: Floats) -> Floats:
        seen = None if past is None else past(t)
        return equation.rate(drive, flat.reshape(x.shape), seen, t, middle).ravel()

    # solve_ivp would keep the state of every step, which fills the memory where cells are many
    steps = _method(equation, length)
    # a start that is small is solved as well as others: it may grow far
    moves = float(np.abs(right(time, x.ravel())).max()) * float(equation.template.tau.min())
    size = min(1.0, max(SMALL, moves, float(np.abs(x).max())))
    solver = steps(right, time, x.ravel(), time + length, rtol=precision, atol=precision * size)
    if isinstance(solver, Radau):
        solver.lu = equation.factoring(solver.lu)
    times = [time]
    pieces: list[DenseOutput[np.float64]] = []
    while solver.status == "running":
        try:
            message = solver.step()
        except MethodError:
            raise
        except ValueError as error:  # Radau's matrices overflow where rates are beyond 1e77
            message = str(error)
        if message is not None:
            raise MethodError(f"The reference solver stopped: {message}")
        if steps is Radau and len(times) > MOST_STEPS:
            raise MethodError(
                f"The reference solver gives up at time {solver.t:.3g} of {time + length:.3g}, "
                f"after {MOST_STEPS} implicit steps: the fastest rate is too large; scale the "
                "weights."
            )
        times.append(solver.t)
        track.follow(equation, solver, x.shape)
        if past is not None:
            pieces.append(solver.dense_output())
    dense = None if past is None else OdeSolution(times, pieces)
    return solver.y.reshape(x.shape), len(times) - 1, dense


def _agreed(run: Callable[[float, Track], Answer], moments: Sequence[float]) -> Answer:
    """Return the answer of runs to finer tolerances, when two of them agree."""
    share = LOOKED_AT if moments else 1.0
    before, precision = run(share * COARSER, Track(moments)), share * PRECISION
    while True:
        answer = run(precision, Track(moments))
        both = zip((*answer.passed, answer), (*before.passed, before), strict=True)
        sizes = [max(1.0, float(np.abs(end.state).max())) for end in (*answer.passed, answer)]
        apart = [float(np.abs(end.state - other.state).max()) for end, other in both]
        far = any(off > AGREED * size for off, size in zip(apart, sizes, strict=True))
        if not far or precision <= FINEST:
            errors = [
                SAFETY * off + precision * size for off, size in zip(apart, sizes, strict=True)
            ]
            passed = [
                replace(end, error=error)
                for end, error in zip(answer.passed, errors[:-1], strict=True)
            ]
            return replace(answer, error=errors[-1], passed=tuple(passed))
        before, precision = answer, max(0.1 * precision, FINEST)


def _to_the_end(equation: Budgeted, solver: Solver, precision: float, track: Track) -> Answer:
    """Run to the end; to equilibrium in stretches that double."""
    answer = Answer(equation.start(), 0.0, 0, math.inf)
    track.begin(answer.state)
    drive = equation.drive()
    # settled well below the tolerance that is asked for, so that the rest does not count
    strict = replace(solver, rtol=1e-3 * solver.rtol, atol=1e-3 * solver.atol)
    stretch = 4.0 if solver.settle else solver.duration
    end = solver.duration
    if solver.settle and isinstance(solver.scheme, Exact):
        end = LATEST * float(equation.template.tau.max())
    while answer.time < end:
        stretch = min(stretch, end - answer.time)
        given = (equation, drive, answer.state, answer.time, stretch, None, precision, track)
        x, steps, _ = _stretch(*given)
        answer = Answer(x, answer.time + stretch, answer.steps + steps, math.inf)
        if solver.settle and change(equation, answer, strict) <= 1.0:
            break
        stretch *= 2.0
    return replace(answer, passed=tuple(track.passed))


def _by_stretches(
    equation: Budgeted, solver: Solver, delay: float, precision: float, track: Track
) -> Answer:
    """Run to the end by the method of steps; to equilibrium until nothing moved for a delay."""
    answer = Answer(equation.start(), 0.0, 0, math.inf)
    track.begin(answer.state)
    first = equation.outputs(answer.state)
    dense: OdeSolution | None = None
    fixed = equation.drive()
    while answer.time < solver.duration - 1e-12:
        length = min(delay, solver.duration - answer.time)
        before = dense

        def past(t: float, before: OdeSolution | None = before) -> Floats:
            if before is None:
                return first
            return equation.outputs(np.asarray(before(t - delay)).reshape(first.shape))

        drive = fixed + equation.delayed_drive(before=answer.time < delay / 2)
        x, steps, dense = _stretch(
            equation, drive, answer.state, answer.time, length, past, precision, track
        )
        answer = Answer(x, answer.time + length, answer.steps + steps, math.inf)
        if solver.settle and dense is not None and _still(dense, equation, solver, answer):
            break
    return replace(answer, passed=tuple(track.passed))


def _still(dense: OdeSolution, equation: StateEquation, solver: Solver, answer: Answer) -> bool:
    """Return whether nothing changed over the last delay, so that nothing will."""
    start = np.asarray(dense(float(dense.ts[0]))).reshape(answer.state.shape)
    moved = float(np.abs(start - answer.state).max())
    return moved <= 1e-3 * solver.atol and change(equation, answer, solver) <= 1.0
