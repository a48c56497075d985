"""Explicit Runge–Kutta methods as sweeps over all cells, fixed and adaptive."""

import math
from collections.abc import Sequence
from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import TransientBuilder, X
from cnnum.engines.opencl.transients.feedforward import arrive
from cnnum.engines.opencl.transients.fixed_steps import last_number, repeated
from cnnum.engines.opencl.transients.state_equation import (
    PART,
    RATE,
    Instant,
    Past,
    Y,
    into,
    outputs,
    rates,
    watch_change,
)
from cnnum.engines.opencl.transients.step_control import (
    K0,
    TIME,
    XS,
    Attempt,
    Figures,
    H,
    advance,
    judged,
    rates_of,
)
from cnnum.integrators.choice import AdaptiveSteps, FixedSteps
from cnnum.integrators.tableau import Explicit, Pair, Row
from cnnum.templating.batch_parts import LADDER
from cnnum.templating.reads import delays_outputs, lag

RING, NOW_AT, THEN_AT, NEXT_AT = ir.names("ring now_at then_at next_at")
"""Outputs of the last steps, and where this one's and those of a delay ago stand among them."""

SPAN = ir.Name("span")
"""A frame's own step, where frames have delays of their own."""

LEFT_OUT = ir.Name("left_out")
"""The truncation error of a step in a cell."""

SLIVER = 0.01
"""Share of a step below which the last one is a rounding."""


def combination(weights: Row, at: ir.Expression) -> ir.Expression:
    """Return the weighted sum of the stages' rates at a place."""
    return ir.total(
        [ir.Number(float(weight)) * rates_of(n)[at] for n, weight in enumerate(weights) if weight]
    )


def _stage(
    text: TransientBuilder, tableaux: Sequence[Explicit | Pair], stage: int, instant: Instant
) -> None:
    """Append one stage of step `h`: outputs at its state, then its rates in k."""
    keep = into(rates_of(stage))
    if stage == 0:
        outputs(text, text.each(X))
        _remember(text)
        rates(text, X, keep, instant)
        return
    places = [text.at(layer) for layer in range(text.layers)]
    states = [
        X[at] + H * combination(one.a[stage], at) for at, one in zip(places, tableaux, strict=True)
    ]
    outputs(text, states, keep=XS)
    rates(text, XS, keep, instant)


# delays: a ring of the outputs of the last steps


def _ring_at(text: TransientBuilder, slot: ir.Name, at: ir.Expression) -> ir.Element:
    return RING[ir.after(slot * text.states, at)]


def _remember(text: TransientBuilder) -> None:
    """Append statements that keep this step's outputs in the ring."""
    if delays_outputs(text.template):
        pairs = [(text.at(layer), text.padded_at(layer)) for layer in range(text.layers)]
        text.over_grid([ir.Assign(_ring_at(text, NOW_AT, at), Y[place]) for at, place in pairs])


def _past(text: TransientBuilder, c: float) -> Past | None:
    """Return the outputs a delay ago, at the start or the end of a step."""
    if not delays_outputs(text.template):
        return None

    def past(at: ir.Expression) -> ir.Expression:
        first = _ring_at(text, THEN_AT, at)
        return first if c == 0.0 else first + PART * (_ring_at(text, NEXT_AT, at) - first)

    return past


def _ring(text: TransientBuilder, scheme: FixedSteps) -> list[ir.Statement]:
    """Return the head of a step, which finds the ring's places."""
    late = lag(text.template, scheme.step)
    lines: list[ir.Statement] = []
    if delays_outputs(text.template):
        slots = late + 1
        lines = [
            ir.fixed(NOW_AT, ir.ROUND % slots, of="int"),
            ir.fixed(THEN_AT, ir.call("max", ir.ROUND - late, 0) % slots, of="int"),
            ir.fixed(NEXT_AT, ir.call("max", ir.ROUND + 1 - late, 0) % slots, of="int"),
            ir.fixed(PART, _share(text, scheme)),
        ]
    if text.has_history:
        lines.append(ir.Branch(ir.ROUND.equals(late), tuple(text.aside(arrive))))
    return lines


def _own_delay(text: TransientBuilder) -> ir.Name | None:
    """Return the variable of frames' own delays, None where all have the same or none."""
    own = text.operands.own
    return None if own is None else own.delay


def _share(text: TransientBuilder, scheme: FixedSteps) -> ir.Expression:
    """Return the length of a step over that of all but the last."""
    if _own_delay(text) is not None:
        return H / SPAN
    return last_number(scheme.count, 1.0, scheme.last / scheme.step)


def _instant(text: TransientBuilder, scheme: FixedSteps, c: float) -> Instant:
    step = ir.Number(scheme.step) if _own_delay(text) is None else SPAN
    time = step * ir.real(ir.ROUND) + ir.Number(c) * H if text.template.gains else ir.ZERO
    return Instant(time, _past(text, c))


