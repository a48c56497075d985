"""Explicit Runge–Kutta methods as sweeps over all cells, fixed and adaptive."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.feedforward import arrive
from cnnum.engines.opencl.transients.fixed_steps import last_number, repeated
from cnnum.engines.opencl.transients.initial_state import X
from cnnum.engines.opencl.transients.state_equation import (
    PART,
    RATE,
    Instant,
    Y,
    outputs,
    rates,
    rates_once,
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
    controlled,
    judged,
)
from cnnum.integrators.choice import AdaptiveSteps, FixedSteps
from cnnum.integrators.tableau import Explicit, Pair, Row
from cnnum.templating.batch_parts import LADDER
from cnnum.templating.reads import delays_outputs, lag

RING, NOW_AT, THEN_AT, NEXT_AT = (
    ir.Name("ring"),
    ir.Name("now_at"),
    ir.Name("then_at"),
    ir.Name("next_at"),
)
"""Outputs of the last steps, and where this one's and those of a delay ago stand among them."""

SPAN = ir.Name("span")
"""A frame's own step, where frames have delays of their own."""

SLIVER = 0.01
"""Share of a step below which the last one is a rounding."""


def rates_of(stage: int) -> ir.Name:
    """Return the array of a stage's rates."""
    return ir.Name(f"k{stage}")


def _combination(weights: Row, at: ir.Expression) -> ir.Expression:
    return ir.total(
        [ir.Number(float(weight)) * rates_of(n)[at] for n, weight in enumerate(weights) if weight]
    )


def _stage(
    text: TransientBuilder,
    tableaux: Sequence[Explicit | Pair],
    stage: int,
    instant: Instant,
) -> None:
    """Append one stage of step `h`: outputs at its state, then its rates in k."""

    def keep(at: ir.Expression, _: int) -> list[ir.Statement]:
        return [ir.Assign(rates_of(stage)[at], RATE)]

    if stage == 0:
        outputs(text, text.each(X))
        _remember(text)
        rates(text, X, keep, instant)
        return
    places = [text.at(layer) for layer in range(text.layers)]
    states = [
        X[at] + H * _combination(one.a[stage], at) for at, one in zip(places, tableaux, strict=True)
    ]
    outputs(text, states, keep=XS)
    rates(text, XS, keep, instant)


# delays: a ring of the outputs of the last steps


def _remember(text: TransientBuilder) -> None:
    """Append statements that keep this step's outputs in the ring."""
    if delays_outputs(text.template):
        text.over_grid(
            [
                ir.Assign(
                    RING[ir.after(NOW_AT * text.states, text.at(layer))], Y[text.padded_at(layer)]
                )
                for layer in range(text.layers)
            ]
        )


def _past(text: TransientBuilder, c: float) -> Callable[[ir.Expression], ir.Expression] | None:
    """Return the outputs a delay ago, at the start or the end of a step."""
    if not delays_outputs(text.template):
        return None

    def past(at: ir.Expression) -> ir.Expression:
        first = RING[ir.after(THEN_AT * text.states, at)]
        return (
            first
            if c == 0.0
            else first + PART * (RING[ir.after(NEXT_AT * text.states, at)] - first)
        )

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
        with text.aside() as change:
            arrive(text)
        lines.append(ir.Branch(ir.ROUND.equals(late), tuple(change)))
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
    stages = scheme.stages
    if stages > 1:
        for name in (*(rates_of(stage) for stage in range(stages)), XS):
            text.array(name, text.states)
    if delays_outputs(text.template):
        text.array(RING, (lag(text.template, scheme.step) + 1) * text.states)
    if (delay := _own_delay(text)) is not None:
        scheme = _own_steps(text, scheme, delay)
    head = _ring(text, scheme)
    with text.aside() as body:
        if stages == 1:
            _euler_step(text, scheme)
        else:
            _several_stages(text, scheme)
    figures = repeated(text, scheme, _length(text, scheme), [*head, *body])
    if _own_delay(text) is not None and not scheme.settle:
        taken = ir.Number(text.solver.duration) / SPAN - ir.Number(SLIVER)
        figures["steps"] = ir.call("ceil", taken)
    return figures


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
        with text.aside() as lines:
            _stage(text, tableaux, stage, _instant(text, scheme, c))
        text.body.append(ir.Block(tuple(lines)))
    body: list[ir.Statement] = []
    for layer, tableau in enumerate(tableaux):
        at = text.at(layer)
        if scheme.settle:
            body.append(ir.block(ir.fixed(RATE, K0[at]), watch_change(text, X[at])))
        end: ir.Expression = X[at]
        if tableau.carried:
            end = end + ir.Number(tableau.carried) * (XS[at] - X[at])
        body.append(ir.Assign(X[at], _limited(text, end + H * _combination(tableau.b, at))))
    text.over_cells(body)


def sweeps(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return a step's statements as sweeps over all cells, a stage after the other."""
    tableau = scheme.tableau
    tableaux = tuple(scheme.of(layer) for layer in range(text.layers))
    for name in (*(rates_of(stage) for stage in range(1, tableau.stages)), XS):
        text.array(name, text.states)
    stages: list[ir.Statement] = []
    for stage in range(1, tableau.stages):
        c = ir.Number(float(sum(tableau.a[stage])))
        with text.aside() as lines:
            _stage(text, tableaux, stage, Instant(TIME + c * H))
        stages.append(ir.Block(tuple(lines)))
    taken = advance(text, rates_of(tableau.stages - 1))
    return Attempt(stages, judge(text, tableaux), taken)


def adaptive(
    text: TransientBuilder,
    scheme: AdaptiveSteps,
    attempts: Callable[[TransientBuilder, AdaptiveSteps], Attempt] = sweeps,
) -> Figures:
    """Append steps that follow the error estimate and return the figures of the run."""
    text.array(K0, text.states)
    attempt = attempts(text, scheme)
    with text.aside() as first_rates:
        rates_once(text, X, lambda at, _: [ir.Assign(K0[at], RATE)], Instant(TIME))
    return controlled(text, scheme, attempt, first_rates)


def judge(text: TransientBuilder, tableaux: tuple[Pair, ...]) -> list[ir.Statement]:
    """Return statements that find the worst error of a step, and the change at its end."""
    last, body = rates_of(tableaux[0].stages - 1), list[ir.Statement]()
    for layer, tableau in enumerate(tableaux):
        at = text.at(layer)
        left_out = ir.total([ir.size(H * _combination(d, at)) for d in tableau.truncation])
        error = H * _combination(tableau.error, at)
        body.append(ir.block(*judged(text, at, error, left_out, last)))
    return [ir.sweep(ir.CELL, text.cells, body)]
