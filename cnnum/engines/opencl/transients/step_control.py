"""Steps that may be refused: their length and their error, by what each attempt shows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.engines.opencl.ir.expressions import (
    CELL,
    ONE,
    ROUND,
    ZERO,
    Constant,
    Expression,
    Name,
    Number,
    call,
    pick,
    size,
)
from cnnum.engines.opencl.ir.statements import (
    Accumulate,
    Assign,
    Block,
    Counted,
    Declare,
    Note,
    Statement,
    add,
    fixed,
    sweep,
)
from cnnum.engines.opencl.lowering.storage import UNFINISHED
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.initial_state import X
from cnnum.engines.opencl.transients.state_equation import CHANGE
from cnnum.integrators.estimate import LOST, ROUNDINGS, SAFETY, SMALLEST_RATE, error_growth
from cnnum.integrators.schemes import MAX_STEPS, AdaptiveSteps, ChebyshevSteps

LARGEST_EXPONENT = 80.0
"""e to this is a number of single precision."""

K0, XS = Name("k0"), Name("xs")
"""The rates at a step's start, and the states at its stages, in the end at its end."""

H, TIME, STEPS, SETTLED = Name("h"), Name("time"), Name("steps"), Name("settled")
ERROR, RUNNING, ACCEPT = Name("error"), Name("running"), Name("accept")
WORST, ADDED, SPEED = Name("worst"), Name("added"), Name("speed")
"""Of an attempt: its error over the tolerance, what it adds to the error, the largest rate."""

SPEED_BEFORE, BEHIND, AHEAD, REACHED = (
    Name("speed_before"), Name("behind"), Name("ahead"), Name("reached"),
)  # fmt: skip
FASTER, GROWN = Name("faster"), Name("grown")

