"""Adaptive step control: step length and error, from the error estimate of each attempt."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.lowering.storage import UNFINISHED
from cnnum.engines.opencl.transients.builder import (
    CHANGE,
    RUNNING,
    SETTLED,
    STEPS,
    TIME,
    XS,
    H,
    TransientBuilder,
    X,
    zeros,
)
from cnnum.engines.opencl.transients.state_equation import RESTS, Instant, into, rates_once, watched
from cnnum.integrators.estimate import (
    AROUND,
    FLOOR,
    LEAST_SLOPE,
    LOST,
    ROUNDINGS,
    SMALLEST_RATE,
    error_growth,
    slopes_count,
)
from cnnum.integrators.schemes import MAX_STEPS, NEARLY, AdaptiveSteps, ChebyshevSteps
from cnnum.templating.network import gains_jump

LARGEST_EXPONENT = 80.0
"""Largest argument of exp that does not overflow single precision, with margin."""

K0 = ir.Name("k0")
"""The rates at a step's start."""

ACCEPT, WORST, ADDED, SPEED, E = ir.names("accept worst added speed e")
"""Per attempt: whether it is accepted, its error over the tolerance, its contribution to the total
error, the largest rate; and the error of a cell."""

ACCEPTED = ACCEPT.differs(ir.ZERO)

ERROR, BEHIND, AHEAD, REACHED = ir.names("error behind ahead reached")
SPEED_BEFORE, FASTER, GROWN = ir.names("speed_before faster grown")

PASSED = ir.Name("passed")
"""The factor by which a cell propagates an error: f'."""

GOAL, ENDS = ir.names("goal ends")
"""The next time at which a step must end, and whether this step ends there."""

AMID_STEP = TIME + ir.Number(0.5) * H
"""The middle of a step."""

