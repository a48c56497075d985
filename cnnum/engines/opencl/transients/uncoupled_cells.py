"""Cells that see only themselves: the pieces of their way, without a step.

The formulas, and the meaning of d, stand in `cnnum.integrators.exact_ends.separate`.
"""

import math

import numpy as np

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.feedforward import drive_of
from cnnum.engines.opencl.transients.names import LARGEST, NOW, X
from cnnum.integrators.estimate import LOST
from cnnum.integrators.exact_ends.separate import (
    STEEPEST,
    Separate,
    growth,
    moved,
    roundings,
    tips_over,
)

FROM, TO, DRIVE, S, E, EDGE, AWAY = ir.names("from to drive s e edge away")
"""Start and end; the piece, where it pulls, when a cell leaves it, and whether it never does."""

G, B, AT_B, CROSSES, OVER, BETWEEN, LEFT, ENDS = ir.names("g b at_b crosses over between left ends")
"""In the middle piece: its rate and the edge ahead, the rate there, whether and how it leaves."""

SEEN, AFTER, GROWN, SIZES = ir.names("seen after grown sizes")


def separate(text: TransientBuilder, scheme: Separate) -> float:
    """Append statements that set the states `x` to their end; return its roundings of `largest`."""
    text.array(X, text.states)
    for layer in range(text.layers):
        text.over_cells(_cell(text, scheme, layer))
    return roundings(text.template)


def _cell(text: TransientBuilder, scheme: Separate, layer: int) -> list[ir.Statement]:
    own, time = float(scheme.own[layer]), float(scheme.time[layer])
    a, slope, d = ir.Number(own), ir.Number(own - 1.0), ir.Number(math.exp(-time))
    inside = ir.pick(CROSSES.differs(ir.ZERO), OVER, BETWEEN)
    to = text.unless_held(ir.pick(AWAY.differs(ir.ZERO), E + d * (FROM - E), inside), FROM)
    begun = ((FROM, text.start_of(layer)), (DRIVE, drive_of(text, layer)))
    return [
        ir.Declare("real", begun, fixed=True),
        ir.fixed(S, ir.pick(FROM > ir.ONE, ir.ONE, ir.pick(FROM < -ir.ONE, -ir.ONE, ir.ZERO))),
        ir.fixed(E, DRIVE + a * S),
        # d when it comes to its edge; 0 where it never does, or is within it
        ir.fixed(EDGE, ir.pick(S * E < S * S, (S - E) / (FROM - E), ir.ZERO)),
        ir.fixed(AWAY, ir.pick(EDGE > d, ir.ZERO, S * S)),
        ir.fixed(NOW, ir.clip(FROM)),
        ir.fixed(G, slope * NOW + DRIVE),
        ir.fixed(B, ir.pick(G < ir.ZERO, -ir.ONE, ir.ONE)),
        ir.fixed(AT_B, slope * B + DRIVE),
        *_inside(own - 1.0, time),
        ir.fixed(TO, to),
        ir.Assign(X[text.at(layer)], TO),
        *_rounded(text, own, time),
    ]


def _inside(slope: float, time: float) -> list[ir.Statement]:
    """Return where cells are at the end that are in the middle piece at first, or enter it."""
    m, d = ir.Number(slope), ir.Number(math.exp(-time))
    entered, crosses, begun = EDGE > d, B * AT_B > ir.ZERO, list[ir.Statement]()
    over: ir.Expression
    between: ir.Expression
    if math.isinf(time):
        if slope > 0.0:  # without a rate a cell stays, though it would leave from beside
            crosses = crosses & G.differs(ir.ZERO)
        over, between = B + AT_B, ir.pick(G.differs(ir.ZERO), -DRIVE / m, NOW)
    elif slope == 1.0:  # as most templates have it: e^t = 1/d is at hand
        both = ((LEFT, ir.pick(entered, d / EDGE, d)), (ENDS, G / AT_B))
        begun = [ir.Declare("real", both, fixed=True)]
        crosses, over = crosses & (LEFT < ENDS), B + AT_B * (ir.ONE - LEFT / ENDS)
        grown = ir.Number(growth(1.0, time)) * ir.pick(entered, EDGE, ir.ONE)
        between = NOW + G * (grown - ir.ONE)
    else:
        ends: ir.Expression = (B - NOW) / G
        moves: ir.Expression = LEFT
        if slope != 0.0:
            steepest = ir.Number(math.log(STEEPEST))
            ends = ir.call("log1p", m * (B - NOW) / G) / m
            moves = ir.call("expm1", ir.call("fmin", m * LEFT, steepest)) / m
        # the time that is left, from where it enters, and that it takes to leave again. A quotient
        # of decays is exact near the end
        left = ir.pick(entered, ir.call("log", EDGE / d), ir.Number(time))
        begun = [ir.fixed(LEFT, left), ir.fixed(ENDS, ends)]
        crosses = crosses & (ENDS < LEFT)
        over = B + AT_B * (ir.ONE - ir.call("exp", ENDS - LEFT))
        between = NOW + G * ir.pick(entered, moves, ir.Number(moved(slope, time)))
    return [
        *begun,
        ir.fixed(CROSSES, ir.pick(crosses, ir.ONE, ir.ZERO)),
        ir.fixed(OVER, over),
        ir.fixed(BETWEEN, between),
    ]


def _rounded(text: TransientBuilder, own: float, time: float) -> list[ir.Statement]:
    """Return the bound on rounding, as `cnnum.integrators.exact_ends.separate` has it."""
    slope, left = own - 1.0, ir.Number(math.exp(-time))
    at_rest = ir.Number(growth(slope, time))
    sum = ir.size(TO) + ir.pick(AWAY.differs(ir.ZERO), left, GROWN) * SIZES
    if not math.isinf(time):
        sum = sum + ir.Number(time) * AFTER
    if tips_over(own, time):
        rounding = float(np.finfo(text.tables.dtype).eps) * roundings(text.template)
        near = ir.pick(ir.size(G) > ir.Number(rounding) * SIZES, ir.ZERO, ir.ONE - AWAY)
        near = ir.pick(ir.size(DRIVE) < ir.Number(slope), near, ir.ZERO)
        sum = sum + ir.Number(2.0 * LOST / rounding) * text.unless_held(near, ir.ZERO)
    return [
        ir.fixed(SEEN, ir.clip(TO)),
        ir.fixed(AFTER, ir.size(ir.Number(slope) * SEEN + DRIVE + (SEEN - TO))),
        ir.fixed(GROWN, ir.pick(G.differs(ir.ZERO), AFTER / ir.size(G), at_rest)),
        ir.fixed(SIZES, ir.size(DRIVE) + ir.size(FROM) + ir.size(ir.Number(own) * NOW)),
        ir.Accumulate(LARGEST, "greater", sum),
    ]