Figures = dict[str, Expression]
"""Of a run: time, steps, settled, error."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """Statements of a step that may be refused.

    Attributes
    ----------
    begin : sequence of Statement
        Before all steps, once `k0` holds the rates at the start `x`.
    stages : sequence of Statement
        The stages, h long.
    judge : sequence of Statement
        What finds `worst`, `added`, `speed` and `change`.
    advance : sequence of Statement
        What takes the step over where `accept` is not 0.
    end : sequence of Statement
        After all steps: what brings the state back to `x`.
    """

    begin: Sequence[Statement]
    stages: Sequence[Statement]
    judge: Sequence[Statement]
    advance: Sequence[Statement]
    end: Sequence[Statement]


@dataclass(frozen=True, slots=True)
class Control:
    """How the length of steps follows their error.

    Attributes
    ----------
    about : str
        A comment.
    scheme : AdaptiveSteps or ChebyshevSteps
    length : Expression
        Of the step at hand.
    carries : bool
        Whether what rounding leaves out of the time is kept for the next step.
    """

    about: str
    scheme: AdaptiveSteps | ChebyshevSteps
    length: Expression
    carries: bool


def controlled(
    text: TransientBuilder,
    control: Control,
    first_rates: Sequence[Statement],
    attempt: Attempt,
    stages: Sequence[Statement],
) -> Figures:
    """Append the steps of attempts, and return the figures of the run.

    Parameters
    ----------
    text : TransientBuilder
    control : Control
    first_rates : sequence of Statement
        What sets `k0`.
    attempt : Attempt
    stages : sequence of Statement
        Those of the attempt, and what comes before them.
    """
    duration = Number(text.solver.duration)
    zeros = [TIME, STEPS, SETTLED, ERROR]
    carried = [(BEHIND, ZERO)] if control.carries else []
    begun = (*((name, ZERO) for name in zeros), (H, Number(control.scheme.first_step)))
    text.body += [
        Note(f"// {control.about}"),
        Declare("real", begun),
        Declare("real", ((SPEED_BEFORE, ZERO), *carried)),
        Declare("real", ((RUNNING, pick(TIME < duration, ONE, ZERO)),)),
        Block(tuple(first_rates)),
        *attempt.begin,
        sweep(CELL, text.states, [Accumulate(SPEED_BEFORE, "greater", size(K0[CELL]))]),
        Counted(
            ROUND,
            0,
            MAX_STEPS,
            RUNNING,
            (
                Declare("real", tuple((name, ZERO) for name in (WORST, ADDED, SPEED, CHANGE))),
                Assign(H, control.length),
                *stages,
                *attempt.judge,
                fixed(ACCEPT, pick(WORST <= ONE, RUNNING, ZERO)),
                *attempt.advance,
                *_moved_on(control),
                *_followed(text),
                *_next(control, duration),
            ),
        ),
        Assign(UNFINISHED, call("fmax", UNFINISHED, RUNNING)),
        *attempt.end,
    ]
    figures: Figures = {"time": TIME, "steps": STEPS, "error": Number(SAFETY) * ERROR}
    return figures | ({"settled": SETTLED} if control.scheme.settle else {})


def _moved_on(control: Control) -> list[Statement]:
    if not control.carries:
        return [add(TIME, ACCEPT * H), add(STEPS, RUNNING)]
    ahead = ((AHEAD, ACCEPT * H - BEHIND), (REACHED, TIME + AHEAD))
    return [
        Note("// what rounding leaves out of the time comes with the next step"),
        Declare("real", ahead, fixed=True),
        Assign(BEHIND, (REACHED - TIME) - AHEAD),
        Assign(TIME, REACHED),
        add(STEPS, RUNNING),
    ]


def _followed(text: TransientBuilder) -> list[Statement]:
    """Return what follows the error: it grows as the rates do, within what the feedback allows."""
    before = call("fmax", SPEED_BEFORE, Number(SMALLEST_RATE))
    growth = call("fmin", Number(error_growth(text.template)) * H, Number(LARGEST_EXPONENT))
    sum = call("fmin", ERROR * GROWN + ADDED, Number(LOST))
    return [
        Note("// an error grows as the rates do, within what the feedback allows"),
        fixed(FASTER, call("fmax", SPEED / before, ONE)),
        fixed(GROWN, call("fmin", FASTER, call("exp", growth))),
        Assign(ERROR, pick(ACCEPT.differs(ZERO), sum, ERROR)),
        Assign(SPEED_BEFORE, pick(ACCEPT.differs(ZERO), SPEED, SPEED_BEFORE)),
    ]


def _next(control: Control, duration: Expression) -> list[Statement]:
    """Return what says how long the next step is, and whether there is one."""
    rests = (ACCEPT * Number(float(control.scheme.settle))).differs(ZERO) & (CHANGE <= ONE)
    ends = (TIME >= duration * Number(1.0 - 1e-6)) | SETTLED.differs(ZERO)
    follows = control.scheme.control
    least_error = call("R", Constant("1e-10"))
    power = call("pow", call("fmax", WORST, least_error), Number(-1.0 / follows.order))
    factor = call(
        "clamp",
        call("R", Constant(f"{follows.caution:g}")) * power,
        call("R", Constant(f"{follows.least:g}")),
        call("R", 5),
    )
    return [
        Assign(SETTLED, pick(rests, ONE, SETTLED)),
        Assign(RUNNING, pick(ends, ZERO, RUNNING)),
        Assign(H, pick(RUNNING.differs(ZERO), H * factor, H)),
    ]


def advance(text: TransientBuilder, last: Name) -> list[Statement]:
    """Return statements that take a step over where `accept` is not 0."""
    accepted = ACCEPT.differs(ZERO)
    body = [
        Assign(X[CELL], pick(accepted, XS[CELL], X[CELL])),
        Assign(K0[CELL], pick(accepted, last[CELL], K0[CELL])),
    ]
    return [sweep(CELL, text.states, body)]


def rounding(text: TransientBuilder) -> Number:
    """Return what a step's roundings are, of a state of 1."""
    return Number(ROUNDINGS * float(np.finfo(text.tables.dtype).eps))