Figures = dict[str, ir.Expression]
"""Results of a run: time, steps, settled, error."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """Statements of a step that may be rejected.

    Attributes
    ----------
    stages : sequence of Statement
        The stages, h long.
    judge : sequence of Statement
        Statements that find `worst`, `added`, `speed` and `change`.
    advance : sequence of Statement
        Statements that apply the step if `accept` is not 0.
    begin, end : sequence of Statement
        `begin` comes before all steps, once `k0` holds the rates at the start `x`. `end` comes
        after them, to bring the state back to `x`.
    """

    stages: Sequence[ir.Statement]
    judge: Sequence[ir.Statement]
    advance: Sequence[ir.Statement]
    begin: Sequence[ir.Statement] = ()
    end: Sequence[ir.Statement] = ()


Controlled = AdaptiveSteps | ChebyshevSteps


def controlled(
    text: TransientBuilder,
    scheme: Controlled,
    attempts: Callable[[TransientBuilder, Any], Attempt],
) -> Figures:
    """Append steps controlled by the error estimate, and return the results of the run.

    Time is accumulated by compensated summation for embedded pairs.
    """
    text.array(K0, text.states)
    attempt = attempts(text, scheme)
    first_rates = text.aside(lambda: rates_once(text, into(K0), Instant(TIME)))
    pair, longest = isinstance(scheme, AdaptiveSteps), ir.Number(scheme.control.longest)
    duration = ir.Number(text.solver.duration)
    many = "" if pair else ", stages follow the steps"
    stops = scheme.stops if isinstance(scheme, AdaptiveSteps) else ()
    goal = duration if not stops else GOAL
    length = ir.call("fmin", ir.call("fmin", H, longest), goal - TIME)
    if stops:  # leave no sliver of a step before a breakpoint of a gain in time
        usual = ir.call("fmin", H, longest)
        length = ir.pick(goal - TIME <= ir.Number(NEARLY) * usual, goal - TIME, usual)
    passed, rate = passed_on(text, X[ir.CELL], K0[ir.CELL])
    fastest = [*passed, ir.Accumulate(SPEED_BEFORE, "greater", rate)]
    step = (
        ir.Declare("real", zeros(WORST, ADDED, SPEED, CHANGE)),
        *([ir.fixed(GOAL, _next_stop(stops, duration))] if stops else []),
        ir.Assign(H, length),
        *(_begun_anew(text, fastest) if gains_jump(text.template) else []),
        *attempt.stages,
        *attempt.judge,
        ir.fixed(ACCEPT, ir.pick(WORST <= ir.ONE, RUNNING, ir.ZERO)),
        *attempt.advance,
        *(_carried_on(stops) if pair else [ir.add(TIME, ACCEPT * H)]),
        ir.add(STEPS, RUNNING),
        *_followed(text, scheme),
        *_next(scheme, duration),
    )
    first = (H, ir.Number(scheme.first_step))
    text.body += [
        ir.Note(f"// {scheme.name}: steps follow the error estimate{many}"),
        ir.Declare("real", (*zeros(TIME, STEPS, SETTLED, ERROR), first)),
        ir.Declare("real", zeros(SPEED_BEFORE, *([BEHIND] if pair else []))),
        ir.declare(RUNNING, ir.pick(TIME < duration, ir.ONE, ir.ZERO)),
        ir.Block(tuple(first_rates)),
        *attempt.begin,
        ir.sweep(ir.CELL, text.states, fastest),
        ir.Counted(ir.ROUND, 0, MAX_STEPS, RUNNING, step),
        ir.Assign(UNFINISHED, ir.call("fmax", UNFINISHED, RUNNING)),
        *attempt.end,
    ]
    least = ir.pick(ir.ZERO < STEPS, ir.Number(FLOOR * text.solver.atol), ir.ZERO)
    error = ir.Number(scheme.safety) * ERROR + least
    figures: Figures = {"time": TIME, "steps": STEPS, "error": error}
    return figures | ({"settled": SETTLED} if scheme.settle else {})


def _next_stop(stops: Sequence[float], duration: ir.Expression) -> ir.Expression:
    """Return the next time at which a step must end."""
    goal = duration
    for stop in reversed(stops):
        goal = ir.pick(TIME < ir.Number(stop), ir.Number(stop), goal)
    return goal


def _begun_anew(text: TransientBuilder, fastest: list[ir.Statement]) -> list[ir.Statement]:
    """Return statements that recompute the rates at a step's start, after a possible jump."""
    rates = text.aside(lambda: rates_once(text, into(K0), Instant(TIME, AMID_STEP)))
    none, result = ir.Assign(SPEED_BEFORE, ir.ZERO), ir.sweep(ir.CELL, text.states, fastest)
    return [ir.Block(tuple(rates)), none, result]


def _carried_on(stops: Sequence[float]) -> list[ir.Statement]:
    ahead = ((AHEAD, ACCEPT * H - BEHIND), (REACHED, TIME + AHEAD))
    lines: list[ir.Statement] = [
        ir.Note("// the part of the time that rounding leaves out comes with the next step"),
        ir.Declare("real", ahead, fixed=True),
        ir.Assign(BEHIND, (REACHED - TIME) - AHEAD),
    ]
    if not stops:
        return [*lines, ir.Assign(TIME, REACHED)]
    ends = ir.pick(GOAL - TIME <= H, ACCEPT, ir.ZERO)
    return [
        *lines,
        ir.fixed(ENDS, ends),
        ir.Assign(TIME, ir.pick(ENDS.differs(ir.ZERO), GOAL, REACHED)),
        ir.Assign(BEHIND, ir.pick(ENDS.differs(ir.ZERO), ir.ZERO, BEHIND)),
    ]


