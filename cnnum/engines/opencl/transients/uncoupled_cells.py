"""Cells that see only themselves: the pieces of their way, without a step.

The formulas, and what d is, stand in `cnnum.integrators.separate`.
"""

import math

from cnnum.engines.opencl.ir.expressions import (
    ONE,
    ZERO,
    Expression,
    Name,
    Number,
    call,
    clip,
    pick,
    size,
)
from cnnum.engines.opencl.ir.statements import Accumulate, Assign, Declare, Statement, fixed
from cnnum.engines.opencl.transients.builder import NOW, TransientBuilder
from cnnum.engines.opencl.transients.closed_form import LARGEST, begin_exact, exact_figures
from cnnum.engines.opencl.transients.feedforward import drive_of
from cnnum.engines.opencl.transients.initial_state import X, start_of
from cnnum.engines.opencl.transients.step_control import Figures
from cnnum.integrators.separate import STEEPEST, Separate, growth, moved, roundings

FROM, TO, DRIVE, S, E, EDGE, AWAY = (
    Name(name) for name in ("from", "to", "drive", "s", "e", "edge", "away")
)
"""Start and end; the piece, where it pulls, when a cell leaves it, and whether it never does."""

G, B, AT_B, CROSSES, OVER, BETWEEN, LEFT, ENDS = (
    Name(name) for name in ("g", "b", "at_b", "crosses", "over", "between", "left", "ends")
)
"""In the middle piece: its rate and the edge ahead, the rate there, whether and how it leaves."""

SEEN, AFTER, GROWN, SIZES = (Name(name) for name in ("seen", "after", "grown", "sizes"))


def separate(text: TransientBuilder, scheme: Separate) -> Figures:
    """Append what sets the states `x` to their end and return the figures of the run."""
    begin_exact(text, ": no cell sees another")
    text.array(X, text.states)
    for layer in range(text.layers):
        text.over_cells(_cell(text, scheme, layer))
    return exact_figures(text, roundings(text.template))


def _cell(text: TransientBuilder, scheme: Separate, layer: int) -> list[Statement]:
    own, time = float(scheme.own[layer]), float(scheme.time[layer])
    a, slope, d = Number(own), Number(own - 1.0), Number(math.exp(-time))
    inside = pick(CROSSES.differs(ZERO), OVER, BETWEEN)
    to: Expression = pick(AWAY.differs(ZERO), E + d * (FROM - E), inside)
    if text.operands.mask is not None:
        to = pick(text.operands.mask.differs(ZERO), FROM, to)
    begun = ((FROM, start_of(text, layer)), (DRIVE, drive_of(text, layer)))
    return [
        Declare("real", begun, fixed=True),
        fixed(S, pick(FROM > ONE, ONE, pick(FROM < -ONE, -ONE, ZERO))),
        fixed(E, DRIVE + a * S),
        # d when it comes to its edge; 0 where it never does, or is within it
        fixed(EDGE, pick(S * E < S * S, (S - E) / (FROM - E), ZERO)),
        fixed(AWAY, pick(EDGE > d, ZERO, S * S)),
        fixed(NOW, clip(FROM)),
        fixed(G, slope * NOW + DRIVE),
        fixed(B, pick(G < ZERO, -ONE, ONE)),
        fixed(AT_B, slope * B + DRIVE),
        *_inside(own - 1.0, time),
        fixed(TO, to),
        Assign(X[text.at(layer)], TO),
        *_rounded(own, time),
    ]


def _inside(slope: float, time: float) -> list[Statement]:
    """Return where cells are at the end that are in the middle piece at first, or enter it."""
    if math.isinf(time):
        return _at_rest(Number(slope))
    return _weight_of_two(time) if slope == 1.0 else _on_time(slope, time)


def _at_rest(slope: Expression) -> list[Statement]:
    """Return where cells come to rest that are in the middle piece, or enter it."""
    crosses = pick(B * AT_B > ZERO, ONE, ZERO)
    return [
        Declare("real", ((CROSSES, crosses), (OVER, B + AT_B)), fixed=True),
        fixed(BETWEEN, pick(G.differs(ZERO), -DRIVE / slope, NOW)),
    ]


def _weight_of_two(time: float) -> list[Statement]:
    """Return where they are on time for m = 1, as most templates have it: e^t = 1/d is at hand."""
    d, grown = Number(math.exp(-time)), Number(growth(1.0, time))
    left = pick(EDGE > d, d / EDGE, d)
    return [
        Declare("real", ((LEFT, left), (ENDS, G / AT_B)), fixed=True),
        fixed(CROSSES, pick((B * AT_B > ZERO) & (LEFT < ENDS), ONE, ZERO)),
        fixed(OVER, B + AT_B * (ONE - LEFT / ENDS)),
        fixed(BETWEEN, NOW + G * (grown * pick(EDGE > d, EDGE, ONE) - ONE)),
    ]


def _on_time(slope: float, time: float) -> list[Statement]:
    """Return where they are on time for any m."""
    m, d = Number(slope), Number(math.exp(-time))
    ends: Expression = (B - NOW) / G
    entered: Expression = LEFT
    if slope != 0.0:
        ends = call("log1p", m * (B - NOW) / G) / m
        entered = call("expm1", call("fmin", m * LEFT, Number(math.log(STEEPEST)))) / m
    along = Number(moved(slope, time))
    return [
        # time that is left, from where it enters; a quotient of decays is exact near the end
        fixed(LEFT, pick(EDGE > d, call("log", EDGE / d), Number(time))),
        # and that it takes to leave the middle piece again
        fixed(ENDS, ends),
        fixed(CROSSES, pick((B * AT_B > ZERO) & (ENDS < LEFT), ONE, ZERO)),
        fixed(OVER, B + AT_B * (ONE - call("exp", ENDS - LEFT))),
        fixed(BETWEEN, NOW + G * pick(EDGE > d, entered, along)),
    ]


def _rounded(own: float, time: float) -> list[Statement]:
    """Return what rounding leaves, as `cnnum.integrators.separate` has it."""
    slope, left = own - 1.0, Number(math.exp(-time))
    at_rest = Number(growth(slope, time))
    sum = size(TO) + pick(AWAY.differs(ZERO), left, GROWN) * SIZES
    if not math.isinf(time):
        sum = sum + Number(time) * AFTER
    return [
        fixed(SEEN, clip(TO)),
        fixed(AFTER, size(Number(slope) * SEEN + DRIVE + (SEEN - TO))),
        fixed(GROWN, pick(G.differs(ZERO), AFTER / size(G), at_rest)),
        fixed(SIZES, size(DRIVE) + size(FROM) + size(Number(own) * NOW)),
        Accumulate(LARGEST, "greater", sum),
    ]
