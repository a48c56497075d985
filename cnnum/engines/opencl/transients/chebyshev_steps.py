"""Runge–Kutta–Chebyshev steps: as many stages as a step's length needs."""

from collections.abc import Callable
from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_adaptive import STAGES, chebyshev_attempts
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.initial_state import X
from cnnum.engines.opencl.transients.runge_kutta_steps import rates_of
from cnnum.engines.opencl.transients.state_equation import (
    RATE,
    Instant,
    Then,
    outputs,
    rates,
    rates_once,
)
from cnnum.engines.opencl.transients.step_control import (
    K0,
    RUNNING,
    XS,
    Attempt,
    E,
    Figures,
    H,
    advance,
    controlled,
    judged,
)
from cnnum.integrators.chebyshev import MAX_STAGES, chebyshev_method, coefficients
from cnnum.integrators.schemes import ChebyshevSteps

OLD, K1 = ir.Name("old"), rates_of(1)
"""The stage before the last, and the rates at the step's end."""

REACH, TABLE_ROW, STAGE, NEW = ir.Name("reach"), ir.Name("row"), ir.Name("j"), ir.Name("new")
BEGIN, BACK1, BACK2, WEIGHT, START = (
    ir.Name("begin"), ir.Name("back1"), ir.Name("back2"), ir.Name("weight"), ir.Name("start"),
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
    first: Callable[[TransientBuilder, ir.Name, Then, Instant], None],
) -> Figures:
    """Append steps of such attempts; `first` finds the rates at the start."""
    text.array(K0, text.states)
    attempt = attempts(text, text.tables.data(coefficients()))
    with text.aside() as first_rates:
        first(text, X, lambda at, _: [ir.Assign(K0[at], RATE)], Instant())
    attempt = replace(attempt, stages=[*_count_stages(scheme), *attempt.stages])
    return controlled(text, scheme, attempt, first_rates)


def _count_stages(scheme: ChebyshevSteps) -> list[ir.Statement]:
    """Return statements that find a step's stages: the lane with the longest step decides."""
    # the interval of stability over s² − 1
    reach = chebyshev_method(MAX_STAGES).real_stability / (MAX_STAGES**2 - 1)
    stable = RUNNING * H * ir.Number(scheme.fastest) * ir.Number(1.0 / reach)
    short = ir.Cast("scalar", STAGES * STAGES) < REACH
    return [
        ir.Note("// the lane with the longest step says how many stages all of them take"),
        ir.fixed(
            REACH, ir.call("LARGEST_LANE", stable) + ir.Cast("scalar", ir.Integer(1)), of="scalar"
        ),
        ir.declare(STAGES, 2, of="int"),
        ir.While((STAGES < MAX_STAGES) & short, (ir.Assign(STAGES, ir.Integer(1), "+="),)),
    ]


def _sweeps(text: TransientBuilder, table: int) -> Attempt:
    """Return a step's statements as sweeps over all cells; in the data its rows are a `table`."""
    for name in (XS, OLD, K1):
        text.array(name, text.states)

    def then(at: ir.Expression, _: int) -> list[ir.Statement]:
        states = (ir.ONE - BACK1 - BACK2) * X[at] + BACK1 * XS[at] + BACK2 * OLD[at]
        return [ir.Assign(OLD[at], states + H * (WEIGHT * RATE + START * K0[at]))]

    def number(place: int) -> ir.Expression:
        return text.tables.number_at(TABLE_ROW + place if place else TABLE_ROW)

    with text.aside() as stage:
        _rates(text, XS, then, Instant())
    with text.aside() as last_rates:
        _rates(text, XS, lambda at, _: [ir.Assign(K1[at], RATE)], Instant())
    # the older values are not needed any more: the two change places
    swap: list[ir.Statement] = [
        ir.fixed(NEW, OLD[ir.CELL]),
        ir.Assign(OLD[ir.CELL], XS[ir.CELL]),
        ir.Assign(XS[ir.CELL], NEW),
    ]
    first = [
        ir.Assign(OLD[ir.CELL], X[ir.CELL]),
        ir.Assign(XS[ir.CELL], X[ir.CELL] + BEGIN * H * K0[ir.CELL]),
    ]
    weights = [
        ir.Declare("real", ((BACK1, number(0)), (BACK2, number(1))), fixed=True),
        ir.Declare("real", ((WEIGHT, number(2)), (START, number(3))), fixed=True),
    ]
    each = (
        ir.add(TABLE_ROW, ir.Integer(4)),
        *weights,
        *stage,
        ir.sweep(ir.CELL, text.states, swap),
    )
    stages: list[ir.Statement] = [
        ir.declare(TABLE_ROW, ir.Integer(table) + STAGES * MAX_STAGES * 4, of="int"),
        ir.fixed(BEGIN, number(2)),
        ir.sweep(ir.CELL, text.states, first),
        ir.Counted(STAGE, 1, STAGES, None, each),
        ir.Block(tuple(last_rates)),
    ]
    return Attempt(stages, _judge(text), advance(text, K1))


def _rates(text: TransientBuilder, state: ir.Name, then: Then, instant: Instant) -> None:
    outputs(text, text.each(state))
    rates(text, state, then, instant)


def _judge(text: TransientBuilder) -> list[ir.Statement]:
    """Return statements that find the worst error of a step, and the change at its end."""
    # Sommeijer, Shampine & Verwer 1998, section 2.2
    states = ir.call("R", ir.Constant("0.8")) * (X[ir.CELL] - XS[ir.CELL])
    error = states + ir.call("R", ir.Constant("0.4")) * H * (K0[ir.CELL] + K1[ir.CELL])
    return [ir.sweep(ir.CELL, text.states, judged(text, ir.CELL, error, E, K1))]