def _followed(text: TransientBuilder, scheme: Controlled) -> list[ir.Statement]:
    """Return statements that track the error, which grows with the rates, within its bound."""
    before = ir.call("fmax", SPEED_BEFORE, ir.Number(SMALLEST_RATE))
    numbers = text.operands.own
    fastest = numbers.growth if numbers else ir.Number(error_growth(text.template))
    growth = ir.call("fmin", fastest * H, ir.Number(LARGEST_EXPONENT))
    own = ADDED * ir.call("pow", ir.call("fmax", GROWN, ir.ONE), ir.Number(scheme.later))
    sum = ir.call("fmin", ERROR * GROWN + own, ir.Number(LOST))
    return [
        ir.Note("// an error grows as the rates do, within the bound of the feedback"),
        ir.fixed(FASTER, ir.call("fmax", SPEED / before, ir.ONE)),
        ir.fixed(GROWN, ir.call("fmin", FASTER, ir.call("exp", growth))),
        ir.Assign(ERROR, ir.pick(ACCEPTED, sum, ERROR)),
        ir.Assign(SPEED_BEFORE, ir.pick(ACCEPTED, SPEED, SPEED_BEFORE)),
    ]


def _next(scheme: Controlled, duration: ir.Expression) -> list[ir.Statement]:
    """Return statements that set the length of the next step and whether there is one."""
    rests = (ACCEPT * ir.Number(float(scheme.settle))).differs(ir.ZERO) & RESTS
    ends = (TIME >= duration * ir.Number(1.0 - 1e-6)) | SETTLED.differs(ir.ZERO)
    follows = scheme.control
    shares = ("1e-10", f"{follows.caution:g}", f"{follows.least:g}")
    least_error, caution, least = (ir.real(ir.Constant(share)) for share in shares)
    power = ir.call("pow", ir.call("fmax", WORST, least_error), ir.Number(-1.0 / follows.order))
    factor = ir.call("clamp", caution * power, least, ir.real(5))
    return [
        ir.Assign(SETTLED, ir.pick(rests, ir.ONE, SETTLED)),
        ir.Assign(RUNNING, ir.pick(ends, ir.ZERO, RUNNING)),
        ir.Assign(H, ir.pick(RUNNING.differs(ir.ZERO), H * factor, H)),
    ]


def advance(text: TransientBuilder, last: ir.Name) -> list[ir.Statement]:
    """Return statements that apply a step if `accept` is not 0."""
    pairs = [(state[ir.CELL], end[ir.CELL]) for state, end in ((X, XS), (K0, last))]
    body = [ir.Assign(state, ir.pick(ACCEPTED, end, state)) for state, end in pairs]
    return [ir.sweep(ir.CELL, text.states, body)]


def passed_on(
    text: TransientBuilder, state: ir.Expression, rate: ir.Expression
) -> tuple[list[ir.Statement], ir.Expression]:
    """Return |dx/dt| times the cell's error propagation factor, and the statements it needs.

    See `cnnum.integrators.estimate`.
    """
    if not slopes_count(text.template):
        return [], ir.size(rate)
    around, half = ir.Number(AROUND), ir.Number(0.5 / AROUND)
    rise = text.output(state + around) - text.output(state - around)
    slope = ir.call("fmax", half * ir.size(rise), ir.Number(LEAST_SLOPE))
    return [ir.fixed(PASSED, slope)], PASSED * ir.size(rate)


def rounding(text: TransientBuilder) -> ir.Number:
    """Return the rounding error of a step, for a state of 1."""
    return ir.Number(ROUNDINGS * float(np.finfo(text.tables.dtype).eps))


def judged(
    text: TransientBuilder,
    at: ir.Expression,
    error: ir.Expression,
    left_out: ir.Expression,
    rate: ir.Name,
) -> list[ir.Statement]:
    """Return statements that update the error estimate of a step by one cell.

    Parameters
    ----------
    text : TransientBuilder
    at : Expression
        The cell's index.
    error, left_out : Expression
        The step's error estimate, and its contribution `e` to the tracked error.
    rate : Name
        The rates at the step's end.
    """
    before, after, last = X[at], XS[at], rate[at]
    passed, speed = passed_on(text, after, last)
    larger = ir.call("fmax", ir.size(before), ir.size(after))
    return [
        ir.fixed(E, ir.size(error)),
        ir.Accumulate(WORST, "greater", E / text.scale(larger)),
        ir.Accumulate(ADDED, "greater", left_out + rounding(text) * ir.size(after)),
        *passed,
        ir.Accumulate(SPEED, "greater", speed),
        watched(text, after, last),
    ]
