"""Runge–Kutta–Chebyshev steps: as many stages as a step's length needs."""

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.names import RATE, RUNNING, XS, H, X, rates_of
from cnnum.engines.opencl.transients.state_equation import Instant, Then, into, outputs, rates
from cnnum.engines.opencl.transients.step_control import K0, Attempt, E, advance, judged
from cnnum.integrators.schemes import ChebyshevSteps
from cnnum.integrators.tableau import MAX_STAGES, chebyshev_method, coefficients

STAGES, OLD, K1 = ir.Name("stages"), ir.Name("old"), rates_of(1)
"""The number of a step's stages, the stage before the last, and the rates at the step's end."""

REACH, TABLE_ROW, STAGE, NEW = ir.names("reach row j new")
BEGIN, BACK1, BACK2, WEIGHT, START = ir.names("begin back1 back2 weight start")
"""Numbers of a method's rows."""


def count_stages(scheme: ChebyshevSteps) -> list[ir.Statement]:
    """Return statements that find a step's stages: the lane with the longest step decides."""
    # the interval of stability over s² − 1
    reach = chebyshev_method(MAX_STAGES).real_stability / (MAX_STAGES**2 - 1)
    stable = RUNNING * H * ir.Number(scheme.fastest) * ir.Number(1.0 / reach)
    longest = ir.call("LARGEST_LANE", stable) + ir.Cast("scalar", ir.Integer(1))
    short = ir.Cast("scalar", STAGES * STAGES) < REACH
    return [
        ir.Note("// the lane with the longest step says how many stages all of them take"),
        ir.fixed(REACH, longest, of="scalar"),
        ir.declare(STAGES, 2, of="int"),
        ir.While((STAGES < MAX_STAGES) & short, (ir.Assign(STAGES, ir.Integer(1), "+="),)),
    ]


def chebyshev_sweeps(text: TransientBuilder, scheme: ChebyshevSteps) -> Attempt:
    """Return a step's statements as sweeps over all cells."""
    table = text.tables.data(coefficients())
    for name in (XS, OLD, K1):
        text.array(name, text.states)

    def then(at: ir.Expression, _: int) -> list[ir.Statement]:
        states = (ir.ONE - BACK1 - BACK2) * X[at] + BACK1 * XS[at] + BACK2 * OLD[at]
        return [ir.Assign(OLD[at], states + H * (WEIGHT * RATE + START * K0[at]))]

    def number(place: int) -> ir.Expression:
        return text.tables.number_at(TABLE_ROW + place if place else TABLE_ROW)

    stage = text.aside(lambda: _rates(text, then))
    last_rates = text.aside(lambda: _rates(text, into(K1)))
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
    each = (
        ir.add(TABLE_ROW, ir.Integer(4)),
        ir.Declare("real", ((BACK1, number(0)), (BACK2, number(1))), fixed=True),
        ir.Declare("real", ((WEIGHT, number(2)), (START, number(3))), fixed=True),
        *stage,
        ir.sweep(ir.CELL, text.states, swap),
    )
    stages = [
        *count_stages(scheme),
        ir.declare(TABLE_ROW, ir.Integer(table) + STAGES * MAX_STAGES * 4, of="int"),
        ir.fixed(BEGIN, number(2)),
        ir.sweep(ir.CELL, text.states, first),
        ir.Counted(STAGE, 1, STAGES, None, each),
        ir.Block(tuple(last_rates)),
    ]
    return Attempt(stages, _judge(text), advance(text, K1))


def _rates(text: TransientBuilder, then: Then) -> None:
    outputs(text, text.each(XS))
    rates(text, XS, then, Instant())


def _judge(text: TransientBuilder) -> list[ir.Statement]:
    """Return statements that find the worst error of a step, and the change at its end."""
    # Sommeijer, Shampine & Verwer 1998, section 2.2
    states = ir.call("R", ir.Constant("0.8")) * (X[ir.CELL] - XS[ir.CELL])
    error = states + ir.call("R", ir.Constant("0.4")) * H * (K0[ir.CELL] + K1[ir.CELL])
    return [ir.sweep(ir.CELL, text.states, judged(text, ir.CELL, error, E, K1))]
