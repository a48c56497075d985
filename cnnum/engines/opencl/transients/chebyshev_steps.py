"""Runge–Kutta–Chebyshev steps: as many stages as a step's length needs."""

from collections.abc import Callable

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.opencl.ir.expressions import (
    CELL,
    ONE,
    Cast,
    Constant,
    Expression,
    Integer,
    Name,
    Number,
    call,
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
    While,
    add,
    declare,
    fixed,
    sweep,
)
from cnnum.engines.opencl.large_arrays.strip_adaptive import STAGES, chebyshev_attempts
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.initial_state import X
from cnnum.engines.opencl.transients.runge_kutta_steps import rates_of
from cnnum.engines.opencl.transients.state_equation import (
    CHANGE,
    RATE,
    Instant,
    Then,
    outputs,
    rates,
    rates_once,
)
from cnnum.engines.opencl.transients.step_control import (
    ADDED,
    K0,
    RUNNING,
    SPEED,
    TIME,
    WORST,
    XS,
    Attempt,
    Control,
    Figures,
    H,
    advance,
    controlled,
    rounding,
)
from cnnum.integrators.chebyshev import MAX_STAGES, chebyshev_method
from cnnum.integrators.schemes import ChebyshevSteps

OLD, K1 = Name("old"), rates_of(1)
"""The stage before the last, and the rates at the step's end."""

REACH, TABLE_ROW, STAGE, NEW = Name("reach"), Name("row"), Name("j"), Name("new")
BEGIN, BACK1, BACK2, WEIGHT, START = (
    Name("begin"), Name("back1"), Name("back2"), Name("weight"), Name("start"),
)  # fmt: skip
"""Numbers of a method's rows."""


def chebyshev(text: TransientBuilder, scheme: ChebyshevSteps) -> Figures:
    """Append the steps as sweeps over all cells, and return the figures of the run."""
    return _controlled(text, scheme, _sweeps, _rates)


def chebyshev_in_strips(text: TransientBuilder, scheme: ChebyshevSteps) -> Figures:
    """Append the steps by strips of rows, and return the figures of the run."""
    return _controlled(text, scheme, chebyshev_attempts, rates_once)


def _controlled(
    text: TransientBuilder,
    scheme: ChebyshevSteps,
    attempts: Callable[[TransientBuilder, int], Attempt],
    first: Callable[[TransientBuilder, Name, Then, Instant], None],
) -> Figures:
    """Append steps of such attempts; `first` finds the rates at the start."""
    text.array(K0, text.states)
    attempt = attempts(text, text.tables.data(_coefficients()))
    with text.aside() as first_rates:
        first(text, X, lambda at, _: [Assign(K0[at], RATE)], Instant())
    longest = Number(scheme.control.longest)
    left = Number(text.solver.duration) - TIME
    control = Control(
        about="runge-kutta-chebyshev: steps follow the error estimate, stages follow the steps",
        scheme=scheme,
        length=call("fmin", H, call("fmin", longest, left)),
        carries=False,
    )
    stages = [*_count_stages(scheme), *attempt.stages]
    return controlled(text, control, first_rates, attempt, stages)


def _count_stages(scheme: ChebyshevSteps) -> list[Statement]:
    """Return what finds the stages of a step: the lane with the longest says how many all take."""
    reach = RUNNING * H * Number(scheme.fastest) * Number(1.0 / _reach())
    short = Cast("scalar", STAGES * STAGES) < REACH
    return [
        Note("// the lane with the longest step says how many stages all of them take"),
        fixed(REACH, call("LARGEST_LANE", reach) + Cast("scalar", Integer(1)), of="scalar"),
        declare(STAGES, 2, of="int"),
        While((STAGES < MAX_STAGES) & short, (Assign(STAGES, Integer(1), "+="),)),
    ]


def _sweeps(text: TransientBuilder, table: int) -> Attempt:
    """Return a step's statements as sweeps over all cells; in the data its rows are a `table`."""
    for name in (XS, OLD, K1):
        text.array(name, text.states)

    def then(at: Expression, _: int) -> list[Statement]:
        states = (ONE - BACK1 - BACK2) * X[at] + BACK1 * XS[at] + BACK2 * OLD[at]
        return [Assign(OLD[at], states + H * (WEIGHT * RATE + START * K0[at]))]

    def number(place: int) -> Expression:
        return text.tables.number_at(TABLE_ROW + place if place else TABLE_ROW)

    with text.aside() as stage:
        _rates(text, XS, then, Instant())
    with text.aside() as last_rates:
        _rates(text, XS, lambda at, _: [Assign(K1[at], RATE)], Instant())
    # what was before is not needed any more: the two change places
    swap: list[Statement] = [
        fixed(NEW, OLD[CELL]),
        Assign(OLD[CELL], XS[CELL]),
        Assign(XS[CELL], NEW),
    ]
    first = [Assign(OLD[CELL], X[CELL]), Assign(XS[CELL], X[CELL] + BEGIN * H * K0[CELL])]
    weights = [
        Declare("real", ((BACK1, number(0)), (BACK2, number(1))), fixed=True),
        Declare("real", ((WEIGHT, number(2)), (START, number(3))), fixed=True),
    ]
    each = (add(TABLE_ROW, Integer(4)), *weights, *stage, sweep(CELL, text.states, swap))
    stages: list[Statement] = [
        declare(TABLE_ROW, Integer(table) + STAGES * MAX_STAGES * 4, of="int"),
        fixed(BEGIN, number(2)),
        sweep(CELL, text.states, first),
        Counted(STAGE, 1, STAGES, None, each),
        Block(tuple(last_rates)),
    ]
    return Attempt([], stages, _judge(text), advance(text, K1), [])


def _rates(text: TransientBuilder, state: Name, then: Then, instant: Instant) -> None:
    outputs(text, text.each(state))
    rates(text, state, then, instant)


def _reach() -> float:
    """Return the interval of stability over s² − 1."""
    return chebyshev_method(MAX_STAGES).real_stability / (MAX_STAGES**2 - 1)


def _coefficients() -> Floats:
    """Return (most + 1, most, 4) numbers: method s, stage j; the first stage's weight at j = 0."""
    table = np.zeros((MAX_STAGES + 1, MAX_STAGES, 4))
    for stages in range(2, MAX_STAGES + 1):
        method = chebyshev_method(stages)
        table[stages, 0, 2] = method.first
        table[stages, 1:stages] = method.rows
    return table


def _judge(text: TransientBuilder) -> list[Statement]:
    """Return what finds the worst error of a step, and the change at its end."""
    tau, e = Number(float(text.template.tau.max())), Name("e")
    # Sommeijer, Shampine & Verwer 1998, section 2.2
    states = call("R", Constant("0.8")) * (X[CELL] - XS[CELL])
    error = states + call("R", Constant("0.4")) * H * (K0[CELL] + K1[CELL])
    larger = call("fmax", size(X[CELL]), size(XS[CELL]))
    body: list[Statement] = [
        fixed(e, size(error)),
        Accumulate(WORST, "greater", e / text.scale(larger)),
        Accumulate(ADDED, "greater", e + rounding(text) * size(XS[CELL])),
        Accumulate(SPEED, "greater", size(K1[CELL])),
        Accumulate(CHANGE, "greater", size(tau * K1[CELL]) / text.scale(XS[CELL])),
    ]
    return [sweep(CELL, text.states, body)]