def _own_steps(text: TransientBuilder, scheme: FixedSteps, delay: ir.Name) -> FixedSteps:
    """Append the step of each frame, the same part of its delay in all; return more steps.

    A delay is within a ladder's rung, so that no frame takes more steps than that times the usual.
    """
    late = ir.Number(1.0 / lag(text.template, scheme.step))
    text.body.append(ir.fixed(SPAN, delay * late))
    return replace(scheme, count=math.ceil(LADDER * scheme.count) + 1)


def _length(text: TransientBuilder, scheme: FixedSteps) -> ir.Expression:
    """Return the length of step `n`: 0 where a frame is at its end."""
    if _own_delay(text) is None:
        return last_number(scheme.count, scheme.step, scheme.last)
    left = ir.Number(text.solver.duration) - SPAN * ir.real(ir.ROUND)
    return ir.call("clamp", left, ir.ZERO, SPAN)


def fixed_steps(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append steps of a fixed length and return the figures of the run."""
    if scheme.stages > 1:
        _declare_stages(text, scheme.stages, 0)
    if delays_outputs(text.template):
        text.array(RING, (lag(text.template, scheme.step) + 1) * text.states)
    if (delay := _own_delay(text)) is not None:
        scheme = _own_steps(text, scheme, delay)
    head = _ring(text, scheme)
    body = text.aside(_euler_step if scheme.stages == 1 else _several_stages, scheme)
    figures = repeated(text, scheme, _length(text, scheme), [*head, *body])
    if _own_delay(text) is not None and not scheme.settle:
        taken = ir.Number(text.solver.duration) / SPAN - ir.Number(SLIVER)
        figures["steps"] = ir.call("ceil", taken)
    return figures


def _declare_stages(text: TransientBuilder, stages: int, first: int) -> None:
    """Append the arrays of the rates from one stage on, and of the states at stages."""
    for name in (*(rates_of(stage) for stage in range(first, stages)), XS):
        text.array(name, text.states)


def _limited(text: TransientBuilder, state: ir.Expression) -> ir.Expression:
    return ir.clip(state) if text.template.output.limited else state


def _euler_step(text: TransientBuilder, scheme: FixedSteps) -> None:
    outputs(text, text.each(X))
    _remember(text)

    def then(at: ir.Expression, layer: int) -> list[ir.Statement]:
        change = [watch_change(text, X[at])] if scheme.settle else []
        (weight,) = scheme.of(layer).b
        move = RATE if weight == 1 else ir.Number(float(weight)) * RATE
        return [*change, ir.Assign(X[at], _limited(text, X[at] + H * move))]

    rates(text, X, then, _instant(text, scheme, 0.0))


def _several_stages(text: TransientBuilder, scheme: FixedSteps) -> None:
    tableaux = [scheme.of(layer) for layer in range(text.layers)]
    for stage in range(scheme.stages):
        c = float(sum(tableaux[0].a[stage]))
        lines = text.aside(_stage, tableaux, stage, _instant(text, scheme, c))
        text.body.append(ir.Block(tuple(lines)))
    body: list[ir.Statement] = []
    for layer, tableau in enumerate(tableaux):
        at = text.at(layer)
        if scheme.settle:
            body.append(ir.block(ir.fixed(RATE, K0[at]), watch_change(text, X[at])))
        end: ir.Expression = X[at]
        if tableau.carried:
            end = end + ir.Number(tableau.carried) * (XS[at] - X[at])
        body.append(ir.Assign(X[at], _limited(text, end + H * combination(tableau.b, at))))
    text.over_cells(body)


def sweeps(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return a step's statements as sweeps over all cells, a stage after the other."""
    tableaux = tuple(scheme.of(layer) for layer in range(text.layers))
    _declare_stages(text, scheme.tableau.stages, 1)
    stages: list[ir.Statement] = []
    for stage in range(1, scheme.tableau.stages):
        c = ir.Number(float(sum(scheme.tableau.a[stage])))
        lines = text.aside(_stage, tableaux, stage, Instant(TIME + c * H))
        stages.append(ir.Block(tuple(lines)))
    return taken_over(text, scheme, stages)


def taken_over(
    text: TransientBuilder, scheme: AdaptiveSteps, stages: Sequence[ir.Statement]
) -> Attempt:
    """Return a step of these stages, with its judgement: the worst error, the change at its end."""
    last, body = rates_of(scheme.tableau.stages - 1), list[ir.Statement]()
    for layer in range(text.layers):
        at, tableau = text.at(layer), scheme.of(layer)
        left_out = ir.total([ir.size(H * combination(d, at)) for d in tableau.truncation])
        error: ir.Expression = H * combination(tableau.error, at)
        lines = list[ir.Statement]()
        if scheme.bends:
            lines.append(ir.fixed(LEFT_OUT, left_out))
            error, left_out = ir.call("fmax", ir.size(error), LEFT_OUT), LEFT_OUT
        body.append(ir.block(*lines, *judged(text, at, error, left_out, last)))
    return Attempt(stages, [ir.sweep(ir.CELL, text.cells, body)], advance(text, last))
