"""The state equation: outputs y = f(x) and rates dx/dt."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import (
    CHANGE,
    NOW,
    PART,
    RATE,
    SUM,
    XP,
    YD,
    TransientBuilder,
    X,
    Y,
)
from cnnum.engines.opencl.transients.couplings import drive_of, gain_name, gains, nonlinear
from cnnum.graph.schedule import has_feedback
from cnnum.templating.network import delays_outputs, moving_inputs, reads_states, taps

RESTS = CHANGE <= ir.ONE
"""Whether nothing changes any more."""

Then = Callable[[ir.Expression, int], Sequence[ir.Statement]]
"""Statements on `rate`, given the cell's index in the stacked states and its layer."""


Past = Callable[[ir.Expression], ir.Expression]
"""The delayed output of the cell at an index in the stacked states."""


def into(array: ir.Name) -> Then:
    """Return the statements that store rates in a stacked array."""
    return lambda at, _: [ir.Assign(array[at], RATE)]


@dataclass(frozen=True, slots=True)
class Instant:
    """When rates are evaluated.

    Attributes
    ----------
    time : Expression
        Time since the start.
    middle : Expression
        Time of the middle of the step.
    past : Past or None
        None if the template has no delayed A.
    within : (Expression, Expression) or None
        Start and length of a step that may contain jumps of gains.
    """

    time: ir.Expression = ir.ZERO
    middle: ir.Expression = ir.ZERO
    past: Past | None = None
    within: tuple[ir.Expression, ir.Expression] | None = None


def declare_outputs(text: TransientBuilder) -> None:
    """Append the padded arrays of outputs (and states), and the fixed parts of their rims."""
    names = [Y, *([XP] if reads_states(text.template) else [])]
    names += [YD] if delays_outputs(text.template) else []
    boundary = text.template.boundary
    for name in names:
        text.array(name, text.layers * text.padded)
        if boundary.constant is not None:
            value = boundary.constant if name == XP else text.rim_output()
            text.fill_rims(name, text.layers, boundary, value)


def outputs(
    text: TransientBuilder, state: Sequence[ir.Expression], keep: ir.Name | None = None
) -> None:
    """Append y = f(state) and store it; the state is given by one expression per layer."""
    template, body = text.template, list[ir.Statement]()
    for layer, expression in enumerate(state):
        inner: list[ir.Statement] = [ir.declare(NOW, expression)]
        if template.output.limited:
            inner.append(ir.Assign(NOW, ir.clip(NOW)))
        if keep is not None:
            inner.append(ir.Assign(keep[text.at(layer)], NOW))
        if reads_states(template):
            inner.append(ir.Assign(XP[text.padded_at(layer)], NOW))
        inner.append(ir.Assign(Y[text.padded_at(layer)], text.output(NOW)))
        body.append(ir.block(*inner))
    text.over_grid(body)
    text.copy_rims(Y)
    if reads_states(template):
        text.copy_rims(XP)


def rates(
    text: TransientBuilder, state: ir.Name, then: Then, instant: Instant, *, outwards: bool = False
) -> None:
    """Append the evaluation of `rate` = dx/dt in every cell of every layer, followed by `then`.

    At a limit of the state, rates that lead outwards are 0 unless `outwards` is set.
    """
    if instant.past is not None and delays_outputs(text.template):
        past = enumerate(map(instant.past, text.places))
        text.over_grid([ir.Assign(YD[text.padded_at(m)], output) for m, output in past])
        text.copy_rims(YD)
    text.body += gains(text, instant.time, instant.middle, instant.within)
    text.over_grid(_rate_lines(text, state, then, outwards=outwards))


def rates_once(text: TransientBuilder, then: Then, instant: Instant) -> None:
    """Append the same for the states `x`, whose outputs have not been computed yet.

    The statements of `then` may not change values that other cells see.
    """
    # whether couplings read anything that changes, or any input
    if has_feedback(text.template) or moving_inputs(text.template):
        outputs(text, text.each(X))
        rates(text, X, then, instant)
    else:
        text.body += gains(text, instant.time, instant.middle, instant.within)
        text.over_cells(_rate_lines(text, X, then))


def _rate_lines(
    text: TransientBuilder, state: ir.Name, then: Then, *, outwards: bool = False
) -> list[ir.Statement]:
    """Return statements that compute the rates of a cell."""
    body: list[ir.Statement] = [ir.Declare("real", ((SUM, None), (RATE, None)))]
    for layer, now in enumerate(text.each(state)):
        body.append(ir.Assign(SUM, drive_of(text, layer) - now))
        body += _couplings(text, layer)
        body.append(ir.Assign(RATE, text.rate(layer) * SUM))
        if text.template.output.limited and not outwards:
            # at the rails, a rate that drives a state outwards is 0
            inwards = ir.pick(now * RATE > ir.ZERO, ir.ZERO, RATE)
            body.append(ir.Assign(RATE, ir.pick(ir.size(now) >= ir.ONE, inwards, RATE)))
        if text.operands.mask is not None:
            body.append(ir.Assign(RATE, text.unless_held(RATE, ir.ZERO)))
        body += then(text.at(layer), layer)
    return body


def _couplings(text: TransientBuilder, layer: int) -> list[ir.Statement]:
    template = text.template
    gained = {gain.source: k for k, gain in enumerate(template.gains) if gain.to == layer}
    weights = taps(template.A, layer)
    lines = text.weighted(Y, tuple(tap for tap in weights if tap.source not in gained))
    for source, k in gained.items():
        part = text.weighted(Y, tuple(tap for tap in weights if tap.source == source), PART)
        lines.append(ir.block(ir.declare(PART, ir.ZERO), *part, ir.add(SUM, gain_name(k) * PART)))
    lines += nonlinear(text, layer, static=False)
    if template.delayed is not None and delays_outputs(text.template):
        lines += text.weighted(YD, taps(template.delayed.A, layer))
    return lines


def watched(
    text: TransientBuilder, state: ir.Expression, rate: ir.Expression = RATE
) -> ir.Accumulate:
    """Return the statement that updates `change`, the largest rate in units of the tolerance.

    A state whose rate times its layer's τ is below the tolerance stays within about that of its
    equilibrium.
    """
    return ir.Accumulate(CHANGE, "greater", ir.size(text.slowest() * rate) / text.scale(state))
